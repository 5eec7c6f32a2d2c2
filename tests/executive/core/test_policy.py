"""The decisions: one test for each question that the policy asks, and laws over all of its answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from executive.core import policy
from executive.core.policy import Failures, GivenUp, StepOutcome, UncertainAtoms
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
    SkillResult,
    SkillStatus,
    Step,
    Verdict,
)
from tests.fakes import FREE, at, budget, held, pick, put

SETTINGS = Settings()
STEP = put("a", "q")
EXPECTED = Facts({at("a", "q"): True, at("a", "r"): False, held("a"): False, FREE: True})
AS_EXPECTED = Verdict(holds=frozenset(EXPECTED))
ELSEWHERE = Verdict(holds=frozenset({held("a"), FREE}), violated=frozenset({at("a", "q"), at("a", "r")}))
BLACK = Verdict(unknown=frozenset(EXPECTED))
ONCE = Failures(1, 1)
OUT_OF_REACH = (Cause(Reason.SKILL_FAILED, steps=("pick(b,p)",), status=SkillStatus.UNREACHABLE),)


def times(count: int) -> Failures:
    return Failures(count, count)


def turn(status: SkillStatus = SkillStatus.DONE, **changes: object) -> StepOutcome:
    usual = StepOutcome(
        STEP,
        SkillResult(STEP, status),
        EXPECTED,
        AS_EXPECTED,
        doubts={},
        planned=2,
        rest=(0, 1),
        repeatable=False,
        looks=1,
        attempt=1,
        failures=ONCE,
    )
    return replace(usual, **changes)  # type: ignore[arg-type]


def after(status: SkillStatus = SkillStatus.DONE, **changes: object) -> Decision:
    return policy.after(turn(status, **changes), SETTINGS)


def test_all_as_expected_goes_on() -> None:
    decision = after()
    assert (decision.kind, decision.codes) == (DecisionKind.CONTINUE, (Reason.AS_EXPECTED,))


def test_a_surprise_that_matters_is_looked_at_once_more_and_then_believed() -> None:
    first = after(verdict=ELSEWHERE, rest=None)
    assert first.kind is DecisionKind.LOOK_AGAIN
    second = after(verdict=ELSEWHERE, rest=None, looks=2)
    assert second.kind is DecisionKind.REPLAN
    assert second.causes == (
        Cause(Reason.STEP_FAILED, steps=("place(a,q)",)),
        Cause(Reason.EFFECT_MISSING, (at("a", "q"),)),
        Cause(Reason.SEEN_INSTEAD, (at("a", "r"),)),
    )
    assert second.evidence == (at("a", "q"), at("a", "r"))


def test_a_surprise_that_changes_nothing_is_believed_at_once() -> None:
    decision = after(verdict=ELSEWHERE)
    assert decision.kind is DecisionKind.CONTINUE
    assert decision.codes == (Reason.EFFECT_MISSING, Reason.SEEN_INSTEAD, Reason.PLAN_VALID)


def test_skill_and_eye_that_agree_on_a_failure_need_no_second_look() -> None:
    decision = after(SkillStatus.DROPPED, verdict=ELSEWHERE, rest=None)
    assert decision.kind is DecisionKind.REPLAN
    assert decision.causes[0] == Cause(Reason.SKILL_FAILED, steps=("place(a,q)",), status=SkillStatus.DROPPED)
    assert decision.codes[1:] == (Reason.EFFECT_MISSING, Reason.SEEN_INSTEAD)


def test_what_is_seen_wins_over_what_the_skill_reports() -> None:
    assert after(SkillStatus.DROPPED).kind is DecisionKind.LOOK_AGAIN
    believed = after(SkillStatus.DROPPED, looks=2)
    assert (believed.kind, believed.code) == (DecisionKind.CONTINUE, Reason.SKILL_FAILED_YET_SEEN)
    assert after(SkillStatus.DONE, verdict=ELSEWHERE, rest=None, looks=2).kind is DecisionKind.REPLAN


def test_time_that_an_early_end_saved_is_told() -> None:
    result = SkillResult(STEP, SkillStatus.DROPPED, "nothing between the fingers", seconds=2.0, planned_seconds=5.25)
    decision = policy.after(turn(result=result, verdict=ELSEWHERE, rest=None), SETTINGS)
    cause = decision.causes[0]
    assert (cause.status, cause.detail, cause.seconds) == (SkillStatus.DROPPED, "nothing between the fingers", 3.25)


def test_steps_that_are_done_already_are_left_out_after_a_second_look() -> None:
    assert after(verdict=ELSEWHERE, rest=(1,)).kind is DecisionKind.LOOK_AGAIN
    decision = after(verdict=ELSEWHERE, rest=(1,), looks=2)
    assert decision.kind is DecisionKind.CONTINUE
    assert decision.causes[-1] == Cause(Reason.STEPS_UNNEEDED, count=1, total=2)


def test_retries_are_bounded_in_a_row_and_over_the_run() -> None:
    missed = SkillStatus.GRASP_MISSED
    kinds = [
        after(missed, rest=None, repeatable=True, attempt=attempt).kind
        for attempt in range(1, SETTINGS.max_retries + 3)
    ]
    assert kinds == [DecisionKind.RETRY] * SETTINGS.max_retries + [DecisionKind.REPLAN] * 2
    circles = after(missed, rest=None, repeatable=True, failures=times(SETTINGS.max_failures))
    assert circles.kind is DecisionKind.GIVE_UP_GOAL
    assert circles.causes[-1] == Cause(Reason.FAILED_WITH_SAME_FACTS, count=10)


def test_what_does_not_fit_is_not_tried_again() -> None:
    decision = after(SkillStatus.DOES_NOT_FIT, rest=None, repeatable=True, failures=times(1))
    assert decision.kind is DecisionKind.GIVE_UP_GOAL


@pytest.mark.parametrize("status", [SkillStatus.GRASP_MISSED, SkillStatus.UNREACHABLE])
def test_some_more_failures_are_too_many_whatever_was_known(status: SkillStatus) -> None:
    most = SETTINGS.max_failures_ever(status)
    assert most > SETTINGS.max_failures_with_same_facts(status)
    elsewhere = [after(status, rest=None, repeatable=True, failures=Failures(1, ever)) for ever in (most - 1, most)]
    assert [decision.kind for decision in elsewhere] == [DecisionKind.RETRY, DecisionKind.GIVE_UP_GOAL]
    assert elsewhere[1].causes[-1] == Cause(Reason.FAILED_TOO_OFTEN, count=most)


def test_a_step_whose_preconditions_are_gone_is_not_tried_again() -> None:
    assert after(SkillStatus.GRASP_MISSED, rest=None, repeatable=False).kind is DecisionKind.REPLAN


def test_where_chance_plays_no_part_patience_is_shorter() -> None:
    few = SETTINGS.max_retries + 2
    assert (
        after(SkillStatus.UNREACHABLE, rest=None, repeatable=True, failures=times(few)).kind
        is DecisionKind.GIVE_UP_GOAL
    )
    assert after(SkillStatus.DROPPED, rest=None, repeatable=True, failures=times(few)).kind is DecisionKind.RETRY


def test_a_doubt_that_matters_is_looked_at_as_often_as_allowed() -> None:
    doubts = {at("a", "q"): None, FREE: 3}
    for looks in range(1, SETTINGS.max_looks_again + 1):
        decision = after(doubts=doubts, rest=None, looks=looks)
        assert decision.kind is DecisionKind.LOOK_AGAIN
        assert decision.causes == (Cause(Reason.CANNOT_TELL, tuple(doubts), (None, 3)),)
    looks = SETTINGS.max_looks_again + 1
    assert after(doubts=doubts, rest=None, looks=looks).kind is DecisionKind.REPLAN
    assert after(doubts=doubts, looks=looks).kind is DecisionKind.CONTINUE, "what was last known carries the plan"


def test_an_eye_that_tells_nothing_ends_the_run_by_name() -> None:
    doubts = dict.fromkeys(EXPECTED)
    assert after(verdict=BLACK, doubts=doubts, rest=None).kind is DecisionKind.LOOK_AGAIN
    decision = after(verdict=BLACK, doubts=doubts, rest=None, looks=4)
    assert (decision.kind, decision.outcome) == (DecisionKind.STOP, OutcomeKind.GAVE_UP)
    assert decision.causes == (Cause(Reason.NOTHING_SEEN, steps=("place(a,q)",), count=4),)


def test_without_looks_to_spare_the_first_one_decides() -> None:
    stingy = Settings(max_looks_again=0)
    assert policy.after(turn(verdict=ELSEWHERE, rest=None), stingy).kind is DecisionKind.REPLAN
    assert policy.after(turn(SkillStatus.DROPPED), stingy).kind is DecisionKind.CONTINUE


atoms = st.frozensets(st.sampled_from(sorted(EXPECTED)))


@st.composite
def turns(draw: st.DrawFn) -> StepOutcome:
    holds = draw(atoms)
    violated = draw(atoms) - holds
    planned = draw(st.integers(0, 3))
    chosen = draw(st.none() | st.sets(st.integers(0, planned - 1) if planned else st.nothing()))
    return turn(
        draw(st.sampled_from([status for status in SkillStatus if status is not SkillStatus.CRASHED])),
        verdict=Verdict(holds, violated, frozenset(EXPECTED) - holds - violated),
        doubts=dict.fromkeys(sorted(draw(atoms) - holds - violated), draw(st.none() | st.integers(0, 9))),
        planned=planned,
        rest=None if chosen is None else tuple(sorted(chosen)),
        repeatable=draw(st.booleans()),
        looks=draw(st.integers(1, 5)),
        attempt=draw(st.integers(1, 5)),
        failures=draw(
            st.builds(lambda here, more: Failures(here, here + more), st.integers(1, 12), st.integers(0, 12))
        ),
    )


@given(turns(), st.integers(0, 3), st.integers(0, 3), st.integers(1, 6))
@example(turn(rest=None), 1, 1, 1)
def test_every_turn_is_decided_within_its_budget_and_with_a_reason(
    some: StepOutcome, looks_again: int, retries: int, failures: int
) -> None:
    settings = Settings(max_looks_again=looks_again, max_retries=retries, max_failures=failures)
    decision = policy.after(some, settings)
    assert len(set(decision.codes)) == len(decision.codes)
    if decision.kind is DecisionKind.LOOK_AGAIN:
        assert some.looks <= looks_again
    elif decision.kind is DecisionKind.RETRY:
        assert some.repeatable
        assert some.attempt <= retries
        assert some.failures.here < failures
        assert some.failures.ever < settings.max_failures_ever(some.result.status)
    elif decision.kind is DecisionKind.CONTINUE:
        assert some.rest is not None
    elif decision.kind is DecisionKind.STOP:
        assert some.verdict.unknown == set(EXPECTED)
    else:
        assert some.rest is None
        given_up = decision.kind is DecisionKind.GIVE_UP_GOAL
        assert given_up == some.failures.too_many(some.result.status, settings)


def before(step: Step, verdict: Verdict, waits: int, failures: Failures, settings: Settings) -> Decision | None:
    return policy.before(step, step.precondition.facts, verdict, waits, failures, settings)


def test_a_step_begins_when_its_preconditions_are_known_to_hold() -> None:
    step = pick("a", "p")
    assert (
        policy.before(
            step, step.precondition.facts, Verdict(holds=frozenset(step.precondition.facts)), 0, ONCE, SETTINGS
        )
        is None
    )


def test_a_precondition_is_waited_for_a_few_looks_and_then_is_a_failure() -> None:
    step = pick("a", "p")
    verdict = Verdict(frozenset({FREE}), frozenset({at("a", "p")}))
    for waits in range(SETTINGS.precondition_wait):
        decision = before(step, verdict, waits, ONCE, SETTINGS)
        assert decision is not None
        assert decision.kind is DecisionKind.LOOK_AGAIN
    failed = before(step, verdict, SETTINGS.precondition_wait, ONCE, SETTINGS)
    cause = Cause(Reason.PRECONDITION_UNMET, literals=("at(a,p)",), steps=("pick(a,p)",))
    assert failed == Decision(DecisionKind.REPLAN, (cause,), (at("a", "p"),))
    given_up = policy.before(
        step, step.precondition.facts, verdict, SETTINGS.precondition_wait, times(SETTINGS.max_retries + 2), SETTINGS
    )
    assert given_up is not None
    assert given_up.kind is DecisionKind.GIVE_UP_GOAL


def test_an_unknown_precondition_is_never_taken_for_true() -> None:
    step = replace(STEP, precondition=Condition.of({held("a"): True, FREE: False}))
    unknown = policy.before(
        step, step.precondition.facts, Verdict(unknown=frozenset({held("a"), FREE})), 2, ONCE, SETTINGS
    )
    assert unknown is not None
    assert unknown.kind is DecisionKind.REPLAN
    (cause,) = unknown.causes
    assert (cause.code, cause.literals, cause.atoms) == (Reason.PRECONDITION_UNMET, ("held(a)",), (held("a"),))
    closed = policy.before(
        step,
        step.precondition.facts,
        Verdict(holds=frozenset({held("a")}), unknown=frozenset({FREE})),
        0,
        ONCE,
        SETTINGS,
    )
    assert closed is None, "what was planned from is false where nothing is known"


def test_what_looks_do_not_tell_is_tried_before_it_is_given_up_if_it_is_probable() -> None:
    step, often = pick("a", "p"), times(SETTINGS.max_failures_with_same_facts(SkillStatus.NOT_THERE))
    unknown = Verdict(frozenset({FREE}), unknown=frozenset({at("a", "p")}))
    seen_not_to = Verdict(unknown=frozenset({FREE}), violated=frozenset({at("a", "p")}))
    for verdict, failures, is_likely, kind in (
        (unknown, often, True, DecisionKind.CONTINUE),
        (unknown, often, False, DecisionKind.GIVE_UP_GOAL),
        (unknown, ONCE, True, DecisionKind.REPLAN),
        (seen_not_to, often, True, DecisionKind.GIVE_UP_GOAL),
    ):
        needed, waits = step.precondition.facts, SETTINGS.precondition_wait
        decision = policy.before(step, needed, verdict, waits, failures, SETTINGS, is_likely)
        assert decision is not None
        assert decision.kind is kind
    assert policy.before(step, needed, unknown, 0, often, SETTINGS, True).kind is DecisionKind.LOOK_AGAIN  # type: ignore[union-attr]


def test_a_run_opens_with_all_that_can_be_seen() -> None:
    everything = (at("a", "p"), FREE)
    known = Facts({FREE: True})
    assert policy.first(everything, Facts(dict.fromkeys(everything, True)), 1, SETTINGS).kind is DecisionKind.CONTINUE
    assert policy.first(everything, known, 1, SETTINGS).kind is DecisionKind.LOOK_AGAIN
    assert policy.first(everything, known, 4, SETTINGS).kind is DecisionKind.CONTINUE
    assert policy.first(everything, Facts(), 4, SETTINGS).outcome is OutcomeKind.GAVE_UP
    assert policy.first((), Facts(), 1, SETTINGS).kind is DecisionKind.CONTINUE


def unplanned(
    no_plan: NoPlan, times: int, unsure: tuple[Atom, ...] = (), doubts: tuple[Atom, ...] = (FREE,)
) -> Decision:
    return policy.unplanned(no_plan, times, UncertainAtoms(doubts, unsure), SETTINGS)


@pytest.mark.parametrize(
    ("reason", "code"),
    [(NoPlanReason.TIMED_OUT, Reason.PLANNER_TIMED_OUT), (NoPlanReason.CRASHED, Reason.PLANNER_CRASHED)],
)
def test_a_planner_that_failed_is_asked_once_more(reason: NoPlanReason, code: Reason) -> None:
    again = unplanned(NoPlan(reason, "signal 11"), 1)
    assert again.kind is DecisionKind.REPLAN
    assert again.causes == (Cause(code, detail="signal 11"), Cause(Reason.PLANNER_ASKED_AGAIN))
    assert unplanned(NoPlan(reason), 2).outcome is OutcomeKind.NO_PLAN


def test_a_state_without_a_plan_is_doubted_before_the_goal_is() -> None:
    unsolvable = NoPlan(NoPlanReason.UNSOLVABLE)
    first = unplanned(unsolvable, 1, doubts=(at("a", "q"), FREE))
    assert (first.kind, first.evidence) == (DecisionKind.LOOK_AGAIN, (at("a", "q"), FREE))
    assert unplanned(unsolvable, 2).kind is DecisionKind.GIVE_UP_GOAL
    assert unplanned(unsolvable, 1, doubts=()).outcome is OutcomeKind.NO_PLAN, "one that cannot look has no doubts"


def test_what_is_not_sure_is_looked_at_as_often_as_allowed_before_a_goal_is_given_up() -> None:
    unsolvable = NoPlan(NoPlanReason.UNSOLVABLE)
    for times in range(2, SETTINGS.max_looks_again + 1):
        decision = unplanned(unsolvable, times, unsure=(FREE,))
        assert (decision.kind, decision.evidence) == (DecisionKind.LOOK_AGAIN, (FREE,))
    assert unplanned(unsolvable, SETTINGS.max_looks_again + 1, unsure=(FREE,)).kind is DecisionKind.GIVE_UP_GOAL


GOAL = Condition.of({at("a", "q"): True, at("b", "r"): True})


def test_success_is_a_goal_that_is_seen() -> None:
    def finish(verdict: Verdict, checks: int = 1, unsure: tuple[Atom, ...] = ()) -> Decision:
        return policy.finish(GOAL, verdict, unsure, checks, GivenUp(ALWAYS), SETTINGS)

    one, other = sorted(GOAL.facts)
    assert finish(Verdict(GOAL.atoms)).outcome is OutcomeKind.GOAL_REACHED
    wrong, unknown = (
        Verdict(frozenset({one}), frozenset({other})),
        Verdict(frozenset({one}), unknown=frozenset({other})),
    )
    assert finish(wrong).kind is finish(unknown).kind is DecisionKind.LOOK_AGAIN
    assert finish(wrong, 2).kind is DecisionKind.REPLAN, "what is seen twice is believed"
    assert finish(unknown, SETTINGS.max_looks_again).kind is DecisionKind.LOOK_AGAIN
    unseen = finish(unknown, SETTINGS.max_looks_again + 1)
    assert unseen.outcome is OutcomeKind.PARTIAL
    assert unseen.causes == (Cause(Reason.GOAL_ONLY_BELIEVED, (at("b", "r"),), count=4),)
    assert finish(Verdict(unknown=GOAL.atoms), 4).outcome is OutcomeKind.GAVE_UP


def test_what_was_given_up_is_tried_again_or_named() -> None:
    verdict = Verdict(frozenset({at("a", "q")}))
    kept, dropped = Condition.literal(at("a", "q")), Condition.literal(at("b", "r"))
    partial = policy.finish(kept, verdict, (), 1, GivenUp(dropped, OUT_OF_REACH), SETTINGS)
    assert partial.outcome is OutcomeKind.PARTIAL
    assert partial.causes[1:] == (Cause(Reason.GIVEN_UP_BEFORE, literals=("at(b,r)",)), *OUT_OF_REACH)
    for checks in range(1, SETTINGS.max_looks_again + 1):
        doubted = policy.finish(kept, verdict, (FREE,), checks, GivenUp(dropped, OUT_OF_REACH), SETTINGS)
        assert (doubted.kind, doubted.evidence) == (DecisionKind.LOOK_AGAIN, (FREE,))
    again = policy.finish(kept, verdict, (), 1, GivenUp(dropped, (), Plan((), 0.0, "", 0.0)), SETTINGS)
    assert (again.kind, again.codes[-1]) == (DecisionKind.REPLAN, Reason.REACHABLE_AGAIN)


def test_giving_up_names_what_is_left() -> None:
    cause = Decision(DecisionKind.GIVE_UP_GOAL, OUT_OF_REACH)
    some = policy.given_up(cause, GOAL, Condition.literal(at("a", "q")), is_stuck=True)
    assert some.kind is DecisionKind.GIVE_UP_GOAL
    assert some.causes == (
        *OUT_OF_REACH,
        Cause(Reason.GOAL_GIVEN_UP, literals=("at(b,r)",)),
        Cause(Reason.GOAL_KEPT, literals=("at(a,q)",)),
    )
    assert some.evidence == (at("b", "r"),)
    assert policy.given_up(cause, GOAL, ALWAYS, is_stuck=True).outcome is OutcomeKind.GAVE_UP
    assert policy.given_up(cause, GOAL, ALWAYS, is_stuck=False).outcome is OutcomeKind.NO_PLAN
    assert policy.given_up(cause, GOAL, GOAL, is_stuck=False).kind is DecisionKind.REPLAN


def solver(reachable: Callable[[frozenset[Atom]], bool], asked: list[Condition]) -> Callable[[Condition], Plan | None]:
    def plan_for(goal: Condition) -> Plan | None:
        asked.append(goal)
        return Plan((), float(len(goal.facts)), "", 0.0) if reachable(goal.atoms) else None

    return plan_for


literals = [at(thing, "p") for thing in "abcdef"]
conflicts = st.lists(st.frozensets(st.sampled_from(literals), min_size=1, max_size=3), max_size=4)


@given(conflicts, st.integers(1, 6))
@example([frozenset({literals[0], literals[1]}), frozenset({literals[0], literals[2]})], 3)
def test_the_part_that_is_kept_is_the_largest_that_can_be_reached(taboo: list[frozenset[Atom]], count: int) -> None:
    """Goals conflict when they contain a taboo set: the general shape of what cannot be had together."""
    goal = Condition.of(dict.fromkeys(literals[:count], True))

    def reachable(chosen: frozenset[Atom]) -> bool:
        return not any(conflict <= chosen for conflict in taboo)

    asked: list[Condition] = []
    kept, plan = policy.largest_reachable(goal, solver(reachable, asked), 64)
    best = max(
        size for size in range(count + 1) if any(reachable(frozenset(c)) for c in combinations(goal.atoms, size))
    )
    assert len(kept.facts) == best
    assert goal.facts.entails(kept.facts)
    assert (plan is None) == (best == 0)
    assert plan is None or plan.cost == len(kept.facts), "the plan is the one for what is kept"
    assert len(asked) <= 2 ** len(goal.facts)


@given(conflicts, st.integers(0, 5))
def test_with_few_questions_allowed_what_is_kept_cannot_be_extended(taboo: list[frozenset[Atom]], most: int) -> None:
    goal = Condition.of(dict.fromkeys(literals, True))

    def reachable(chosen: frozenset[Atom]) -> bool:
        return not any(conflict <= chosen for conflict in taboo)

    asked: list[Condition] = []
    kept, plan = policy.largest_reachable(goal, solver(reachable, asked), most)
    assert reachable(kept.atoms)
    assert (plan is None) == (kept == ALWAYS)
    for atom in goal.atoms - kept.atoms:
        assert not reachable(kept.atoms | {atom})
    assert len(asked) <= 2 * len(goal.facts) + most


def test_each_budget_ends_the_run_by_its_name() -> None:
    settings = Settings(max_cycles=3, max_actions=2, max_replans=1)
    assert policy.exhausted(settings, cycles=2, actions=1, replans=0) is None
    for what, total in (("cycles", 3), ("actions", 2), ("replans", 1)):
        stop = policy.exhausted(settings, **{what: total})
        assert stop is not None
        assert (stop.outcome, stop.causes) == (OutcomeKind.GAVE_UP, (budget(what, total),))


@pytest.mark.parametrize(
    "wrong", [{"seed": -1}, {"max_retries": -1}, {"max_questions": 0}, {"guard_looks": -1}, {"sure": 1.5}]
)
def test_settings_refuse_nonsense(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Settings(**wrong)
