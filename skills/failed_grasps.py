"""Grasps that came to nothing: the next attempt takes another one, if it can."""

from __future__ import annotations

import numpy as np

from executive.types import FloatArray

_NEAR, _TURNED, _TIPPED = 0.012, 0.3, 0.3
"""Two grasps are alike when they are no farther apart than this (m) and this (rad) in the item's frame, and the item
stands or lies as it did (rad)."""


class FailedGrasps:
    """Of each item, the grasps that have failed, in the item's own frame, and which way was up in it."""

    def __init__(self) -> None:
        self._failed: dict[str, list[tuple[FloatArray, FloatArray]]] = {}

    def add(self, item: str, pose: FloatArray, grasp: FloatArray) -> None:
        """A grasp (4, 4) of an item at `pose` (4, 4), both in the world frame, has failed."""
        self._failed.setdefault(item, []).append((_within(pose, grasp), pose[2, :3].copy()))

    def forget(self, item: str) -> None:
        """The item has been taken hold of."""
        self._failed.pop(item, None)

    def times(self, item: str, pose: FloatArray, grasp: FloatArray) -> int:
        """How often grasps like this one have failed while the item stood or lay like this."""
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
