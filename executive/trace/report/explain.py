"""The story of a run in plain sentences, made from its events alone: what was done, seen, decided, and why.

A cycle in which all went as expected is one line. Of any other, and of one that is asked for, everything is told that a
decision rested on: the atoms, what was expected of them, how probable they were, which pictures showed it, and what the
skill said.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TextIO

from executive.errors import InputError, OptionError
from executive.trace.report.sentences import SENTENCES, cycles, decided, listed, looked, pictures, truth
from executive.trace.terminal.console import console_for, printable
from executive.trace.terminal.view import contradiction, spoken
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Event,
    FaultInjected,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Moved,
    NoPlan,
    Observation,
    Payload,
    Plan,
    SkillResult,
    Started,
)


@dataclass(frozen=True, slots=True)
class Chapter:
    """The events of one cycle, in order, and when it began and ended on the world's clock."""

    cycle: int
    events: Sequence[Event] = field(default_factory=tuple)

    @property
    def span(self) -> str:
        start, end = self.events[0].time, self.events[-1].time
        return f"{start:.1f} s" if end - start < 0.05 else f"{start:.1f} s to {end:.1f} s"

    def of(self, *kinds: type) -> list[Payload]:
        return [event.payload for event in self.events if isinstance(event.payload, kinds)]

    @property
    def uneventful(self) -> bool:
        """One step, done and seen to be done, and nothing else worth a word."""
        decisions, results = self.of(Decision), self.of(SkillResult)
        return (
            [d.kind for d in decisions if isinstance(d, Decision)] == [DecisionKind.CONTINUE]
            and all(isinstance(r, SkillResult) and r.done for r in results)
            and len(results) == 1
            and all(c.verdict.satisfied for c in self.of(Compared) if isinstance(c, Compared))
            and not self.of(FaultInjected, Blinded, Moved, Plan, NoPlan)
            and not any(g.held is False for g in self.of(Guarded) if isinstance(g, Guarded))
            and not any(j.contradictions or j.overruled for j in self.of(Judged) if isinstance(j, Judged))
        )


def explain(events: Iterable[Event], cycle: int | None = None) -> list[str]:
    """The run, or one cycle of it, line by line; what belongs to a line above is indented.

    Raises:
        InputError: the events are no run, or it has no such cycle.
    """
    chapters: dict[int, list[Event]] = {}
    started: Started | None = None
    for event in events:
        if isinstance(event.payload, Started):
            started = event.payload
        chapters.setdefault(event.cycle, []).append(event)
    if started is None:
        raise InputError("these events are no run: none of them starts it")
    if cycle is not None and cycle not in chapters:
        raise OptionError(f"there is no cycle {cycle}; the run has cycles 0 to {max(chapters)}", option="cycle")
    lines = _opening(started)
    for number, some in sorted(chapters.items()):
        if cycle is None or number == cycle:
            lines += _chapter(Chapter(number, some), whole=cycle is not None)
    return lines


def print_lines(lines: Iterable[str], stream: TextIO) -> None:
    """Print what `explain` returns; in a terminal, as wide as that is."""
    console = console_for(stream)
    for line in lines:
        text = printable(line)
        if console.is_terminal:
            indent = " " * (len(text) - len(text.lstrip()) + 2)
            width = max(40, console.width)
            text = textwrap.fill(text, width, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)
        print(text, file=stream)


def _opening(started: Started) -> list[str]:
    goal = ", ".join(started.task.goal.texts()) or "nothing"
    who = "nobody looks" if started.is_blind else f"seen by {started.estimator}"
    return [
        f"{started.domain}, {started.task.problem}, seed {started.seed}, {who}.",
        f"The goal: {goal}.",
    ]


def _chapter(chapter: Chapter, whole: bool) -> list[str]:
    head = f"Cycle {chapter.cycle}, {chapter.span}"
    if chapter.uneventful and not whole:
        (order,) = (payload for payload in chapter.of(Dispatched) if isinstance(payload, Dispatched))
        looks = [payload for payload in chapter.of(Looked) if isinstance(payload, Looked) and _decisive(payload)]
        seen = f", and seen as expected (look {looks[-1].observation_id})" if looks else ""
        return [f"{head}: {spoken(order.step)} was done{seen}."]
    teller = _Teller(whole)
    body = [line for event in chapter.events for line in teller.tell(event)]
    return [f"{head}:", *(f"  {line}" for line in body)]


