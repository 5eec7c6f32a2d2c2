"""How a run stands: what each thing that can happen changes, and what it leaves as it was."""

from __future__ import annotations

from dataclasses import replace

import pytest

from executive.course import Course
from executive.types import Decision, DecisionKind, Facts, OutcomeKind, Plan, SkillResult, SkillStatus
from tests.fakes import FREE, at, held, pick, put, task

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
TASK = task(["a", "b"], ["p", "q", "r"], GOAL)
START = Facts.closed({at("a", "p"), at("b", "p"), FREE}, TASK.atoms)
GRIPPED = Facts.closed({held("a"), at("b", "p")}, TASK.atoms)
STEPS = (pick("a", "p"), put("a", "q"), pick("b", "p"), put("b", "r"))
REPLAN = Decision(DecisionKind.REPLAN, "it failed")
GIVE_UP = Decision(DecisionKind.GIVE_UP_GOAL, "it failed again")


def planned() -> Course:
    return Course.of(TASK, Facts()).looked(START, 0).planned(Plan(STEPS, 4.0, "", 0.0), GOAL)


def test_a_plan_is_carried_out_step_by_step() -> None:
    course = planned()
    assert (course.left, course.replans, course.looks) == (STEPS, 0, 1)
    course = course.next_cycle().dispatched()
    assert (course.actions, course.cycle, course.moment.looks) == (1, 1, ())
    assert course.moment.expected == GRIPPED
    course = course.looked(GRIPPED, 1)
    turn = course.turn(SkillResult(STEPS[0], SkillStatus.DONE))
    assert turn.verdict.satisfied
    assert (turn.rest, turn.planned, turn.looks, turn.doubts) == ((0, 1, 2), 3, 1, {})
    course = course.judged(turn, Decision(DecisionKind.CONTINUE, "as expected"))
    assert course.left == STEPS[1:]
    assert course.todo == (1, 2, 3)


def test_steps_that_are_left_out_keep_the_others_places_in_the_plan() -> None:
    course = planned().dispatched().looked(GRIPPED | {at("b", "p"): False, at("b", "r"): True}, 1)
    course = course.judged(course.turn(SkillResult(STEPS[0], SkillStatus.DONE)), REPLAN)
    assert (course.todo, course.left) == ((1,), STEPS[1:2])


def test_a_failure_is_counted_where_the_step_was_begun_from() -> None:
    course = planned()
    for attempt in range(1, 4):
        course = course.dispatched().looked(START, attempt)
        turn = course.turn(SkillResult(STEPS[0], SkillStatus.GRASP_MISSED))
        assert (turn.rest, turn.repeatable, turn.attempt, turn.failures) == (None, True, attempt, attempt)
        course = course.judged(turn, REPLAN)
    assert course.failed_before(STEPS[0], START) == 3
    assert course.failed_before(STEPS[0], GRIPPED) == 0
    assert course.planned(Plan(STEPS, 4.0, "", 0.0), GOAL).attempt == 1


def test_a_step_is_stuck_only_where_it_was_given_up_on() -> None:
    course = planned().dispatched().looked(START, 1)
    assert not course.failed(STEPS[0], START, REPLAN).is_stuck
    stuck = course.failed(STEPS[0], START, GIVE_UP)
    assert stuck.is_stuck
    assert stuck.leads_nowhere(Plan(STEPS, 4.0, "", 0.0))
    assert not stuck.leads_nowhere(Plan(STEPS[2:], 2.0, "", 0.0))
    assert not stuck.waiting().looked(GRIPPED, 2).is_stuck


def test_looks_at_one_moment_are_settled_but_while_waiting_the_last_one_counts() -> None:
    """Expected and first seen to be false, then seen to be true: an error of the eye, unless a change is waited for."""
    course = planned().dispatched().looked(GRIPPED, 1)
    help_came = GRIPPED | {at("b", "r"): True}
    assert course.looked(help_came, 2).known.facts[at("b", "r")] is False
    assert course.waiting().looked(help_came, 2).known.facts[at("b", "r")] is True
    assert course.looked(help_came, 2).trusting_last_look().known.facts[at("b", "r")] is True


def test_what_is_assumed_is_known_but_was_never_seen() -> None:
    course = planned().dispatched().assumed()
    assert course.known.facts == GRIPPED
    assert course.known.age(held("a"), 5) is None
    assert course.left == STEPS[1:]


def test_a_goal_is_seen_in_the_last_look_and_after_the_last_action() -> None:
    reached = Decision(DecisionKind.STOP, "", outcome=OutcomeKind.GOAL_REACHED)
    there = Facts.closed({at("a", "q"), at("b", "r"), FREE}, TASK.atoms)
    course = planned().looked(there, 1)
    assert course.ended(reached).goal_seen
    assert course.ended(reached).unreached == ()
    assert not course.ended(replace(reached, outcome=OutcomeKind.INTERRUPTED)).goal_seen
    assert not course.dispatched().ended(reached).goal_seen
    assert not course.looked(there.without([at("b", "r")]), 2).ended(reached).goal_seen
    assert planned().ended(reached).unreached == ("at(a,q)", "at(b,r)")


def test_given_up_goals_are_those_that_are_no_longer_gone_for() -> None:
    rest = GOAL.only([at("b", "r")])
    course = planned().giving_up("a is gone").planned(Plan((), 0.0, "", 0.0), rest)
    assert (course.goal, course.given_up, course.given_up_why) == (rest, GOAL.without(rest), "a is gone")
    assert course.replans == 1


def test_only_a_stop_ends_a_run() -> None:
    with pytest.raises(ValueError, match="does not end with"):
        planned().ended(REPLAN)


def test_the_past_is_never_rewritten() -> None:
    before = planned()
    kept = replace(before)
    before.next_cycle().dispatched().looked(GRIPPED, 1).failed(STEPS[0], START, GIVE_UP).assumed().waiting()
    assert before == kept
