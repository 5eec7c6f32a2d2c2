"""Poses of a known shape from points of its surface: Gauss-Newton on the distance field, from many starts at once.

The residual of a point is its signed distance to the surface, so that nothing has to be searched for and all starts are
stepped together. Poses are of the model's centre: rotations (S, 3, 3) and translations (S, 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executive.perception.models import CELL, ItemModel
from executive.perception.registration_kernels import mean_distances, normal_equations
from executive.types import FloatArray

_NEAR = 1e-3
_SCALES = (0.015, 0.010, 0.006, 0.004)
"""m: distances beyond which a point counts for less and less, from the first step to the last."""

LARGEST = 0.01
"""m: no point counts as farther from the surface than this."""


_ALIKE = 12.0
"""Measurements that are worth one: neighbours share their errors."""

_AMISS = 0.0003
"""Standard deviation in m of what no number of points would take away: surfaces and cameras that are not quite as they
are told. It moves a pose as any other error of the points, and turns what is nearly round the most. With this, nine of
ten errors of each item and more are in the ellipsoids that should hold as many (`benchmarks.poses`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses of one model, (S, 3, 3) and (S, 3), and the mean distance of the points to its surface in each, cut off at
    `LARGEST`, (S,) in m."""

    rotations: FloatArray
    translations: FloatArray
    misfit: FloatArray

    def best(self, count: int) -> Poses:
        """The so many that fit best."""
        chosen = np.argsort(self.misfit, kind="stable")[:count]
        return Poses(self.rotations[chosen], self.translations[chosen], self.misfit[chosen])


def starts(model: ItemModel, points: FloatArray) -> Poses:
    """Where to begin: the shape laid along the sides of the points in every way, and half way between those.

    Args:
        points: (N, 3) in the world, seen from above.
    """
    about = Rotation.from_euler("z", _along(points[:, :2])).as_matrix()
    rotations = about @ model.orientations
    low, high = np.quantile(points, 0.02, axis=0), np.quantile(points, 0.98, axis=0)
    half = np.abs(rotations) @ model.half
    translations = np.tile(0.5 * (low + high), (len(rotations), 1))
    translations[:, 2] = high[2] - half[:, 2]  # the top is seen, the bottom may not be
    return Poses(rotations, translations, np.full(len(rotations), np.inf))


def joined(parts: Sequence[Poses]) -> Poses:
    """All the poses of some sets."""
    return Poses(
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.translations for part in parts]),
        np.concatenate([part.misfit for part in parts]),
    )


def refined(model: ItemModel, poses: Poses, points: FloatArray, steps: int) -> Poses:
    """The poses after some steps towards the points (N, 3)."""
    rotations, translations, points = poses.rotations, poses.translations, np.ascontiguousarray(points)
    low, normal, right = model.low, np.empty((len(rotations), 6, 6)), np.empty((len(rotations), 6))
    for step in range(steps):
        scale = _SCALES[min(len(_SCALES) - 1, step * len(_SCALES) // steps)]
        normal_equations(
            model.field, low, CELL, np.ascontiguousarray(rotations), translations, points, scale, normal, right
        )
        normal += 1e-4 * len(points) * np.diag([1.0, 1.0, 1.0, _NEAR, _NEAR, _NEAR])
        change = np.linalg.solve(normal, right[..., None])[..., 0]
        change[:, :3] = np.clip(change[:, :3], -0.02, 0.02)
        change[:, 3:] = np.clip(change[:, 3:], -0.4, 0.4)
        translations = translations + np.einsum("sij,sj->si", rotations, change[:, :3])
        rotations = rotations @ Rotation.from_rotvec(change[:, 3:]).as_matrix()
    return Poses(rotations, translations, misfit(model, rotations, translations, points))


def misfit(model: ItemModel, rotations: FloatArray, translations: FloatArray, points: FloatArray) -> FloatArray:
    """The mean distance of points (N, 3) to the surface in each pose, cut off at `LARGEST`, (S,) in m."""
    means, rotations = np.empty(len(rotations)), np.ascontiguousarray(rotations)
    mean_distances(model.field, model.low, CELL, rotations, translations, np.ascontiguousarray(points), LARGEST, means)
    return means


def local(rotations: FloatArray, translations: FloatArray, points: FloatArray) -> FloatArray:
    """Points (N, 3) of the world as seen from each pose, (S, N, 3)."""
    return np.asarray((points[None] - translations[:, None]) @ rotations)


def covariance(model: ItemModel, rotation: FloatArray, translation: FloatArray, points: FloatArray) -> FloatArray:
    """The covariance (6, 6) of a pose's translation (m, in the world) and rotation (rad, about the world's axes) by
    the points that it was fitted to.

    What the points say nothing about, such as a turn of something round, is as uncertain as it can be.
    """
    rows, distance, weight = _linearised(model, rotation[None], translation[None], points, _SCALES[-1])
    variance = float((weight[0] * distance[0] ** 2).sum() / max(1.0, weight[0].sum())) + 1e-8
    information = np.einsum("ni,nj,n->ij", rows[0], rows[0], weight[0])
    count = max(1.0, float(weight[0].sum()))
    turned = np.zeros((6, 6))
    turned[:3, :3] = turned[3:, 3:] = rotation
    found = sum(
        np.linalg.inv(information / each + np.diag([1.0 / 0.1**2] * 3 + [1.0 / np.pi**2] * 3))
        for each in (_ALIKE * variance, count * _AMISS**2)
    )
    return np.asarray(turned @ found @ turned.T)


def _linearised(
    model: ItemModel, rotations: FloatArray, translations: FloatArray, points: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """By how much each point's distance falls as each pose moves and turns, in its own frame (S, N, 6); the distances
    (S, N); and how much each counts (S, N)."""
    seen = local(rotations, translations, points)
    distance, gradient = model.distances(seen)
    rows = np.concatenate([gradient, _cross(seen, gradient)], axis=-1)
    weight = 1.0 / np.square(1.0 + np.square(distance / scale))
    return rows, distance, weight


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """The cross product of rows of three, (..., 3): several times as fast as NumPy's."""
    (a, b, c), (x, y, z) = (np.moveaxis(rows, -1, 0) for rows in (one, other))
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def _along(points: FloatArray) -> float:
    """The direction in rad, up to a quarter turn, of the sides of the smallest rectangle around points (N, 2)."""
    angles = np.linspace(0.0, 0.5 * np.pi, 18, endpoint=False)
    along = np.stack([np.cos(angles), np.sin(angles)])
    across = np.stack([-np.sin(angles), np.cos(angles)])
    sides = [np.ptp(np.quantile(points @ axes, [0.02, 0.98], axis=0), axis=0) for axes in (along, across)]
    return float(angles[int(np.argmin(sides[0] * sides[1]))])
