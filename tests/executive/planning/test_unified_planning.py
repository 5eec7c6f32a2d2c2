"""Any planner of unified-planning, by its name: what it does not take, and what is not here, is refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task
from executive.errors import InputError, MissingError
from executive.planning.unified_planning import UnifiedPlanner
from executive.protocols import Planner
from executive.types import Condition, Facts, NoPlan, NoPlanReason, Plan
from tests.executive.domain.pddl.test_reader import PAIRS

ENGINE = "fast-downward-opt"
STATE = Facts.parse(
    "robot-gripper-empty",
    "on-table(milk-carton,black-table)",
    "on-table(cereal-box,wood-table)",
    "on-table(lemon,white-table)",
)


@pytest.fixture(scope="module")
def breakfast() -> Schema:
    return read_task(*PAIRS["breakfast"])


@pytest.fixture(scope="module")
def planner(breakfast: Schema) -> UnifiedPlanner:
    return UnifiedPlanner(breakfast, ENGINE)


def test_it_plans_without_the_steps_that_it_is_to_avoid(planner: UnifiedPlanner, breakfast: Schema) -> None:
    assert isinstance(planner, Planner)
    answer = planner.plan(STATE, breakfast.task.goal)
    assert isinstance(answer, Plan)
    assert (answer.cost, answer.planner, len(answer.steps)) == (4.0, ENGINE, 4)
    assert all(step == breakfast.ground(step.action, step.args) for step in answer.steps)
    without = planner.plan(STATE, breakfast.task.goal, frozenset(answer.steps[:1]))
    assert isinstance(without, NoPlan)
    assert without.reason is NoPlanReason.UNSOLVABLE


def test_a_goal_that_holds_needs_no_steps(planner: UnifiedPlanner) -> None:
    assert planner.plan(STATE, Condition.parse("not robot-gripping(lemon)")) == Plan((), 0.0, ENGINE, 0.0)


def test_its_time_is_up(planner: UnifiedPlanner, breakfast: Schema) -> None:
    for seconds in (0.0, 0.1):
        answer = planner.plan(STATE, breakfast.task.goal, seconds=seconds)
        assert isinstance(answer, NoPlan)
        assert answer.reason is NoPlanReason.TIMED_OUT


def test_an_atom_of_another_task_is_refused(planner: UnifiedPlanner) -> None:
    with pytest.raises(ValueError, match="holding"):
        planner.plan(Facts.parse("holding(red-cube)"), Condition.parse("robot-gripper-empty"))


def test_a_feature_that_an_engine_does_not_take_is_named() -> None:
    with pytest.raises(InputError, match=r"fast-downward-opt .* forall effects"):
        UnifiedPlanner(read_task(*PAIRS["dishes"]), ENGINE)


def test_what_is_not_installed_is_refused_by_name_with_what_is(breakfast: Schema) -> None:
    with pytest.raises(MissingError, match=r"enhsp is not installed; installed: .*fast-downward-opt.*\[numeric\]"):
        UnifiedPlanner(breakfast, "enhsp")
    with pytest.raises(InputError, match="'fast-downwart'; did you mean 'fast-downward'"):
        UnifiedPlanner(breakfast, "fast-downwart")


def test_a_process_that_fails_is_a_crash(
    planner: UnifiedPlanner, breakfast: Schema, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "broken.py").write_text("print('starting')\nraise SystemExit('no such licence')\n")
    monkeypatch.setattr("executive.planning.unified_planning._PROCESS", tmp_path / "broken.py")
    answer = planner.plan(STATE, breakfast.task.goal)
    assert isinstance(answer, NoPlan)
    assert (answer.reason, "no such licence" in answer.detail) == (NoPlanReason.CRASHED, True)
