"""How a run stands: what each thing that can happen changes, and what it leaves as it was."""

from __future__ import annotations

from dataclasses import replace

import pytest

from executive.belief.threshold import ThresholdMonitor
from executive.core.policy import UncertainAtoms
from executive.core.run_state import RunState, StuckSteps
from executive.core.settings import Settings
from executive.types import (
    Belief,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Facts,
    Ground,
    Looked,
    LookKind,
    OutcomeKind,
    Plan,
    Reason,
    SkillResult,
    SkillStatus,
)
from tests.fakes import FREE, at, held, pick, put, task

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
TASK = task(["a", "b"], ["p", "q", "r"], GOAL)
START = Facts.closed({at("a", "p"), at("b", "p"), FREE}, TASK.atoms)
GRIPPED = Facts.closed({held("a"), at("b", "p")}, TASK.atoms)
STEPS = (pick("a", "p"), put("a", "q"), pick("b", "p"), put("b", "r"))
FAILED = (Cause(Reason.STEP_FAILED),)
CONTINUE = Decision(DecisionKind.CONTINUE, (Cause(Reason.AS_EXPECTED),))
REPLAN = Decision(DecisionKind.REPLAN, FAILED)
GIVE_UP = Decision(DecisionKind.GIVE_UP_GOAL, FAILED)


MONITOR = ThresholdMonitor(TASK.atoms)


def looked(run_state: RunState, seen: Facts, number: int) -> RunState:
    """With one more look, which asks about what is in `seen` and sees that."""
    raw = Belief.certain(seen, number, "scripted")
    memory, judgement = MONITOR.looked(run_state.memory, raw, run_state.cycle)
    return run_state.looked(
        memory, judgement, raw, Looked(number, LookKind.FULL, len(seen), len(TASK.atoms), ("front",))
    )


def dispatched(run_state: RunState, result: SkillResult | None = None) -> RunState:
    run_state = run_state.dispatched()
    result = result or SkillResult(run_state.left[0], SkillStatus.DONE)
    return run_state.acted(result, MONITOR.acted(run_state.memory, result.step, result))


def planned() -> RunState:
    run_state = RunState(TASK, TASK.goal, Facts(), MONITOR.begin())
    return looked(run_state, START, 0).planned(Plan(STEPS, 4.0, "", 0.0), TASK.goal)


def test_a_plan_is_carried_out_step_by_step() -> None:
    run_state = planned()
    assert (run_state.left, run_state.replans, run_state.looks) == (STEPS, 0, 1)
    run_state = dispatched(run_state.next_cycle())
    assert (run_state.actions, run_state.cycle, run_state.moment.looks, run_state.seen) == (1, 1, 0, Facts())
    assert run_state.moment.expected == GRIPPED
    run_state = looked(run_state, GRIPPED, 1)
    turn = run_state.turn(SkillResult(STEPS[0], SkillStatus.DONE))
    assert turn.verdict.satisfied
    assert (turn.rest, turn.planned, turn.looks, turn.doubts) == ((0, 1, 2), 3, 1, {})
    run_state = run_state.judged(turn, CONTINUE)
    assert run_state.left == STEPS[1:]
    assert run_state.todo == (1, 2, 3)


def test_steps_that_are_left_out_keep_the_others_places_in_the_plan() -> None:
    run_state = looked(dispatched(planned()), GRIPPED | {at("b", "p"): False, at("b", "r"): True}, 1)
    run_state = run_state.judged(run_state.turn(SkillResult(STEPS[0], SkillStatus.DONE)), REPLAN)
    assert (run_state.todo, run_state.left) == ((1,), STEPS[1:2])


