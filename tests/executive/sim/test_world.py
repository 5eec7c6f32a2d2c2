"""The world is drawn by seed, can be saved and restored, is seen whole, and is broken only as it is told."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from executive.errors import DomainError, InputError
from executive.protocols import Estimator, Simulator, World
from executive.sim import placement, scene
from executive.sim.truth import Oracle, Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom, FloatArray, Frame, Observation
from tests.contracts import EstimatorContract, SimulatorContract
from tests.executive.sim.stage import ITEMS, MEANING, OBJECTS, ROOT, SCENE, TABLES, grocery


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return grocery(seed=3)


class TestMujocoWorld(SimulatorContract):
    def make(self) -> Simulator:
        return grocery(seed=1)

    def pass_time(self, world: World, seconds: float) -> None:
        assert isinstance(world, MujocoWorld)
        world.settle(seconds)


class TestOracle(EstimatorContract):
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        world = grocery(seed=1)
        atoms = [Atom("on-table", (item, table)) for item in ITEMS for table in TABLES]
        return Oracle(Truth(world, MEANING)), world.observe(), atoms


@pytest.mark.parametrize("seed", range(5))
def test_items_stand_upright_apart_and_within_reach(seed: int) -> None:
    drawn = grocery(seed)
    poses = drawn.obstacles()
    truth = Truth(drawn, MEANING).of([Atom("on-table", (item, table)) for item in ITEMS for table in TABLES])
    near, far = drawn.spec.robot.reach
    for item, pose in poses.items():
        up = np.zeros(9)
        mujoco.mju_quat2Mat(up, pose[3:])
        assert up[8] > 0.99, f"{item} does not stand upright"
        assert sum(truth[Atom("on-table", (item, table))] for table in TABLES) == 1
        assert near - 0.02 <= np.hypot(*pose[:2]) <= far + 0.02
        for other, place in poses.items():
            if other != item:
                room = placement.circle(drawn.shapes[item]) + placement.circle(drawn.shapes[other])
                assert np.hypot(*(pose[:2] - place[:2])) > room + drawn.spec.placement.gap - 0.02


def test_seed_fixes_the_scene_and_another_changes_it() -> None:
    first, again, other = grocery(7).obstacles(), grocery(7).obstacles(), grocery(8).obstacles()
    assert all(np.array_equal(first[item], again[item]) for item in ITEMS)
    assert any(not np.allclose(first[item], other[item]) for item in ITEMS)


def test_declared_places_are_kept() -> None:
    for seed in range(3):
        drawn = grocery(seed, placed={"milk-carton": "black-table", "cereal-box": "wood-table"})
        assert Truth(drawn, MEANING).of([Atom.parse("on-table(milk-carton,black-table)")]).true
        assert Truth(drawn, MEANING).of([Atom.parse("on-table(cereal-box,wood-table)")]).true
    with pytest.raises(DomainError, match="is no table"):
        grocery(0, placed={"lemon": "milk-carton"})


def located(world: MujocoWorld) -> FloatArray:
    pose = world.locate("lemon")
    assert pose is not None
    return pose


def test_restored_world_goes_on_as_the_saved_one(world: MujocoWorld) -> None:
    saved = world.snapshot()
    world.command_gripper(1.0)
    world.settle(0.5)
    first, there = world.data.qpos.copy(), located(world)
    world.restore(saved)
    world.command_gripper(1.0)
    world.settle(0.5)
    assert np.array_equal(world.data.qpos, first)
    assert np.array_equal(located(world), there)
    world.restore(saved)


def test_a_restored_hand_goes_on_gripping() -> None:
    drawn = grocery(0, items=("lemon",))
    drawn.command_gripper(1.0)
    drawn.settle(0.6)
    saved, closed = drawn.snapshot(), drawn.gripper_width()
    drawn.command_gripper(0.0)
    drawn.settle(0.6)
    assert drawn.gripper_width() > 0.06
    drawn.restore(saved)
    drawn.settle(0.6)
    assert drawn.gripper_width() == pytest.approx(closed, abs=0.001)


def test_foreign_snapshot_is_refused(world: MujocoWorld) -> None:
    saved = world.snapshot()
    for foreign in (b"", b"nonsense", saved[:200], saved[:-20], b"PK\x03\x04nonsense"):
        with pytest.raises(InputError, match="not a snapshot"):
            world.restore(foreign)
    with pytest.raises(InputError, match="another scene"):
        world.restore(grocery(0, items=("lemon",)).snapshot())


def test_nothing_but_the_hands_own_joints_is_constrained(world: MujocoWorld) -> None:
    model = world.model
    assert all(kind == mujoco.mjtEq.mjEQ_JOINT for kind in model.eq_type)
    joints = {model.joint(index).name for index in (*model.eq_obj1id, *model.eq_obj2id)}
    assert joints == set(scene.FINGER_JOINTS)


def segmented(renderer: mujoco.Renderer) -> Any:
    """The geom that each pixel shows, (H, W)."""
    renderer.enable_segmentation_rendering()
    try:
        return np.array(renderer.render())[:, :, 0]
    finally:
        renderer.disable_segmentation_rendering()


@pytest.mark.parametrize("seed", [3, 5, 11])
def test_every_item_and_the_jaws_can_be_seen(seed: int) -> None:
    drawn = grocery(seed)
    seen = dict.fromkeys([*ITEMS, "jaws"], 0)
    fingers = {drawn.model.body(name).id for name in ("left_inner_finger", "right_inner_finger")}
    for camera in drawn.spec.cameras:
        owner = np.append(drawn.model.geom_bodyid, -1)[drawn.cameras.drawing.drawn(drawn.data, camera, segmented)]
        for item in ITEMS:
            root = drawn.model.body(item).id
            bodies = np.flatnonzero(drawn.model.body_rootid == root)
            seen[item] = max(seen[item], int(np.isin(owner, bodies).sum()))
        seen["jaws"] = max(seen["jaws"], int(np.isin(owner, list(fingers)).sum()))
    drawn.close()
    assert min(seen.values()) > 500, seen


def test_a_dropping_gripper_opens_and_obeys_again(world: MujocoWorld) -> None:
    saved = world.snapshot()
    world.command_gripper(1.0)
    world.settle(0.6)
    assert world.gripper_width() < 0.01
    world.disturb("drop", np.random.default_rng(0))
    world.settle(0.5)
    assert world.gripper_width() > 0.06
    world.settle(1.2)
    assert world.gripper_width() < 0.01
    world.restore(saved)


def test_a_miss_misleads_once(world: MujocoWorld) -> None:
    right = located(world)
    world.disturb("miss", np.random.default_rng(0))
    wrong = located(world)
    assert np.linalg.norm(wrong[:2] - right[:2]) == pytest.approx(0.075)
    assert np.array_equal(located(world), right)


def test_a_shove_moves_one_item_to_another_free_place() -> None:
    drawn = grocery(2)
    before = drawn.obstacles()
    said = drawn.disturb("shove", np.random.default_rng(4), item="soda-can")
    after = drawn.obstacles()
    assert said.startswith("someone moved soda-can to ")
    table = said.rsplit(" ", 1)[1]
    assert Truth(drawn, MEANING).of([Atom("on-table", ("soda-can", table))]).true
    assert np.linalg.norm(after["soda-can"][:2] - before["soda-can"][:2]) > 0.02
    for item in set(ITEMS) - {"soda-can"}:
        assert np.linalg.norm(after[item][:3] - before[item][:3]) < 0.005


def test_nobody_puts_an_item_where_the_arm_is(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = grocery(2)
    before = drawn.obstacles()
    in_the_wrist = np.array([*drawn.data.body("wrist_3_link").xpos, 1.0, 0.0, 0.0, 0.0])
    monkeypatch.setattr(placement, "free_spot", lambda *_, **__: ("black-table", in_the_wrist))
    assert "no table has room" in drawn.disturb("shove", np.random.default_rng(0), item="lemon")
    for item in ITEMS:
        assert np.array_equal(drawn.obstacles()[item], before[item])


def test_nobody_takes_an_item_out_of_the_hand() -> None:
    drawn = grocery(0, items=("water-bottle",))
    drawn.command_gripper(1.0)
    for _ in range(40):  # held up by its neck while the fingers close
        drawn.put("water-bottle", np.array([*(drawn.data.site("grip_site").xpos - [0, 0, 0.06]), 1, 0, 0, 0]))
        drawn.advance()
    assert "the robot holds it" in drawn.disturb("shove", np.random.default_rng(0), item="water-bottle")
    assert "the robot holds it" in drawn.disturb("shove", np.random.default_rng(0))


def test_cameras_of_different_sizes_are_drawn_in_their_own(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    wide = SCENE.read_text(encoding="utf-8").replace("fovy_degrees = 48", "fovy_degrees = 48\nwidth = 320\nheight = 96")
    file.write_text(wide, encoding="utf-8")
    drawn = MujocoWorld(file, {"lemon": "item", **dict.fromkeys(TABLES, "table")})
    for _ in range(2):
        shapes = {camera: image.shape for camera, image in drawn.observe().images.items()}
        assert shapes.pop("front") == (96, 320, 3)
        assert set(shapes.values()) == {(384, 384, 3)}
    drawn.close()
    drawn.close()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "lemon"', 'name = "right_hand"', "MuJoCo refuses this scene: .*repeated name 'right_hand'"),
        ("2.0548", "9.0", r"robot\.home: elbow_joint does not turn that far"),
        ("-1.7152", "-0.9", r"robot\.home: there the arm touches black-table"),
        ("gap = 0.06", "gap = 0.9", r"placement\.gap: no room was found"),
    ],
)
def test_scenes_that_cannot_be_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = SCENE.read_text(encoding="utf-8") + "\n[placement]\ngap = 0.06\n"
    assert old in text
    file = tmp_path / "scene.toml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    objects = {**OBJECTS, "right_hand": "item"} if "right_hand" in new else OBJECTS
    objects = {name: kind for name, kind in objects.items() if name != "lemon" or "right_hand" not in new}
    with pytest.raises(DomainError, match=rf"scene\.toml: {words}"):
        MujocoWorld(file, objects)


def test_robot_on_the_floor_and_table_that_is_a_block(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    text = SCENE.read_text(encoding="utf-8").replace("position = [0.0, 0.0, 0.92]", "position = [0.0, 0.0, 0.0]", 1)
    for height in ("0.41", "0.0", "-0.41"):
        text = text.replace(
            f"{height}, 0.80]\nsize = [0.44, 0.40, 0.04]", f"{height}, 0.04]\nsize = [0.44, 0.40, 0.04]"
        )
    file.write_text(text, encoding="utf-8")
    assert MujocoWorld(file, OBJECTS).joints() == pytest.approx(grocery(0).handle.limits.home, abs=0.02)


def test_watchers_see_frames_and_change_nothing() -> None:
    watched, alone = grocery(5), grocery(5)
    frames: list[Frame] = []
    watched.watch(lambda frame: frames.append(frame) if isinstance(frame, Frame) else None)
    for each in (watched, alone):
        each.command_gripper(1.0)
        each.settle(1.0)
    assert 8 <= len(frames) <= 12
    assert np.array_equal(watched.data.qpos, alone.data.qpos)
    assert set(ITEMS) <= set(frames[0].poses)


def test_scenery_is_sound_and_names_what_frames_move(world: MujocoWorld) -> None:
    scenery = world.scenery()
    moving = set(world.frame().poses)
    for geometry in scenery.geometries:
        assert geometry.faces.max() < len(geometry.vertices)
        assert np.isfinite(geometry.vertices).all()
        assert geometry.body == "" or geometry.body in moving
    assert {camera.name for camera in scenery.cameras} == {camera.name for camera in world.spec.cameras}
    assert sum(len(geometry.vertices) for geometry in scenery.geometries) < 40_000


def test_a_world_that_nobody_closed_ends_silently() -> None:
    program = """
import executive.app.run  # which settles how pictures are drawn
from tests.executive.sim.stage import grocery
world = grocery(0, ("lemon",))
print(len(world.observe().images))
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("5\n", "")
