"""How far drawers are open, by the bars of their handles among measured points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.perception.openings import Bar, openings
from executive.types import FloatArray

STROKE, GAP = 0.19, 0.046
BAR = Bar("drawer", np.array([0.55, 0.1, 0.88]), np.array([-1.0, 0.0, 0.0]), 0.055, 0.012, STROKE)
AWAY = np.array([0.3, -0.5, 1.3])


def points(opening: float, seed: int = 0, bar: int = 120, front: int = 400) -> FloatArray:
    """What cameras measure of the upper faces of the bar, and of the front behind it, with 2 mm of noise."""
    rng = np.random.default_rng(seed)

    def spread(count: int, out: float, deep: float, wide: float, high: float) -> FloatArray:
        local = rng.uniform(-1.0, 1.0, (count, 3)) * [deep, wide, high] + [out, 0.0, 0.0]
        return np.asarray(BAR.closed + np.column_stack([-local[:, 0], local[:, 1], local[:, 2]]))

    noise = rng.normal(0.0, 0.002, (bar + front, 3))
    shapes = spread(bar, opening, 0.006, 0.055, 0.006), spread(front, opening - GAP, 0.0, 0.1, 0.04)
    return np.concatenate(shapes) + noise


@given(st.floats(0.0, STROKE), st.integers(0, 1000))
def test_it_is_measured_to_within_millimetres_wherever_the_drawer_is(opening: float, seed: int) -> None:
    found = openings([BAR], points(opening, seed), AWAY, {})
    assert found["drawer"] == pytest.approx(opening, abs=0.004)


def test_what_is_not_seen_or_where_the_hand_is_is_as_it_was() -> None:
    before, hidden = {"drawer": 0.07}, points(0.15, bar=5, front=5)
    assert openings([BAR], hidden, AWAY, before) == before
    assert openings([BAR], np.empty((0, 3)), AWAY, {}) == {"drawer": 0.0}
    hand = BAR.closed + 0.1 * BAR.axis
    assert openings([BAR], points(0.15), hand, before) == before
    assert openings([BAR], points(0.15), hand + [0.0, 0.0, 0.2], before)["drawer"] == pytest.approx(0.15, abs=0.004)