def test_a_failure_is_counted_where_the_step_was_begun_from() -> None:
    run_state = planned()
    for attempt in range(1, 4):
        run_state = looked(dispatched(run_state), START, attempt)
        turn = run_state.turn(SkillResult(STEPS[0], SkillStatus.GRASP_MISSED))
        assert (turn.rest, turn.repeatable, turn.attempt) == (None, True, attempt)
        assert turn.failures == (attempt, attempt)
        run_state = run_state.judged(turn, REPLAN)
    assert run_state.failing(STEPS[0], START) == (4, 4)
    assert run_state.failing(STEPS[0], START | {at("b", "p"): False, at("b", "r"): True}) == (1, 4), "b was in the way"
    assert run_state.failing(STEPS[0], START | {at("b", "q"): True}) == (4, 4), "b elsewhere has nothing to do with it"
    assert run_state.failing(STEPS[2], START) == (1, 1)
    assert run_state.planned(Plan(STEPS, 4.0, "", 0.0), TASK.goal).attempt == 1


def test_a_step_that_comes_out_is_stuck_no_longer_and_its_failures_are_counted_anew() -> None:
    run_state = planned().failed(STEPS[0], START, GIVE_UP).failed(STEPS[2], START, GIVE_UP)
    run_state = looked(dispatched(run_state), GRIPPED, 1)
    run_state = run_state.judged(run_state.turn(SkillResult(STEPS[0], SkillStatus.DONE)), CONTINUE)
    assert run_state.failing(STEPS[0], START) == (1, 1)
    assert run_state.failing(STEPS[2], START) == (2, 2)
    assert run_state.stuck_among(STEPS, START, StuckSteps.NEVER) == {STEPS[2]}


def test_a_plan_hangs_on_a_step_that_is_stuck_where_it_would_be_carried_out() -> None:
    run_state, first = looked(dispatched(planned()), START, 1), frozenset(STEPS[:1])
    assert not run_state.failed(STEPS[0], START, REPLAN).stuck_among(STEPS, START, StuckSteps.NEVER)
    stuck, later = run_state.failed(STEPS[0], START, GIVE_UP), (*STEPS[2:], *STEPS[:2])
    assert not stuck.stuck_among(STEPS[2:], START, StuckSteps.NEVER)
    for plan in (STEPS, later):
        assert stuck.stuck_among(plan, START, StuckSteps.NEVER) == first
    assert stuck.stuck_among(STEPS, START, StuckSteps.IF_CHANGED) == first
    assert not stuck.stuck_among(later, START, StuckSteps.IF_CHANGED), "b is not in the way any more by then"
    in_vain = (pick("b", "p"), put("b", "p"), *STEPS[:2])
    assert stuck.stuck_among(in_vain, START, StuckSteps.IF_CHANGED) == first, "nothing has changed by then"


def test_a_stuck_step_is_worth_one_more_try_when_nothing_else_is_left_to_do() -> None:
    run_state = looked(dispatched(planned()), START, 1)
    stuck = run_state.failed(STEPS[0], START, GIVE_UP)
    assert stuck.stuck_among(STEPS, START, StuckSteps.LAST_RESORT), "nothing was done since"
    later = replace(stuck, actions=stuck.actions + 1)
    assert later.stuck_among(STEPS, START, StuckSteps.IF_CHANGED)
    assert not later.stuck_among(STEPS, START, StuckSteps.LAST_RESORT)
    twice = replace(later.failed(STEPS[0], START, GIVE_UP), actions=later.actions + 1)
    for allowed in StuckSteps:
        assert twice.stuck_among((*STEPS[2:], *STEPS[:2]), START, allowed), "given up on twice, it is left alone"


def test_what_a_look_did_not_ask_about_is_no_doubt_but_what_it_could_not_tell_is() -> None:
    run_state, effects = dispatched(planned()), GRIPPED.only(STEPS[0].unconditional)
    result = SkillResult(STEPS[0], SkillStatus.DONE)
    focused = looked(run_state, effects, 1)
    assert focused.expected == effects
    assert focused.turn(result).verdict.satisfied
    assert focused.turn(result).doubts == {}, "where b is was seen a cycle ago, and nobody asked"
    raw = Belief(1, {}, frozenset({at("b", "p")}), "scripted")
    memory, judgement = MONITOR.looked(focused.memory, raw, 3)
    unanswered = focused.looked(memory, judgement, raw, Looked(2, LookKind.CLOSER, 1, len(TASK.atoms)))
    assert unanswered.turn(result).doubts == {at("b", "p"): 3}
    assert not unanswered.asked_all


