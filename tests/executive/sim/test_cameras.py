"""Pictures and depth of one moment are drawn once, and are those that are drawn one by one."""

from __future__ import annotations

import numpy as np
import pytest

from executive.sim import rendering
from executive.sim.depth_kernels import FARTHEST
from executive.sim.world import MujocoWorld
from tests.executive.sim.stage import grocery


@pytest.fixture
def world() -> MujocoWorld:
    return grocery(5, items=("lemon", "soda-can"), depth=True)


def test_picture_and_depth_are_those_that_are_drawn_one_by_one(world: MujocoWorld) -> None:
    drawing = world.cameras.drawing
    for camera in world.spec.cameras:
        picture, depth = drawing.picture_and_depth(world.data, camera)
        alone = drawing.depth(world.data, camera)
        assert np.array_equal(picture, drawing.picture(world.data, camera))
        within = alone <= FARTHEST
        assert within.any()
        assert np.array_equal(depth[within], alone[within])
        assert (depth[~within] > FARTHEST).all()


def test_an_estimate_at_the_moment_of_a_look_has_its_depth(world: MujocoWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    look = world.observe()
    monkeypatch.setattr(rendering, "_there", lambda work: pytest.fail("nothing has moved, and it is drawn again"))
    sensed = world.sense()
    assert sensed.depth.keys() == look.depth.keys()
    assert all(np.array_equal(sensed.depth[name], look.depth[name]) for name in look.depth)


@pytest.mark.parametrize("change", ["time", "item", "camera"])
def test_what_has_moved_is_drawn_again(world: MujocoWorld, change: str) -> None:
    before = world.sense()
    if change == "time":
        world.settle(0.05)
    elif change == "item":
        pose = world.pose("lemon")
        pose[2] += 0.1
        world.put("lemon", pose)
    else:
        world.move_camera("front", np.array([0.0, 0.02, 0.0]))
    after = world.sense()
    assert not np.array_equal(after.depth["front"], before.depth["front"])
    assert np.array_equal(after.depth["wood"], before.depth["wood"]) == (change == "camera")


def test_only_cameras_that_are_asked_for_are_drawn(world: MujocoWorld) -> None:
    assert world.observe(cameras=["hand"]).images.keys() == {"hand"}
    assert world.observe(cameras=[]).images == {}
