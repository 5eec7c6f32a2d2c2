"""A problem begins as it says, and what cannot be for its size is known before anything moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.app.run import Run, RunConfig
from executive.domain.scaffold import create
from executive.errors import DomainError
from executive.types import Condition, Ended, Facts, NoPlan, NoPlanReason, OutcomeKind, Plan
from tests.fakes import Recorder

TRAY = """
[[table]]
name = "tray"
centre = [0.30, 0.0, 0.86]
size = [0.07, 0.05, 0.06]

[[item]]
name = "crate"
shape = "box"
size = [0.13, 0.06, 0.10]
"""
PROBLEM = """(define (problem p) (:domain workshop)
  (:objects red-block crate - item dark-table light-table tray - table)
  (:init {init})
  (:goal (and {goal})))"""
PLACED = "(hand-empty) (on red-block dark-table) (on crate dark-table)"
CRATE, BLOCK = Facts.parse("on(crate,tray)"), Facts.parse("on(red-block,light-table)")
WHY = "crate, 13.0 x 6.0 x 10.0 cm, does not fit on tray, 7.0 x 5.0 cm, whichever way it lies"


@pytest.fixture
def workshop(tmp_path: Path) -> Path:
    """A new domain with a tray that is smaller than a crate, though not than the block."""
    folder = create("workshop", tmp_path).folder
    with (folder / "scene.toml").open("a") as scene:
        scene.write(TRAY)
    return folder


def prepared(folder: Path, init: str, goal: str, recorder: Recorder | None = None) -> Run:
    (folder / "problems" / "p.pddl").write_text(PROBLEM.format(init=init, goal=goal))
    config = RunConfig(
        str(folder), problem="p", seed=1, estimator="oracle", runs=folder.parent / "runs", name="r", viewer=False
    )
    return Run(config, [recorder] if recorder else [])


def test_a_goal_that_is_too_large_for_its_place_is_refused_with_both_sizes(workshop: Path) -> None:
    with pytest.raises(DomainError) as caught:
        prepared(workshop, PLACED, "(on crate tray)")
    assert caught.value.message == WHY
    assert (caught.value.file, caught.value.key) == (workshop / "problems" / "p.pddl", ":goal")
    assert not (workshop.parent / "runs" / "r").exists()


def test_no_plan_puts_anything_where_it_does_not_fit(workshop: Path) -> None:
    with prepared(workshop, PLACED, "(on crate tray) (on red-block light-table)") as run:
        planner, task = run.executive.queries.planner, run.domain.task
        state = run.truth.of(task.atoms)
        whole, part = planner.plan(state, task.goal), planner.plan(state, Condition.of(BLOCK))
        assert isinstance(whole, NoPlan)
        assert (whole.reason, whole.detail) == (NoPlanReason.UNSOLVABLE, WHY)
        assert isinstance(part, Plan)
        assert [str(step) for step in part.steps] == [
            "pick-up(red-block,dark-table)",
            "put-down(red-block,light-table)",
        ]
        held = state | Facts.parse("holding(crate)", "not on(crate,dark-table)", "not hand-empty()")
        assert isinstance(planner.plan(held, Condition.of(BLOCK)), Plan), "the hand is emptied where there is room"
        there = state | CRATE
        assert isinstance(planner.plan(there, Condition.of(CRATE)), Plan), "it is there already"


def test_what_init_says_and_the_scene_is_not_is_refused_with_its_line(workshop: Path) -> None:
    for init, line in (
        ("(holding crate)\n  (hand-empty)", 4),
        ("(on crate dark-table)\n  (not (on red-block dark-table))\n  (not (on red-block light-table))\n"
         "  (not (on red-block tray))", 6),
        ("(on crate tray)\n  (on crate dark-table)", 4),
    ):  # fmt: skip
        with pytest.raises(DomainError) as caught:
            prepared(workshop, init, "(on red-block light-table)")
        assert (caught.value.file, caught.value.key) == (workshop / "problems" / "p.pddl", f"line {line}")


def test_a_problem_may_begin_with_something_in_the_hand(workshop: Path) -> None:
    recorder = Recorder()
    with prepared(workshop, "(holding red-block) (on crate dark-table)", "(on red-block tray)", recorder) as run:
        summary = run.execute()
    (ended,) = recorder.of(Ended)
    assert ended.outcome is OutcomeKind.GOAL_REACHED
    assert summary["goal_true"]
    assert ended.actions == 1, "it was put down on a tray that is hardly wider than it"


@pytest.mark.slow
def test_the_rest_of_the_goal_is_reached_without_a_try_at_what_does_not_fit(workshop: Path) -> None:
    recorder = Recorder()
    with prepared(workshop, PLACED, "(on crate tray) (on red-block light-table)", recorder) as run:
        run.execute()
    (ended,) = recorder.of(Ended)
    assert (ended.outcome, ended.unreached) == (OutcomeKind.PARTIAL, ("on(crate,tray)",))
    assert ended.actions == 2
    assert WHY in [cause.detail for cause in ended.causes]


def test_an_item_that_the_gripper_cannot_take_is_told_where_it_has_to_be_moved(workshop: Path) -> None:
    scene = workshop / "scene.toml"
    scene.write_text(scene.read_text().replace("size = [0.13, 0.06, 0.10]", "size = [0.06, 0.09, 0.003]"))
    with pytest.raises(DomainError) as caught:
        prepared(workshop, PLACED, "(on crate light-table)")
    assert caught.value.message.startswith("crate, 6.0 x 9.0 x 0.3 cm, is too thin to be taken")
    assert (caught.value.file, caught.value.key) == (scene, "item")
    with prepared(workshop, PLACED, "(on crate dark-table) (on red-block light-table)") as run:
        held = run.executive.queries.planner.plan(
            run.truth.of(run.domain.task.atoms), Condition.parse("holding(crate)")
        )
        assert isinstance(held, NoPlan)
