"""An estimator's answers about one look, as a table: in colour on a terminal, elsewhere as plain lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TextIO

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from executive.trace.terminal.console import console_for

_WIDTH = 10
"""Cells of a full bar."""


@dataclass(frozen=True, slots=True)
class Line:
    """One answer: of which `group` it is (an atom's predicate), what it is about, what was asked, and the probability
    of true; None is unanswered, and `note` says why."""

    group: str
    name: str
    question: str
    probability: float | None
    note: str = ""


def print_answers(lines: Sequence[Line], stream: TextIO) -> None:
    """Print the answers, grouped in the order given."""
    console = console_for(stream)
    groups = [list(members) for _, members in groupby(lines, key=lambda line: line.group)]
    if not console.is_terminal:
        _print_plain(groups, console)
        return
    table = Table(box=SIMPLE, pad_edge=False, show_edge=False)
    table.add_column("P(true)", no_wrap=True)
    table.add_column("atom", overflow="fold", ratio=2)
    table.add_column("question", overflow="fold", ratio=3, style="dim")
    for members in groups:
        for line in members:
            style = _style(line.probability)
            said = Text(line.question)
            if line.probability is None:
                said.append(f"\nunanswered: {line.note}", "yellow")
            table.add_row(Text(_gauge(line.probability, console), style), Text(line.name, style), said)
        table.add_section()
    console.print(table)


def _print_plain(groups: Sequence[Sequence[Line]], console: Console) -> None:
    width = max((len(line.name) for members in groups for line in members), default=0)
    for number, members in enumerate(groups):
        if number:
            console.print()
        for line in members:
            note = f"  (unanswered: {line.note})" if line.probability is None else ""
            text = f"{_gauge(line.probability, console)}  {line.name:{width}}  {line.question}{note}"
            console.print(text, soft_wrap=True)


def _gauge(probability: float | None, console: Console) -> str:
    """Return the probability as a number and as a bar, always equally wide."""
    if probability is None:
        return f"   ?  {'':{_WIDTH}}"
    full, rest = ("#", ".") if console.options.ascii_only else ("\N{FULL BLOCK}", "\N{MIDDLE DOT}")
    filled = round(probability * _WIDTH)
    return f"{probability:.2f}  {full * filled}{rest * (_WIDTH - filled)}"


def _style(probability: float | None) -> str:
    if probability is None:
        return "yellow"
    return "green" if probability >= 0.5 else "dim"
