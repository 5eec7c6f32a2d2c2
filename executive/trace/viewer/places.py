"""Where things may be that cannot always be seen: a bar for each thing and place, as long as it is probable that the
thing is there. What is believed shrinks to one bar a thing as one looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import rerun as rr

from executive.trace.viewer.blueprint import PLACES, PLACES_WIDTH
from executive.trace.viewer.colours import Colour
from executive.types import Atom, Judged, Started, Task

MOST_THINGS = 2
"""How many things there is room for."""

_ROW, _GAP = 22.0, 14.0
"""Units from a bar to the next, and from a thing to the next."""
_LETTER, _FRAME, _MOST = 10.0, 24.0, 0.65 * PLACES_WIDTH
"""Units that a letter and a label's frame take in a window of 1280x800 pixels, where they take most; a label's letters
have the same size in every window. Bars begin behind the longest one, or here."""
_ABOVE = 5.0
"""A label hangs below its point by so much."""
_LEAST = 0.005
"""Less probable than this, there is no bar."""
_NAME: Colour = (190, 194, 202)
_SEEN: Colour = (52, 140, 84)
_BELIEVED: Colour = (86, 130, 190)
_EMPTY: Colour = (64, 68, 78)


class _Bar(NamedTuple):
    atom: Atom
    label: str
    y: float


class Places:
    """Logs the bars of a run; nothing where all can always be seen."""

    def __init__(self, record: rr.RecordingStream) -> None:
        self._record = record
        self._bars: tuple[_Bar, ...] = ()

    @property
    def height(self) -> float:
        """How much room the bars take, in the panel's own units; 0 where there are none."""
        return self._bars[-1].y + 2 * _ROW if self._bars else 0.0

    def begin(self, started: Started) -> None:
        """Learn which things there are."""
        y, bars = _ROW, list[_Bar]()
        for thing, atoms in things(started.task).items():
            for atom in atoms:
                bars.append(_Bar(atom, f"{thing} {label(atom)}", y))
                y += _ROW
            y += _GAP
        self._bars = tuple(bars)

    def show(self, judged: Judged) -> None:
        """Draw the bars anew."""
        if not self._bars:
            return
        chances = [judged.probability.get(bar.atom, 0.0) for bar in self._bars]
        names = [f"{bar.label}: {chance:.2f}" for bar, chance in zip(self._bars, chances, strict=True)]
        left = min(_LETTER * max(map(len, names)) + _FRAME, _MOST)
        room = PLACES_WIDTH - left - _FRAME
        told = [(bar, chance) for bar, chance in zip(self._bars, chances, strict=True) if chance >= _LEAST]
        strips = [[(left, bar.y), (left + room * chance, bar.y)] for bar, chance in told]
        colours = [self._colour(bar.atom, judged) for bar, _ in told]
        self._record.log([PLACES, "bars"], rr.LineStrips2D(strips, colors=colours, radii=0.3 * _ROW))
        at = [(0.5 * (left - _FRAME), bar.y - _ABOVE) for bar in self._bars]
        self._record.log([PLACES, "names"], rr.Points2D(at, labels=names, radii=0.01, colors=_NAME, show_labels=True))

    def _colour(self, atom: Atom, judged: Judged) -> Colour:
        truth: Mapping[Atom, bool] = judged.seen
        return _BELIEVED if atom not in truth else _SEEN if truth[atom] else _EMPTY


def things(task: Task) -> dict[str, Sequence[Atom]]:
    """Return the things that cannot always be seen, those of the goal first, each with the atoms that say where it may
    be: those that differ in their last object, and those that have no other object."""
    found: dict[tuple[str, ...], list[Atom]] = {atom.args[:-1]: [] for atom in task.visible if len(atom.args) > 1}
    for atom in task.atoms:
        for key in (atom.args[:-1], atom.args):
            if key in found:
                found[key].append(atom)
                break
    wanted = {atom.args[:-1] for atom in task.goal.atoms}
    keys = sorted(found, key=lambda key: (key not in wanted, key))
    return {" ".join(key): tuple(sorted(found[key], key=_last)) for key in keys[:MOST_THINGS]}


def label(atom: Atom) -> str:
    """Return what an atom says of the thing that it is about."""
    return " ".join((atom.predicate, *atom.args[1:]))


def _last(atom: Atom) -> tuple[int, Atom]:
    return -len(atom.args), atom
