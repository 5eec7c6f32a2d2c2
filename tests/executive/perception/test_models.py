"""Distances to known shapes, their symmetries, and poses from their points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from executive.perception.clouds import View, clusters
from executive.perception.evidence import evidence
from executive.perception.models import MARGIN, ItemModel, cube_rotations
from executive.perception.registration import covariance, refined, starts
from executive.types import FloatArray
from tests.executive.perception.room import CAMERAS, SIZE, box

BRICK, CUBE = box("brick", (0.06, 0.10, 0.05)), box("cube", (0.06, 0.06, 0.06))
coordinate = st.floats(-0.065, 0.065)


def exact(half: FloatArray, point: FloatArray) -> float:
    """The signed distance of a point to the surface of a box."""
    beyond = np.abs(point) - half
    return float(np.linalg.norm(np.maximum(beyond, 0.0)) + min(0.0, float(beyond.max())))


@given(st.tuples(coordinate, coordinate, coordinate))
def test_distances_are_those_to_the_surface(point: tuple[float, float, float]) -> None:
    at = np.array(point)
    true = exact(BRICK.half, at)
    told, gradient = BRICK.distances(at[None])
    if true < MARGIN - 0.005:
        assert abs(float(told[0]) - true) < 0.0015
    else:
        assert told[0] > 0.01
    assert np.linalg.norm(gradient) < 1.01


def test_a_mesh_that_is_inside_out_has_the_same_distances() -> None:
    turned = ItemModel("brick", BRICK.vertices, BRICK.faces[:, ::-1], BRICK.rgb)
    assert np.abs(BRICK.field[..., 0] - turned.field[..., 0]).max() < 0.003


def test_cubes_have_24_rotations_and_shapes_those_that_leave_them_as_they_are() -> None:
    assert len(cube_rotations()) == 24
    assert np.array_equal(cube_rotations()[0], np.eye(3))
    assert len(CUBE.symmetries) == 24
    assert len(BRICK.symmetries) == 4
    assert len(box("post", (0.05, 0.05, 0.16)).symmetries) == 8


def test_angles_are_told_as_far_as_a_shape_tells_them() -> None:
    quarter, little = (Rotation.from_euler("z", turn, degrees=True).as_matrix() for turn in (90, 7))
    assert np.degrees(BRICK.angle(np.eye(3), quarter)) == pytest.approx(90)
    assert CUBE.angle(np.eye(3), quarter) == pytest.approx(0, abs=1e-6)
    assert np.degrees(CUBE.angle(quarter, little)) == pytest.approx(7)
    round_one = ItemModel("can", BRICK.vertices, BRICK.faces, BRICK.rgb, axis=2)
    assert round_one.angle(np.eye(3), quarter) == pytest.approx(0, abs=1e-6)
    leaning = Rotation.from_euler("x", 20, degrees=True).as_matrix()
    assert np.degrees(round_one.angle(np.eye(3), leaning)) == pytest.approx(20)


@given(st.integers(0, 10**6))
def test_a_pose_is_found_from_points_of_three_sides(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    centre = np.array([*rng.uniform(-0.3, 0.3, 2), 0.025])
    seen = BRICK.points[(BRICK.normals @ [[1.0], [0.6], [1.0]]).ravel() > 0.1]
    points = seen @ turn.T + centre + rng.normal(0.0, 0.001, seen.shape)
    found = refined(BRICK, starts(BRICK, points), points, 10).best(1)
    assert np.linalg.norm(found.translations[0] - centre) < 0.002
    assert np.degrees(BRICK.angle(found.rotations[0], turn)) < 2.0


def test_what_the_points_say_nothing_about_is_uncertain() -> None:
    inner = np.abs(BRICK.points[:, :2] / BRICK.half[:2]).max(axis=1) < 0.8
    top = BRICK.points[(BRICK.normals[:, 2] > 0.9) & inner]
    spread = np.sqrt(np.diag(covariance(BRICK, np.eye(3), np.zeros(3), top)))
    assert spread[2] < 0.001 < 0.01 < min(spread[:2])
    assert max(spread[3:5]) < 0.05 < spread[5]


def test_pictures_and_points_are_each_other_s_inverse() -> None:
    width, height = SIZE
    rng = np.random.default_rng(0)
    depth = rng.integers(400, 1500, (height, width)).astype(np.uint16)
    view = View.of(CAMERAS["left"], depth)
    pixels = rng.integers(0, width * height, 500)
    away, found, inside = view.project(view.points(pixels))
    assert inside.all()
    assert np.array_equal(found, pixels)
    assert np.allclose(away, depth.reshape(-1)[pixels] / 1000.0, atol=1e-6)
    behind = view.position + view.rotation @ np.array([0.0, 0.0, -1.0])
    assert not view.project(behind[None])[2].any()


def test_clusters_are_what_hangs_together_within_bounds() -> None:
    rng = np.random.default_rng(0)
    low, high = np.full(3, -0.5), np.full(3, 0.5)
    near, far, outside = (rng.uniform(-0.02, 0.02, (count, 3)) + shift for count, shift in (
        (900, [0.0, 0.0, 0.0]), (1200, [0.2, 0.0, 0.0]), (800, [0.9, 0.0, 0.0])))  # fmt: skip
    scattered = rng.uniform(-0.4, 0.4, (60, 3))
    points = np.concatenate([near, scattered, far, outside])
    groups = clusters(points, low, high)
    assert [len(group) >= least for group, least in zip(groups, (1150, 850), strict=True)] == [True, True]
    assert np.linalg.norm(points[groups[0]].mean(axis=0) - [0.2, 0.0, 0.0]) < 0.01
    assert clusters(points[:0], low, high) == []
    assert clusters(scattered, low, high) == []


def test_a_surface_that_cameras_look_through_is_refuted_and_one_behind_something_hidden() -> None:
    width, height = SIZE
    view = View.of(CAMERAS["left"], np.full((height, width), 800, np.uint16))
    ahead = view.position + view.rotation @ np.array([0.0, 0.0, 1.0])
    towards = view.rotation[:, 2]
    told = evidence(BRICK, np.stack([np.eye(3)] * 2), np.stack([ahead - 0.4 * towards, ahead + 0.2 * towards]), [view])
    assert told.refuted[0] == 1.0
    assert told.refuted[1] == 0.0
    assert told.hidden[1] > 0.2
    assert not told.confirmed.any()


def test_a_face_that_is_seen_edge_on_is_not_refuted_by_what_is_seen_past_it() -> None:
    width, height = SIZE
    view = View.of(CAMERAS["left"], np.full((height, width), 1200, np.uint16))
    ahead = view.position + 0.8 * view.rotation[:, 2]
    askew = view.rotation @ Rotation.from_euler("xyz", (0.3, 0.4, 0.0)).as_matrix()
    told = evidence(BRICK, np.stack([view.rotation, askew]), np.stack([ahead] * 2), [view])
    facing_or_averted = float((np.abs(BRICK.normals[:, 2]) > 0.9).mean())
    assert told.refuted[0] == pytest.approx(facing_or_averted)
    assert told.refuted[1] == 1.0
