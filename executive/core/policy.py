"""The policy: pure functions from verdict, skill report and budget to one Decision with its causes.

Each function decides at one point of a cycle. The order of the conditions inside it is the policy, so they are to be
read from top to bottom. Nothing is remembered here; every count is an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, islice
from typing import NamedTuple

from executive.core.settings import Settings
from executive.types import (
    ALWAYS,
    Atom,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Facts,
    NoPlan,
    NoPlanReason,
    OutcomeKind,
    Plan,
    Reason,
    SearchOrder,
    SkillResult,
    SkillStatus,
    Step,
    Verdict,
)


class Failures(NamedTuple):
    """How often a step has failed: with the present relevant facts (`here`), and in all since it last worked."""

    here: int
    ever: int

    def too_many(self, status: SkillStatus, settings: Settings) -> bool:
        """Return whether the step is to be given up on."""
        same, ever = settings.max_failures_with_same_facts(status), settings.max_failures_ever(status)
        return self.here >= same or self.ever >= ever


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What is known once a step was carried out and looked at.

    Attributes:
        verdict: what was seen against what was expected, for all that was asked about.
        doubts: the atoms that the rest of the plan or the goal depends on and that no look could tell, each with the
            number of cycles since it was last seen (None: never).
        planned: how many steps were to follow.
        rest: the positions of those that are still to be done from what is known; None if they do not reach the goal.
        repeatable: whether they would if the step were carried out once more.
        looks: how many there were since the action.
        attempt: this step's tries in a row.
        failures: how often it has failed, this time included.
        found_otherwise: the atoms that could not be seen before, and are not as the plan took them to be.
    """

    step: Step
    result: SkillResult
    expected: Facts
    verdict: Verdict
    doubts: Mapping[Atom, int | None]
    planned: int
    rest: tuple[int, ...] | None
    repeatable: bool
    looks: int
    attempt: int
    failures: Failures
    found_otherwise: tuple[Atom, ...] = ()

    @property
    def is_found_otherwise(self) -> bool:
        """Whether the step came out, and what it shows calls for another plan."""
        is_done = self.result.done and not self.verdict.violated
        return self.rest is None and is_done and bool(self.found_otherwise)


class UncertainAtoms(NamedTuple):
    """The atoms that a look could ask about, the least certain first (none for an executive that does not look), and
    those of them that cannot be told, or not with `Settings.sure`."""

    atoms: tuple[Atom, ...] = ()
    unsure: tuple[Atom, ...] = ()


class GivenUp(NamedTuple):
    """The parts of the goal that were given up, and why; or those of them that can be reached after all, with a plan
    that reaches the rest of the goal, too."""

    goals: Condition
    why: tuple[Cause, ...] = ()
    plan: Plan | None = None


class OptimisticPlan(NamedTuple):
    """A plan from a state that is less probable than the believed one.

    Attributes:
        doubted: the atom in which that state differs.
        state: the most probable state in which it does.
        plan: reaches the goal from there.
    """

    doubted: Atom
    state: Facts
    plan: Plan

    @property
    def instead(self) -> tuple[Atom, ...]:
        """The positive literals that the plan's first step needs."""
        return tuple(sorted(self.plan.steps[0].precondition.facts.true))


class ClearingPlan(NamedTuple):
    """A plan for the goal that first makes an atom false which kept one of its steps from being done."""

    moved: Atom
    plan: Plan


def first(
    atoms: Collection[Atom], known: Facts, looks: int, settings: Settings, hidden: Collection[Atom] = ()
) -> Decision:
    """After a look that opens the run: is there something to plan from? What is `hidden` cannot be told by looking."""
    unknown = tuple(atom for atom in atoms if atom not in known and atom not in hidden)
    found_out = (Cause(Reason.HIDDEN, tuple(sorted(hidden))),) if hidden else ()
    if unknown and looks <= settings.max_looks_again:
        return Decision(DecisionKind.LOOK_AGAIN, (Cause(Reason.CANNOT_TELL, unknown),), unknown)
    if unknown and not known:
        return _stop(OutcomeKind.GAVE_UP, Cause(Reason.NOTHING_SEEN, count=looks), evidence=unknown)
    if unknown:
        return Decision(DecisionKind.CONTINUE, (Cause(Reason.UNKNOWN_AS_FALSE, unknown), *found_out), unknown)
    return Decision(DecisionKind.CONTINUE, found_out or (Cause(Reason.ALL_KNOWN),))


