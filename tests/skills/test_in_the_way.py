"""Whole runs in which something is in the way: the hands do not give up."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from executive.app.config import RunConfig
from executive.app.run import Run
from executive.trace.record.log import read_events
from executive.types import Decision, FloatArray, OutcomeKind, Reason
from tests.executive.sim.stage import ROOT

TRAY = '[[table]]\nname = "tray"\ncentre = [0.42, 0.0, 0.83]\nsize = [0.12, 0.12, 0.03]\n'
PROBLEM = """(define (problem p) (:domain grocery)
  (:objects {items} - item wood-table black-table white-table {tray} - table)
  (:init (robot-gripper-empty) {init})
  (:goal (and {goal})))"""


def prepared(folder: Path, items: str, goal: str, init: str = "", tray: str = "") -> Run:
    domain = folder / "shop"
    shutil.copytree(ROOT / "domains" / "grocery", domain)
    with (domain / "scene.toml").open("a") as scene:
        scene.write(TRAY if tray else "")
    text = PROBLEM.format(items=items, goal=goal, init=init, tray=tray)
    (domain / "problems" / "p.pddl").write_text(text, encoding="utf-8")
    config = RunConfig(str(domain), problem="p", seed=3, estimator="oracle", runs=folder, name="run", viewer=False)
    return Run(config)


def put(run: Run, item: str, bottom: FloatArray) -> None:
    """Has an item stand upright with the middle of its foot at a point (3,)."""
    shape = run.world.shapes[item]
    centre = bottom + np.array([0.0, 0.0, shape.half[2] + 0.002])
    run.world.put(item, np.concatenate([centre - shape.centre, [1.0, 0.0, 0.0, 0.0]]))
    run.world.data.qvel[:] = 0.0


def test_with_a_lemon_on_it_a_can_is_taken_and_both_come_to_their_places(tmp_path: Path) -> None:
    goal = "(on-table soda-can wood-table) (on-table lemon black-table)"
    with prepared(tmp_path, "soda-can lemon", goal) as run:
        middle = np.array([0.46, 0.0, 0.80])
        put(run, "soda-can", middle)
        put(run, "lemon", middle + [0.0, 0.0, 2 * run.world.shapes["soda-can"].half[2] + 0.002])
        run.world.settle(0.5)
        summary = run.execute()
        assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
        assert run.world.gripped() is None


def test_where_there_is_no_room_what_is_in_the_way_is_moved_by_a_plan(tmp_path: Path) -> None:
    """With the box in the hand nothing else can be moved, so that the box is put down elsewhere meanwhile."""
    goal, init = "(on-table cereal-box tray)", "(on-table cereal-box wood-table)"
    with prepared(tmp_path, "cereal-box lemon", goal, init, tray="tray") as run:
        put(run, "lemon", np.array([0.42, 0.0, 0.83]))
        run.world.settle(0.5)
        summary = run.execute()
        assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
        events = [event.payload for event in read_events(run.folder)]
    causes = [cause for event in events if isinstance(event, Decision) for cause in event.causes]
    (cleared,) = [cause for cause in causes if cause.code is Reason.PLAN_CLEARS]
    assert [str(atom) for atom in cleared.atoms] == ["on-table(lemon,tray)"]
