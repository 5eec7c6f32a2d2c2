"""What to do next, and why: pure functions from what was seen, what the skill says and the budget to one Decision.

Each function answers at one moment of a turn of the loop. The order of the questions inside it is the policy, so they
are to be read from top to bottom. Nothing is remembered here; every count comes in.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import combinations, islice
from typing import NamedTuple

from executive.core.settings import Settings
from executive.types import (
    ALWAYS,
    Atom,
    Condition,
    Decision,
    DecisionKind,
    Facts,
    NoPlan,
    NoPlanReason,
    OutcomeKind,
    Plan,
    SkillResult,
    SkillStatus,
    Step,
    Verdict,
)


class Failures(NamedTuple):
    """How often a step has failed: while the known facts that bear on it were these, and in all."""

    here: int
    ever: int

    def too_many(self, status: SkillStatus, settings: Settings) -> bool:
        return self.here >= settings.tolerated(status) or self.ever >= settings.bearable(status)


@dataclass(frozen=True, slots=True)
class Turn:
    """What is known once a step was carried out and looked at.

    `verdict` holds what was seen against what was expected of everything that was asked about. `doubts` are the atoms
    that the rest of the plan or the goal hangs on and that no look could tell, each with the number of cycles since it
    was last seen (None: never). `planned` steps were to follow; `rest` are the positions of those that are still to be
    done from what is known, or None when they no longer reach the goal. `repeatable`: they would, if the step were done
    once more. `looks` counts those since the action, `attempt` this step's tries in a row, `failures` how often it has
    failed, this time included.
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


class Doubts(NamedTuple):
    """What a look could be about, the least certain atoms first (none for an executive that cannot look and has no
    reason to doubt what it believes), and those of them that cannot be told, or not with `Settings.sure`."""

    atoms: tuple[Atom, ...] = ()
    unsure: tuple[Atom, ...] = ()


class Dropped(NamedTuple):
    """What of the goal was given up, and why; or what of that is within reach after all, with a plan that reaches what
    is left of the goal, too."""

    goals: Condition
    why: str = ""
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
    def instead(self) -> str:
        """What the plan begins with, in words."""
        return _listed(sorted(self.plan.steps[0].precondition.facts.true))


def first(atoms: Collection[Atom], known: Facts, looks: int, settings: Settings) -> Decision:
    """After a look that opens the run: is there something to plan from?"""
    unknown = tuple(atom for atom in atoms if atom not in known)
    if unknown and looks <= settings.max_looks_again:
        return Decision(DecisionKind.LOOK_AGAIN, f"cannot tell {_listed(unknown)}", unknown)
    if unknown and not known:
        return _stop(OutcomeKind.GAVE_UP, f"nothing can be seen: {_looks(looks)} told no atom", unknown)
    if unknown:
        return Decision(DecisionKind.CONTINUE, f"cannot tell {_listed(unknown)}: planned from as false", unknown)
    return Decision(DecisionKind.CONTINUE, "every atom is known")


def before(
    step: Step, needed: Facts, verdict: Verdict, waits: int, failures: Failures, settings: Settings
) -> Decision | None:
    """Before a step: `verdict` holds the literals `needed` of its precondition against what is known; `waits` looks
    were taken to see them come true; `failures` are those of the step, this one included."""
    # Unknown is never true; in the state that was planned from it is false.
    unmet = tuple(sorted(verdict.violated | {atom for atom in verdict.unknown if needed[atom]}))
    if not unmet:
        return None
    reason = f"{step} cannot begin: {_unmet(unmet, needed, verdict)}"
    if waits < settings.precondition_wait:
        return Decision(DecisionKind.LOOK_AGAIN, f"{reason}; waiting (look {waits + 1})", unmet)
    return _fail(reason, unmet, failures, SkillStatus.NOT_THERE, settings)


