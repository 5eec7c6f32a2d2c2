"""What faults do to the simulated world: as told, to nothing else, and never to what the hand holds."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np
import pytest

from executive.errors import InputError
from executive.protocols import Skill, SkillContext
from executive.sim.disturbances import BOXES
from executive.sim.scene import PADS
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills.pick import pick
from executive.skills.place import place
from executive.types import Atom, FloatArray, SkillStatus, Step
from tests.executive.sim.stage import ITEMS, MEANING, TABLES, grocery


@pytest.fixture(scope="module")
def stage() -> tuple[MujocoWorld, bytes]:
    world = grocery(2, blockings=1)
    return world, world.snapshot()


@pytest.fixture
def world(stage: tuple[MujocoWorld, bytes]) -> MujocoWorld:
    stage[0].restore(stage[1])
    return stage[0]


def where(world: MujocoWorld) -> dict[str, str]:
    atoms = [Atom("on-table", (item, table)) for item in ITEMS for table in TABLES]
    return {atom.args[0]: atom.args[1] for atom in Truth(world, MEANING).of(atoms).true}


def up(pose: FloatArray) -> float:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, pose[3:])
    return float(rotation[8])


def uninterrupted(world: MujocoWorld, before: dict[str, FloatArray], *but: str) -> bool:
    return all(np.abs(world.pose(item) - before[item]).max() < 0.01 for item in ITEMS if item not in but)


def test_boxes_that_wait_change_no_scene_and_no_picture(world: MujocoWorld) -> None:
    plain = grocery(2)
    for item in ITEMS:
        assert np.allclose(world.pose(item), plain.pose(item), atol=1e-4)
    assert len(world.boxes) == BOXES
    images = plain.observe().images
    for camera, image in world.observe().images.items():
        assert float(np.mean(image != images[camera])) < 0.01, f"{camera} sees boxes that are not there yet"
    plain.close()


def test_someone_moves_an_item_to_a_table_of_his_choice(world: MujocoWorld) -> None:
    before = world.obstacles()
    for table in TABLES:
        said = world.disturb("shove", np.random.default_rng(1), item="lemon", table=table)
        assert said == f"someone moved lemon to {table}"
        assert where(world)["lemon"] == table
    assert uninterrupted(world, before, "lemon")


def _note(world: MujocoWorld, seen: list[dict[str, FloatArray]]) -> None:
    seen.append({name: world.pose(name) for name in ("lemon", "soda-can")})


def test_what_is_done_in_view_takes_its_time_and_ends_as_what_is_done_at_once(world: MujocoWorld) -> None:
    before, snapshot = world.obstacles(), world.snapshot()
    places = []
    for arguments in ({}, {"seconds": "2"}):
        world.restore(snapshot)
        began, seen = world.time, list[dict[str, FloatArray]]()
        for tick in range(1, 9):
            world.schedule(tick / 5, partial(_note, world, seen))
        world.disturb("swap", np.random.default_rng(1), item="lemon", **{"with": "soda-can"}, **arguments)
        assert world.time - began == pytest.approx(2.3 if arguments else 0.3, abs=0.05)
        assert uninterrupted(world, before, "lemon", "soda-can")
        places.append({name: world.pose(name)[:2] for name in ("lemon", "soda-can")})
    for name in ("lemon", "soda-can"):
        assert np.linalg.norm(places[0][name] - places[1][name]) < 0.02
        steps = np.linalg.norm(np.diff([each[name][:3] for each in seen], axis=0), axis=1)
        assert steps.max() < 0.3, "it is carried, and not suddenly elsewhere"
    apart = [float(np.linalg.norm(each["lemon"][:3] - each["soda-can"][:3])) for each in seen]
    assert min(apart) > 0.08


def test_what_is_taken_away_is_nowhere(world: MujocoWorld) -> None:
    before, expected = world.obstacles(), where(world)
    del expected["lemon"]
    assert world.disturb("take", np.random.default_rng(0), item="lemon") == "someone took lemon away"
    assert where(world) == expected
    world.settle(0.5)
    assert np.hypot(*world.pose("lemon")[:2]) > 3.0
    assert uninterrupted(world, before, "lemon")


def test_two_items_change_places(world: MujocoWorld) -> None:
    before, expected = world.obstacles(), where(world)
    expected |= {"lemon": expected["cereal-box"], "cereal-box": expected["lemon"]}
    said = world.disturb("swap", np.random.default_rng(1), item="lemon", **{"with": "cereal-box"})
    assert said == "someone swapped lemon and cereal-box"
    world.settle(0.5)
    assert where(world) == expected
    assert np.linalg.norm(world.pose("lemon")[:2] - before["cereal-box"][:2]) < 0.03
    assert uninterrupted(world, before, "lemon", "cereal-box")


@pytest.mark.parametrize("item", ["cereal-box", "milk-carton", "water-bottle", "soda-can"])
def test_what_is_tipped_over_lies_where_it_stood(world: MujocoWorld, item: str) -> None:
    before, expected = world.obstacles(), where(world)
    assert world.disturb("tip", np.random.default_rng(3), item=item) == f"{item} was tipped over"
    assert abs(up(world.pose(item))) < 0.3
    assert where(world)[item] == expected[item]
    assert uninterrupted(world, before, item)


def test_what_is_pushed_to_the_floor_lies_there(world: MujocoWorld) -> None:
    before, expected = world.obstacles(), where(world)
    for item in ("lemon", "cereal-box"):
        table = expected.pop(item)
        assert world.disturb("push", np.random.default_rng(0), item=item) == f"{item} was pushed off {table}"
    world.settle(1.0)
    assert where(world) == expected
    assert all(world.pose(item)[2] < 0.2 for item in ("lemon", "cereal-box"))
    assert uninterrupted(world, before, "lemon", "cereal-box")


def carried_out(skill: Skill, world: MujocoWorld, *args: str) -> SkillStatus:
    step = Step.strips(getattr(skill, "__name__", ""), args)
    context = SkillContext(world.handle, np.random.default_rng(0), lambda _: None, lambda: False)
    return skill(step, context).status


def test_a_blocked_table_has_no_room(world: MujocoWorld) -> None:
    before, (clear, *_) = world.obstacles(), [name for name, table in where(world).items() if table == "black-table"]
    assert clear == "bread-loaf"
    world.put(clear, world.pose(clear) - [0.0, 1.0, 0.8, 0.0, 0.0, 0.0, 0.0])  # else its surroundings stay free
    assert world.disturb("block", np.random.default_rng(0), table="black-table").endswith("boxes on black-table")
    world.settle(0.5)
    assert uninterrupted(world, before, clear)
    again = world.disturb("block", np.random.default_rng(0), table="black-table")
    assert again.startswith("black-table was to be blocked, but ")
    assert carried_out(pick, world, "lemon", where(world)["lemon"]) is SkillStatus.DONE
    assert carried_out(place, world, "lemon", "black-table") is SkillStatus.UNREACHABLE
    assert carried_out(place, world, "lemon", "wood-table") is SkillStatus.DONE


def test_what_is_small_finds_the_room_that_boxes_leave(world: MujocoWorld) -> None:
    world.disturb("block", np.random.default_rng(0), table="black-table")
    world.settle(0.5)
    assert carried_out(pick, world, "lemon", where(world)["lemon"]) is SkillStatus.DONE
    assert carried_out(place, world, "lemon", "black-table") is SkillStatus.DONE
    assert where(world)["lemon"] == "black-table"


def _axis(before: FloatArray, after: FloatArray) -> FloatArray:
    """The axis about which a pose (7,) was turned to get to another."""
    inverse, turn = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(inverse, before[3:])
    mujoco.mju_mulQuat(turn, after[3:], inverse)
    return np.asarray(turn[1:] / np.linalg.norm(turn[1:]))


def _across_pads(world: MujocoWorld) -> FloatArray:
    left, right = (world.data.geom(name).xpos for name in PADS)
    return np.asarray((right - left) / np.linalg.norm(right - left))


@pytest.mark.parametrize("item", ["lemon", "milk-carton"])
def test_an_item_slips_in_the_grip_and_is_held_on(world: MujocoWorld, item: str) -> None:
    assert carried_out(pick, world, item, where(world)[item]) is SkillStatus.DONE
    saved, before = world.snapshot(), world.pose(item)
    slipped = 0
    for seed in range(5):
        world.restore(saved)
        said = world.disturb("slip", np.random.default_rng(seed))
        assert abs(_axis(before, world.pose(item)) @ _across_pads(world)) > 0.999, "it pivots between the pads"
        world.settle(0.5)
        after = world.pose(item)
        assert world.gripped() == item
        assert Truth(world, MEANING).of([Atom("robot-gripping", (item,))]).true
        turned = 2 * np.arccos(min(1.0, abs(float(before[3:] @ after[3:]))))
        slipped += said.startswith(f"{item} turned by ") and 0.1 < turned < 0.7
    assert slipped >= 4
    assert carried_out(place, world, item, where(world).get(item, "wood-table")) is SkillStatus.DONE


def test_nobody_takes_anything_out_of_the_hand(world: MujocoWorld) -> None:
    assert carried_out(pick, world, "lemon", where(world)["lemon"]) is SkillStatus.DONE
    for kind in ("shove", "take", "tip", "push"):
        assert world.disturb(kind, np.random.default_rng(0), item="lemon").endswith("the robot holds it")
    assert world.disturb("swap", np.random.default_rng(0), item="lemon").startswith("nothing was swapped")


def test_an_empty_hand_lets_nothing_slip(world: MujocoWorld) -> None:
    assert world.disturb("slip", np.random.default_rng(0)) == "nothing slipped: the hand is empty"


@pytest.mark.parametrize(
    ("kind", "arguments", "words"),
    [
        ("eclipse", {}, "cannot be disturbed by 'eclipse'"),
        ("take", {"item": "pear"}, "no item 'pear' to take"),
        ("swap", {"with": "pear"}, "no item 'pear' to swap"),
        ("shove", {"item": "box-1"}, "no item 'box-1' to shove"),
        ("block", {"table": "lemon"}, "no table 'lemon'"),
    ],
)
def test_what_there_is_not_is_bad_input(world: MujocoWorld, kind: str, arguments: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        world.disturb(kind, np.random.default_rng(0), **arguments)


@pytest.mark.parametrize("kind", ["shove", "take", "swap", "tip", "push", "block"])
def test_the_same_chance_does_the_same(world: MujocoWorld, kind: str) -> None:
    saved, ends = world.snapshot(), []
    for _ in range(2):
        world.restore(saved)
        ends.append((world.disturb(kind, np.random.default_rng(7)), world.data.qpos.copy()))
    assert ends[0][0] == ends[1][0]
    assert np.array_equal(ends[0][1], ends[1][1])