def _decisive(looked: Looked) -> bool:
    return looked.kind is not LookKind.GUARD


class _Teller:
    """Turns the events of one cycle into sentences; a look is told in one, once all of its events are there."""

    def __init__(self, whole: bool) -> None:
        self._whole, self._cause, self._raw = whole, "", dict[Atom, float]()
        self._probability: Mapping[Atom, float] = {}
        self._silent: frozenset[Atom] = frozenset()
        self._errors: tuple[str, ...] = ()

    def tell(self, event: Event) -> list[str]:
        match event.payload:
            case Observation(cause=cause):
                self._cause = cause
            case Belief() as belief:
                self._take(belief)
            case Looked() as look:
                return self._look(look)
            case Judged() as judged:
                return self._judged(judged)
            case Compared() as compared:
                return self._compared(compared)
            case Decision() as decision:
                return decided(decision)
            case payload:
                sentence = SENTENCES.get(type(payload))
                return [] if sentence is None else [sentence(event)]
        return []

    def _take(self, belief: Belief) -> None:
        self._raw, self._silent = dict(belief.probability), belief.unanswered
        self._probability = {**self._probability, **belief.probability}
        errors = (answer.error for answers in belief.evidence.values() for answer in answers if answer.error)
        self._errors = tuple(dict.fromkeys(errors))

    def _look(self, look: Looked) -> list[str]:
        if look.kind is LookKind.GUARD and not self._whole:
            return []
        lines = [looked(look, self._cause)]
        if self._silent:
            why = f": {self._errors[0]}" if self._errors else ""
            lines.append(f"  {len(self._silent)} of them got no answer{why}: {listed(sorted(self._silent))}.")
        if self._whole and look.cameras:
            lines.append(f"  {pictures(look.observation_id, look.cameras)}")
        return lines

    def _judged(self, judged: Judged) -> list[str]:
        self._probability = judged.probability
        lines = [f"  The answers {contradiction(clash)}." for clash in judged.contradictions]
        for wrong in judged.overruled:
            believed = "cannot be told" if wrong.believed is None else f"is taken for {truth(wrong.believed)}"
            lines.append(
                f"  The look says that {wrong.atom} is {truth(wrong.answered)} (P {wrong.answer:.2f}); with what else "
                f"is known it {believed} (P {wrong.probability:.2f})."
            )
        if self._whole:
            for atom, value in judged.remembered.items():
                lines.append(
                    f"  {atom} was not told; {cycles(value.age)} ago it was {truth(value.value)}, and is true by now "
                    f"with P {value.probability:.2f}."
                )
            if judged.came_about is not None:
                lines.append(f"  That the action did all it was to do has P {judged.came_about:.2f}.")
        return lines

    def _compared(self, compared: Compared) -> list[str]:
        verdict, expected = compared.verdict, compared.expected
        what = {"preconditions": "what the next step needs", "goal": "the goal", "effects": "what was expected"}
        about = what.get(compared.what, compared.what)
        if verdict.satisfied:
            return [f"Of {about}, all is seen to hold."] if compared.what != "preconditions" or self._whole else []
        lines = [f"Of {about}, not all is seen to hold:"]
        for atom in sorted(verdict.violated):
            wanted = expected.get(atom)  # a record of somebody else's may say less
            told = "is not as expected" if wanted is None else f"should be {truth(wanted)} and is {truth(not wanted)}"
            lines.append(f"  {atom} {told}{self._p(atom)}")
        if verdict.unknown:
            lines.append(f"  {listed(sorted(verdict.unknown))} cannot be told")
        return lines

    def _p(self, atom: Atom) -> str:
        value, raw = self._probability.get(atom), self._raw.get(atom)
        if value is None:
            return ""
        said = f", of which the look alone says {raw:.2f}" if raw is not None and abs(raw - value) > 0.005 else ""
        return f" (P {value:.2f}{said})"