def before(
    step: Step,
    needed: Facts,
    verdict: Verdict,
    waits: int,
    failures: Failures,
    settings: Settings,
    is_likely: bool = False,
) -> Decision | None:
    """Before a step: `verdict` holds the literals `needed` of its precondition against what is known; `waits` looks
    were taken to see them come true; `failures` are those of the step, this one included; `is_likely` says whether they
    hold in the most probable state. It is better to try the step than to give up because looks do not tell."""
    # Unknown is never true; in the state that was planned from it is false.
    unmet = tuple(sorted(verdict.violated | {atom for atom in verdict.unknown if needed[atom]}))
    if not unmet:
        return None
    never_seen = tuple(atom for atom in unmet if atom in verdict.unknown)
    literals = needed.only(unmet).literals()
    cause = Cause(Reason.PRECONDITION_UNMET, never_seen, literals=literals, steps=(str(step),))
    if waits < settings.precondition_wait:
        return Decision(DecisionKind.LOOK_AGAIN, (cause, Cause(Reason.WAITING, count=waits + 1)), unmet)
    if is_likely and not verdict.violated and failures.too_many(SkillStatus.NOT_THERE, settings):
        return Decision(DecisionKind.CONTINUE, (cause, Cause(Reason.TRIED_ANYWAY, never_seen)), unmet)
    return _fail((cause,), unmet, failures, SkillStatus.NOT_THERE, settings)


def after(turn: StepOutcome, settings: Settings) -> Decision:
    """After a step was carried out and looked at: go on, look once more, try once more, plan anew, give up or stop?"""
    step, result, verdict = turn.step, turn.result, turn.verdict
    may_look = turn.looks <= settings.max_looks_again
    doubts, named = _doubts(turn.doubts), (str(step),)
    if turn.doubts and may_look:
        return Decision(DecisionKind.LOOK_AGAIN, doubts, tuple(turn.doubts))
    if verdict.unknown and not verdict.holds and not verdict.violated:
        blind = Cause(Reason.NOTHING_SEEN, steps=named, count=turn.looks)
        return _stop(OutcomeKind.GAVE_UP, blind, evidence=tuple(sorted(verdict.unknown)))

    surprises, evidence = _surprises(verdict, turn.expected), tuple(sorted(verdict.violated))
    broken, as_planned = turn.rest is None, turn.rest == tuple(range(turn.planned))
    reported = () if result.done else (_report(result, seen_done=as_planned),)
    # One look is enough where skill and estimator agree: both say that it worked, or both say that it did not.
    agreed = as_planned if result.done else broken
    if not agreed and may_look and turn.looks == 1:
        broken_plan = () if reported or surprises else (Cause(Reason.PLAN_INVALID, steps=named),)
        return Decision(DecisionKind.LOOK_AGAIN, (*reported, *surprises, *broken_plan), evidence or step.affects)
    if turn.rest is not None:
        causes, skipped = (*reported, *surprises, *doubts), turn.planned - len(turn.rest)
        if skipped:
            causes += (Cause(Reason.STEPS_UNNEEDED, count=skipped, total=turn.planned),)
        elif causes:
            causes += (Cause(Reason.PLAN_VALID),)
        return Decision(DecisionKind.CONTINUE, causes or (Cause(Reason.AS_EXPECTED),), evidence or step.affects)
    if turn.is_found_otherwise:
        found = Cause(Reason.FOUND_OTHERWISE, turn.found_otherwise)
        return Decision(DecisionKind.REPLAN, (found, *doubts), turn.found_otherwise)
    causes = (*(reported or (Cause(Reason.STEP_FAILED, steps=named),)), *surprises, *doubts)
    evidence = evidence or tuple(turn.doubts)
    enough = turn.failures.too_many(result.status, settings)
    if not enough and turn.repeatable and turn.attempt <= settings.max_retries:
        again = Cause(Reason.RETRY, count=turn.attempt + 1, total=settings.max_retries + 1)
        return Decision(DecisionKind.RETRY, (*causes, again), evidence)
    return _fail(causes, evidence, turn.failures, result.status, settings)


