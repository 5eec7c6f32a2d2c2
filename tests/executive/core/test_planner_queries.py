"""What the planner is asked, and what becomes of its answers."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from executive.belief import ThresholdMonitor
from executive.core.compare import reaches, relevant_facts
from executive.core.planner_queries import PlannerQueries
from executive.core.run_state import RunState, Stuck, StuckSteps
from executive.core.session import Session
from executive.types import (
    ALWAYS,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Facts,
    NoPlan,
    NoPlanReason,
    Plan,
    Probed,
    Reason,
    Step,
)
from tests.fakes import FREE, FakePlanner, FakeWorld, Recorder, at, held, pick, put, steps_of, task

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
TASK = task(["a", "b"], ["p", "q", "r"], GOAL)
START = Facts.closed({at("a", "p"), at("b", "p"), FREE}, TASK.atoms)
NEVER_AGAIN = Stuck(START, actions=0, times=2)


class Asking:
    """A planner with all steps of the task, and what is asked of it for a run in which some of them are stuck."""

    def __init__(self, stuck: Mapping[Step, Stuck] | None = None, planner: FakePlanner | None = None) -> None:
        self.planner, self.recorder, self.left = planner or FakePlanner(steps_of(TASK)), Recorder(), 60.0
        session = Session([self.recorder], FakeWorld({}, ["p", "q", "r"]))
        monitor = ThresholdMonitor(TASK.atoms)
        self.queries = PlannerQueries(self.planner, monitor, session, 64, lambda: self.left)
        self.run_state = RunState(TASK, TASK.goal, START, stuck=stuck or {})

    @property
    def probed(self) -> list[Probed]:
        return self.recorder.of(Probed)


def test_without_a_stuck_step_the_planner_is_asked_once() -> None:
    asking = Asking()
    plan = asking.queries.plan(asking.run_state, START)
    assert isinstance(plan, Plan)
    assert (len(plan.steps), plan.without, asking.probed) == (4, (), [])
    assert asking.planner.asked == [(START, TASK.goal)]


def test_a_plan_goes_around_a_step_that_is_stuck() -> None:
    asking = Asking({pick("a", "p"): NEVER_AGAIN})
    answer = asking.queries.probe(asking.run_state, TASK.goal)
    assert isinstance(answer, NoPlan), "the thing can be lifted by no other step"
    assert asking.planner.avoided == [frozenset(), frozenset({pick("a", "p")})]
    assert [each.plan is None for each in asking.probed] == [False, True], "what is not carried out is told"
    assert answer.without == ("pick(a,p)",)


def test_what_is_in_the_way_of_a_step_is_moved_away_first() -> None:
    """b stands at q, where a is to go, and there is no other way to bring a there."""
    blocked = Facts.closed({held("a"), at("b", "q")}, TASK.atoms)
    stuck = Stuck(relevant_facts(put("a", "q"), blocked), actions=2, times=1, blockers=("b",))
    asking = Asking({put("a", "q"): stuck})
    answer = asking.queries.plan(asking.run_state, blocked)
    assert isinstance(answer, Plan)
    assert reaches(answer.steps, blocked, Condition.of(GOAL))
    assert answer.steps.index(pick("b", "q")) < answer.steps.index(put("a", "q"))
    found = asking.queries.clearing(asking.run_state, blocked)
    assert found is not None
    assert found.moved == at("b", "q")
    # A step that was blocked again and again, each time by something else, is given up on.
    hopeless = Asking({put("a", "q"): stuck._replace(times=9)})
    assert isinstance(hopeless.queries.plan(hopeless.run_state, blocked), NoPlan)
    # Nor is there a plan where nobody knows what is in the way.
    unknown = Asking({put("a", "q"): stuck._replace(blockers=(), times=1)})
    assert isinstance(unknown.queries.plan(unknown.run_state, blocked), NoPlan)


def test_what_is_in_the_way_somewhere_else_is_moved_away_first() -> None:
    """b stands at r, past which there is no motion to q."""
    blocked = Facts.closed({held("a"), at("b", "r")}, TASK.atoms)
    given_up = Decision(DecisionKind.GIVE_UP_GOAL, (Cause(Reason.STEP_FAILED, steps=("put(a,q)",)),))
    run_state = Asking({}).run_state.failed(put("a", "q"), blocked, given_up, blockers=("b",))
    asking = Asking(dict(run_state.stuck))
    assert run_state.stuck_among([put("a", "q")], blocked, StuckSteps.IF_CHANGED)
    elsewhere = Facts.closed({held("a"), at("b", "p")}, TASK.atoms)
    assert not run_state.stuck_among([put("a", "q")], elsewhere, StuckSteps.IF_CHANGED)
    found = asking.queries.clearing(asking.run_state, blocked)
    assert found is not None
    assert found.moved == at("b", "r")
    assert reaches(found.plan.steps, blocked, Condition.of(GOAL))
    assert found.plan.steps.index(pick("b", "r")) < found.plan.steps.index(put("a", "q"))
    # Once it is away it stays there until the step is done, though the goal wants it back.
    found = asking.queries.clearing(asking.run_state, elsewhere)
    assert found is not None
    assert found.plan.steps == (put("a", "q"), pick("b", "p"), put("b", "r"))


def test_a_planner_that_does_not_avoid_what_it_should_has_no_plan() -> None:
    plan = Plan((pick("a", "p"), put("a", "q")), 2.0, "stubborn", 0.0)
    asking = Asking({pick("a", "p"): NEVER_AGAIN}, FakePlanner([], [plan] * 9))
    answer = asking.queries.probe(asking.run_state, TASK.goal)
    assert isinstance(answer, NoPlan)
    assert (answer.reason, answer.without) == (NoPlanReason.UNSOLVABLE, ("pick(a,p)",))
    assert len(asking.planner.asked) == 2


def test_the_part_of_the_goal_that_does_not_depend_on_a_stuck_step_is_the_largest() -> None:
    asking = Asking({put("a", "q"): NEVER_AGAIN})
    kept, plan, hangs = asking.queries.largest(asking.run_state)
    assert (kept, hangs) == (Condition.literal(at("b", "r")), True)
    assert plan is not None
    assert [step.args[0] for step in plan.steps] == ["b", "b"]


def test_a_step_is_tried_in_other_circumstances_only_where_nothing_else_is_left() -> None:
    """What bears on it has changed since it was given up on: another thing stood there."""
    once = Stuck(Facts({at("b", "q"): True}), actions=0, times=1)
    asking = Asking({put("a", "q"): once, put("b", "r"): once})
    kept, _, hangs = asking.queries.largest(asking.run_state)
    assert (kept, hangs) == (TASK.goal, False)
    assert isinstance(asking.queries.probe(asking.run_state, TASK.goal, StuckSteps.NEVER), NoPlan)


def test_what_was_given_up_is_asked_for_part_by_part() -> None:
    asking = Asking({put("a", "q"): NEVER_AGAIN})
    assert asking.queries.with_given_up(asking.run_state) == (None, TASK.goal), "nothing was"
    asking.run_state = RunState(TASK, ALWAYS, START, stuck={put("a", "q"): NEVER_AGAIN})
    plan, goal = asking.queries.with_given_up(asking.run_state)
    assert plan is not None
    assert goal == Condition.literal(at("b", "r"))


def test_what_holds_already_is_not_asked_for() -> None:
    asking = Asking()
    plan = asking.queries.probe(asking.run_state, Condition.literal(at("a", "p")))
    assert isinstance(plan, Plan)
    assert (plan.steps, asking.planner.asked) == ((), [])


def test_each_question_checks_the_time_that_is_left() -> None:
    class Over(Exception):  # noqa: N818  (no error, but the end)
        pass

    def over() -> float:
        raise Over

    asking = Asking()
    asking.queries._in_time = over
    with pytest.raises(Over):
        asking.queries.plan(asking.run_state, START)
    assert asking.planner.asked == []
