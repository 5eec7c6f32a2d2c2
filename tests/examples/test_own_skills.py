"""The skills that docs/how-to/own-world.md writes with the parts of ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from examples.own_skills import push, stack
from executive.types import SkillStatus, Step
from tests.executive.sim.stage import grocery
from tests.skills.test_library import blocks
from tests.skills.test_skills import Robot


def test_an_item_is_stacked(tmp_path: Path) -> None:
    robot = blocks(tmp_path)
    step = Step("stack", ("block-a", "block-b"))
    assert stack(step, robot._context()).status is SkillStatus.NOT_THERE  # the hand is empty
    assert robot.pick("block-a", "black-table").done
    result = stack(step, robot._context())
    assert result.done, result.reason
    upper, lower = robot.world.pose("block-a"), robot.world.pose("block-b")
    assert abs(upper[2] - lower[2] - 0.045) < 0.002
    assert np.hypot(*(upper - lower)[:2]) < 0.008
    assert not robot.world.gripped()


def test_an_item_is_pushed_to_the_middle() -> None:
    robot = Robot(grocery(22, ("soda-can",)))
    table = robot.table_of("soda-can")
    middle = next(np.array(each.centre) for each in robot.world.spec.tables if each.name == table)
    before = robot.world.pose("soda-can")[:2] - middle[:2]
    assert np.hypot(*before) > 0.05
    result = push(Step("push", ("soda-can", table)), robot._context())
    assert result.done, result.reason
    assert np.hypot(*(robot.world.pose("soda-can")[:2] - middle[:2])) < 0.03
    assert robot.phases().count("push") == 1
    assert robot.so(f"on-table(soda-can,{table})")
