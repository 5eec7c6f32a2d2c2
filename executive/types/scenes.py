"""The poses and shapes of everything in the world: as they are, for visualisation only, and as they are estimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from executive.types.facts import FloatArray

_DOUBT = 0.02
"""By how much a probability has to change to be news."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The poses of all moving bodies: name -> (7,) position in m and quaternion (w, x, y, z), world frame.

    `joints` are the arm's joint positions in rad. Where the world tells it, `command` is what the servos are told: a
    position in rad for each joint, and last how far the fingers shall close, 0 to 1; `fingers` are the finger joints'
    positions in rad. Only for who watches and for exporting a run; no decision depends on one.
    """

    poses: Mapping[str, FloatArray]
    joints: FloatArray
    gripper: float
    """Opening between the finger pads in m."""
    command: FloatArray | None = None
    fingers: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """A rigid triangle mesh that moves with `body`: (V, 3) vertices in m in the body's frame, (F, 3) vertex indices,
    RGBA in 0..1. The body name "" is the world."""

    body: str
    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]
    rgba: tuple[float, float, float, float]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera. `pose` is (7,): position in m and quaternion (w, x, y, z) in the world frame, looking along its
    own -z with +x to the right (the OpenGL convention, RUB); `fovy` is the vertical field of view in rad."""

    name: str
    pose: tuple[float, ...]
    fovy: float
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """The world's shapes, which `Frame` moves, its cameras, and the names of the arm's joints, for visualisation."""

    geometries: tuple[Geometry, ...] = ()
    cameras: tuple[Camera, ...] = ()
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points (N, 3) in m, world frame, and their colours (N, 3), uint8: some of what depth cameras measured of things
    that are neither furniture nor robot. Only for visualisation."""

    points: npt.NDArray[np.float32]
    colours: npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedPose:
    """Where an item is by what was measured.

    `pose` is (7,), world frame; `covariance` (6, 6) of its position (m) and rotation (rad, about the world's axes);
    `misfit` is the mean distance in m of the points measured on it from its surface; `views` are the cameras that
    measured it. `source` is `seen`, `held` (by the joints, with the last pose in the fingers) or `remembered` (hidden
    since `time`, a moment of the world's clock in seconds, and not refuted).
    """

    pose: FloatArray
    covariance: FloatArray
    misfit: float
    views: tuple[str, ...]
    source: str = "seen"
    time: float = 0.0

    @property
    def spread(self) -> float:
        """The standard deviation of the position in m along its most uncertain direction."""
        return float(np.sqrt(max(0.0, np.linalg.eigvalsh(self.covariance[:3, :3])[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class Lump:
    """Something that is there and is no known item: the box around it along the world's axes, centre and half extents,
    (3,) each in m."""

    centre: FloatArray
    half: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PosesEstimated:
    """Poses were estimated from depth pictures: of each item that is seen, held or remembered. Items in `missing` are
    not seen where they were, nor anywhere else. `left_out` says why a camera's depth was not used. Of items that
    nothing tells apart, `identity` says by name how probable it is that the item is where each of them is said to be.
    `openings` says how far each drawer is open, in m.
    """

    poses: Mapping[str, EstimatedPose]
    missing: tuple[str, ...] = ()
    lumps: tuple[Lump, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    identity: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    openings: Mapping[str, float] = field(default_factory=dict)

    def differs_from(self, other: PosesEstimated, by: float) -> bool:
        """Whether something is found or missing that was not, or is more than `by` m from where it was, or is more or
        less certainly what it is called than it was."""
        if self.poses.keys() != other.poses.keys() or self.openings.keys() != other.openings.keys():
            return True
        if any(abs(opening - other.openings[name]) > by for name, opening in self.openings.items()):
            return True
        for name, pose in self.poses.items():
            before = other.poses[name]
            if pose.source != before.source or float(np.linalg.norm(pose.pose[:3] - before.pose[:3])) > by:
                return True
        return any(
            abs(chance - other.identity.get(name, {}).get(label, 0.0)) > _DOUBT
            for name, row in self.identity.items()
            for label, chance in row.items()
        )


Watched: TypeAlias = Frame | PosesEstimated | PointCloud
"""What those who watch a world are told."""


def about_vertical(angle: float) -> FloatArray:
    """Return the rotation (3, 3) by an angle in rad about the world's vertical axis."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