def test_before_a_goal_is_given_up_for_want_of_a_plan_everything_is_doubted_however_few_questions_a_look_has() -> None:
    doubts = planned().uncertain_atoms(Settings(max_questions=2))
    assert set(doubts.atoms) == set(TASK.atoms)
    assert RunState(TASK, TASK.goal, START).uncertain_atoms(Settings()) == UncertainAtoms(), (
        "one that does not look has none"
    )


def test_a_small_task_is_asked_about_whole_and_a_large_one_where_it_matters() -> None:
    run_state = dispatched(planned())
    assert run_state.questions(len(TASK.atoms)) == TASK.atoms
    few = run_state.questions(7)
    assert set(few) == {*STEPS[0].unconditional, *STEPS[1].precondition.facts, *GOAL}
    assert few[:3] == tuple(STEPS[0].unconditional), "what the step was to change comes first"
    assert run_state.questions(4) == few[:4]


def test_waiting_makes_another_moment_of_which_nothing_is_seen_yet() -> None:
    run_state = looked(dispatched(planned()), GRIPPED, 1)
    waiting = run_state.waiting(MONITOR.acted(run_state.memory, None))
    assert (waiting.seen, waiting.known) == (Facts(), GRIPPED)
    help_came = GRIPPED | {at("b", "r"): True}
    assert looked(waiting, help_came, 2).known[at("b", "r")] is True


def test_what_is_assumed_is_known_but_was_never_seen() -> None:
    run_state = planned().dispatched().assumed()
    assert (run_state.known, run_state.seen) == (GRIPPED, Facts())
    assert run_state.left == STEPS[1:]


def test_a_decision_is_told_with_what_is_believed_and_which_look_said_so() -> None:
    run_state = looked(dispatched(planned()), START.without([at("b", "p")]), 4)
    told = run_state.grounded(Decision(DecisionKind.RETRY, FAILED, (held("a"), at("b", "p"), at("b", "q"))))
    assert told.report == SkillResult(STEPS[0], SkillStatus.DONE)
    assert told.grounds == (
        Ground(held("a"), True, False, 0.0, 4, ("front",)),
        Ground(at("b", "p"), True, None, 1.0, 0, ("front",)),
        Ground(at("b", "q"), False, False, 0.0, 4, ("front",)),
    )


def test_a_goal_is_seen_by_the_looks_after_the_last_action() -> None:
    reached = Decision(DecisionKind.STOP, (Cause(Reason.GOAL_SEEN),), outcome=OutcomeKind.GOAL_REACHED)
    there = Facts.closed({at("a", "q"), at("b", "r"), FREE}, TASK.atoms)
    run_state = looked(dispatched(planned()), there, 1)
    assert run_state.ended(reached).goal_seen
    assert run_state.ended(reached).unreached == ()
    assert not run_state.ended(replace(reached, outcome=OutcomeKind.INTERRUPTED)).goal_seen
    assert not run_state.dispatched().ended(reached).goal_seen
    assert looked(run_state, Facts({at("b", "q"): False}), 2).ended(reached).goal_seen, (
        "a closer look at something else"
    )
    assert not looked(run_state, Facts({at("b", "r"): False}), 2).ended(reached).goal_seen
    assert planned().ended(reached).unreached == ("at(a,q)", "at(b,r)")


def test_given_up_goals_are_those_that_are_no_longer_gone_for() -> None:
    rest = Condition.literal(at("b", "r"))
    run_state = planned().giving_up(FAILED).planned(Plan((), 0.0, "", 0.0), rest)
    assert (run_state.goal, run_state.given_up, run_state.given_up_why) == (
        rest,
        Condition.literal(at("a", "q")),
        FAILED,
    )
    assert run_state.replans == 1


def test_only_a_stop_ends_a_run() -> None:
    with pytest.raises(ValueError, match="does not end with"):
        planned().ended(REPLAN)


def test_the_past_is_never_rewritten() -> None:
    before = planned()
    kept = replace(before)
    looked(dispatched(before.next_cycle()), GRIPPED, 1).failed(STEPS[0], START, GIVE_UP).assumed().waiting(None)
    assert before == kept
