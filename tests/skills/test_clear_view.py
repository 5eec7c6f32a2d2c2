"""Out of the eye's way: moves that change what can be seen and nothing else, and a drop that others see."""

from __future__ import annotations

import numpy as np
import pytest

from executive.protocols import Skill, SkillContext
from executive.skills import arm
from executive.skills.arm import Attempt
from executive.skills.clear_view import aside, home, view_points
from executive.skills.place import place
from executive.types import Sense, SkillResult, SkillStatus, Step
from tests.executive.sim.stage import TABLES, grocery
from tests.skills.test_skills import Robot, other


@pytest.fixture(scope="module")
def robot() -> Robot:
    """With a can in the hand, where it was picked."""
    made = Robot(grocery(seed=20, home_pose=False))
    assert made.pick("soda-can", made.table_of("soda-can")).done
    return made


def hidden(robot: Robot, *tables: str) -> int:
    attempt = Attempt(Step("look", tables), robot._context())
    attempt.update_collisions(attempt.held())
    cameras = np.stack(list(attempt.handle.camera_positions.values()))
    return attempt.arm.collision.hides(attempt.body.joints(), cameras, view_points(attempt))


def bring(robot: Robot, skill: Skill, *tables: str) -> float:
    result = skill(Step("look", tables), robot._context())
    assert result.status is SkillStatus.DONE, result.reason
    return result.seconds


def test_aside_clears_the_view_and_keeps_what_it_holds(robot: Robot) -> None:
    where = robot.world.obstacles()
    for tables in ((), *((table,) for table in TABLES)):
        before = hidden(robot, *tables)
        seconds = bring(robot, aside, *tables)
        assert (seconds > 0.0) == (before > 0)
        assert hidden(robot, *tables) < max(1, before)
        assert robot.so("robot-gripping(soda-can)")
    del where["soda-can"]
    now = robot.world.obstacles()
    assert all(np.allclose(now[item], pose, atol=0.002) for item, pose in where.items()), "it touches nothing"


def test_home_is_gone_to_once(robot: Robot) -> None:
    assert bring(robot, home) > 0.0
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() < 0.02
    assert bring(robot, home) == 0.0
    assert robot.so("robot-gripping(soda-can)")


def doubted(robot: Robot, target: str) -> SkillResult:
    """The can on its way, and from 0.8 s on somebody who says that it is gone. It is not."""
    start = robot.world.time
    context = SkillContext(
        robot.world.handle, robot.rng, robot._hear, lambda: False,
        lambda: "it is gone" if robot.world.time > start + 0.8 else "",
    )  # fmt: skip
    return place(Step("place", ("soda-can", target)), context)


def test_a_hand_that_is_not_sure_heeds_what_others_see_and_stays_closed(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arm, "_FIRM", -1.0)
    result = doubted(robot, other(robot.table_of("lemon")))
    assert (result.status, result.sense, result.reason) == (SkillStatus.DROPPED, Sense.SEEN, "it is gone")
    assert result.planned_seconds > result.seconds
    assert robot.so("robot-gripping(soda-can)"), "they may be mistaken, as they are here"


def test_a_hand_that_feels_what_it_holds_carries_on(robot: Robot) -> None:
    target = other(robot.table_of("lemon"))
    assert doubted(robot, target).status is SkillStatus.DONE
    assert robot.so(f"on-table(soda-can,{target})")


def test_a_drop_that_is_felt_says_so(robot: Robot) -> None:
    source = robot.table_of("soda-can")
    assert robot.pick("soda-can", source).done

    def drop() -> None:
        robot.world.disturb("drop", robot.rng)

    robot.world.schedule(0.6, drop)
    result = robot.place("soda-can", other(source))
    assert (result.status, result.sense) == (SkillStatus.DROPPED, Sense.FELT)