def assumed(result: SkillResult) -> Decision:
    """After a step of an executive that does not look: its effects are assumed, whatever its skill says."""
    said = Cause(Reason.SKILL_DONE, steps=(str(result.step),)) if result.done else _report(result)
    return Decision(DecisionKind.CONTINUE, (said, Cause(Reason.EFFECTS_ASSUMED)), result.step.affects)


def crashed(result: SkillResult) -> Decision | None:
    """A skill that raises is a bug, not a failure of the task."""
    if result.status is not SkillStatus.CRASHED:
        return None
    cause = Cause(Reason.SKILL_CRASHED, steps=(str(result.step),), detail=result.reason)
    return _stop(OutcomeKind.CRASHED, cause)


def unplanned(no_plan: NoPlan, times: int, doubts: UncertainAtoms, settings: Settings) -> Decision:
    """The planner has no plan, for the `times`-th time in a row for this reason."""
    code = _NO_PLAN[no_plan.reason]
    cause = Cause(code, steps=no_plan.without, detail=no_plan.detail)
    if no_plan.reason is not NoPlanReason.UNSOLVABLE:
        if times == 1:
            return Decision(DecisionKind.REPLAN, (cause, Cause(Reason.PLANNER_ASKED_AGAIN)))
        return _stop(OutcomeKind.NO_PLAN, replace(cause, count=times))
    if not doubts.atoms:
        return _stop(OutcomeKind.NO_PLAN, cause)
    if times == 1:
        return Decision(DecisionKind.LOOK_AGAIN, (cause, Cause(Reason.BELIEF_DOUBTED)), doubts.atoms)
    if doubts.unsure and times <= settings.max_looks_again:
        return Decision(DecisionKind.LOOK_AGAIN, (cause, Cause(Reason.UNCERTAIN, doubts.unsure)), doubts.unsure)
    return Decision(DecisionKind.GIVE_UP_GOAL, (cause,))


def optimistic(cause: Decision, found: OptimisticPlan) -> Decision:
    """`cause` calls for giving up goals, and there is a plan for all of them from a state that is possible."""
    tried = Cause(Reason.OPTIMISTIC_PLAN, (found.doubted,))
    return Decision(DecisionKind.REPLAN, (*cause.causes, tried), (found.doubted,))


def goes_around(cause: Decision) -> Decision:
    """`cause` calls for giving up goals, as a step fails again and again, and there is a plan for all of them without
    that step."""
    return Decision(DecisionKind.REPLAN, (*cause.causes, Cause(Reason.PLAN_WITHOUT_STEP)), cause.evidence)


def clears(cause: Decision, found: ClearingPlan) -> Decision:
    """`cause` calls for giving up goals, as something is in the way of a step, and there is a plan for all of them that
    moves it away before."""
    return Decision(DecisionKind.REPLAN, (*cause.causes, Cause(Reason.PLAN_CLEARS, (found.moved,))), cause.evidence)


def given_up(cause: Decision, goal: Condition, kept: Condition, is_stuck: bool) -> Decision:
    """`cause` calls for giving up goals, and `kept` is the part of `goal` that can be reached. `is_stuck`: there are
    plans, but they contain a step that fails again and again."""
    dropped = goal.without(kept.conjuncts)
    if kept == ALWAYS:
        outcome = OutcomeKind.GAVE_UP if is_stuck else OutcomeKind.NO_PLAN
        nothing = Cause(Reason.NOTHING_REACHABLE)
        return _stop(outcome, *cause.causes, nothing, evidence=cause.evidence or _atoms(goal))
    if dropped == ALWAYS:
        return Decision(DecisionKind.REPLAN, (*cause.causes, Cause(Reason.WHOLE_GOAL_REACHABLE)), cause.evidence)
    parts = Cause(Reason.GOAL_GIVEN_UP, literals=dropped.texts()), Cause(Reason.GOAL_KEPT, literals=kept.texts())
    return Decision(DecisionKind.GIVE_UP_GOAL, (*cause.causes, *parts), _atoms(dropped))


