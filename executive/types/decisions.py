"""What to do next, and how a run ends."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from executive.types.actions import SkillResult
from executive.types.facts import Atom


class DecisionKind(StrEnum):
    CONTINUE = "continue"
    LOOK_AGAIN = "look again"
    RETRY = "retry"
    REPLAN = "replan"
    GIVE_UP_GOAL = "give up a goal"
    STOP = "stop"


class OutcomeKind(StrEnum):
    GOAL_REACHED = "goal-reached"  # it is seen to hold
    PLAN_COMPLETED = "plan-completed"  # by an executive that does not look: it assumes that the goal holds
    PARTIAL = "partial"
    NO_PLAN = "no-plan"
    GAVE_UP = "gave-up"
    INTERRUPTED = "interrupted"
    CRASHED = "crashed"

    @property
    def claims_goal(self) -> bool:
        """Whether the executive takes the whole goal to hold, whether seen or assumed."""
        return self in (OutcomeKind.GOAL_REACHED, OutcomeKind.PLAN_COMPLETED)


@dataclass(frozen=True, slots=True)
class Ground:
    """One atom that spoke for a decision, as it stood then: what was expected of it (None: nothing), what it was taken
    for (None: it cannot be told), its probability where there was one, and the last look that was asked about it, with
    the cameras whose pictures that look took (-1 and none: no look was)."""

    atom: Atom
    expected: bool | None
    believed: bool | None
    probability: float | None
    observation_id: int = -1
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do next, why, and the atoms that spoke for it. A decision to stop carries the outcome.

    `grounds` say of each atom in `evidence` what it rested on, and `report` is what the skill said, if it was asked.
    """

    kind: DecisionKind
    reason: str
    evidence: tuple[Atom, ...] = ()
    outcome: OutcomeKind | None = None
    grounds: tuple[Ground, ...] = ()
    report: SkillResult | None = None

    def __post_init__(self) -> None:
        if (self.kind is DecisionKind.STOP) != (self.outcome is not None):
            raise ValueError("a decision carries an outcome if and only if it stops the run")
