"""Rigid transforms as (4, 4) matrices, and back to (7,) poses: position in m, quaternion (w, x, y, z)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from executive.types import FloatArray


def matrix(pose: FloatArray) -> FloatArray:
    """The (4, 4) transform of a (7,) pose."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(pose[[4, 5, 6, 3]]).as_matrix()
    result[:3, 3] = pose[:3]
    return result


def pose(transform: FloatArray) -> FloatArray:
    """The (7,) pose of a (4, 4) transform."""
    x, y, z, w = Rotation.from_matrix(transform[:3, :3]).as_quat()
    return np.array([*transform[:3, 3], w, x, y, z])


def inverse(transform: FloatArray) -> FloatArray:
    result = np.eye(4)
    result[:3, :3] = transform[:3, :3].T
    result[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return result


def translated(transform: FloatArray, offset: FloatArray) -> FloatArray:
    """The transform moved by `offset` (3,) in the world frame."""
    result = transform.copy()
    result[:3, 3] += offset
    return result


def box_corners(transform: FloatArray, centre: FloatArray, half: FloatArray) -> FloatArray:
    """The eight corners (8, 3), in the world frame, of a box given in the frame of `transform`."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return np.asarray((centre + signs * half) @ transform[:3, :3].T + transform[:3, 3])
