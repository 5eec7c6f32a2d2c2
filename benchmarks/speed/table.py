"""What a row of the table says, how two programs are timed side by side, and on what machine."""

from __future__ import annotations

import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Row:
    """One measurement: how long (`seconds`) or how much (`unit` says of what) ours takes and the baseline takes, the
    target, and whether it is reached; None where nothing was promised."""

    stage: str
    ours: float
    baseline: float | None
    unit: str
    target: str
    reached: bool | None
    beside: str
    """What it is held against."""
    note: str = ""
    series: tuple[tuple[float, float], ...] = ()
    """What is plotted of it: size and seconds."""

    @property
    def ratio(self) -> float | None:
        """How many times the baseline is ours."""
        return None if self.baseline is None or self.ours == 0 else self.baseline / self.ours


def side_by_side(
    ours: Callable[[], object], baseline: Callable[[], object], rounds: int, *, times: int = 1
) -> tuple[float, float, float]:
    """Medians of the seconds of processor time that one call of each takes, taken by turns so that both meet the same
    load, and the median of the ratios of neighbours. Ours is called `times` times in a row, so that its time can be
    told. Processor time, as others may be at work on the machine: of what computes in one process, it is what
    the wall's clock would show on an idle one."""
    mine, other = [], []
    for _ in range(rounds):
        began = time.process_time()
        for _ in range(times):
            ours()
        mine.append((time.process_time() - began) / times)
        began = time.process_time()
        baseline()
        other.append(time.process_time() - began)
    ratio = statistics.median(theirs / own for own, theirs in zip(mine, other, strict=True))
    return statistics.median(mine), statistics.median(other), ratio


def machine() -> dict[str, str]:
    """Where, when and with what it was measured."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return {
        "date": time.strftime("%Y-%m-%d"),
        "processor": f"{model or platform.processor()} ({platform.machine()})",
        "cores": str(os.cpu_count()),
        "load": " ".join(f"{load:.1f}" for load in os.getloadavg()),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "mujoco", "numba", "ompl", "toppra", "robosuite")},
    }


def plot(rows: list[Row], file: Path) -> None:
    """Draw how the rows that have a series grow, on logarithmic axes."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 3.5), layout="constrained")
    for row in (row for row in rows if row.series):
        sizes, seconds = zip(*row.series, strict=True)
        axes.loglog(sizes, seconds, "o-", label=row.stage.split(",")[0])
        axes.loglog(sizes, [seconds[0] * size / sizes[0] for size in sizes], ":", color="grey")
    axes.set(xlabel="atoms asked about", ylabel="s", title="dotted: linear")
    axes.legend()
    figure.savefig(file, dpi=120)
    pyplot.close(figure)


class Former(NamedTuple):
    """What a row said when it was measured before, on whatever machine."""

    ours: float
    ratio: float | None


def read_former(file: Path) -> dict[str, Former]:
    """The rows of a table that was kept with `--out`, by their stage."""
    rows = json.loads(file.read_text())["rows"]
    return {row["stage"]: Former(row["ours"], row["ratio"]) for row in rows}


def printed(rows: list[Row], where: dict[str, str], former: Mapping[str, Former] | None = None) -> str:
    """The table, for people; with `former`, what each row said before stands beside it."""
    head = ("stage", "ours", *_BEFORE[former is not None], "baseline", "ratio", "target", "reached", "against")
    body = [
        (
            row.stage,
            f"{row.ours:.4g} {row.unit}",
            *(() if former is None else _beside(row, former.get(row.stage))),
            "" if row.baseline is None else f"{row.baseline:.4g} {row.unit}",
            "" if row.ratio is None else f"{row.ratio:.3g}",
            row.target,
            {True: "yes", False: "no", None: ""}[row.reached],
            row.beside,
        )
        for row in rows
    ]
    widths = [max(len(line[column]) for line in (head, *body)) for column in range(len(head))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
             for line in (head, *body)]  # fmt: skip
    notes = [f"{row.stage}: {row.note}" for row in rows if row.note]
    return "\n".join([*lines, "", *notes, "", ", ".join(f"{key} {value}" for key, value in where.items())])


_BEFORE = ((), ("former", "times", "former ratio"))
"""The columns that a former table adds: what ours was, how many times that it is now, and its ratio to the baseline,
which tells a slower machine from a slower program."""


def _beside(row: Row, before: Former | None) -> tuple[str, str, str]:
    if before is None:
        return ("", "", "")
    times = "" if before.ours == 0 else f"{row.ours / before.ours:.2f}"
    return (f"{before.ours:.4g} {row.unit}", times, "" if before.ratio is None else f"{before.ratio:.3g}")
