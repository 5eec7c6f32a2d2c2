"""The inner loops of fitting poses to points, compiled: each point is taken into its pose's frame, looked up in the
distance field, and added to its pose's normal equations, with nothing stored in between."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from executive.types import FloatArray
from executive.util.compiled import compiled

Field = npt.NDArray[np.float32]


@compiled
def normal_equations(
    field: Field,
    low: FloatArray,
    cell: float,
    rotations: FloatArray,
    translations: FloatArray,
    points: FloatArray,
    scale: float,
    normal: FloatArray,
    right: FloatArray,
) -> None:
    """Fill the normal equations of each pose: `normal` (S, 6, 6) and `right` (S, 6), by points (N, 3) of the world.

    Args:
        field: signed distances in m and their gradients, (X, Y, Z, 4), `cell` m apart, from `low` (3,) on.
        scale: m beyond which a point counts for less and less.
    """
    row, seen, index = np.empty(6), np.empty(3), np.empty(3, dtype=np.int64)
    beside = np.empty(3)
    for pose in range(len(rotations)):
        normal[pose], right[pose] = 0.0, 0.0
        for point in range(len(points)):
            distance = _looked_up(
                field, low, cell, rotations[pose], translations[pose], points[point], seen, index, beside
            )
            for axis in range(3):
                row[axis] = field[index[0], index[1], index[2], 1 + axis]
            row[3] = seen[1] * row[2] - seen[2] * row[1]
            row[4] = seen[2] * row[0] - seen[0] * row[2]
            row[5] = seen[0] * row[1] - seen[1] * row[0]
            far = 1.0 + (distance / scale) * (distance / scale)
            weight = 1.0 / (far * far)
            for one in range(6):
                weighted = row[one] * weight
                right[pose, one] += weighted * distance
                for other in range(one + 1):
                    normal[pose, one, other] += weighted * row[other]
        for one in range(6):
            for other in range(one):
                normal[pose, other, one] = normal[pose, one, other]


@compiled
def mean_distances(
    field: Field,
    low: FloatArray,
    cell: float,
    rotations: FloatArray,
    translations: FloatArray,
    points: FloatArray,
    largest: float,
    means: FloatArray,
) -> None:
    """Fill the mean distance of the points to the surface in each pose, (S,), no point counting for more than
    `largest`."""
    seen, index, beside = np.empty(3), np.empty(3, dtype=np.int64), np.empty(3)
    for pose in range(len(rotations)):
        total = 0.0
        for point in range(len(points)):
            distance = _looked_up(
                field, low, cell, rotations[pose], translations[pose], points[point], seen, index, beside
            )
            total += min(abs(distance), largest)
        means[pose] = total / len(points)


@compiled
def _looked_up(
    field: Field,
    low: FloatArray,
    cell: float,
    rotation: FloatArray,
    translation: FloatArray,
    point: FloatArray,
    seen: FloatArray,
    index: npt.NDArray[np.int64],
    beside: FloatArray,
) -> float:
    """The signed distance of a point by its nearest cell of the field and the gradient there; fills where it is `seen`
    from the pose (3,), and the `index` of the cell. What is outside of the field is told of its border."""
    moved_x, moved_y, moved_z = point[0] - translation[0], point[1] - translation[1], point[2] - translation[2]
    for axis in range(3):
        seen[axis] = moved_x * rotation[0, axis] + moved_y * rotation[1, axis] + moved_z * rotation[2, axis]
        place = (seen[axis] - low[axis]) / cell
        nearest = min(max(np.rint(place), 0.0), field.shape[axis] - 1.0)
        index[axis] = int(nearest)
        beside[axis] = min(max(place - nearest, -1.0), 1.0)
    near = field[index[0], index[1], index[2]]
    distance: float = near[0] + cell * (beside[0] * near[1] + beside[1] * near[2] + beside[2] * near[3])
    return distance


def ready() -> None:
    """Have everything here compiled and kept: once, after an installation."""
    field, one = np.zeros((2, 2, 2, 4), dtype=np.float32), np.eye(3)[None]
    normal_equations(field, np.zeros(3), 1.0, one, one[:, 0], one[0], 1.0, np.empty((1, 6, 6)), np.empty((1, 6)))
    mean_distances(field, np.zeros(3), 1.0, one, one[:, 0], one[0], 1.0, np.empty(1))
