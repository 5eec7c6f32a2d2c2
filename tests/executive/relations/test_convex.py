"""Whether convex things touch, held against distances that are known without the algorithm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from executive.relations import Part
from executive.relations.convex import distance, within
from executive.types import FloatArray

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SEEDS = st.integers(0, 2**32 - 1)


def hull(rng: np.random.Generator) -> FloatArray:
    return np.asarray(rng.normal(size=(int(rng.integers(1, 30)), 3)) * rng.uniform(0.01, 0.2, 3))


@given(SEEDS)
def test_the_distance_to_a_box_is_that_of_its_faces(seed: int) -> None:
    """Of a point and a box, it is how far the point is outside along each axis."""
    rng = np.random.default_rng(seed)
    half, point, turn = rng.uniform(0.01, 0.3, 3), rng.normal(size=3) * 0.4, Rotation.random(rng=rng).as_matrix()
    expected = float(np.linalg.norm(np.maximum(np.abs(point) - half, 0.0)))
    assert distance((CORNERS * half) @ turn.T, (point @ turn.T)[None]) == pytest.approx(expected, abs=2e-6)


@given(SEEDS)
def test_hulls_pushed_apart_are_as_far_apart_as_they_were_pushed(seed: int) -> None:
    """Moved along a direction until the supporting planes are a gap apart, hulls are at least that far apart; pushed
    into each other, they overlap."""
    rng = np.random.default_rng(seed)
    one, other = hull(rng), hull(rng)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    gap = float(rng.uniform(0.001, 0.1))
    apart = other + way * ((one @ way).max() - (other @ way).min() + gap)
    found = distance(one, apart)
    assert found >= gap - 2e-6
    assert found == pytest.approx(distance(apart, one), abs=2e-6)
    assert distance(one, other - other.mean(axis=0) + one.mean(axis=0)) == pytest.approx(0.0, abs=2e-6)


@given(SEEDS, st.floats(0.0, 0.05))
def test_what_is_within_is_what_the_distance_says(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    one, other = hull(rng), hull(rng) + rng.normal(size=3) * 0.2
    exact = distance(one, other)
    if abs(exact - tolerance) > 1e-5:
        assert within(Part(one), Part(other), tolerance) is (exact < tolerance)


def test_balls_touch_at_the_sum_of_their_radii() -> None:
    ball = Part(np.zeros((1, 3)), 0.02)
    assert within(ball, Part(np.array([[0.0499, 0.0, 0.0]]), 0.03), 0.0)
    assert not within(ball, Part(np.array([[0.0501, 0.0, 0.0]]), 0.03), 0.0)