def after(turn: Turn, settings: Settings) -> Decision:
    """After a step was carried out and looked at: go on, look once more, try once more, plan anew, give up or stop?"""
    step, result, verdict = turn.step, turn.result, turn.verdict
    may_look = turn.looks <= settings.max_looks_again
    if turn.doubts and may_look:
        return Decision(DecisionKind.LOOK_AGAIN, f"cannot tell {_aged(turn.doubts)}", tuple(turn.doubts))
    if verdict.unknown and not verdict.holds and not verdict.violated:
        reason = f"nothing can be seen any more: {_looks(turn.looks)} after {step} told no atom"
        return _stop(OutcomeKind.GAVE_UP, reason, tuple(sorted(verdict.unknown)))

    surprise, evidence = _surprise(verdict, turn.expected), tuple(sorted(verdict.violated))
    doubt = f"cannot tell {_aged(turn.doubts)}" if turn.doubts else ""
    broken, as_planned = turn.rest is None, turn.rest == tuple(range(turn.planned))
    reported = "" if result.done else f"{_report(result)}{', yet what it was for is seen' if as_planned else ''}"
    # One look is enough where skill and eye agree: both say that it worked, or both say that it did not.
    agreed = as_planned if result.done else broken
    if not agreed and may_look and turn.looks == 1:
        reason = _joined(reported, surprise) or f"{step} is done, yet the plan does not reach the goal from here"
        return Decision(DecisionKind.LOOK_AGAIN, reason, evidence or step.affects)
    if turn.rest is not None:
        skipped = turn.planned - len(turn.rest)
        onward = f"{skipped} of {turn.planned} steps no longer needed" if skipped else "the plan still reaches the goal"
        news = _joined(reported, surprise, doubt)
        reason = _joined(news, onward) if news or skipped else "as expected"
        return Decision(DecisionKind.CONTINUE, reason, evidence or step.affects)
    reason = _joined(reported or f"{step} did not come out", surprise, doubt)
    evidence = evidence or tuple(turn.doubts)
    enough = turn.failures.too_many(result.status, settings)
    if not enough and turn.repeatable and turn.attempt <= settings.max_retries:
        again = f"trying again ({turn.attempt + 1} of {settings.max_retries + 1})"
        return Decision(DecisionKind.RETRY, _joined(reason, again), evidence)
    return _fail(reason, evidence, turn.failures, result.status, settings)


def assumed(result: SkillResult) -> Decision:
    """After a step of an executive that does not look: its effects are assumed, whatever its skill says."""
    said = f"{result.step} is done" if result.done else _report(result)
    return Decision(DecisionKind.CONTINUE, f"{said}; nobody looks, its effects are assumed", result.step.affects)


def crashed(result: SkillResult) -> Decision | None:
    """A skill that raises is a bug, not a failure of the task."""
    if result.status is not SkillStatus.CRASHED:
        return None
    return _stop(OutcomeKind.CRASHED, f"the skill for {result.step} crashed: {result.reason}")


def unplanned(no_plan: NoPlan, times: int, doubts: Doubts, settings: Settings) -> Decision:
    """The planner has no plan, for the `times`-th time in a row for this reason."""
    detail = f": {no_plan.detail}" if no_plan.detail else ""
    without = f" without {_listed(no_plan.without)}" if no_plan.without else ""
    reason = f"the planner answers {no_plan.reason}{without}{detail}"
    if no_plan.reason is not NoPlanReason.UNSOLVABLE:
        if times == 1:
            return Decision(DecisionKind.REPLAN, f"{reason}; asking once more")
        return _stop(OutcomeKind.NO_PLAN, f"{reason}, {times} times")
    if not doubts.atoms:
        return _stop(OutcomeKind.NO_PLAN, reason)
    if times == 1:
        doubted = "looking again at what is least certain, as what is believed may be wrong"
        return Decision(DecisionKind.LOOK_AGAIN, f"{reason}; {doubted}", doubts.atoms)
    if doubts.unsure and times <= settings.max_looks_again:
        return Decision(
            DecisionKind.LOOK_AGAIN, f"{reason}, and {_listed(doubts.unsure)} could be surer", doubts.unsure
        )
    return Decision(DecisionKind.GIVE_UP_GOAL, reason)