def finish(
    goal: Condition,
    verdict: Verdict,
    unsure: Collection[Atom],
    checks: int,
    dropped: GivenUp,
    settings: Settings,
    redo: OptimisticPlan | None = None,
    remembered: tuple[Atom, ...] = (),
) -> Decision:
    """Nothing is left to do: `verdict` holds the goal against what is seen now, for only seeing it is success, and is
    the `checks`-th one in a row. `unsure` are its atoms, and where some of it was given up all atoms, that cannot be
    told with `Settings.sure`. `redo` would bring about once more what cannot be told. `remembered` are its atoms that
    were seen before and are hidden now, as the goal has it."""
    gave_up = dropped.goals != ALWAYS
    recalled = (Cause(Reason.GOAL_RECALLED, remembered),) if remembered else ()
    once_more, many_more = checks <= min(1, settings.max_looks_again), checks <= settings.max_looks_again
    # What was given up is worth more looks than what holds: it may have come within reach and not be believed yet.
    if verdict.satisfied and unsure and (once_more or (gave_up and many_more)):
        atoms = tuple(sorted(unsure))
        return Decision(DecisionKind.LOOK_AGAIN, (Cause(Reason.GOAL_UNCERTAIN, atoms),), atoms)
    if verdict.satisfied and not gave_up:
        return _stop(OutcomeKind.GOAL_REACHED, Cause(Reason.GOAL_SEEN), *recalled, evidence=_atoms(goal))
    if verdict.satisfied:
        seen, literals, named = Cause(Reason.REST_OF_GOAL_SEEN), dropped.goals.texts(), _atoms(dropped.goals)
        if dropped.plan is not None:
            return Decision(DecisionKind.REPLAN, (seen, Cause(Reason.REACHABLE_AGAIN, literals=literals)), named)
        before_ = Cause(Reason.GIVEN_UP_BEFORE, literals=literals)
        return _stop(OutcomeKind.PARTIAL, seen, before_, *dropped.why, evidence=named)
    wrong, unknown = tuple(sorted(verdict.violated)), tuple(sorted(verdict.unknown))
    missing = [Cause(Reason.GOAL_NOT_SEEN, wrong)] if wrong else [Cause(Reason.GOAL_UNKNOWN, unknown)]
    if wrong and unknown:
        missing.append(Cause(Reason.CANNOT_TELL, unknown))
    # One more look is enough to believe what is seen; what cannot be told is worth all of them.
    if once_more or (unknown and many_more):
        return Decision(DecisionKind.LOOK_AGAIN, tuple(missing), wrong + unknown)
    if wrong:
        return Decision(DecisionKind.REPLAN, tuple(missing), wrong)
    believed = Cause(Reason.GOAL_ONLY_BELIEVED, unknown, count=checks)
    if redo is not None:
        again = Cause(Reason.DONE_AGAIN, redo.instead)
        return Decision(DecisionKind.REPLAN, (believed, again), (redo.doubted,))
    outcome = OutcomeKind.PARTIAL if verdict.holds else OutcomeKind.GAVE_UP
    return _stop(outcome, believed, evidence=unknown)


def look_for(atom: Atom) -> Decision:
    """What the goal or a step hangs on cannot be seen from here, and there is a plan to see it."""
    return Decision(DecisionKind.REPLAN, (Cause(Reason.TO_BE_SEEN, (atom,)),), (atom,))


def look_first(order: SearchOrder) -> Decision:
    """What the goal needs is not known to be anywhere: this is where to look first."""
    return Decision(DecisionKind.CONTINUE, (_places(Reason.LOOK_FIRST, order),), _at(order))


def look_elsewhere(order: SearchOrder) -> Decision:
    """The plan goes on, and by what was seen since there is a better place to look first than the next of the plan."""
    return Decision(DecisionKind.REPLAN, (_places(Reason.LOOK_ELSEWHERE, order),), _at(order))


def finish_blind(goal: Condition) -> Decision:
    """Nothing is left to do for an executive that does not look: it believes what it assumed."""
    return _stop(OutcomeKind.PLAN_COMPLETED, Cause(Reason.GOAL_NOT_OBSERVED), evidence=_atoms(goal))


