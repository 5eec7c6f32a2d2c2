"""Whether two convex things touch: the distance algorithm of Gilbert, Johnson and Keerthi (1988), which walks towards
the origin in the difference of two sets of corners."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from executive.types import FloatArray

_STEPS = 50
_EXACT = 1e-8
"""m by which a distance may be off."""


class Part:
    """The convex hull of some corners (N, 3), in m, and everything less than `radius` away from it: a ball is one
    corner with a radius."""

    def __init__(self, corners: FloatArray, radius: float = 0.0) -> None:
        self.corners, self.radius = corners, radius

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The box around it along the world's axes, as two corners (3,)."""
        return self.corners.min(axis=0) - self.radius, self.corners.max(axis=0) + self.radius


def within(one: Part, other: Part, tolerance: float) -> bool:
    """Return whether two parts are at most `tolerance` m apart."""
    (low, high), (lowest, highest) = one.bounds, other.bounds
    if (low - highest > tolerance).any() or (lowest - high > tolerance).any():
        return False
    enough = tolerance + one.radius + other.radius
    return distance(one.corners, other.corners, enough) <= enough


def distance(one: FloatArray, other: FloatArray, enough: float = np.inf) -> float:
    """Return how far the hulls of corners (N, 3) and (M, 3) are apart in m; 0 if they overlap. Where it is more than
    `enough`, or less, what is returned may be a bound on its side of it."""
    nearest = one[0] - other[0]
    simplex: list[FloatArray] = []
    for _ in range(_STEPS):
        away = float(np.linalg.norm(nearest))
        if away <= _EXACT or (np.isfinite(enough) and away <= enough):
            return away
        corner = one[int(np.argmin(one @ nearest))] - other[int(np.argmax(other @ nearest))]
        bound = float(corner @ nearest) / away
        if bound > enough or away - bound <= _EXACT or any(corner is each for each in simplex):
            return max(bound, 0.0) if bound > enough else away
        nearest, simplex = _nearest([*simplex, corner])
    return float(np.linalg.norm(nearest))


def _nearest(corners: Sequence[FloatArray]) -> tuple[FloatArray, list[FloatArray]]:
    """The point nearest to the origin of the hull of up to four corners, of which the last is new, and the corners that
    it lies between."""
    newest, rest = corners[-1], corners[:-1]
    best, chosen, least = newest, [newest], float(newest @ newest)
    for count in range(1, len(rest) + 1):
        for others in itertools.combinations(rest, count):
            sides = np.stack(others) - newest
            gram = sides @ sides.T
            try:
                shares = np.linalg.solve(gram, -sides @ newest)
            except np.linalg.LinAlgError:  # they lie in one line or plane: fewer of them say the same
                continue
            if (shares < 0.0).any() or shares.sum() > 1.0:
                continue
            point = newest + shares @ sides
            length = float(point @ point)
            if length < least:
                best, chosen, least = point, [*others, newest], length
    return np.asarray(best), chosen
