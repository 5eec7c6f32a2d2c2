"""A run's decisions once more, from its record: no model looks, no simulator moves, no planner searches.

The same loop runs with recorded parts: the run's looks, planner's answers and actions' outcomes, in the same order.
With the run's settings and monitor it takes the same decisions. With others it may ask for something that the record
lacks: a look where there was none, another action, a plan from another state. There the replay parts from the record
and ends.

What the record can tell is used. Looks at the same moment (between two actions) are there to be taken, and need not all
be. A plan that was found from a state that is now believed to be another one is taken if it would work from there too.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NoReturn

from executive.app.resume import remembered
from executive.belief import Monitor
from executive.core.compare import reaches
from executive.core.loop import Executive
from executive.core.observer import Look
from executive.core.policy import exhausted
from executive.core.run_state import RunState
from executive.core.session import Session
from executive.errors import ExecutiveError
from executive.protocols import SkillContext, Supposing
from executive.replay.record import Action, Decided, Part, Record, same_causes
from executive.trace.phrases import look_cause
from executive.types import (
    Atom,
    Condition,
    Decision,
    Event,
    Facts,
    NoPlan,
    Observation,
    Plan,
    Probed,
    Resumed,
    Scenery,
    SearchOrder,
    SkillResult,
    Step,
)


@dataclass(frozen=True, slots=True)
class Replay:
    """What is decided from a record. `end` says why it goes no further, nothing when it came to an end of its own;
    `parted`: because the record does not hold what it wants next. `asked` are the states and goals that the planner was
    asked about, by the number of its answer among the record's parts."""

    decisions: tuple[Decided, ...]
    end: str = ""
    parted: bool = False
    asked: Mapping[int, tuple[Facts, Condition]] = field(default_factory=lambda: MappingProxyType({}))


def replay(record: Record, monitor: Monitor, before: Replay | None = None) -> Replay:
    """Decide once more, with what `monitor` makes of the recorded looks.

    Args:
        before: the replay with the recorded monitor, where this is another one. Whether the planner was asked from the
            same state is known from it.
    """
    reel, seen = _Reel(record, before.asked if before else None), _Decisions()
    started = record.started
    executive = Executive(
        started.task,
        planner=reel,
        monitor=monitor,
        skills=_Skills(reel),
        session=Session([seen], _World(), clock=_Clock(record, reel, seen)),
        observer=None if started.is_blind else _Observer(started.estimator, reel),
        settings=record.settings,
        initial=record.initial,
        run_state=None if record.since is None else _resumed(record, record.since, monitor),
        search=reel,
    )
    try:
        executive.run()
    except _RecordEndsError as end:
        return Replay(tuple(seen.decisions), str(end), end.parted, MappingProxyType(reel.asked))
    return Replay(tuple(seen.decisions), asked=MappingProxyType(reel.asked))


# Inside.


class _RecordEndsError(ExecutiveError):
    """The record does not hold what is wanted next; `parted`: since something else was done then."""

    def __init__(self, message: str, parted: bool) -> None:
        self.parted = parted
        super().__init__(message)


