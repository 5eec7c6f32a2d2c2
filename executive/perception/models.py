"""Shapes that are known, made ready to be found: a signed distance field, samples of the surface, and symmetries."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from executive.types import FloatArray

CELL = 0.003
"""m between the points of a distance field."""

MARGIN = 0.02
"""m around a shape within which its field tells distances; farther points are told apart no more."""

_NEAREST, _APART = 6, 0.002
"""Samples of the surface that tell the side of a point, and m between them at most."""

_DENSE, _SAMPLES = 20000, 400
_ALIKE, _ALIKE_WORST = 0.0009, 0.004
"""m by which a turned surface may lie beside the unturned one, in the mean and at 95 %, and count as the same."""

_LOOKALIKE = 0.0045
"""m by which a turned surface may lie beside the unturned one in the mean and be taken for it."""

_SAME, _SAME_COLOUR = 1e-6, 0.02
"""m between the corners of two shapes, and of 0..1 between their mean colours, up to which they are the same."""


@dataclass(frozen=True, eq=False)
class ItemModel:
    """The shape of an item as a closed mesh, in its own body frame.

    Attributes:
        name: the item's.
        vertices: (V, 3) in m.
        faces: (F, 3), indices of vertices.
        rgb: its mean colour, (3,) in 0..1.
        axis: the axis of the body (0, 1, 2) that the shape is round about, None for others.
    """

    name: str
    vertices: FloatArray
    faces: npt.NDArray[np.int64]
    rgb: FloatArray
    axis: int | None = None

    @cached_property
    def centre(self) -> FloatArray:
        """The middle of the bounding box, (3,): the origin of what `field`, `points` and `symmetries` are told in."""
        return np.asarray(0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0)))

    @cached_property
    def half(self) -> FloatArray:
        """Half the extents of the bounding box, (3,) in m."""
        return np.asarray(0.5 * np.ptp(self.vertices, axis=0))

    @cached_property
    def _dense(self) -> tuple[FloatArray, FloatArray]:
        """Points of the surface, spread evenly by area, and its outward normals there: (N, 3) each."""
        corners = (self.vertices - self.centre)[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(across, axis=1)
        kept = twice > 1e-12
        corners, across, twice = corners[kept], across[kept], twice[kept]
        if float(np.einsum("ij,ij->", corners[:, 0], across)) < 0.0:
            across = -across  # the mesh is inside out
        # Where on the surface follows from low-discrepancy numbers, so that a shape is always sampled alike.
        index = np.arange(_DENSE) + 0.5
        face = np.minimum(np.searchsorted(np.cumsum(twice) / twice.sum(), index / _DENSE), len(twice) - 1)
        u, v = np.sqrt((index * 0.7548776662466927) % 1.0), (index * 0.5698402909980532) % 1.0
        a, b, c = corners[face].transpose(1, 0, 2)
        points = (1.0 - u)[:, None] * a + (u * (1.0 - v))[:, None] * b + (u * v)[:, None] * c
        return points, across[face] / twice[face][:, None]

    @cached_property
    def points(self) -> FloatArray:
        """Some points of the surface, spread evenly, (N, 3)."""
        return self._dense[0][:: _DENSE // _SAMPLES]

    @cached_property
    def normals(self) -> FloatArray:
        """The outward normals at `points`, (N, 3)."""
        return self._dense[1][:: _DENSE // _SAMPLES]

    @cached_property
    def field(self) -> npt.NDArray[np.float32]:
        """The signed distance to the surface in m, negative inside, and its gradient: (X, Y, Z, 4), `CELL` apart, from
        `-(half + MARGIN)` on."""
        low = self.low
        size = self.field_shape()[:3]
        axes = [low[axis] + CELL * np.arange(size[axis]) for axis in range(3)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points, normals = self._dense
        away, nearest = cKDTree(points).query(cells, k=_NEAREST)
        offset = cells[:, None] - points[nearest]
        along = np.einsum("nki,nki->nk", offset, normals[nearest])
        # Where faces meet, the one that is seen the most straight on tells inside from outside.
        clearest = np.argmax(np.where(away < away[:, :1] + CELL, np.abs(along), -1.0), axis=1)
        sign = np.copysign(1.0, along[np.arange(len(cells)), clearest])
        # Between samples, the plane of the nearest one is nearer to the truth than the sample itself.
        beside = np.sqrt(np.maximum(away[:, 0] ** 2 - along[:, 0] ** 2, 0.0))
        distance = (sign * np.where(beside < _APART, np.abs(along[:, 0]), away[:, 0])).reshape(size)
        gradient = np.stack(np.gradient(distance, CELL), axis=-1)
        length = np.linalg.norm(gradient, axis=-1, keepdims=True)
        gradient /= np.maximum(length, 1e-6)
        return np.concatenate([distance[..., None], gradient], axis=-1).astype(np.float32)

    @property
    def low(self) -> FloatArray:
        """The corner (3,) around `centre` in m where `field` begins."""
        return -(self.half + MARGIN)

    def field_shape(self) -> tuple[int, ...]:
        """The shape of `field`."""
        low = self.low
        return (*(np.ceil(-2.0 * low / CELL).astype(int) + 1).tolist(), 4)

    def use_field(self, field: npt.NDArray[np.float32]) -> None:
        """Have a field that was computed for this very shape before be `field`; computing it takes a quarter of a
        second.

        Raises:
            ValueError: it is the field of another shape.
        """
        if field.shape != self.field_shape() or field.dtype != np.float32 or not np.isfinite(field).all():
            raise ValueError(f"{self.name}: expected a field of {self.field_shape()}, got {field.shape}")
        vars(self)["field"] = field

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The signed distances (...) in m of points (..., 3) around `centre` to the surface, and their gradients
        (..., 3). Beyond `MARGIN`, what is told is nearer than the truth."""
        field, low = self.field, self.low
        grid = (points - low) / CELL
        index = np.rint(grid)
        np.clip(index, 0, np.array(field.shape[:3]) - 1, out=index)
        flat = (index @ [field.shape[1] * field.shape[2], field.shape[2], 1.0]).astype(np.int64)
        found = field.reshape(-1, 4).take(flat, axis=0)
        gradient = found[..., 1:]
        beside = np.clip(grid - index, -1.0, 1.0)
        return found[..., 0] + CELL * (beside * gradient).sum(axis=-1), gradient

    @cached_property
    def symmetries(self) -> tuple[FloatArray, ...]:
        """The rotations (3, 3) among those of a cube that leave the shape as it is, the identity first. Turns about the
        `axis` of what is round are left to that."""
        return tuple(turn for turn in cube_rotations() if self._unchanged(turn))

    @cached_property
    def lookalikes(self) -> tuple[FloatArray, ...]:
        """The rotations (3, 3) of a cube that change the shape but little, so that one is easily taken for another."""
        return tuple(
            turn
            for turn in cube_rotations()
            if self.angle(np.eye(3), turn) > 0.1 and np.abs(self.distances(self.points @ turn.T)[0]).mean() < _LOOKALIKE
        )

    @cached_property
    def orientations(self) -> FloatArray:
        """The rotations of a cube and those half way between about the vertical, without any that the shape does not
        tell from another, (K, 3, 3)."""
        found: list[FloatArray] = []
        for yaw in (0.0, 0.25 * np.pi):
            about = Rotation.from_euler("z", yaw).as_matrix()
            for turn in cube_rotations():
                if all(self.angle(about @ turn, other) > 0.1 for other in found):
                    found.append(about @ turn)
        return np.stack(found)

    def looks_like(self, other: ItemModel) -> bool:
        """Whether nothing tells the two items apart: one shape and one colour."""
        return (
            self.vertices.shape == other.vertices.shape
            and self.faces.shape == other.faces.shape
            and np.allclose(self.vertices, other.vertices, atol=_SAME)
            and np.array_equal(self.faces, other.faces)
            and np.allclose(self.rgb, other.rgb, atol=_SAME_COLOUR)
        )

    def _unchanged(self, turn: FloatArray) -> bool:
        distance = np.abs(self.distances(self.points @ np.asarray(turn).T)[0])
        return bool(distance.mean() < _ALIKE and np.quantile(distance, 0.95) < _ALIKE_WORST)

    def angle(self, one: FloatArray, other: FloatArray) -> float:
        """The angle in rad between two orientations (3, 3), as far as the shape tells them apart."""
        if self.axis is not None:
            flips = {round(float(turn[self.axis, self.axis])) for turn in self.symmetries}
            along = float(np.clip(one[:, self.axis] @ other[:, self.axis], -1.0, 1.0))
            return float(np.arccos(abs(along) if -1 in flips else along))
        traces = [float(np.trace(one.T @ other @ turn)) for turn in self.symmetries]
        return float(np.arccos(np.clip(0.5 * (max(traces) - 1.0), -1.0, 1.0)))


def identical(models: Sequence[ItemModel]) -> list[tuple[str, ...]]:
    """The names of items that nothing tells apart, in groups of two and more."""
    groups: list[list[ItemModel]] = []
    for model in models:
        mine = next((group for group in groups if group[0].looks_like(model)), None)
        if mine is None:
            groups.append([model])
        else:
            mine.append(model)
    return [tuple(model.name for model in group) for group in groups if len(group) > 1]


def cube_rotations() -> Sequence[FloatArray]:
    """The 24 rotations of a cube, (3, 3) each, the identity first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0.0:
                found.append(turn)
    return found