def optimistic(cause: Decision, found: OptimisticPlan) -> Decision:
    """`cause` calls for giving up goals, and there is a plan for all of them from a state that is possible."""
    reason = f"{cause.reason}; before any of it is given up, it is tried as if {found.doubted} were so"
    return Decision(DecisionKind.REPLAN, reason, (found.doubted,))


def goes_around(cause: Decision) -> Decision:
    """`cause` calls for giving up goals, as a step fails again and again, and there is a plan for all of them without
    that step."""
    return Decision(DecisionKind.REPLAN, f"{cause.reason}; there is a plan that does without it", cause.evidence)


def given_up(cause: Decision, goal: Condition, kept: Condition, is_stuck: bool) -> Decision:
    """`cause` calls for giving up goals, and `kept` is what of `goal` can be reached. `is_stuck`: there are plans, but
    they hang on a step that fails again and again."""
    dropped = goal.without(kept.conjuncts)
    if kept == ALWAYS:
        reason = f"{cause.reason}; there is no other part of the goal to go for"
        outcome = OutcomeKind.GAVE_UP if is_stuck else OutcomeKind.NO_PLAN
        return _stop(outcome, reason, cause.evidence or _atoms(goal))
    if dropped == ALWAYS:
        return Decision(DecisionKind.REPLAN, f"{cause.reason}; yet there is a plan for the whole goal", cause.evidence)
    reason = f"{cause.reason}; giving up {_conjuncts(dropped)}, going for {_conjuncts(kept)}"
    return Decision(DecisionKind.GIVE_UP_GOAL, reason, _atoms(dropped))


def finish(
    goal: Condition,
    verdict: Verdict,
    unsure: Collection[Atom],
    checks: int,
    dropped: Dropped,
    settings: Settings,
    redo: OptimisticPlan | None = None,
) -> Decision:
    """Nothing is left to do: `verdict` holds the goal against what is seen now, for only seeing it is success, and is
    the `checks`-th one in a row. `unsure` are its atoms, and where some of it was given up all atoms, that cannot be
    told with `Settings.sure`. `redo` would bring about once more what cannot be told."""
    gave_up = dropped.goals != ALWAYS
    once_more, many_more = checks <= min(1, settings.max_looks_again), checks <= settings.max_looks_again
    # What was given up is worth more looks than what holds: it may have come within reach and not be believed yet.
    if verdict.satisfied and unsure and (once_more or (gave_up and many_more)):
        reason = f"{_listed(sorted(unsure))} could be surer"
        return Decision(DecisionKind.LOOK_AGAIN, f"nothing is left to do, but {reason}", tuple(sorted(unsure)))
    if verdict.satisfied and not gave_up:
        return _stop(OutcomeKind.GOAL_REACHED, "the goal is seen to hold", _atoms(goal))
    if verdict.satisfied:
        reason, named = "what was left of the goal is seen to hold", _atoms(dropped.goals)
        back = _conjuncts(dropped.goals)
        if dropped.plan is not None:
            return Decision(DecisionKind.REPLAN, f"{reason}; there is a plan for {back} now", named)
        return _stop(OutcomeKind.PARTIAL, f"{reason}; {back} was given up: {dropped.why}", named)
    wrong, unknown = tuple(sorted(verdict.violated)), tuple(sorted(verdict.unknown))
    missing = _joined(
        f"not seen as the goal has it: {_listed(wrong)}" if wrong else "",
        f"cannot tell {_listed(unknown)}" if unknown else "",
    )
    # One more look is enough to believe what is seen; what cannot be told is worth all of them.
    if once_more or (unknown and many_more):
        return Decision(DecisionKind.LOOK_AGAIN, f"nothing is left to do, but {missing}", wrong + unknown)
    if wrong:
        return Decision(DecisionKind.REPLAN, f"nothing is left to do, but {missing}", wrong)
    if redo is not None:
        reason = f"{missing} in {_looks(checks)}: done once more, as if {redo.instead}"
        return Decision(DecisionKind.REPLAN, f"the goal is believed to hold, but {reason}", (redo.doubted,))
    outcome = OutcomeKind.PARTIAL if verdict.holds else OutcomeKind.GAVE_UP
    return _stop(outcome, f"the goal is believed to hold, but {missing} in {_looks(checks)}", unknown)


