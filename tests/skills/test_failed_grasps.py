"""A grasp that has failed is known again, however the item was turned since, and no other is taken for it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.skills.failed_grasps import FailedGrasps
from executive.types import FloatArray


def pose(x: float, y: float, yaw: float, tip: float = 0.0) -> FloatArray:
    """(4, 4): turned by `yaw` about the vertical, after having been tipped by `tip` about x."""
    cos, sin, up, over = np.cos(yaw), np.sin(yaw), np.cos(tip), np.sin(tip)
    result = np.eye(4)
    result[:3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ [[1, 0, 0], [0, up, -over], [0, over, up]]
    result[:3, 3] = x, y, 0.8
    return result


def at(item: FloatArray, x: float = 0.0, turn: float = 0.0) -> FloatArray:
    """From above, `x` m beside the item's origin, along it, the hand turned by `turn`."""
    grasp = pose(0.0, 0.0, turn, np.pi)
    grasp[:3, 3] = x, 0.0, 0.05
    return item @ grasp


PLACES = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-np.pi, np.pi))


@given(PLACES, PLACES)
def test_it_is_the_same_grasp_wherever_the_item_is_pushed(before: tuple[float, ...], after: tuple[float, ...]) -> None:
    tried, first, then = FailedGrasps(), pose(*before), pose(*after)
    tried.add("can", first, at(first))
    tried.add("can", first, at(first))
    assert tried.times("can", then, at(then)) == 2
    assert tried.times("can", then, at(then, x=0.03)) == 0
    assert tried.times("can", then, at(then, turn=np.pi)) == 0
    assert tried.times("carton", then, at(then)) == 0


@pytest.mark.parametrize("tip", [np.pi / 2, np.pi])
def test_what_has_fallen_over_is_begun_with_anew(tip: float) -> None:
    tried, first, then = FailedGrasps(), pose(0, 0, 0), pose(0, 0, 0, tip)
    tried.add("can", first, at(first))
    assert tried.times("can", then, at(then)) == 0


def test_what_was_taken_hold_of_is_forgotten() -> None:
    tried, first = FailedGrasps(), pose(0, 0, 0)
    tried.add("can", first, at(first))
    tried.forget("can")
    assert tried.times("can", first, at(first)) == 0
    tried.forget("can")
