"""A memory of failed grasps, so that the next attempt prefers another one."""

from __future__ import annotations

import numpy as np

from executive.types import FloatArray

_NEAR, _TURNED, _TIPPED = 0.012, 0.3, 0.3
"""The tolerances of similar grasps: distance (m) and angle (rad) in the item's frame, and tilt of the item (rad)."""


class FailedGrasps:
    """The failed grasps of each item, in the item's own frame, with the vertical in that frame."""

    def __init__(self) -> None:
        self._failed: dict[str, list[tuple[FloatArray, FloatArray]]] = {}

    def add(self, item: str, pose: FloatArray, grasp: FloatArray) -> None:
        """Records that a grasp (4, 4) of an item at `pose` (4, 4), both in the world frame, has failed."""
        self._failed.setdefault(item, []).append((_within(pose, grasp), pose[2, :3].copy()))

    def forget(self, item: str) -> None:
        """Forgets the failures of an item, which has been grasped."""
        self._failed.pop(item, None)

    def times(self, item: str, pose: FloatArray, grasp: FloatArray) -> int:
        """Counts the failures of similar grasps with the item in a similar orientation."""
        wanted = _within(pose, grasp)
        return sum(
            float(np.linalg.norm(failed[:3, 3] - wanted[:3, 3])) < _NEAR
            and _angle(float(np.trace(failed[:3, :3].T @ wanted[:3, :3])) / 2 - 0.5) < _TURNED
            and _angle(float(up @ pose[2, :3])) < _TIPPED
            for failed, up in self._failed.get(item, ())
        )


def _within(pose: FloatArray, grasp: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(pose) @ grasp)


def _angle(cosine: float) -> float:
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