def finish_blind(goal: Condition) -> Decision:
    """Nothing is left to do for an executive that does not look: it believes what it assumed."""
    reason = "the plan is carried out; nobody looked whether the goal holds"
    return _stop(OutcomeKind.PLAN_COMPLETED, reason, _atoms(goal))


def exhausted(settings: Settings, **used: float) -> Decision | None:
    """Whether taking one more of these (`cycles`, `actions`, `looks`, `replans`, `seconds`) would exceed the budget."""
    for what, count in used.items():
        limit = getattr(settings, f"max_{what}")
        if count >= limit:
            return _stop(OutcomeKind.GAVE_UP, f"the budget of {limit:g} {what} is used up")
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


def _stop(outcome: OutcomeKind, reason: str, evidence: tuple[Atom, ...] = ()) -> Decision:
    return Decision(DecisionKind.STOP, reason, evidence, outcome)


def _fail(
    reason: str, evidence: tuple[Atom, ...], failures: Failures, status: SkillStatus, settings: Settings
) -> Decision:
    """Plan anew, unless that has led here too often."""
    if not failures.too_many(status, settings):
        return Decision(DecisionKind.REPLAN, reason, evidence)
    here = failures.here >= settings.tolerated(status)
    count, where = (failures.here, "from the same known facts") if here else (failures.ever, "by now")
    times = "for the first time" if count == 1 else f"{count} times"
    return Decision(DecisionKind.GIVE_UP_GOAL, f"{reason}; it came to this {times} {where}", evidence)


def _surprise(verdict: Verdict, expected: Facts) -> str:
    missing = sorted(atom for atom in verdict.violated if expected[atom])
    instead = sorted(atom for atom in verdict.violated if not expected[atom])
    if missing:
        seen = f"; seen instead: {_listed(instead)}" if instead else ""
        return f"{_listed(missing)} not seen as expected{seen}"
    return f"{_listed(instead)} seen, which was not expected" if instead else ""


def _unmet(atoms: Collection[Atom], wanted: Facts, verdict: Verdict) -> str:
    def unmet(atom: Atom) -> str:
        if atom in verdict.unknown:
            return f"{atom} was never seen"
        return f"{atom} does not hold" if wanted[atom] else f"{atom} holds"

    return _listed([unmet(atom) for atom in atoms])


def _report(result: SkillResult) -> str:
    saved = result.planned_seconds - result.seconds
    early = f" ({saved:.1f} s early)" if saved >= 0.05 else ""
    return f"{result.step} reports {result.status}{f': {result.reason}' if result.reason else ''}{early}"


def _aged(doubts: Mapping[Atom, int | None]) -> str:
    def aged(atom: Atom, age: int | None) -> str:
        return f"{atom} (never seen)" if age is None else f"{atom} (last seen {age} cycle{'s' * (age != 1)} ago)"

    return _listed([aged(atom, age) for atom, age in doubts.items()])


def _listed(things: Collection[object], most: int = 4) -> str:
    shown = ", ".join(str(thing) for thing in list(things)[:most])
    return f"{shown} and {len(things) - most} more" if len(things) > most else shown


def _conjuncts(condition: Condition) -> str:
    return _listed(condition.texts())


def _atoms(condition: Condition) -> tuple[Atom, ...]:
    return tuple(sorted(condition.atoms))


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _looks(count: int) -> str:
    return "one look" if count == 1 else f"{count} looks"
