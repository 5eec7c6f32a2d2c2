"""Depth is measured with the errors of a real sensor, from a stream of random numbers of its own."""

from __future__ import annotations

import numpy as np
import pytest

from executive.errors import DomainError
from executive.sim.depth_kernels import FARTHEST, NEAREST
from executive.sim.depth_sensor import measured
from executive.sim.spec import CameraSpec, read_scene
from executive.types import DepthImage, FloatArray, Image
from tests.executive.sim.stage import SCENE, grocery

SIZE = 96
GREY = np.full((SIZE, SIZE, 3), 128, np.uint8)


def camera(noise: float = 0.002) -> CameraSpec:
    return CameraSpec(
        name="front", position=(0, 0, 1), target=(1, 0, 0), width=SIZE, height=SIZE, depth=True, depth_noise=noise
    )


def sense(exact: FloatArray, image: Image = GREY, noise: float = 0.002, seed: int = 0) -> DepthImage:
    return measured(exact, image, camera(noise), np.random.default_rng(seed))


def flat(distance: float) -> FloatArray:
    return np.full((SIZE, SIZE), distance)


def test_the_error_grows_with_the_square_of_the_distance() -> None:
    near, far = (np.std(sense(flat(z)) / 1000.0 - z) for z in (0.75, 1.5))
    assert 0.8 * 0.002 * 1.5**2 < far < 1.3 * 0.002 * 1.5**2
    assert 3.3 < far / near < 4.7


def test_neighbours_share_a_part_of_their_errors() -> None:
    error = sense(flat(1.0)) / 1000.0 - 1.0
    beside, apart = (np.corrcoef(error[:, :-by].ravel(), error[:, by:].ravel())[0, 1] for by in (1, 8))
    assert beside > 0.4
    assert abs(apart) < 0.1


def test_without_noise_it_is_the_distance_to_a_millimetre() -> None:
    exact = np.linspace(0.5, 2.0, SIZE * SIZE).reshape(SIZE, SIZE)
    assert np.abs(sense(exact, noise=0.0) / 1000.0 - exact).max() <= 0.0005 + 1e-9


def test_a_frontal_grey_wall_is_measured_everywhere() -> None:
    assert (sense(flat(1.0)) > 0).all()


@pytest.mark.parametrize("distance", [NEAREST - 0.05, FARTHEST + 0.5])
def test_what_is_too_near_or_too_far_is_not_measured(distance: float) -> None:
    assert not sense(flat(distance)).any()


def test_at_an_edge_most_is_lost_and_the_rest_lies_between() -> None:
    exact = flat(1.5)
    exact[:, SIZE // 2 :] = 1.0
    strip = sense(exact)[:, SIZE // 2 - 1 : SIZE // 2 + 1]
    assert 0.5 < (strip == 0).mean() < 0.9
    assert ((strip == 0) | ((strip > 950) & (strip < 1550))).all()
    assert np.ptp(strip[strip > 0]) > 300, "some of it is neither of the two"


@pytest.mark.parametrize(("level", "at_least"), [(0, 0.5), (255, 0.4)])
def test_dark_and_saturated_surfaces_are_measured_in_part(level: int, at_least: float) -> None:
    lost = (sense(flat(1.0), np.full_like(GREY, level)) == 0).mean()
    assert at_least < lost < 0.8


def test_a_surface_seen_at_a_glancing_angle_is_lost() -> None:
    size = 4 * SIZE
    fine = CameraSpec(name="front", position=(0, 0, 1), target=(1, 0, 0), width=size, height=size, depth=True)
    across = (np.arange(size) + 0.5 - size / 2) * 2.0 * np.tan(np.deg2rad(22.5)) / size
    lost = []
    for lean in (0.0, 60.0, 80.0):  # degrees; of a plane, the inverse distance is linear in the picture
        nearness = np.tile(1.0 - across * np.tan(np.deg2rad(lean)), (size, 1))
        exact = np.where(nearness > 0.5, 1.0 / np.maximum(nearness, 0.5), 0.0)
        image = np.full((size, size, 3), 128, np.uint8)
        middle = (slice(None), slice(size // 2 - 10, size // 2 + 10))
        lost.append((measured(exact, image, fine, np.random.default_rng(0))[middle] == 0).mean())
    assert lost[0] == 0.0
    assert lost[1] == 0.0
    assert 0.3 < lost[2] < 0.6, "the cosine is 0.17 there, and the chance 1 - 0.17 / 0.3"


def test_the_same_moment_of_the_same_seed_is_measured_alike() -> None:
    worlds = [grocery(seed, items=("lemon",), depth=True) for seed in (5, 5, 6)]
    first, again, other = (world.observe().depth for world in worlds)
    assert set(first) == {camera.name for camera in worlds[0].spec.cameras if camera.depth}
    for name, depth in first.items():
        assert np.array_equal(depth, again[name])
        assert not np.array_equal(depth, other[name])


def test_measuring_depth_changes_nothing_else() -> None:
    plain, deep = grocery(5, items=("lemon",)), grocery(5, items=("lemon",), depth=True)
    for _ in range(2):
        one, other = plain.observe(), deep.observe()
        assert not one.depth
        assert other.depth
        assert all(np.array_equal(one.images[name], other.images[name]) for name in one.images)
        assert np.array_equal(plain.pose("lemon"), deep.pose("lemon"))
        plain.settle(0.05)
        deep.settle(0.05)


def test_only_asked_cameras_that_measure_depth_do(tmp_path: object) -> None:
    world = grocery(1, items=("lemon",), depth=True)
    assert set(world.observe(cameras=["front"]).depth) == {"front"}


def test_a_noise_that_no_sensor_has_is_refused(tmp_path: pytest.TempPathFactory) -> None:
    from pathlib import Path

    file = Path(str(tmp_path)) / "scene.toml"
    file.write_text(SCENE.read_text().replace("depth = true", "depth = true\ndepth_noise = -1", 1))
    with pytest.raises(DomainError) as refused:
        read_scene(file)
    assert "depth_noise" in str(refused.value)
