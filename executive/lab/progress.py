"""How far long work is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

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
    """How far a stage of a training is: `done` of `wanted` steps, of which `new` took `seconds`; `told` says how good
    it is by now."""

    stage: str
    done: int
    wanted: int
    new: int
    seconds: float
    told: str = ""


@contextmanager
def told(stream: TextIO, unit: str = "points") -> Iterator[Callable[[Progress], None]]:
    """What long work is to be watched with; `unit` is what its points are called."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    from executive.trace.console import console_for, is_live

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
    """What work in several stages is to be watched with: a bar or a line for the stage that is under way."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    from executive.trace.console import console_for, is_live

    console = console_for(stream)
    if not is_live(console):
        yield lambda now: print(f"{now.stage} {now.done} of {now.wanted}  {_left(now)}  {now.told}".rstrip(),
                                file=stream, flush=True)  # fmt: skip
        return
    columns = (TextColumn("{task.description:9}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[told]}"))
    with Bar(*columns, console=console) as bar:
        rows: dict[str, TaskID] = {}

        def tell(now: Stage) -> None:
            if now.stage not in rows:
                rows[now.stage] = bar.add_task(now.stage, total=now.wanted, told="")
            bar.update(rows[now.stage], completed=now.done, told=f"{_left(now)}  {now.told}".strip())

        yield tell


def _left(now: Stage) -> str:
    return estimate(Progress(now.done, now.wanted, now.new, now.seconds))


def estimate(progress: Progress) -> str:
    """The pace so far, and how long the rest takes at it."""
    if not progress.new or progress.seconds <= 0.0:
        return ""
    pace = progress.new / progress.seconds
    left = round((progress.wanted - progress.points) / pace)
    clock = f"{left // 3600}:{left // 60 % 60:02d}:{left % 60:02d}"
    said = f"{60 * pace:.0f} a minute" if 60 * pace >= 3 else f"{3600 * pace:.0f} an hour"
    return f"{said}, {clock} left"


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
