"""How far long work is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

if TYPE_CHECKING:
    from rich.progress import TaskID

_EVERY = 30.0
"""Seconds between two lines where there is no terminal."""


class Progress(NamedTuple):
    """How far a collection or an evaluation is: points of all that were asked for, of which `new` were made in
    `seconds`."""

    points: int
    wanted: int
    new: int
    seconds: float


class Stage(NamedTuple):
    """How far a training is: in which of its `stages`, counted from 1, with `done` of `wanted` steps; `left` are the
    seconds that all of it still takes, as far as that can be told, and `told` says how good it is by now."""

    stage: str
    number: int
    stages: int
    done: float
    wanted: int
    left: float | None
    told: str = ""


class Outlook:
    """How long work in several stages still takes: by how long the stage at hand takes, and by how the stages compare.

    Args:
        efforts: about how many seconds each stage takes, in order.
    """

    def __init__(self, efforts: Mapping[str, float]) -> None:
        self._efforts = dict(efforts)

    def place(self, stage: str) -> tuple[int, int]:
        """Which stage it is, counted from 1, and of how many."""
        return list(self._efforts).index(stage) + 1, len(self._efforts)

    def left(self, stage: str, done: float, wanted: float, new: float, seconds: float) -> float | None:
        """Seconds that this stage and all later ones still take, if `new` of its `wanted` steps took `seconds`."""
        if new <= 0.0 or seconds <= 0.0:
            return None
        expected, later = self._efforts[stage], list(self._efforts.values())[self.place(stage)[0] :]
        slower = seconds / (expected * new / wanted)
        return slower * (expected * (wanted - done) / wanted + sum(later))


@contextmanager
def told(stream: TextIO, unit: str = "points") -> Iterator[Callable[[Progress], None]]:
    """What long work is to be watched with; `unit` is what its points are called."""
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
def stages(stream: TextIO) -> Iterator[Callable[[Stage], None]]:
    """What work in several stages is to be watched with: a bar for each stage that was begun, or a line now and then;
    either says how long all of it still takes."""
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
        TextColumn("{task.fields[told]}"),
    )
    with Bar(*columns, console=console) as bar:
        rows: dict[str, TaskID] = {}

        def tell(now: Stage) -> None:
            if now.stage not in rows:
                for row in rows.values():
                    bar.update(row, told="")
                name = f"{now.number} of {now.stages} {now.stage}"
                rows[now.stage] = bar.add_task(name, total=now.wanted, told="")
            bar.update(rows[now.stage], completed=now.done, told=_left(now))

        yield tell


def _left(now: Stage) -> str:
    left = "" if now.left is None else f"about {_clock(now.left)} left in all"
    return f"{left}  {now.told}".strip()


def _stage_lines(stream: TextIO) -> Callable[[Stage], None]:
    spoken, last = -_EVERY, None

    def tell(now: Stage) -> None:
        nonlocal spoken, last
        moment, turn = time.monotonic(), (now.stage, now.done >= now.wanted)
        if moment - spoken >= _EVERY or turn != last:
            spoken, last = moment, turn
            where = f"stage {now.number} of {now.stages}, {now.stage}: {int(now.done)} of {now.wanted}"
            print(f"{where}  {_left(now)}".rstrip(), file=stream, flush=True)

    return tell


def estimate(progress: Progress) -> str:
    """The pace so far, and how long the rest takes at it."""
    if not progress.new or progress.seconds <= 0.0:
        return ""
    pace = progress.new / progress.seconds
    said = f"{60 * pace:.0f} a minute" if 60 * pace >= 3 else f"{3600 * pace:.0f} an hour"
    return f"{said}, {_clock((progress.wanted - progress.points) / pace)} left"


def _clock(seconds: float) -> str:
    left = round(seconds)
    return f"{left // 3600}:{left // 60 % 60:02d}:{left % 60:02d}"


def summary(manifest: Mapping[str, Any], folder: object) -> str:
    """What was collected, in a few lines."""
    counted = manifest["statistics"]
    amount = f"{counted['points']} points ({counted['episodes']} episode{'s' * (counted['episodes'] != 1)})"
    lines = [f"{amount} in {folder}; its README.md tells of them"]
    for action, statuses in counted["attempts"].items():
        each = ", ".join(f"{status} {count}" for status, count in statuses.items())
        lines.append(f"  {action}: {each}")
    return "\n".join(lines)


def _lines(stream: TextIO, unit: str) -> Callable[[Progress], None]:
    spoken, full = -_EVERY, False

    def tell(now: Progress) -> None:
        nonlocal spoken, full
        if now.seconds - spoken >= _EVERY or (now.points == now.wanted and not full):
            spoken, full = now.seconds, now.points == now.wanted
            print(f"{now.points} of {now.wanted} {unit}  {estimate(now)}".rstrip(), file=stream, flush=True)

    return tell
