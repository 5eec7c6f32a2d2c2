"""Boxes stand wherever something unknown is, and rise no higher."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.sim.unknown import COUNT, LARGE, SMALL, boxes, covered, shapes
from executive.types import Lump

sides = st.tuples(*[st.floats(0.005, 0.09)] * 3)


@given(sides, st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=20))
def test_every_point_of_a_lump_is_covered(half: tuple[float, float, float], shares: list[tuple[float, ...]]) -> None:
    lump = Lump(np.array([0.4, 0.1, 0.9]), np.array(half))
    poses = covered([lump])
    there = shapes(boxes())
    edges = {name: 2.0 * there[name].half[0] for name in poses}
    assert len(set(edges.values())) == 1
    for share in shares:
        point = lump.centre + np.array(share) * lump.half
        assert min(np.abs(pose[:3] - point).max() - 0.5 * edges[name] for name, pose in poses.items()) <= 1e-9
    top = max(pose[2] + 0.5 * edges[name] for name, pose in poses.items())
    assert top <= lump.centre[2] + lump.half[2] + 1e-9


def test_there_are_so_many_boxes_and_the_largest_lump_is_covered_first() -> None:
    there = shapes(boxes())
    assert len(there) == 2 * COUNT
    small = [Lump(np.array([float(number), 0.0, 0.0]), np.full(3, 0.01)) for number in range(COUNT + 5)]
    large = Lump(np.array([-1.0, 0.0, 0.0]), np.full(3, 0.1))
    poses = covered([*small, large])
    assert set(poses) <= set(there)
    assert sum(pose[0] < -0.5 for pose in poses.values()) == 8
    assert sum(pose[0] > -0.5 for pose in poses.values()) == COUNT
    assert {2.0 * there[name].half[0] for name in poses} == {SMALL, LARGE}
    assert not covered([])
