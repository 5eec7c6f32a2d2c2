"""Blocks in towers and regions: stacked, moved, toppled, swapped, and what is then told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from executive.sim.world import MujocoWorld
from executive.skills import SkillError, carrier, check_stands, tower
from executive.skills.move import move
from executive.types import SkillStatus, Step
from tests.skills.test_library import attempt
from tests.skills.test_skills import Robot

FOLDER = Path(__file__).parents[2] / "domains" / "blocksworld"
LOW, MID, TOP, FREE = (
    "large-red-metal-cube",
    "large-blue-rubber-cylinder",
    "small-green-metal-cube",
    "small-pink-metal-cube",
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A tower of three, and a block beside it."""
    objects = dict.fromkeys((LOW, MID, TOP, FREE), "block")
    return Robot(MujocoWorld(FOLDER / "scene.toml", objects, seed=4, stacked={MID: LOW, TOP: MID}))


@pytest.fixture
def standing(robot: Robot) -> Robot:
    """The same, as it was at first."""
    start: bytes | None = getattr(robot, "start", None)
    if start is None:
        vars(robot)["start"] = robot.world.snapshot()
    else:
        robot.world.restore(start)
    return robot


def heights(robot: Robot, *items: str) -> list[float]:
    table = robot.world.spec.tables[0].centre[2]
    return [float(robot.world.pose(item)[2] - robot.world.shapes[item].half[2] - table) for item in items]


def test_a_tower_is_what_items_rest_on_from_the_top_down(standing: Robot) -> None:
    assert [carrier(attempt(standing), item) for item in (TOP, MID, LOW)] == [MID, LOW, "table"]
    assert tower(attempt(standing), TOP) == [TOP, MID, LOW]
    assert tower(attempt(standing), "table") == []


def test_a_tower_that_fell_under_what_was_put_on_it_is_told(standing: Robot) -> None:
    below = tower(attempt(standing), TOP)
    check_stands(attempt(standing), below)
    standing.world.put(TOP, np.array([0.5, 0.3, 0.82, 1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(SkillError, match=f"{TOP} fell off {MID}") as failure:
        check_stands(attempt(standing), below)
    assert failure.value.status is SkillStatus.COLLAPSED


def test_a_toppled_tower_comes_down_above_its_foot(standing: Robot) -> None:
    world, rng = standing.world, np.random.default_rng(1)
    assert world.disturb("topple", rng, item=FREE) == f"nothing was toppled: nothing stands on {FREE}"
    assert world.disturb("topple", rng, item=LOW) == f"someone toppled what stood on {LOW}"
    assert max(heights(standing, LOW, MID, TOP)) < 0.03
    assert world.disturb("topple", rng) == "nothing was toppled: nothing stands on anything"


def test_blocks_are_swapped_within_towers(standing: Robot) -> None:
    world, rng = standing.world, np.random.default_rng(1)
    said = world.disturb("swap", rng, item=MID, **{"with": FREE})
    assert said == f"someone swapped {MID} and {FREE}"
    low, small = (2 * float(world.shapes[item].half[2]) for item in (LOW, FREE))
    assert heights(standing, LOW, FREE, TOP, MID) == pytest.approx([0.0, low, low + small, 0.0], abs=0.003)
    assert "one stands on the other" in world.disturb("swap", rng, item=LOW, **{"with": TOP})


def test_a_block_is_moved_into_a_column_and_onto_what_stands_there() -> None:
    objects = {"r": "block", "g": "block", "y": "block", "c1": "column", "c3": "column"}
    world = MujocoWorld(
        FOLDER / "columns" / "scene.toml", objects, seed=1, regions={"r": "c1", "g": "c3"}, stacked={"y": "r"}
    )
    robot = Robot(world)
    result = move(Step("moveblock", ("y", "c3")), robot._context())
    assert result.done, result.reason
    assert carrier(attempt(robot), "y") == "g"
    assert move(Step("moveblock", ("r", "c3")), robot._context()).done
    assert tower(attempt(robot), "c3") == ["r", "y", "g"]
    world.close()
