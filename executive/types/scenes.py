"""The poses and shapes of everything in the world, for visualisation only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from executive.types.facts import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The poses of all moving bodies: name -> (7,) position in m and quaternion (w, x, y, z), world frame.

    Only for visualisation; no decision depends on one.
    """

    poses: Mapping[str, FloatArray]
    joints: FloatArray
    gripper: float
    """Opening between the finger pads in m."""


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
    """The world's shapes, which `Frame` moves, and its cameras, for visualisation."""

    geometries: tuple[Geometry, ...] = ()
    cameras: tuple[Camera, ...] = ()