class _Reel:
    """The record's parts, taken in order. `known` are the states and goals of then, where they are known."""

    def __init__(self, record: Record, known: Mapping[int, tuple[Facts, Condition]] | None) -> None:
        self._record, self._parts, self._known, self._at = record, record.parts, known, 0
        self.asked: dict[int, tuple[Facts, Condition]] = {}

    def look(self, cause: str) -> Look:
        for number, part in self._here():
            if isinstance(part, Look):
                self._at = number + 1
                return part
        self._end(f"it looks again ({look_cause(cause)})")

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        for number, part in self._here():
            if isinstance(part, Plan | NoPlan | Probed):
                self._check(number, part, state, goal, avoid)
                self._at, self.asked[number] = number + 1, (state, goal)
                return part if not isinstance(part, Probed) else part.plan or part.no_plan or _never()
        self._end(f"it plans anew, for {_listed(goal.texts())}")

    def order(self, supposing: Supposing, goal: Condition, hidden: frozenset[Atom]) -> SearchOrder:
        """What was found then; a record from before there were searches has none."""
        for number, part in self._here():
            if isinstance(part, SearchOrder):
                self._at = number + 1
                return part
        return SearchOrder()

    @property
    def is_over(self) -> bool:
        """Whether all of it was taken."""
        return self._at == len(self._parts)

    def action(self, step: Step) -> SkillResult:
        for number, part in enumerate(self._parts[self._at :], start=self._at):
            if isinstance(part, Action):
                if part.order.step != step:
                    self._end(f"its next action is {step}")
                if part.result is None:
                    raise _RecordEndsError(self._record.cut, parted=False)
                self._at = number + 1
                return part.result
        self._end(f"it carries out {step}")

    def _here(self) -> Iterator[tuple[int, Part]]:
        """The parts that are left of this moment, which ends with the next action."""
        for number, part in enumerate(self._parts[self._at :], start=self._at):
            if isinstance(part, Action):
                return
            yield number, part

    def _check(
        self, number: int, answer: Plan | NoPlan | Probed, state: Facts, goal: Condition, avoid: frozenset[Step]
    ) -> None:
        """Whether the planner would say so of this state and goal, too, if it is to avoid those steps."""
        if isinstance(answer, Probed) and answer.goal != goal:
            self._end(f"it asks for a plan for {_listed(goal.texts())}")
        said = (answer.plan or answer.no_plan) if isinstance(answer, Probed) else answer
        without = tuple(sorted(map(str, avoid)))
        if said is None or said.without != without:
            self._end(f"it asks for a plan without {_listed(without)}" if avoid else "it asks for a plan with any step")
        if self._known is None or self._known.get(number) == (state, goal):
            return
        plan = answer.plan if isinstance(answer, Probed) else answer
        rules = self._record.started.task.derived
        if not isinstance(plan, Plan) or not reaches(plan.steps, state, goal, rules):
            there = self._known.get(number, (Facts(), goal))[0]
            other = [literal for literal in state.literals() if literal not in there.literals()]
            self._end(f"it plans from another state ({_listed(other)})")

    def _end(self, wanted: str) -> NoReturn:
        following = next((part for part in self._parts[self._at :] if isinstance(part, Action)), None)
        if following is None and self._record.cut:
            raise _RecordEndsError(self._record.cut, parted=False)
        if following is None:
            raise _RecordEndsError(f"{wanted}, where the run came to its end", parted=True)
        order = following.order
        raise _RecordEndsError(f"{wanted}, where action {order.action} of the run was {order.step}", parted=True)


class _World:
    """A world in which nothing moves, and no time passes."""

    time = 0.0
    handle = None

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        raise NotImplementedError

    def schedule(self, delay: float, action: Any) -> None:
        raise NotImplementedError

    def stop(self) -> None:
        """Nothing moves."""

    def scenery(self) -> Scenery:
        return Scenery()

    def watch(self, listener: Any) -> None:
        """Nothing moves."""


class _Observer:
    """Takes the looks that were taken then."""

    questions = None

    def __init__(self, name: str, reel: _Reel) -> None:
        self.name, self._reel = name, reel

    def look(self, run_state: RunState, cause: str) -> Look:
        return self._reel.look(cause)

    def look_at_all(self, run_state: RunState, cause: str) -> Look:
        return self._reel.look(cause)

    def look_again(self, run_state: RunState, cause: str, atoms: Sequence[Atom], surprised: bool = False) -> Look:
        return self._reel.look(cause)

    def begin_moment(self) -> None:
        """The reel knows which looks are of one moment."""

    def guard(self, step: Step) -> None:
        """What was carried then is part of the skill's recorded report."""


class _Skills(dict[str, Any]):
    """For every action, whatever became of it then."""

    def __init__(self, reel: _Reel) -> None:
        super().__init__()
        self._reel = reel

    def __missing__(self, action: str) -> Any:
        return self._carried_out

    def _carried_out(self, step: Step, context: SkillContext) -> SkillResult:
        return self._reel.action(step)


class _Decisions:
    """The sink that keeps decisions."""

    def __init__(self) -> None:
        self.decisions: list[Decided] = []

    def write(self, event: Event) -> None:
        if isinstance(event.payload, Decision):
            self.decisions.append(Decided(event.cycle, event.payload))

    def close(self) -> None:
        pass


class _Clock:
    """No time passes in a replay. It is up where it was up then: after all that the record tells."""

    def __init__(self, record: Record, reel: _Reel, made: _Decisions) -> None:
        self._record, self._reel, self._made = record, reel, made

    def __call__(self) -> float:
        settings, decisions = self._record.settings, self._record.decisions
        at_the_end = self._reel.is_over and len(self._made.decisions) == len(decisions) - 1
        out_of_time = exhausted(settings, seconds=settings.max_seconds) if at_the_end else None
        is_up = out_of_time is not None and same_causes(decisions[-1].decision, out_of_time)
        return settings.max_seconds if is_up else 0.0


def _resumed(record: Record, since: Resumed, monitor: Monitor) -> RunState:
    """Return how the run stood when another process went on with it."""
    task, blind = record.started.task, record.started.is_blind
    memory = None if blind else remembered(record.before, monitor)
    return RunState(task, task.goal, record.initial if blind else Facts(), memory).resumed(since)


def _listed(literals: Sequence[str], most: int = 3) -> str:
    shown = ", ".join(literals[:most])
    return f"{shown} and {len(literals) - most} more" if len(literals) > most else shown


def _never() -> NoReturn:
    raise AssertionError("Probed has an answer")
