"""The events of a run, which are all that a sink sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from executive.types.actions import Dispatched, Motion, Moved, Phase, SkillResult
from executive.types.decisions import Cause, Caused, Decision, OutcomeKind
from executive.types.facts import Facts
from executive.types.observations import Belief, Blinded, Guarded, Judged, Looked, Observation, Questions, Verdict
from executive.types.scenes import Frame, PointCloud, PosesEstimated, Scenery
from executive.types.searching import SearchOrder
from executive.types.tasks import NoPlan, Plan, Probed, Task


@dataclass(frozen=True, slots=True)
class Started:
    """The run begins; has everything that is needed to repeat it."""

    run: str
    domain: str
    task: Task
    estimator: str
    seed: int
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_blind(self) -> bool:
        """Whether the run is blind (open loop): the plan is executed as if every step succeeded."""
        return self.estimator == "none"


@dataclass(frozen=True, slots=True)
class Resumed:
    """Another process continues the run, in the simulated world of the cycle `restored`. The rest is how far it had
    come by its record: `cycle`, dispatched `actions`, `plans`, `looks`, and the `wall` seconds of the earlier
    processes."""

    restored: int
    cycle: int
    actions: int
    plans: int
    looks: int
    wall: float = 0.0


@dataclass(frozen=True, slots=True)
class FaultInjected:
    """A fault was injected."""

    kind: str
    spec: str
    action: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Compared:
    """An expectation was compared with what was seen. `what` is `preconditions`, `effects` or `goal`."""

    what: str
    expected: Facts
    verdict: Verdict
    observation_id: int


@dataclass(frozen=True, slots=True)
class Revised:
    """The facts that are planned from were updated to what was seen."""

    facts: Facts
    changed: Facts


@dataclass(frozen=True, slots=True)
class Timing:
    """The wall seconds of a stage of the loop, without sinks: `observe`, `estimate`, `plan` or `skill`. `guard` is the
    part of `skill` that the hold guard's looks took; `compile` is the compilation of skills, once on a machine."""

    stage: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Ended(Caused):
    """The run has ended, for the causes of the last decision. `goal_seen` is the executive's claim, not ground truth.
    `looks` counts those that decisions were based on; the hold guard's are not included."""

    outcome: OutcomeKind
    causes: tuple[Cause, ...]
    goal_seen: bool
    unreached: tuple[str, ...]
    cycles: int
    actions: int
    replans: int
    looks: int

    def __post_init__(self) -> None:
        if not self.causes:
            raise ValueError("the end of a run has a cause")


Payload: TypeAlias = (
    Started
    | Resumed
    | Questions
    | Scenery
    | Observation
    | PosesEstimated
    | PointCloud
    | Belief
    | Plan
    | NoPlan
    | Probed
    | SearchOrder
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


News: TypeAlias = Phase | Motion | PosesEstimated
"""What a skill announces."""


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """One event of a run. `cycle` counts turns of the loop, `time` is the world's clock and `wall` the process's
    monotonic clock since the run began, both in seconds."""

    cycle: int
    time: float
    wall: float
    payload: Payload
