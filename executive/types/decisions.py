"""Decisions and their reasons, as codes with parameters, and the outcomes of runs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from executive.types.actions import SkillResult, SkillStatus
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


class Reason(StrEnum):
    """The code of a reason for a decision. The comment says which parameters its `Cause` has; docs/reference/reasons.md
    says what each means."""

    # At the first look.
    ALL_KNOWN = "all-known"
    INITIAL_STATE_GIVEN = "initial-state-given"
    CANNOT_TELL = "cannot-tell"  # atoms; ages, if they were asked about before
    UNKNOWN_AS_FALSE = "unknown-as-false"  # atoms
    HIDDEN = "hidden"  # atoms: planned with as they most probably are
    NOTHING_SEEN = "nothing-seen"  # count of looks; steps, if one was carried out before
    # Before a step.
    PRECONDITION_UNMET = "precondition-unmet"  # steps, unmet literals; atoms: those of them that were never seen
    WAITING = "waiting"  # count: which look comes next
    TRIED_ANYWAY = "tried-anyway"  # atoms: never seen, and most probably true
    # After a step.
    AS_EXPECTED = "as-expected"
    SKILL_DONE = "skill-done"  # steps
    SKILL_FAILED = "skill-failed"  # steps, status, detail, seconds that it ended early
    SKILL_FAILED_YET_SEEN = "skill-failed-yet-seen"  # the same; the effects are seen all the same
    SKILL_CRASHED = "skill-crashed"  # steps, detail
    STEP_FAILED = "step-failed"  # steps
    EFFECT_MISSING = "effect-missing"  # atoms
    SEEN_INSTEAD = "seen-instead"  # atoms
    UNEXPECTED = "unexpected"  # atoms
    EFFECTS_ASSUMED = "effects-assumed"
    PLAN_VALID = "plan-valid"
    PLAN_INVALID = "plan-invalid"  # steps: the one that was carried out
    FOUND_OTHERWISE = "found-otherwise"  # atoms: what could not be seen before
    STEPS_UNNEEDED = "steps-unneeded"  # count of total
    RETRY = "retry"  # count of total
    FAILED_WITH_SAME_FACTS = "failed-with-same-facts"  # count
    FAILED_TOO_OFTEN = "failed-too-often"  # count
    # When planning.
    LOOK_FIRST = "look-first"  # literals: the places, the first to be looked at; probabilities and costs of each
    LOOK_ELSEWHERE = "look-elsewhere"  # the same, where the plan at hand looks at another place first
    PLAN_FOUND = "plan-found"  # count of steps
    UNSOLVABLE = "unsolvable"  # steps that had to be avoided, detail, count if it was asked more than once
    PLANNER_TIMED_OUT = "planner-timed-out"  # the same
    PLANNER_CRASHED = "planner-crashed"  # the same
    PLANNER_ASKED_AGAIN = "planner-asked-again"
    BELIEF_DOUBTED = "belief-doubted"
    UNCERTAIN = "uncertain"  # atoms
    OPTIMISTIC_PLAN = "optimistic-plan"  # atoms: what is assumed to be true
    PLAN_WITHOUT_STEP = "plan-without-step"
    PLAN_CLEARS = "plan-clears"  # atoms: what is changed first
    WHOLE_GOAL_REACHABLE = "whole-goal-reachable"
    NOTHING_REACHABLE = "nothing-reachable"
    GOAL_GIVEN_UP = "goal-given-up"  # literals
    GOAL_KEPT = "goal-kept"  # literals
    # When no step is left.
    GOAL_SEEN = "goal-seen"
    GOAL_UNCERTAIN = "goal-uncertain"  # atoms
    GOAL_NOT_SEEN = "goal-not-seen"  # atoms
    GOAL_UNKNOWN = "goal-unknown"  # atoms
    GOAL_RECALLED = "goal-recalled"  # atoms: seen before, and hidden as the goal has it
    TO_BE_SEEN = "to-be-seen"  # atoms of the goal
    GOAL_ONLY_BELIEVED = "goal-only-believed"  # atoms, count of looks
    DONE_AGAIN = "done-again"  # atoms: what is assumed to be true
    REST_OF_GOAL_SEEN = "rest-of-goal-seen"
    REACHABLE_AGAIN = "reachable-again"  # literals
    GIVEN_UP_BEFORE = "given-up-before"  # literals; the causes that follow are why
    GOAL_NOT_OBSERVED = "goal-not-observed"
    # At any time.
    BUDGET_SPENT = "budget-spent"  # what (cycles, actions, looks, replans, seconds), total
    INTERRUPTED = "interrupted"  # detail; what, if it was in a stage of the loop
    STAGE_FAILED = "stage-failed"  # what: the stage of the loop, detail
    RECORDED = "recorded"  # detail: the text of a record from before there were codes


@dataclass(frozen=True, slots=True)
class Cause:
    """One reason of a decision: its code, and the parameters that the code has.

    `atoms` are what it is about, `ages` how many cycles ago each was last seen (None: never), `literals` signed atoms
    or parts of a goal as text, `steps` steps as text. `count`, of `total`, counts what the code says. `probabilities`
    and `costs` are of the literals, one by one. `detail` is what a part from outside said of itself.
    """

    code: Reason
    atoms: tuple[Atom, ...] = ()
    ages: tuple[int | None, ...] = ()
    literals: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()
    status: SkillStatus | None = None
    what: str = ""
    count: int = 0
    total: float = 0.0
    seconds: float = 0.0
    detail: str = ""
    probabilities: tuple[float, ...] = ()
    costs: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Ground:
    """The state of an atom that a decision depended on: its expected value (None: no expectation), its believed
    value (None: unknown), its probability if there was one, and the last observation in which it was asked about, with
    the cameras (-1 and none without such an observation)."""

    atom: Atom
    expected: bool | None
    believed: bool | None
    probability: float | None
    observation_id: int = -1
    cameras: tuple[str, ...] = ()


class Caused:
    """What has causes, the first of which matters most: a decision, or the end of a run."""

    __slots__ = ()
    causes: tuple[Cause, ...]

    @property
    def code(self) -> Reason:
        """The code of the cause that matters most."""
        return self.causes[0].code

    @property
    def codes(self) -> tuple[Reason, ...]:
        """The codes of all causes."""
        return tuple(cause.code for cause in self.causes)


@dataclass(frozen=True, slots=True)
class Decision(Caused):
    """What to do next, the causes, and the atoms that it depended on. A decision to stop has the outcome.

    `grounds` has the state of each atom in `evidence`, and `report` is the skill's result, if it was considered.
    """

    kind: DecisionKind
    causes: tuple[Cause, ...]
    evidence: tuple[Atom, ...] = ()
    outcome: OutcomeKind | None = None
    grounds: tuple[Ground, ...] = ()
    report: SkillResult | None = None

    def __post_init__(self) -> None:
        if not self.causes:
            raise ValueError("a decision has a cause")
        if (self.kind is DecisionKind.STOP) != (self.outcome is not None):
            raise ValueError("a decision carries an outcome if and only if it stops the run")
