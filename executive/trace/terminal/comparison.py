"""Decisions side by side: what a run decided, and what others would have decided from the same record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TextIO

from executive.trace import phrases
from executive.trace.terminal.console import console_for, printable
from executive.types import Decision

_PIPE = 160
"""Characters of a line where there is no terminal."""

_ATOMS = 4
"""How many atoms are told of a decision."""


class Pair(NamedTuple):
    """Two decisions of one cycle, None where one side has none; whether both do the same, and for the same reason."""

    cycle: int
    left: Decision | None
    right: Decision | None
    agree: bool
    same: bool


def print_pairs(pairs: Sequence[Pair], heads: tuple[str, str], stream: TextIO) -> None:
    """A table of two columns with these heads; what differs stands out."""
    from rich.table import Table
    from rich.text import Text

    console = console_for(stream)
    if not console.is_terminal:
        console.width = _PIPE
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("cycle", justify="right")
    for head in heads:
        table.add_column(Text(head), ratio=1, overflow="fold")
    for pair in pairs:
        style = "" if not pair.agree else "dim" if pair.same else "yellow"
        cells = [Text(_told(side, not pair.same), style) for side in (pair.left, pair.right)]
        table.add_row(f"{'' if pair.agree else '* '}{pair.cycle}", *cells)
    console.print(table)


def _told(decision: Decision | None, why: bool) -> str:
    if decision is None:
        return "-"
    lines = [printable(phrases.event(decision))]
    lines += [f"  {phrases.ground(ground)}" for ground in decision.grounds[:_ATOMS]] if why else []
    left = len(decision.grounds) - _ATOMS
    return "\n".join([*lines, f"  and {left} more atoms"] if why and left > 0 else lines)
