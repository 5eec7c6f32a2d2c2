"""Progress of long work: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

if TYPE_CHECKING:
    from rich.progress import TaskID

_REPORT_EVERY = 30.0
"""Seconds between two lines without a terminal."""


class Progress(NamedTuple):
    """The progress of a collection, evaluation or campaign: `points` of `wanted`, of which `new` were made in
    `seconds` by this process."""

    points: int
    wanted: int
    new: int
    seconds: float


class Stage(NamedTuple):
    """The progress of a training: the `number` of the stage from 1 of `stages`, `done` of `wanted` steps; `left` is the
    estimate of the seconds until the end of all stages, if there is one, and `metrics` the current metrics as text."""

    stage: str
    number: int
    stages: int
    done: float
    wanted: int
    left: float | None
    metrics: str = ""


class RemainingTime:
    """Estimates the remaining time of work in several stages from the pace of the current stage and the expected
    ratios.

    Args:
        efforts: stage -> its expected seconds, in order.
    """

    def __init__(self, efforts: Mapping[str, float]) -> None:
        self._efforts = dict(efforts)

    def place(self, stage: str) -> tuple[int, int]:
        """The number of a stage, from 1, and the number of stages."""
        return list(self._efforts).index(stage) + 1, len(self._efforts)

    def left(self, stage: str, done: float, wanted: float, new: float, seconds: float) -> float | None:
        """The remaining seconds of this stage and all later ones, if `new` of its `wanted` steps took `seconds`."""
        if new <= 0.0 or seconds <= 0.0:
            return None
        expected, later = self._efforts[stage], list(self._efforts.values())[self.place(stage)[0] :]
        slower = seconds / (expected * new / wanted)
        return slower * (expected * (wanted - done) / wanted + sum(later))


@contextmanager
def show_progress(stream: TextIO, unit: str = "points") -> Iterator[Callable[[Progress], None]]:
    """Shows progress; yields the callback that receives it. `unit` is the name of the points."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    from executive.trace.terminal.console import console_for, is_live

    console = console_for(stream)
    if not is_live(console):
        yield _lines(stream, unit)
        return
    columns = (TextColumn(unit), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[estimate]}"))
    with Bar(*columns, console=console) as bar:
        task = bar.add_task(unit, total=None, estimate="")
        yield lambda now: bar.update(task, completed=now.points, total=now.wanted, estimate=estimate(now))


@contextmanager
def show_stages(stream: TextIO) -> Iterator[Callable[[Stage], None]]:
    """Shows the progress of work in stages, with the remaining time; yields the callback that receives it. There is a
    bar for each stage that was begun, or a line now and then."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    from executive.trace.terminal.console import console_for, is_live

    console = console_for(stream)
    if not is_live(console):
        yield _stage_lines(stream)
        return
    columns = (
        TextColumn("{task.description:14}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[metrics]}"),
    )
    with Bar(*columns, console=console) as bar:
        rows: dict[str, TaskID] = {}

        def tell(now: Stage) -> None:
            if now.stage not in rows:
                for row in rows.values():
                    bar.update(row, metrics="")
                name = f"{now.number} of {now.stages} {now.stage}"
                rows[now.stage] = bar.add_task(name, total=now.wanted, metrics="")
            bar.update(rows[now.stage], completed=now.done, metrics=_left(now))

        yield tell


def expected(seconds: Mapping[str, float]) -> str:
    """A line with the expected time of all stages, and of each."""
    each = ", ".join(f"{stage} {_clock(value)}" for stage, value in seconds.items())
    return f"all of it takes about {_clock(sum(seconds.values()))} here ({each})"


def _left(now: Stage) -> str:
    left = "" if now.left is None else f"about {_clock(now.left)} left in all"
    return f"{left}  {now.metrics}".strip()


def _stage_lines(stream: TextIO) -> Callable[[Stage], None]:
    last_report, last = -_REPORT_EVERY, None

    def tell(now: Stage) -> None:
        nonlocal last_report, last
        moment, turn = time.monotonic(), (now.stage, now.done >= now.wanted)
        if moment - last_report >= _REPORT_EVERY or turn != last:
            last_report, last = moment, turn
            where = f"stage {now.number} of {now.stages}, {now.stage}: {int(now.done)} of {now.wanted}"
            print(f"{where}  {_left(now)}".rstrip(), file=stream, flush=True)

    return tell


def estimate(progress: Progress) -> str:
    """A text with the pace so far and the remaining time at that pace."""
    if not progress.new or progress.seconds <= 0.0:
        return ""
    pace = progress.new / progress.seconds
    said = f"{60 * pace:.0f} a minute" if 60 * pace >= 3 else f"{3600 * pace:.0f} an hour"
    return f"{said}, {_clock((progress.wanted - progress.points) / pace)} left"


def _clock(seconds: float) -> str:
    left = round(seconds)
    return f"{left // 3600}:{left // 60 % 60:02d}:{left % 60:02d}"


def summary(manifest: Mapping[str, Any], folder: object) -> str:
    """A summary of a collection in a few lines."""
    counted = manifest["statistics"]
    amount = f"{counted['points']} points ({counted['episodes']} episode{'s' * (counted['episodes'] != 1)})"
    lines = [f"{amount} in {folder}; its README.md tells of them"]
    for action, statuses in counted["attempts"].items():
        each = ", ".join(f"{status} {count}" for status, count in statuses.items())
        lines.append(f"  {action}: {each}")
    return "\n".join(lines)


def _lines(stream: TextIO, unit: str) -> Callable[[Progress], None]:
    last_report, full = -_REPORT_EVERY, False

    def tell(now: Progress) -> None:
        nonlocal last_report, full
        if now.seconds - last_report >= _REPORT_EVERY or (now.points == now.wanted and not full):
            last_report, full = now.seconds, now.points == now.wanted
            print(f"{now.points} of {now.wanted} {unit}  {estimate(now)}".rstrip(), file=stream, flush=True)

    return tell
