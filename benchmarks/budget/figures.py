"""A line of the table: what was measured, what it was before, what it is to be; and whether others were computing."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

QUIET = 0.1
"""Others may take so much of the machine's time in a measurement that still counts as quiet."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A measurement against its budget.

    Attributes:
        former: what it was when the budget was set, in words.
        target: the budget: at most so much, or at least where `more` is better; None for a row that failed.
        value: what was measured, in `unit`; None where it was not, and `note` says why.
        cpu: seconds of processor time of all processes that took part, where `value` is a wall time.
    """

    stage: str
    former: str
    target: float | None
    value: float | None
    unit: str = "s"
    more: bool = False
    cpu: float | None = None
    note: str = ""

    @property
    def reached(self) -> bool | None:
        """Whether the budget is kept; None where nothing was measured."""
        if self.value is None or self.target is None:
            return None
        return self.value >= self.target if self.more else self.value <= self.target


@dataclass(frozen=True, slots=True)
class Measured:
    """A figure, and the share of the machine's processor time that others took meanwhile."""

    figure: Figure
    others: float

    @property
    def quiet(self) -> bool:
        return self.others <= QUIET

    def to_dict(self) -> dict[str, Any]:
        figure = self.figure
        names = ("stage", "former", "target", "value", "unit", "more", "cpu", "note", "reached")
        return {**{name: getattr(figure, name) for name in names}, "others": round(self.others, 3)}


def watched(measure: Callable[[], Iterable[Figure]]) -> Iterator[Measured]:
    """Yield the figures that `measure` takes, one after the other, each with what others took of the machine (Linux;
    elsewhere nobody counts as quiet)."""
    rows = iter(measure())
    while True:
        before, own, began = _busy(), _own(), time.perf_counter()
        figure = next(rows, None)
        if figure is None:
            return
        wall, spent = time.perf_counter() - began, _own() - own
        whole = max(1e-9, wall * (os.cpu_count() or 1))
        yield Measured(figure, max(0.0, _busy() - before - spent) / whole)


def _busy() -> float:
    """Seconds of processor time that all processes of the machine have taken since it started."""
    if not Path("/proc/stat").exists():
        return float("inf")
    user, nice, system, _idle, _wait, irq, soft, *_ = map(
        int, Path("/proc/stat").read_text().split("\n")[0].split()[1:]
    )
    return (user + nice + system + irq + soft) / os.sysconf("SC_CLK_TCK")


def _own() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def printed(rows: Iterable[Measured], where: dict[str, str]) -> str:
    """Return the table in Markdown, for people."""
    lines = [
        "| stage | before | to reach | measured | CPU s | reached | machine |",
        "|---|---|---|---|---|---|---|",
    ]
    notes = []
    for row in rows:
        figure = row.figure
        value = "not measured" if figure.value is None else f"{figure.value:.3g} {figure.unit}".strip()
        bound = (
            ""
            if figure.target is None
            else f"at {'least' if figure.more else 'most'} {figure.target:g} {figure.unit}".strip()
        )
        cpu = "" if figure.cpu is None else f"{figure.cpu:.2f}"
        reached = {True: "yes", False: "no", None: ""}[figure.reached]
        state = "quiet" if row.quiet else f"busy, others took {row.others:.0%}"
        lines.append(f"| {figure.stage} | {figure.former} | {bound} | {value} | {cpu} | {reached} | {state} |")
        if figure.note:
            notes.append(f"- {figure.stage}: {figure.note}")
    return "\n".join([*lines, "", *notes, "", ", ".join(f"{key} {value}" for key, value in where.items())])
