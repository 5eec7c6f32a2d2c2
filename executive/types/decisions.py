"""Decisions, and the outcomes of runs."""

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
    GOAL_REACHED = "goal-reached"  # the goal is seen to hold
    PLAN_COMPLETED = "plan-completed"  # in a blind run, which assumes that the goal holds
    PARTIAL = "partial"
    NO_PLAN = "no-plan"
    GAVE_UP = "gave-up"
    INTERRUPTED = "interrupted"
    CRASHED = "crashed"

    @property
    def claims_goal(self) -> bool:
        """Whether the executive claims the whole goal, seen or assumed."""
        return self in (OutcomeKind.GOAL_REACHED, OutcomeKind.PLAN_COMPLETED)


@dataclass(frozen=True, slots=True)
class Ground:
    """An atom that was a reason for a decision, as it was then: its expected value (None: no expectation), its believed
    value (None: unknown), its probability if there was one, and the last observation in which it was asked about, with
    the cameras (-1 and none without such an observation)."""

    atom: Atom
    expected: bool | None
    believed: bool | None
    probability: float | None
    observation_id: int = -1
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do next, the reason, and the atoms that it depended on. A decision to stop has the outcome.

    `grounds` has the state of each atom in `evidence`, and `report` is the skill's result, if it was considered.
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
