"""A moment drawn anew is the moment; other lights and cameras change the pictures as they say, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.sim.relighting import STEEPEST, Lights, Relighting, Shift, tint
from executive.sim.world import MujocoWorld
from executive.types import FloatArray
from tests.executive.sim.stage import OBJECTS, SCENE, grocery

SEEDS = st.integers(min_value=0, max_value=2**32)


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return grocery(seed=5)


@pytest.fixture(scope="module")
def studio() -> Iterator[Relighting]:
    with Relighting.of(SCENE, OBJECTS) as made:
        yield made


@pytest.fixture(scope="module")
def qpos(world: MujocoWorld) -> FloatArray:
    return np.array(world.data.qpos)


def test_a_moment_drawn_anew_is_what_the_world_showed(world: MujocoWorld, studio: Relighting, qpos: FloatArray) -> None:
    seen, drawn = world.observe().images, studio.pictures(qpos)
    assert list(drawn) == list(seen)
    for camera, picture in seen.items():
        assert np.array_equal(drawn[camera] | 1, picture | 1), f"{camera}: the same, but for the sensor's noise"


def test_what_was_changed_is_put_back(studio: Relighting, qpos: FloatArray) -> None:
    rng = np.random.default_rng(1)
    before = studio.pictures(qpos, cameras=["front"])["front"]
    other = studio.pictures(qpos, Lights.drawn(rng), {"front": Shift.drawn(rng)}, ["front"])["front"]
    assert np.abs(other.astype(int) - before).mean() > 3
    assert np.array_equal(studio.pictures(qpos, cameras=["front"])["front"], before)
    with pytest.raises(RuntimeError, match="on the way"), studio.set_up(qpos, Lights.drawn(rng)):
        raise RuntimeError("on the way")
    assert np.array_equal(studio.pictures(qpos, cameras=["front"])["front"], before)


def test_only_the_cameras_that_are_asked_for_are_drawn_or_moved(studio: Relighting, qpos: FloatArray) -> None:
    shift = Shift((0.03, 0.0, 0.0), (0.0, 0.0, 0.0))
    still, moved = studio.pictures(qpos), studio.pictures(qpos, shifts={"hand": shift})
    assert [camera for camera in still if not np.array_equal(still[camera], moved[camera])] == ["hand"]
    assert list(studio.pictures(qpos, cameras=["hand", "front"])) == ["front", "hand"]


def test_a_camera_moves_and_turns_as_it_is_told(studio: Relighting, qpos: FloatArray) -> None:
    camera = studio.model.camera("front").id

    def pose() -> tuple[FloatArray, FloatArray]:
        return studio.data.cam_xpos[camera].copy(), studio.data.cam_xmat[camera].reshape(3, 3).copy()

    with studio.set_up(qpos):
        place, axes = pose()
    with studio.set_up(qpos, shifts={"front": Shift((0.01, -0.02, 0.005), (0.0, 0.1, 0.0))}):
        moved, turned = pose()
    assert np.allclose(moved - place, (0.01, -0.02, 0.005))
    assert np.allclose(turned[:, 1], axes[:, 1])  # about its own y axis, which stays
    assert math.acos(float(turned[:, 0] @ axes[:, 0])) == pytest.approx(0.1)


def test_the_lamp_shines_from_where_it_is_said_to(studio: Relighting, qpos: FloatArray) -> None:
    dark = (0.0, 0.0, 0.0)

    def brightness(direction: tuple[float, float, float], lamp: tuple[float, float, float]) -> FloatArray:
        picture = studio.pictures(qpos, Lights(direction, lamp, dark, dark), cameras=["white"])["white"]
        return np.asarray(picture[200:300, 100:280].mean(axis=(0, 1)))

    above = brightness((0.0, 0.0, -1.0), (0.5, 0.5, 0.5))
    assert brightness((0.0, 0.0, 1.0), (0.5, 0.5, 0.5)).sum() < 0.2 * above.sum()  # from below the table top is dark
    red, green, blue = brightness((0.0, 0.0, -1.0), (0.5, 0.2, 0.1))
    assert red > green > blue


@given(SEEDS)
def test_what_is_drawn_stays_within_its_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lights, shift = Lights.drawn(rng), Shift.drawn(rng)
    assert np.linalg.norm(lights.direction) == pytest.approx(1.0)
    assert math.acos(-lights.direction[2]) <= STEEPEST + 1e-9
    faintest = 0.993  # of a tint's strongest part, between the temperatures of its table
    assert faintest * 0.5 * 0.55 <= max(lights.lamp) <= 1.5 * 0.55 + 1e-9
    for glow in (lights.glow, lights.ambient):
        assert faintest * 0.6 * 0.35 <= max(glow) <= 1.4 * 0.35 + 1e-9
    assert np.linalg.norm(shift.offset) <= 0.03 + 1e-9
    assert np.linalg.norm(shift.turn) <= math.radians(3.0) + 1e-9
    assert Lights.drawn(np.random.default_rng(seed)) == lights


@given(st.floats(min_value=1000.0, max_value=20000.0))
def test_a_tint_is_warm_below_and_cool_above(kelvin: float) -> None:
    red, _, blue = tint(kelvin)
    assert 0.5 < max(tint(kelvin)) <= 1.0
    assert (red >= blue) if kelvin <= 6000 else (red <= blue) or kelvin < 7000


def test_positions_and_cameras_of_another_scene_are_named(studio: Relighting, qpos: FloatArray) -> None:
    with pytest.raises(InputError, match="of another scene: 7, and this one has 54"):
        studio.pictures(qpos[:7])
    with pytest.raises(InputError, match="did you mean 'front'"):
        studio.pictures(qpos, cameras=["fron"])
    with pytest.raises(InputError, match="did you mean 'hand'"):
        studio.pictures(qpos, shifts={"hands": Shift((0, 0, 0), (0, 0, 0))})


def test_a_model_may_be_shared_with_a_world(world: MujocoWorld, qpos: FloatArray) -> None:
    rng = np.random.default_rng(2)
    before = world.render("wood")
    with Relighting(world.model, world.spec) as studio:
        studio.pictures(qpos, Lights.drawn(rng), {"wood": Shift.drawn(rng)}, ["wood"])
    assert np.array_equal(world.render("wood"), before)
    assert np.array_equal(world.data.qpos, qpos)
