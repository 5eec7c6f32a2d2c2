"""The inputs and decisions of a run, sorted out of its events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

from executive.core.observer import Look
from executive.core.settings import Settings
from executive.errors import InputError
from executive.trace.phrases import why
from executive.trace.record.codec import decode
from executive.types import (
    Belief,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    Looked,
    LookKind,
    NoPlan,
    OutcomeKind,
    Plan,
    Probed,
    Reason,
    Resumed,
    SearchOrder,
    SkillResult,
    Started,
    Timing,
)


class Action(NamedTuple):
    """A dispatched step, and its skill's report; None where the record ends before."""

    order: Dispatched
    result: SkillResult | None


class Decided(NamedTuple):
    """A decision, and the cycle in which it was taken."""

    cycle: int
    decision: Decision


Part: TypeAlias = Look | Action | Plan | NoPlan | Probed | SearchOrder
"""One input of the loop: a look, an action's outcome, or an answer of the planner or of the search for places."""


@dataclass(frozen=True, slots=True)
class Record:
    """The inputs and decisions of a run, in order, as long as one process carried it out. `initial` is what a blind
    executive was given at the start. Where the run was resumed, `since` says how far it had come, and `before` has the
    events until then."""

    started: Started
    settings: Settings
    parts: tuple[Part, ...]
    decisions: tuple[Decided, ...]
    initial: Facts
    ended: Ended | None
    since: Resumed | None = None
    before: tuple[Event, ...] = ()

    @classmethod
    def all(cls, events: Iterable[Event]) -> tuple[Record, ...]:
        """Sort a run's events, those of each process apart.

        Raises:
            InputError: they are no run, or what they say of its settings cannot be so.
        """
        every = tuple(events)
        marks = [number for number, event in enumerate(every) if isinstance(event.payload, Resumed)]
        begins, ends = [0, *marks], [*marks, len(every)]
        first = cls._of(every[: ends[0]], None)
        later = [
            replace(cls._of(every[begin:end], first.started), before=every[:begin])
            for begin, end in zip(begins[1:], ends[1:], strict=True)
        ]
        return (first, *later)

    @classmethod
    def _of(cls, events: Iterable[Event], started: Started | None) -> Record:
        since: Resumed | None = None
        ended: Ended | None = None
        parts: list[Part] = []
        decisions: list[Decided] = []
        last: Belief | None = None
        initial: Facts | None = None
        answered = False  # whether what comes now is the planner's answer, and not one of before that is taken up
        for event in events:
            match event.payload:
                case Started() as begun:
                    started = begun
                case Resumed() as resumed:
                    since = resumed
                case Belief() as belief:
                    last = belief
                    initial = initial or belief.facts()
                case Looked(kind=kind) as looked if kind is not LookKind.GUARD and last is not None:
                    parts.append(Look(last, looked))
                case Plan() | NoPlan() | Probed() as answer if answered:
                    parts.append(answer)
                case SearchOrder() as order:
                    parts.append(order)
                case Dispatched() as dispatched:
                    parts.append(Action(dispatched, None))
                case SkillResult() as result if parts and isinstance(action := parts[-1], Action):
                    parts[-1] = action._replace(result=result)
                case Decision() as decision:
                    decisions.append(Decided(event.cycle, decision))
                case Ended() as end:
                    ended = end
            answered = isinstance(event.payload, Timing) and event.payload.stage == "plan"
        if started is None:
            raise InputError("these events are no run: none of them starts it")
        settings = _settings(started)
        return cls(started, settings, tuple(parts), tuple(decisions), initial or Facts(), ended, since)

    @property
    def cut(self) -> str:
        """Why the record ends before the run came to an end of its own; nothing when it did."""
        if self.decisions and self.decisions[-1].decision.kind is DecisionKind.STOP:
            return ""
        if self.ended is None:
            return "the run was killed here, or is still going on"
        if self.ended.outcome is OutcomeKind.INTERRUPTED:
            return "the run was interrupted here"
        return f"the run crashed here: {why(self.ended)}"


def same_causes(recorded: Decision, other: Decision) -> bool:
    """Return whether both decisions have the same causes; a record from before there were codes has them in words."""
    if recorded.code is Reason.RECORDED:
        return why(recorded) == why(other)
    return recorded.causes == other.causes


def _settings(started: Started) -> Settings:
    try:
        settings: Settings = decode(Settings, dict(started.settings))
    except ValueError as error:
        raise InputError(f"these are no settings of a run: {error}") from None
    return settings
