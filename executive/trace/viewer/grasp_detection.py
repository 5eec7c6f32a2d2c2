"""What the hand holds, told from where things are: for the people who watch, never for those who decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from executive.types import FloatArray

_MOVED = 1e-3
"""m between two frames; what moved less stands still."""
_RIDES, _SHARE = 5e-4, 0.1
"""m, and share of its way, by which an item that rides along may shift against its carrier between two frames."""
_SLIPPED = 0.02
"""m against its carrier by which an item has been let go."""
_NEAR = 0.3
"""m; what is further away from an item carries it not."""


class Grip:
    """Which of `items` goes along with the part of the robot that is nearest to it. Feed every frame to `told`."""

    def __init__(self, items: Sequence[str]) -> None:
        self._items = frozenset(items)
        self._last: Mapping[str, FloatArray] = {}
        self._carrier, self._at = "", np.zeros(3)
        self.holds = ""
        """The item, or nothing."""

    def told(self, poses: Mapping[str, FloatArray]) -> str:
        """Take in where everything is (position in m, quaternion w, x, y, z), and return what is held."""
        if self.holds and not self._still_there(poses):
            self.holds = ""
        if not self.holds:
            self._find(poses)
        self._last = poses
        return self.holds

    def _still_there(self, poses: Mapping[str, FloatArray]) -> bool:
        if self.holds not in poses or self._carrier not in poses:
            return False
        return float(np.linalg.norm(_within(poses[self._carrier], poses[self.holds]) - self._at)) <= _SLIPPED

    def _find(self, poses: Mapping[str, FloatArray]) -> None:
        for item in sorted(self._items & poses.keys() & self._last.keys()):
            way = float(np.linalg.norm(poses[item][:3] - self._last[item][:3]))
            if way < _MOVED:
                continue
            apart = {
                body: float(np.linalg.norm(pose[:3] - poses[item][:3]))
                for body, pose in poses.items()
                if body not in self._items and body in self._last
            }
            body = min(apart, key=apart.__getitem__, default="")
            if not body or apart[body] > _NEAR or np.linalg.norm(poses[body][:3] - self._last[body][:3]) < _MOVED:
                continue
            now, before = _within(poses[body], poses[item]), _within(self._last[body], self._last[item])
            if float(np.linalg.norm(now - before)) <= _RIDES + _SHARE * way:
                self.holds, self._carrier, self._at = item, body, now
                return


def _within(frame: FloatArray, pose: FloatArray) -> FloatArray:
    """Return where `pose` is, (3,) in m, as seen from `frame`; both (7,)."""
    w, x, y, z = frame[3:] / np.linalg.norm(frame[3:])
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen: FloatArray = turn.T @ (pose[:3] - frame[:3])
    return seen
