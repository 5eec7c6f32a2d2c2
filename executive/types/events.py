"""What happens in a run and is worth a line in the trace: all that a sink ever sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from executive.types.actions import Dispatched, Motion, Moved, Phase, SkillResult
from executive.types.decisions import Decision, OutcomeKind
from executive.types.facts import Facts
from executive.types.observations import Belief, Blinded, Guarded, Judged, Looked, Observation, Questions, Verdict
from executive.types.scenes import Frame, Scenery
from executive.types.tasks import NoPlan, Plan, Probed, Task


@dataclass(frozen=True, slots=True)
class Started:
    """The run begins: everything that is needed to repeat it."""

    run: str
    domain: str
    task: Task
    estimator: str
    seed: int
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_blind(self) -> bool:
        """Whether nobody looks: the plan is carried out as if every step went well."""
        return self.estimator == "none"


@dataclass(frozen=True, slots=True)
class Resumed:
    """Another process goes on with the run. The simulated world is as it was in the cycle `restored`; of the rest it is
    said how far the run had come by its record: `cycle`, dispatched `actions`, `plans` and `looks`, and the `wall`
    seconds that the processes before this one took."""

    restored: int
    cycle: int
    actions: int
    plans: int
    looks: int
    wall: float = 0.0


@dataclass(frozen=True, slots=True)
class FaultInjected:
    """Something was broken on purpose, and what exactly."""

    kind: str
    spec: str
    action: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Compared:
    """An expectation was held against what was seen. `what` is `preconditions`, `effects` or `goal`."""

    what: str
    expected: Facts
    verdict: Verdict
    observation_id: int


@dataclass(frozen=True, slots=True)
class Revised:
    """The facts that are planned from changed to what was seen."""

    facts: Facts
    changed: Facts


@dataclass(frozen=True, slots=True)
class Timing:
    """Wall seconds that the loop spent in one stage, sinks not counted: `observe`, `estimate`, `plan` or `skill`; of
    the last, `guard` is the part that was spent on looking meanwhile. `compile` is what skills are made ready by, once
    on a machine."""

    stage: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Ended:
    """The run is over. `goal_seen` is the executive's own claim; nobody but the scorer knows better. `looks` are those
    that decisions were made on; what the guard took while something was carried comes beside them."""

    outcome: OutcomeKind
    reason: str
    goal_seen: bool
    unreached: tuple[str, ...]
    cycles: int
    actions: int
    replans: int
    looks: int


Payload: TypeAlias = (
    Started
    | Resumed
    | Questions
    | Scenery
    | Observation
    | Belief
    | Plan
    | NoPlan
    | Probed
    | Dispatched
    | Phase
    | Motion
    | Frame
    | FaultInjected
    | SkillResult
    | Compared
    | Decision
    | Revised
    | Looked
    | Judged
    | Moved
    | Guarded
    | Blinded
    | Timing
    | Ended
)


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """One thing that happened. `cycle` counts turns of the loop, `time` is the world's clock and `wall` the process's
    monotonic clock since the run began, both in seconds. Events are all that a sink ever sees."""

    cycle: int
    time: float
    wall: float
    payload: Payload
