"""What was believed over time of the atoms in play: as curves against the thresholds, and in words as lanes.

An atom is in play once its truth changed or it was not as expected; it is shown from the start of the run on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import cycle
from typing import NamedTuple

import rerun as rr

from executive.belief import Thresholds
from executive.trace.viewer.blueprint import ANSWERS, BELIEVED, PROBABILITY, THRESHOLDS
from executive.trace.viewer.colours import CURVES, DIM, GREY, Colour
from executive.trace.viewer.parts import Lane, stamp, time_columns
from executive.types import Atom, Belief, Event, Judged, Looked, LookKind, Observation, Timing

_WORDS: Mapping[str, Colour] = {
    "true": (52, 140, 84),
    "was true": (48, 82, 62),
    "unknown": (170, 122, 30),
    "was false": (44, 46, 52),
    "false": (64, 68, 78),
}
"""What an atom is taken for; "was": no look since the last action told, and it is remembered."""
_APART = 0.02
"""An answer that is no further than this from what is made of it has no mark of its own."""


class _Point(NamedTuple):
    event: Event
    probability: float | None
    word: str


class Beliefs:
    """Logs what becomes of each atom in play.

    Args:
        thresholds: above and below what an atom is true and false, by predicate; `""` is for all others.
    """

    def __init__(self, record: rr.RecordingStream, thresholds: Mapping[str, Thresholds]) -> None:
        self._record, self._thresholds = record, {"": Thresholds(), **thresholds}
        self._past: dict[Atom, list[_Point]] = {}
        self._answers: dict[Atom, list[tuple[Event, float]]] = {}
        self._shown: dict[Atom, Lane] = {}
        self._amiss: Counter[Atom] = Counter()
        self._colours = cycle(CURVES)
        self._looks: list[Event] = []
        self._drawn: set[tuple[str, str]] = set()
        self._open: tuple[Event, Belief] | None = None

    def tell(self, event: Event) -> None:
        """Take in the next event. A look's answers stand for themselves unless a judgement of them follows; a glance's
        are marks beside the curve."""
        match event.payload:
            case Belief() as belief:
                self._settle()
                self._open = (event, belief)
            case Looked(kind=LookKind.GUARD) if self._open is not None:
                _, belief = self._open
                self._open = None
                self._mark(event, belief.probability)
            case Judged() as judged:
                said = self._open[1].probability if self._open is not None else {}
                self._open = None
                self._judged(event, judged, said)
            case Looked() | Timing() | Observation():
                pass
            case _:
                self._settle()

    def amiss(self, atoms: Iterable[Atom]) -> None:
        """These were not as expected, or cannot be told."""
        self._amiss.update(sorted(atoms))
        self._show(self._amiss)

    def telling(self, goal: Iterable[Atom], most_words: int, most_curves: int) -> tuple[list[str], list[str]]:
        """Return which of the atoms in play tell most, as entities: in words some that were amiss most often, and the
        goal's; as curves those that were amiss, and those whose answers were not what was made of them. The curves get
        colours that can be told apart."""
        amiss = [atom for atom, _ in self._amiss.most_common()]
        doubted = sorted(self._answers.keys() & self._shown, key=lambda atom: (-len(self._answers[atom]), atom))
        rest = [*(atom for atom in sorted(goal) if atom in self._shown), *amiss, *self._shown]
        words, curves = (
            [*dict.fromkeys([*amiss[: most_words // 2], *rest])],
            [*dict.fromkeys([*amiss, *doubted, *rest])],
        )
        for atom, colour in zip(curves[:most_curves], CURVES, strict=False):
            self._style(atom, colour)
        return [_path(atom) for atom in words[:most_words]], [_path(atom) for atom in curves[:most_curves]]

    def _show(self, atoms: Iterable[Atom]) -> None:
        """Bring atoms into play."""
        for atom in sorted(set(atoms) - self._shown.keys()):
            colour = next(self._colours)
            lane = self._shown[atom] = Lane(self._record, _entity(BELIEVED, atom), _WORDS)
            self._style(atom, colour)
            past = self._past.get(atom, [])
            lane.enter_all([(point.event, point.word) for point in past])
            known = [(point.event, point.probability) for point in past if point.probability is not None]
            self._curve(PROBABILITY, atom, known)
            self._curve(ANSWERS, atom, self._answers.get(atom, []))

    def _style(self, atom: Atom, colour: Colour) -> None:
        """A curve for what is believed and marks for what was answered, under one name."""
        line = rr.SeriesLines(
            names=str(atom), colors=colour, widths=2.0, interpolation_mode=rr.components.InterpolationMode.StepAfter
        )
        self._record.log(_entity(PROBABILITY, atom), line, static=True)
        marks = rr.SeriesPoints(names=str(atom), colors=colour, markers="Circle", marker_sizes=3.5)
        self._record.log(_entity(ANSWERS, atom), marks, static=True)

    def close(self) -> None:
        self._settle()

    def _settle(self) -> None:
        if self._open is not None:
            (event, belief), self._open = self._open, None
            for atom in (*belief.probability, *belief.unanswered):
                probability = belief.probability.get(atom)
                self._add(atom, _Point(event, probability, self._word(atom, probability)))
            self._limits(event)

    def _judged(self, event: Event, judged: Judged, said: Mapping[Atom, float]) -> None:
        for atom, probability in judged.probability.items():
            if atom in judged.seen:
                word = "true" if judged.seen[atom] else "false"
            elif atom in judged.remembered:
                word = f"was {'true' if judged.remembered[atom].value else 'false'}"
            else:
                word = "unknown"
            self._add(atom, _Point(event, probability, word))
        apart = {
            atom: value for atom, value in said.items() if abs(value - judged.probability.get(atom, value)) > _APART
        }
        self._mark(event, apart)
        self._limits(event)

    def _add(self, atom: Atom, point: _Point) -> None:
        past = self._past.setdefault(atom, [])
        past.append(point)
        if atom in self._shown:
            stamp(self._record, point.event)
            self._shown[atom].enter(point.word)
            if point.probability is not None:
                self._record.log(_entity(PROBABILITY, atom), rr.Scalars(point.probability))
        elif _truth(past[0].word) != _truth(point.word):
            self._show([atom])

    def _mark(self, event: Event, answers: Mapping[Atom, float]) -> None:
        for atom, value in answers.items():
            self._answers.setdefault(atom, []).append((event, value))
            if atom in self._shown:
                self._curve(ANSWERS, atom, [(event, value)])

    def _curve(self, root: str, atom: Atom, points: list[tuple[Event, float]]) -> None:
        if points:
            values = rr.Scalars.columns(scalars=[value for _, value in points])
            times = time_columns([event for event, _ in points])
            self._record.send_columns(rr.new_entity_path(_entity(root, atom)), times, values)

    def _limits(self, event: Event) -> None:
        """The thresholds of the atoms in play, as lines across from the first look on."""
        self._looks.append(event)
        for key in sorted({atom.predicate if atom.predicate in self._thresholds else "" for atom in self._shown}):
            each, whose = self._thresholds[key], f"{key}: " if key else ""
            both = {"high": (f"true from {each.high:g}", each.high), "low": (f"false below {each.low:g}", each.low)}
            if each.low == each.high:
                both = {"high": (f"true from {each.high:g}, else false", each.high)}
            for name, (label, value) in both.items():
                entity: list[object] = [THRESHOLDS, key or "all", name]
                since = [event]
                if (key, name) not in self._drawn:
                    self._drawn.add((key, name))
                    style = rr.SeriesLines(names=whose + label, colors=GREY if key else DIM, widths=1.0)
                    self._record.log(entity, style, static=True)
                    since = self._looks
                if 0.0 < value <= 1.0:
                    values = rr.Scalars.columns(scalars=[value] * len(since))
                    self._record.send_columns(rr.new_entity_path(entity), time_columns(since), values)

    def _word(self, atom: Atom, probability: float | None) -> str:
        if probability is None:
            return "unknown"
        truth = self._thresholds.get(atom.predicate, self._thresholds[""]).truth(probability)
        return {True: "true", False: "false", None: "unknown"}[truth]


def _truth(word: str) -> str:
    return word.removeprefix("was ")


def _entity(root: str, atom: Atom) -> list[object]:
    """`root/on-table/lemon/wood-table`, which the viewer prints without escapes."""
    return [root, atom.predicate, *atom.args]


def _path(atom: Atom) -> str:
    return "/".join((atom.predicate, *atom.args))
