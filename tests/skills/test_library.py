"""What skills are made of: on tables and on the tops of other items alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from executive.sim.scene import ItemShape
from executive.sim.world import MujocoWorld
from executive.skills import Attempt, SkillError, Surface, check_rests, surfaces, table_under, transforms
from executive.types import Atom, SkillStatus, Step
from tests.executive.sim.stage import SCENE, TABLES, grocery
from tests.skills.test_skills import Robot

BLOCKS = ("block-a", "block-b", "block-c")
BLOCK = '[[item]]\nname = "{}"\nshape = "box"\nsize = [0.045, 0.045, 0.045]\nmass = 0.05\n'
CAN, LEMON = "soda-can", "lemon"


def blocks(folder: Path, seed: int = 0) -> Robot:
    file = folder / "scene.toml"
    file.write_text("\n".join([SCENE.read_text(encoding="utf-8"), *map(BLOCK.format, BLOCKS)]), encoding="utf-8")
    objects = {**dict.fromkeys(BLOCKS, "item"), **dict.fromkeys(TABLES, "table")}
    placed = dict.fromkeys(BLOCKS, "black-table")
    return Robot(MujocoWorld(file, objects, seed, placed))


def with_rider(seed: int = 20) -> Robot:
    """A can with a lemon on it, in the middle of the black table."""
    robot = Robot(grocery(seed, (CAN, LEMON), placed=dict.fromkeys((CAN, LEMON), "black-table")))
    world = robot.world
    height = world.spec.tables[1].centre[2]
    for item, above in ((CAN, 0.002), (LEMON, 2 * world.shapes[CAN].half[2] + 0.004)):
        shape = world.shapes[item]
        middle = np.array([0.46, 0.0, height + above + shape.half[2]])
        world.put(item, np.concatenate([middle - shape.centre, [1.0, 0.0, 0.0, 0.0]]))
    world.data.qvel[:] = 0.0
    world.settle(0.5)
    return robot


def attempt(robot: Robot, *args: str) -> Attempt:
    return Attempt(Step("act", args), robot._context())


def test_a_tower_is_built_and_taken_down(tmp_path: Path) -> None:
    robot = blocks(tmp_path)
    lower, middle, upper = BLOCKS
    for item, below in ((middle, lower), (upper, middle)):
        assert robot.pick(item, "black-table").done
        assert robot.place(item, below).done
    poses = {item: robot.world.pose(item) for item in BLOCKS}
    heights = [poses[item][2] for item in BLOCKS]
    assert np.diff(heights) == pytest.approx([0.045, 0.045], abs=0.002)
    assert np.hypot(*(poses[upper] - poses[lower])[:2]) < 0.01
    assert robot.pick(upper, lower).status is SkillStatus.NOT_THERE  # it is on the middle one
    assert robot.pick(upper, middle).done
    assert robot.place(upper, "white-table").done
    assert robot.so(f"on-table({upper},white-table)")
    assert robot.world.pose(middle)[2] == pytest.approx(heights[1], abs=0.002)


def test_what_rests_on_an_item_is_put_down_beside_it_before_it_is_taken() -> None:
    robot = with_rider()
    result = robot.pick(CAN, "black-table")
    assert result.done, result.reason
    assert robot.so(f"robot-gripping({CAN})")
    assert robot.so(f"on-table({LEMON},black-table)")
    assert robot.place(CAN, "wood-table").done
    assert robot.so(f"on-table({CAN},wood-table)")


def test_what_rests_on_an_item_is_found(tmp_path: Path) -> None:
    robot = with_rider()
    assert attempt(robot).riders(CAN).keys() == {LEMON}
    assert not attempt(robot).riders(LEMON)
    assert table_under(attempt(robot), LEMON) == "black-table"


def test_what_did_not_stay_where_it_was_put_is_told() -> None:
    robot = with_rider()
    check_rests(attempt(robot), LEMON, CAN)
    pose = robot.world.pose(LEMON)
    robot.world.put(LEMON, pose + np.array([0.12, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(SkillError) as failure:
        check_rests(attempt(robot), LEMON, CAN)
    assert failure.value.status is SkillStatus.FELL
    robot.world.put(LEMON, pose + np.array([0.0, 0.0, -0.9, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(SkillError, match="lemon did not stay on black-table"):
        check_rests(attempt(robot), LEMON, "black-table")


def test_a_box_that_rolls_off_a_ball_is_told(tmp_path: Path) -> None:
    ball = '[[item]]\nname = "ball"\nshape = "sphere"\nsize = [0.05, 0.05, 0.05]\nmass = 0.2\n'
    file = tmp_path / "scene.toml"
    file.write_text(f"{SCENE.read_text(encoding='utf-8')}\n{BLOCK.format('block-a')}{ball}", encoding="utf-8")
    objects = {"block-a": "item", "ball": "item", **dict.fromkeys(TABLES, "table")}
    robot = Robot(MujocoWorld(file, objects, 1, dict.fromkeys(("block-a", "ball"), "black-table")))
    assert robot.pick("block-a", "black-table").done
    result = robot.place("block-a", "ball")
    assert (result.status, result.holding) == (SkillStatus.FELL, False), result.reason
    assert robot.so("on-table(block-a,black-table)")


@pytest.mark.parametrize("axis", range(3))
def test_the_top_of_an_item_is_where_it_ends(axis: int) -> None:
    """A box of 4 x 6 x 10 cm, with each of its sides up in turn, and turned about the vertical."""
    half = np.array([0.02, 0.03, 0.05])
    shape = ItemShape("box", np.array([0.01, 0.0, -0.02]), half)
    item = np.eye(4)
    item[:3, :3] = transforms.matrix(np.array([0, 0, 0, np.cos(0.2), 0, 0, np.sin(0.2)]))[:3, :3]
    item[:3, :3] = item[:3, :3] @ np.roll(np.eye(3), axis, axis=1)
    item[:3, 3] = [0.4, 0.1, 0.9]
    top = Surface.of_item(item, shape)
    up = int(np.argmax(np.abs(item[2, :3])))
    assert top.centre == pytest.approx(item[:3, 3] + item[:3, :3] @ shape.centre + [0, 0, half[up]])
    assert sorted(top.size) == pytest.approx(sorted(2 * np.delete(half, up)))
    corner = top.centre[:2] + _axes(top.yaw).T @ (0.5 * np.array(top.size))
    corners = transforms.box_corners(item, shape.centre, half)
    assert np.linalg.norm(corners[:, :2] - corner, axis=1).min() < 1e-9


def test_an_item_is_put_on_another_edge_along_edge() -> None:
    shape = ItemShape("box", np.zeros(3), np.array([0.03, 0.02, 0.01]))
    below = Surface("base", np.array([0.4, 0.1, 0.85]), (0.06, 0.06), yaw=0.3, is_item=True)
    (spot, yaws), _ = surfaces.spots(np.eye(3), shape, below, {}, {}, np.random.default_rng(0))
    assert spot == pytest.approx([0.4, 0.1, 0.863])
    assert np.cos(2 * (yaws - 0.3)) ** 2 == pytest.approx(1.0)


def _axes(yaw: float) -> np.ndarray:
    return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])


def test_truth_agrees_that_a_tower_stands_on_its_table(tmp_path: Path) -> None:
    robot = blocks(tmp_path, seed=1)
    assert robot.pick("block-b", "black-table").done
    assert robot.place("block-b", "block-a").done
    assert robot.truth.of([Atom.parse("on-table(block-b,black-table)")]).true


def beside(item: str, other: str, gap: float, seed: int = 20) -> Robot:
    """One item so near another, along y, that no finger fits between them, on the black table."""
    robot = Robot(grocery(seed, (item, other), placed=dict.fromkeys((item, other), "black-table")))
    world, y = robot.world, 0.0
    height = world.spec.tables[1].centre[2]
    for name in (item, other):
        shape = world.shapes[name]
        middle = np.array([0.44, y, height + 0.001 + shape.half[2]])
        world.put(name, np.concatenate([middle - shape.centre, [1.0, 0.0, 0.0, 0.0]]))
        y += gap + world.shapes[item].half[1] + world.shapes[other].half[1]
    world.data.qvel[:] = 0.0
    world.settle(0.3)
    return robot


def test_what_is_in_the_way_of_the_fingers_is_moved_aside() -> None:
    robot = beside(LEMON, "milk-carton", 0.003)
    before = robot.world.pose("milk-carton")
    result = robot.pick(LEMON, "black-table")
    assert result.done, result.reason
    assert robot.so(f"robot-gripping({LEMON})")
    assert robot.so("on-table(milk-carton,black-table)")
    assert np.linalg.norm(robot.world.pose("milk-carton")[:2] - before[:2]) > 0.04


def test_what_fits_on_its_end_alone_is_stood_on_its_end(tmp_path: Path) -> None:
    bar = '[[item]]\nname = "bar"\nshape = "box"\nsize = [0.05, 0.14, 0.05]\nmass = 0.05\n'
    tray = '[[table]]\nname = "tray"\ncentre = [0.45, 0.0, 0.83]\nsize = [0.09, 0.09, 0.03]\n'
    file = tmp_path / "scene.toml"
    file.write_text(f"{SCENE.read_text(encoding='utf-8')}\n{bar}{tray}", encoding="utf-8")
    objects = {"bar": "item", "tray": "table", **dict.fromkeys(TABLES, "table")}
    robot = Robot(MujocoWorld(file, objects, placed={"bar": "wood-table"}))
    assert robot.pick("bar", "wood-table").done
    result = robot.place("bar", "tray")
    assert result.done, result.reason
    assert robot.so("on-table(bar,tray)")
    assert robot.world.pose("bar")[2] == pytest.approx(0.83 + 0.07, abs=0.003)


def test_what_stands_in_a_corner_is_dragged_out_of_it(tmp_path: Path) -> None:
    """Walls at two of its sides leave no room for a finger."""
    box = '[[item]]\nname = "box"\nshape = "box"\nsize = [0.06, 0.07, 0.045]\nmass = 0.05\n'
    walls = [
        f'[[table]]\nname = "wall-{side}"\ncentre = [{x}, {y}, 0.84]\nsize = [{deep}, {wide}, 0.04]\n'
        for side, x, y, deep, wide in (("far", 0.555, 0.05, 0.02, 0.2), ("left", 0.46, 0.155, 0.2, 0.02))
    ]
    file = tmp_path / "scene.toml"
    file.write_text("\n".join([SCENE.read_text(encoding="utf-8"), box, *walls]), encoding="utf-8")
    tables = ("wall-far", "wall-left", *TABLES)
    robot = Robot(MujocoWorld(file, {"box": "item", **dict.fromkeys(tables, "table")}, placed={"box": "white-table"}))
    robot.world.put("box", np.array([0.545 - 0.033, 0.145 - 0.038, 0.8235, 1.0, 0.0, 0.0, 0.0]))
    robot.world.settle(0.3)
    result = robot.pick("box", "black-table")
    assert result.done, result.reason
    assert "nudge" in robot.phases()
    assert robot.so("robot-gripping(box)")


def test_where_another_grasp_is_needed_the_item_is_put_down_and_taken_otherwise(tmp_path: Path) -> None:
    """A channel of 5.2 cm between two walls, along y: the box of 6 x 4 x 6 cm goes in along it, but the fingers, which
    hold it across its 4 cm, do not."""
    box = '[[item]]\nname = "box"\nshape = "box"\nsize = [0.06, 0.04, 0.06]\nmass = 0.05\n'
    floor = '[[table]]\nname = "channel"\ncentre = [0.46, 0.0, 0.82]\nsize = [0.052, 0.2, 0.02]\n'
    walls = [
        f'[[table]]\nname = "wall-{side}"\ncentre = [{x}, 0.0, 0.87]\nsize = [0.02, 0.2, 0.06]\n'
        for side, x in (("near", 0.423), ("far", 0.497))
    ]
    file = tmp_path / "scene.toml"
    file.write_text("\n".join([SCENE.read_text(encoding="utf-8"), box, floor, *walls]), encoding="utf-8")
    tables = ("channel", "wall-near", "wall-far", *TABLES)
    robot = Robot(MujocoWorld(file, {"box": "item", **dict.fromkeys(tables, "table")}, held="box"))
    result = robot.place("box", "channel")
    assert result.done, result.reason
    assert robot.phases().count("regrasp") == 1
    assert robot.so("on-table(box,channel)")


def test_where_others_leave_no_room_it_is_told_which(tmp_path: Path) -> None:
    """A tray of 11 x 11 cm in reach, with a lemon in the middle: the cereal box fits there once that is gone."""
    tray = '[[table]]\nname = "tray"\ncentre = [0.40, 0.0, 0.83]\nsize = [0.11, 0.11, 0.03]\n'
    file = tmp_path / "scene.toml"
    file.write_text(f"{SCENE.read_text(encoding='utf-8')}\n{tray}", encoding="utf-8")
    objects = {"cereal-box": "item", LEMON: "item", "tray": "table", **dict.fromkeys(TABLES, "table")}
    robot = Robot(MujocoWorld(file, objects, placed={LEMON: "wood-table"}, held="cereal-box"))
    middle = np.array([0.40, 0.0, 0.832 + robot.world.shapes[LEMON].half[2]])
    robot.world.put(LEMON, np.concatenate([middle - robot.world.shapes[LEMON].centre, [1.0, 0.0, 0.0, 0.0]]))
    robot.world.settle(0.3)
    result = robot.place("cereal-box", "tray")
    assert (result.status, result.blockers, result.holding) == (SkillStatus.BLOCKED, (LEMON,), True), result.reason
    assert robot.place("cereal-box", "white-table").done
    assert robot.pick(LEMON, "tray").done
    assert robot.place(LEMON, "wood-table").done
    assert robot.pick("cereal-box", "white-table").done
    result = robot.place("cereal-box", "tray")
    assert result.done, result.reason
