"""What the gripper can take in some pose, and what in none."""

from __future__ import annotations

import numpy as np
import pytest

from executive.sim.graspable import why_not
from executive.sim.scene import ItemShape
from tests.executive.sim.stage import grocery


def shape(*size: float, axis: int | None = None, is_ball: bool = False) -> ItemShape:
    return ItemShape("thing", np.zeros(3), 0.5 * np.array(size), axis, is_ball)


@pytest.mark.parametrize(
    ("size", "axis", "taken"),
    [
        ((0.06, 0.09, 0.003), None, False),  # a card
        ((0.003, 0.06, 0.06), None, False),  # the same on its edge
        ((0.085, 0.09, 0.10), None, False),  # wider than the gripper in every pose
        ((0.05, 0.16, 0.05), None, True),
        ((0.085, 0.09, 0.05), None, True),  # on one of its sides
        ((0.09, 0.09, 0.02), 2, False),  # a plate
        ((0.04, 0.04, 0.10), 2, True),
        ((0.02, 0.004, 0.004), 0, False),  # a needle
    ],
)
def test_what_can_be_taken(size: tuple[float, float, float], axis: int | None, taken: bool) -> None:
    assert (why_not(shape(*size, axis=axis)) is None) is taken


def test_balls_are_taken_across() -> None:
    assert why_not(shape(0.05, 0.05, 0.05, is_ball=True)) is None
    assert why_not(shape(0.09, 0.09, 0.09, is_ball=True)) is not None


def test_all_groceries_can_be_taken() -> None:
    assert not any(map(why_not, grocery().shapes.values()))
