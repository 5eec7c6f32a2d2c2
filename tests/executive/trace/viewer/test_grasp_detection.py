"""What the hand holds, told from poses: it rides along, until it does not."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.trace.viewer.grasp_detection import Grip
from executive.types import FloatArray

CARRIED, IDLE = "lemon", "can"


def turned(angle: float) -> FloatArray:
    """A quaternion (w, x, y, z) about the vertical."""
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def pose(x: float, y: float, z: float, angle: float = 0.0) -> FloatArray:
    return np.concatenate([[x, y, z], turned(angle)])


def under(hand: FloatArray, below: float = 0.1) -> FloatArray:
    return np.concatenate([hand[:3] - [0, 0, below], hand[3:]])


angles = st.floats(-0.5, 0.5)
ways = st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), angles).filter(
    lambda way: np.linalg.norm(way[:3]) > 5e-3
)


def carried(grip: Grip, some: list[tuple[float, float, float, float]]) -> FloatArray:
    """Move the hand by each of `some`, the item with it, and return where the hand is then."""
    at = np.array([0.4, 0.0, 1.0, 0.0])
    for way in [(0.0, 0.0, 0.0, 0.0), *some]:
        at = at + way
        grip.told({"hand": pose(*at), CARRIED: under(pose(*at)), IDLE: pose(0.6, 0.3, 0.8)})
    return at


@given(st.lists(ways, min_size=1, max_size=6))
def test_what_goes_along_is_held(some: list[tuple[float, float, float, float]]) -> None:
    grip = Grip((CARRIED, IDLE))
    carried(grip, some)
    assert grip.holds == CARRIED


@given(st.lists(ways, min_size=1, max_size=3))
def test_what_falls_is_held_no_longer(some: list[tuple[float, float, float, float]]) -> None:
    grip = Grip((CARRIED, IDLE))
    hand = pose(*carried(grip, some))
    for fallen in (0.05, 0.15, 0.3):
        assert grip.told({"hand": hand, CARRIED: under(hand, 0.1 + fallen), IDLE: pose(0.6, 0.3, 0.8)}) == ""


def test_what_is_put_down_is_held_until_the_hand_leaves() -> None:
    grip = Grip((CARRIED,))
    at = carried(grip, [(0.1, 0.0, -0.1, 0.0)])
    down = under(pose(*at))
    assert grip.told({"hand": pose(*at), CARRIED: down}) == CARRIED
    assert grip.told({"hand": pose(*(at + [0, 0, 0.05, 0])), CARRIED: down}) == ""


def test_what_moves_alone_is_not_held() -> None:
    grip = Grip((CARRIED,))
    for x in (0.0, 0.05, 0.1):
        assert grip.told({"hand": pose(0.05, 0.0, 0.9), CARRIED: pose(x, 0.0, 0.8)}) == ""


def test_what_moves_far_from_the_robot_is_not_held() -> None:
    grip = Grip((CARRIED,))
    for x in (0.0, 0.05, 0.1):
        assert grip.told({"hand": pose(x, 0.0, 1.5), CARRIED: pose(x, 0.0, 0.8)}) == ""
