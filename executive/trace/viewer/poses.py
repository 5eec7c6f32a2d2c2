"""Estimated poses in the viewer: a box around each item where it is taken to be, with how certain that is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from executive.trace.viewer.blueprint import WORLD
from executive.trace.viewer.colours import AMBER, BLUE, GREEN, RED, Colour
from executive.trace.viewer.text_panels import plain
from executive.types import EstimatedPose, FloatArray, PosesEstimated

ESTIMATED = "estimated"
"""What estimated poses hang under, in the world."""

_COLOURS: Mapping[str, Colour] = {"seen": GREEN, "held": BLUE, "remembered": AMBER}
_DEVIATIONS = 3.0
"""Standard deviations that an ellipsoid of uncertainty reaches."""


class PoseMarks:
    """Logs estimated poses.

    Args:
        boxes: the corners of each item's box in its body's frame, low and high (3,) each.
    """

    def __init__(self, record: rr.RecordingStream, boxes: Mapping[str, tuple[FloatArray, FloatArray]]) -> None:
        self._record, self._boxes = record, boxes
        self._shown: frozenset[str] = frozenset()

    def show(self, estimate: PosesEstimated) -> None:
        for name in self._shown - estimate.poses.keys():
            self._record.log([WORLD, ESTIMATED, plain(name)], rr.Clear(recursive=True))
        for name, pose in estimate.poses.items():
            self._show(name, pose)
        self._shown = frozenset(estimate.poses)
        lumps = rr.Boxes3D(
            centers=[lump.centre for lump in estimate.lumps],
            half_sizes=[lump.half for lump in estimate.lumps],
            colors=RED,
            labels=["unknown"] * len(estimate.lumps),
        )
        self._record.log([WORLD, ESTIMATED, "unknown"], lumps)

    def _show(self, name: str, pose: EstimatedPose) -> None:
        low, high = self._boxes.get(name, (np.full(3, -0.02), np.full(3, 0.02)))
        where: list[object] = [WORLD, ESTIMATED, plain(name)]
        colour = _COLOURS.get(pose.source, GREEN)
        x, y, z = pose.pose[:3]
        at = rr.Transform3D(translation=(x, y, z), quaternion=rr.Quaternion(xyzw=pose.pose[[4, 5, 6, 3]]))
        spread = f"{name} {pose.source}, {1e3 * pose.spread:.1f} mm"
        around = rr.Boxes3D(mins=[low], sizes=[high - low], colors=colour, radii=rr.Radius.ui_points(1.0),
                            labels=[plain(spread)], show_labels=False)  # fmt: skip
        self._record.log(where, at, around)
        values, axes = np.linalg.eigh(pose.covariance[:3, :3])
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] = -axes[:, 0]
        # In the world, as the covariance is; the box's own frame is undone.
        turn = Rotation.from_quat(pose.pose[[4, 5, 6, 3]]).inv() * Rotation.from_matrix(axes)
        ellipsoid = rr.Ellipsoids3D(
            centers=[0.5 * (low + high)],
            half_sizes=[_DEVIATIONS * np.sqrt(np.maximum(values, 0.0))],
            quaternions=[rr.Quaternion(xyzw=turn.as_quat())],
            colors=colour,
            fill_mode="solid",
        )
        self._record.log([*where, "uncertainty"], ellipsoid)
