"""How each part of a turn grows with the number of objects: `python -m benchmarks.budget.growth`.

    python -m benchmarks.budget.growth                     # 10, 30, 100, 300 and 1,000 parcels, a minute
    python -m benchmarks.budget.growth --out docs/images   # growth.png there

Runs of the whole loop in the symbolic world, with wrong answers and actions that fail. All seconds are of processor
time. The exponent is that of the last step, from the last size but one to the last: at small sizes what costs the same
at every size hides how the rest grows. The search is Fast Downward's, and told apart from what is ours of a plan.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.budget.cycles import measured

PARCELS = (10, 30, 100, 300, 1_000)

SLACK = 1.1
"""An exponent that still passes for linear: times are measured."""

STAGES = {
    "first look": "look at all atoms",
    "look": "look in a cycle",
    "belief": "belief, a cycle",
    "decision": "decisions, a cycle",
    "event": "events, a cycle",
    "grounding": "grounding, once",
    "replan": "plan anew, ours",
    "search": "plan anew, the search",
    "bytes": "record, bytes a cycle",
}
"""What is told of a row, in words."""

NOT_OURS = ("search",)


class Growth(NamedTuple):
    """How a stage grows: its values in the order of the sizes, and the exponents over all of them and of the last
    step."""

    stage: str
    values: tuple[float, ...]
    exponent: float
    last: float

    @property
    def kept(self) -> bool | None:
        """Whether it grows no faster than the atoms; None where it is not ours."""
        return None if self.stage in NOT_OURS else self.last <= SLACK


def growths(rows: Sequence[Mapping[str, Any]]) -> list[Growth]:
    """Return how each stage grows with the atoms; those that take no time that could be measured are left out."""
    sizes = [math.log(row["atoms"]) for row in rows]
    found = []
    for stage in STAGES:
        values = tuple(float(row[stage]) for row in rows)
        if min(values) <= 0.0:
            continue
        logs = [math.log(value) for value in values]
        mean, middle = sum(sizes) / len(sizes), sum(logs) / len(logs)
        moment = sum((size - mean) * (log - middle) for size, log in zip(sizes, logs, strict=True))
        exponent = moment / sum((size - mean) ** 2 for size in sizes)
        found.append(Growth(stage, values, exponent, (logs[-1] - logs[-2]) / (sizes[-1] - sizes[-2])))
    return found


def printed(rows: Sequence[Mapping[str, Any]], found: Sequence[Growth]) -> str:
    """Return the table in Markdown."""
    atoms = [f"{row['atoms']:,}" for row in rows]
    lines = [f"| CPU s at so many fluent atoms | {' | '.join(atoms)} | exponent | of the last step | at most {SLACK} |"]
    lines.append("|---" * (len(rows) + 4) + "|")
    for each in found:
        shown = [f"{value:,.0f}" if each.stage == "bytes" else f"{value:.2g}" for value in each.values]
        kept = {True: "yes", False: "no", None: ""}[each.kept]
        lines.append(f"| {STAGES[each.stage]} | {' | '.join(shown)} | {each.exponent:.2f} | {each.last:.2f} | {kept} |")
    return "\n".join(lines)


def plot(rows: Sequence[Mapping[str, Any]], found: Sequence[Growth], file: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    atoms = [row["atoms"] for row in rows]
    figure, (times, sizes) = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", width_ratios=(2, 1))
    for each in found:
        axes = sizes if each.stage == "bytes" else times
        axes.loglog(atoms, each.values, "o--" if each.stage in NOT_OURS else "o-", label=STAGES[each.stage])
    for axes, least in ((times, 1e-4), (sizes, 1e3)):
        axes.loglog(atoms, [least * size / atoms[0] for size in atoms], ":", color="grey", label="linear")
        axes.set(xlabel="fluent atoms")
        axes.grid(alpha=0.3)
    times.set(ylabel="CPU s")
    sizes.set(ylabel="bytes a cycle on disk")
    times.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure.savefig(file, dpi=120)
    pyplot.close(figure)


def main() -> None:
    from benchmarks.speed.table import machine

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--parcels", type=int, nargs="+", default=PARCELS, help="numbers of objects, ascending")
    parser.add_argument("--json", action="store_true", help="print the rows for programs")
    parser.add_argument("--out", type=Path, help="a folder for the plot, growth.png")
    arguments = parser.parse_args()
    if len(arguments.parcels) < 2 or sorted(set(arguments.parcels)) != list(arguments.parcels):
        parser.error("--parcels: two numbers or more, ascending")
    rows = []
    for parcels in arguments.parcels:
        print(f"{parcels} parcels ...", file=sys.stderr, flush=True)
        rows.append(measured(parcels))
    found, where = growths(rows), machine()
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        plot(rows, found, arguments.out / "growth.png")
    if arguments.json:
        stages = [{**each._asdict(), "kept": each.kept} for each in found]
        print(json.dumps({"machine": where, "rows": rows, "stages": stages}, indent=2))
    else:
        print(printed(rows, found), ", ".join(f"{key} {value}" for key, value in where.items()), sep="\n\n")


if __name__ == "__main__":
    main()
