"""Whole runs in which something is in the way: the hands do not give up."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import numpy as np

from executive.app.config import RunConfig
from executive.app.run import Run
from executive.sim.world import MujocoWorld
from executive.skills.arm import arm_of
from executive.skills.perform import go_home, perform
from executive.trace.record.log import read_events
from executive.types import Decision, FloatArray, OutcomeKind, Reason, SkillStatus, Step
from tests.executive.sim.stage import ROOT, SCENE, TABLES
from tests.skills.test_skills import Robot

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


def beside_a_wall(folder: Path) -> Robot:
    """A lemon on the table at one side and a can on the one at the other, a wall between them on the table in the
    middle, and an arm that makes straight motions alone: past the wall there are none."""
    wall = '[[item]]\nname = "wall"\nshape = "box"\nsize = [0.40, 0.04, 0.32]\nmass = 0.2\n'
    file = folder / "scene.toml"
    file.write_text(f"{SCENE.read_text(encoding='utf-8')}\n{wall}", encoding="utf-8")
    placed = {"lemon": "white-table", "soda-can": "wood-table", "wall": "black-table"}
    objects = {**dict.fromkeys(placed, "item"), **dict.fromkeys(TABLES, "table")}
    robot = Robot(MujocoWorld(file, objects, placed=placed, home_pose=False))
    robot.world.put("wall", np.array([0.46, 0.0, 0.962, 1.0, 0.0, 0.0, 0.0]))
    robot.world.data.qvel[:] = 0.0
    robot.world.settle(0.3)
    assert robot.pick("lemon", "white-table").done
    planner = arm_of(robot.world.handle).planner
    planner.plan = partial(planner.plan, iterations=0)  # type: ignore[method-assign]
    return robot


def test_what_is_in_the_way_of_every_motion_with_a_full_hand_is_told(tmp_path: Path) -> None:
    robot = beside_a_wall(tmp_path)
    result = robot.place("lemon", "wood-table")
    assert (result.status, result.blockers, result.holding) == (SkillStatus.BLOCKED, ("wall",), True), result.reason
    robot.world.put("wall", np.array([3.0, 0.0, 0.17, 1.0, 0.0, 0.0, 0.0]))
    result = robot.place("lemon", "wood-table")
    assert result.done, result.reason


def test_what_is_in_the_way_of_every_motion_of_an_empty_hand_is_moved_aside(tmp_path: Path) -> None:
    robot = beside_a_wall(tmp_path)
    assert robot.place("lemon", "white-table").done
    result = robot.pick("soda-can", "wood-table")
    assert result.done, result.reason
    assert robot.phases().count("clear") == 1
    assert robot.so("robot-gripping(soda-can)")
    assert robot.so("on-table(wall,black-table)")


def test_what_is_in_the_way_home_is_told(tmp_path: Path) -> None:
    robot = beside_a_wall(tmp_path)
    # In the air, where time does not pass: the straight motion home leads through it.
    robot.world.put("wall", np.array([0.46, -0.08, 1.122, 1.0, 0.0, 0.0, 0.0]))
    robot.world.data.qvel[:] = 0.0
    home = perform(Step("home", ()), robot._context(), go_home)
    assert (home.status, home.blockers, home.holding) == (SkillStatus.BLOCKED, ("wall",), True), home.reason
    robot.world.put("wall", np.array([3.0, 0.0, 0.17, 1.0, 0.0, 0.0, 0.0]))
    assert perform(Step("home", ()), robot._context(), go_home).done
