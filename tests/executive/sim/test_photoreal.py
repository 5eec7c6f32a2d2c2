"""Photorealistic pictures: shapes are where MuJoCo draws them, and the same seed gives the same picture."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from scipy import ndimage

from executive.app.config import RunConfig
from executive.errors import MissingError, OptionError
from executive.sim import photoreal
from executive.sim.world import MujocoWorld
from tests.executive.sim.test_blocks import BASE, MIDDLE, SCENE, TOP

OBJECTS = dict.fromkeys((BASE, MIDDLE, TOP), "block")


@pytest.fixture(scope="module")
def world() -> Iterator[MujocoWorld]:
    pytest.importorskip("mitsuba", reason="the extra photoreal is not installed")
    world = MujocoWorld(SCENE, OBJECTS, seed=2, stacked={TOP: MIDDLE}, renderer="mitsuba")
    yield world
    world.close()


@pytest.mark.slow
def test_silhouettes_are_those_that_mujoco_draws_to_a_pixel(world: MujocoWorld) -> None:
    camera, drawing = world.spec.cameras[0], world.cameras.drawing.photoreal()
    mujoco.mj_forward(world.model, world.data)
    geoms = world.cameras.drawing.geoms(world.data, camera)
    drawing._move(world.data)
    numbers = drawing._mi.load_dict({"type": "aov", "aovs": "shape:shape_index"})
    shapes = np.round(drawing._rendered(numbers, drawing._sensor(world.data, camera), 1)[..., 0]).astype(int)
    for item in OBJECTS:
        mine = geoms == world.model.geom(f"{item}/body").id
        assert mine.sum() > 200
        values, counts = np.unique(shapes[mine], return_counts=True)
        theirs = shapes == values[counts.argmax()]
        beyond = (mine & ~ndimage.binary_dilation(theirs)) | (theirs & ~ndimage.binary_dilation(mine))
        assert not beyond.any()


@pytest.mark.slow
def test_the_same_seed_and_state_give_the_same_picture_and_another_seed_another_light(world: MujocoWorld) -> None:
    first = world.render("front")
    pose = world.pose(TOP)
    world.put(TOP, np.array([0.5, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0]))
    moved = world.render("front")
    assert (moved != first).any()
    world.put(TOP, pose)
    assert (world.render("front") == first).all(), "the scene is kept, and what moved is moved back"
    other = photoreal.PhotorealDrawing(world.model, world.spec, seed=3)
    assert (other.picture(world.data, world.spec.cameras[0]) != first).mean() > 0.5
    told: list[str] = []
    world.prepare(told.append)
    assert any("s a picture" in line for line in told)


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photoreal, "find_spec", lambda name: None)
    with pytest.raises(MissingError, match="photoreal"):
        MujocoWorld(SCENE, OBJECTS, renderer="mitsuba")


def test_a_renderer_is_one_that_there_is() -> None:
    with pytest.raises(OptionError, match="did you mean 'mitsuba'"):
        RunConfig("blocksworld", renderer="mitsuab")
    with pytest.raises(OptionError, match="no pictures to draw"):
        RunConfig("blocksworld", world="symbolic", renderer="mitsuba")


def test_an_llvm_that_ends_the_process_is_told_by_trying_it_in_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    monkeypatch.setenv(photoreal._LLVM, "/nowhere/libLLVM.so")
    assert photoreal._variant() == "scalar_rgb"