def exhausted(settings: Settings, **used: float) -> Decision | None:
    """Return whether taking one more of these (`cycles`, `actions`, `looks`, `replans`, `seconds`) would exceed the
    budget."""
    for what, count in used.items():
        limit = getattr(settings, f"max_{what}")
        if count >= limit:
            return _stop(OutcomeKind.GAVE_UP, Cause(Reason.BUDGET_SPENT, what=what, total=limit))
    return None


def largest_reachable(
    goal: Condition, plan_for: Callable[[Condition], Plan | None], max_plans: int
) -> tuple[Condition, Plan | None]:
    """The largest part of `goal` for which there is a plan, and the plan; nothing and None when there is no such part.

    What cannot be reached alone cannot be reached with more, so each conjunct is tried alone, then all that have a plan
    together, then one fewer, and so on. After `max_plans` of these combinations the part is grown one conjunct at a
    time instead, which ends with a part that nothing can be added to but perhaps not with the largest.
    """
    alone = {part: plan for part in goal.conjuncts if (plan := plan_for(part)) is not None}
    together = (parts for size in range(len(alone), 1, -1) for parts in combinations(alone, size))
    for parts in islice(together, max_plans):
        if (plan := plan_for(goal.only(parts))) is not None:
            return goal.only(parts), plan
    kept: tuple[Condition, ...] = ()
    best: Plan | None = None
    for part in alone:
        if (plan := plan_for(goal.only((*kept, part))) if kept else alone[part]) is not None:
            kept, best = (*kept, part), plan
    return goal.only(kept), best


_NO_PLAN = {
    NoPlanReason.UNSOLVABLE: Reason.UNSOLVABLE,
    NoPlanReason.TIMED_OUT: Reason.PLANNER_TIMED_OUT,
    NoPlanReason.CRASHED: Reason.PLANNER_CRASHED,
}


def _stop(outcome: OutcomeKind, *causes: Cause, evidence: tuple[Atom, ...] = ()) -> Decision:
    return Decision(DecisionKind.STOP, causes, evidence, outcome)


def _fail(
    causes: tuple[Cause, ...], evidence: tuple[Atom, ...], failures: Failures, status: SkillStatus, settings: Settings
) -> Decision:
    """Plan anew, unless that has led here too often."""
    if not failures.too_many(status, settings):
        return Decision(DecisionKind.REPLAN, causes, evidence)
    often = Cause(Reason.FAILED_TOO_OFTEN, count=failures.ever)
    if failures.here >= settings.max_failures_with_same_facts(status):
        often = Cause(Reason.FAILED_WITH_SAME_FACTS, count=failures.here)
    return Decision(DecisionKind.GIVE_UP_GOAL, (*causes, often), evidence)


def _surprises(verdict: Verdict, expected: Facts) -> tuple[Cause, ...]:
    missing = tuple(sorted(atom for atom in verdict.violated if expected[atom]))
    instead = tuple(sorted(atom for atom in verdict.violated if not expected[atom]))
    if not missing:
        return (Cause(Reason.UNEXPECTED, instead),) if instead else ()
    return (Cause(Reason.EFFECT_MISSING, missing), *((Cause(Reason.SEEN_INSTEAD, instead),) if instead else ()))


def _doubts(ages: Mapping[Atom, int | None]) -> tuple[Cause, ...]:
    return (Cause(Reason.CANNOT_TELL, tuple(ages), tuple(ages.values())),) if ages else ()


def _report(result: SkillResult, seen_done: bool = False) -> Cause:
    return Cause(
        Reason.SKILL_FAILED_YET_SEEN if seen_done else Reason.SKILL_FAILED,
        steps=(str(result.step),),
        status=result.status,
        seconds=max(0.0, result.planned_seconds - result.seconds),
        detail=result.reason,
    )


def _places(code: Reason, order: SearchOrder) -> Cause:
    return Cause(
        code,
        literals=tuple(str(place.condition) for place in order.places),
        probabilities=tuple(round(place.probability, 4) for place in order.places),
        costs=tuple(round(place.expected, 4) for place in order.places),
    )


def _at(order: SearchOrder) -> tuple[Atom, ...]:
    """What is sought: the atoms that are taken to be true."""
    return tuple(sorted(order.assumed.true))


def _atoms(condition: Condition) -> tuple[Atom, ...]:
    return tuple(sorted(condition.atoms))
