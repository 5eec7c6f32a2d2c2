"""From depth pictures to points in space, without those of furniture and robot, and on to clusters."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from executive.perception.image_kernels import least_around
from executive.types import Camera, DepthImage, FloatArray, Image

_Real = TypeVar("_Real", np.float32, np.float64)

NOISE = 0.002
"""Standard deviation of a measurement at 1 m, in m, that is reckoned with; it grows with the square of the distance."""

_BESIDE = 0.004
"""m that something is in front of what is known, beyond the noise, to be something else."""

_THROUGH, _BIASED = 0.004, 0.002
"""The share of measurements that look through what is known, and m by which they are off it in the median, from which
on a camera does not stand where it is taken to: of one that does, nothing and 0.05 mm were measured, of one that is off
by 1 cm, 1 % or more or 2 mm or more."""

_ROOM, _ENOUGH = 0.04, 500
"""m from what is known within which a measurement is of it, and how many tell."""

_CELL = 0.008
"""m: points in neighbouring cells of this size are of one cluster."""

_FEW, _LONELY = 40, 3
"""Points that make a cluster, and that make a cell count: what lies between near and far at edges is scattered."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A camera's depth picture as it is used: distances in m, 0 for nothing, and from where they were taken.

    `rotation` (3, 3) and `position` (3,) take points of the camera's frame (looking along +z, y down) into the world.
    """

    name: str
    depth: npt.NDArray[np.float32]
    focal: float
    rotation: FloatArray
    position: FloatArray
    nearest: npt.NDArray[np.float32]
    """The nearest measurement in each pixel and around it, (H, W), infinite where there is none."""
    explained: npt.NDArray[np.bool_] | None = None
    """The pixels, (H * W,), that measured what is known to be there, where that matters: what is behind it is not
    expected to be seen."""

    @classmethod
    def of(cls, camera: Camera, depth: DepthImage) -> View:
        w, x, y, z = camera.pose[3:]
        # From a frame that looks along -z with y up.
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        focal = 0.5 * camera.height / math.tan(0.5 * camera.fovy)
        metres = (depth / 1000.0).astype(np.float32)
        nearest = _least_around(np.where(depth > 0, metres, np.float32(np.inf)))
        return cls(camera.name, metres, focal, rotation, np.array(camera.pose[:3]), nearest)

    def project(self, points: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Where points (..., 3) of the world are in the picture: the distance along the axis, the index of the pixel in
        the flattened picture, and whether it is in there, (...) each."""
        height, width = self.depth.shape
        local = (points - self.position) @ self.rotation
        away = np.maximum(local[..., 2], 1e-6)
        right = np.floor(0.5 * width + self.focal * local[..., 0] / away)
        down = np.floor(0.5 * height + self.focal * local[..., 1] / away)
        inside = (right >= 0) & (right < width) & (down >= 0) & (down < height) & (local[..., 2] > 0.05)
        pixel = np.where(inside, down * width + right, 0).astype(np.int64)
        return local[..., 2], pixel, inside

    def points(self, pixels: npt.NDArray[np.int64]) -> FloatArray:
        """The points in the world (N, 3) of some pixels of the flattened picture."""
        height, width = self.depth.shape
        down, right = np.divmod(pixels, width)
        away = self.depth.reshape(-1)[pixels]
        x, y = (right + 0.5 - 0.5 * width) / self.focal, (down + 0.5 - 0.5 * height) / self.focal
        return np.asarray(np.stack([x * away, y * away, away], axis=1) @ self.rotation.T + self.position)


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points (N, 3) in the world in m, their colours (N, 3) in 0..1, and the number of the view that each is of."""

    points: FloatArray
    colours: FloatArray
    views: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.points)

    def of(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Cloud:
        return Cloud(self.points[chosen], self.colours[chosen], self.views[chosen])


def _least_around(picture: npt.NDArray[_Real]) -> npt.NDArray[_Real]:
    found = np.empty_like(picture)
    least_around(picture, found)
    return found


def tolerance(distance: FloatArray | npt.NDArray[np.float32]) -> FloatArray:
    """How far in m from what is expected a measurement may be and be of the same."""
    return np.asarray(3.0 * NOISE * distance**2 + _BESIDE)


def foreground(view: View, expected: FloatArray) -> npt.NDArray[np.int64]:
    """The pixels of what is in front of what is known to be there.

    Args:
        expected: the distance of furniture and robot, (H, W) in m.
    """
    nearest = _least_around(expected)  # at edges, a measurement may be of the pixel beside
    return np.flatnonzero((view.depth > 0.0) & (view.depth < nearest - tolerance(view.depth)))


def misplaced(view: View, expected: FloatArray) -> str:
    """Why a camera does not seem to stand where it is taken to stand, by what is known to be there; nothing if it does.

    Args:
        expected: the distance of furniture and robot, (H, W) in m.
    """
    measured = view.depth > 0.0
    farthest = -_least_around(-expected)
    through = measured & (view.depth > farthest + tolerance(view.depth) + 0.01)
    share = float(through.sum() / max(1, int(measured.sum())))
    if share > _THROUGH:
        return f"looks through furniture and robot in {share:.1%} of its picture"
    room = measured & (np.abs(view.depth - expected) < _ROOM)
    bias = float(np.median((view.depth - expected)[room])) if int(room.sum()) >= _ENOUGH else 0.0
    if abs(bias) > _BIASED:
        return f"measures furniture and robot {1e3 * bias:+.1f} mm from where they are"
    return ""


def cloud(views: list[View], pixels: list[npt.NDArray[np.int64]], images: list[Image]) -> Cloud:
    """The points of some pixels of each view."""
    points = [view.points(chosen) for view, chosen in zip(views, pixels, strict=True)]
    colours = [image.reshape(-1, 3)[chosen] / 255.0 for image, chosen in zip(images, pixels, strict=True)]
    numbers = [np.full(len(chosen), number) for number, chosen in enumerate(pixels)]
    if not points:
        return Cloud(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, np.int64))
    return Cloud(np.concatenate(points), np.concatenate(colours), np.concatenate(numbers))


def clusters(points: FloatArray, low: FloatArray, high: FloatArray) -> list[npt.NDArray[np.int64]]:
    """The points (N, 3) between two corners of space in groups that hang together: indices, the largest group first."""
    inside = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    if len(inside) < _FEW:
        return []
    cell = ((points[inside] - low) / _CELL).astype(np.int64)
    size = np.ceil((high - low) / _CELL).astype(np.int64) + 1
    flat = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    occupied, mine, count = np.unique(flat, return_inverse=True, return_counts=True)
    kept = np.flatnonzero(count >= _LONELY)
    if not len(kept):
        return []
    rest, third = np.divmod(occupied[kept], size[2])
    first, second = np.divmod(rest, size[1])
    beside = cKDTree(np.stack([first, second, third], axis=1)).query_pairs(1.8, output_type="ndarray")
    links = coo_array((np.ones(len(beside)), (beside[:, 0], beside[:, 1])), shape=(len(kept), len(kept)))
    names = np.full(len(occupied), -1)
    names[kept] = connected_components(links, directed=False)[1]
    group = names[mine]
    order = np.argsort(group, kind="stable")
    edges = np.searchsorted(group[order], np.arange(group.max() + 2))
    groups = [inside[order[start:end]] for start, end in itertools.pairwise(edges)]
    return sorted((found for found in groups if len(found) >= _FEW), key=len, reverse=True)
