"""Estimated poses in the viewer: a box around each item where it is taken to be, with how certain that is, the points
that this is known from, and the tracks of identical things."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from executive.trace.viewer.blueprint import WORLD
from executive.trace.viewer.colours import AMBER, BLUE, CYAN, GREEN, PURPLE, RED, WHITE, Colour
from executive.trace.viewer.text_panels import plain
from executive.types import EstimatedPose, FloatArray, PointCloud, PosesEstimated

ESTIMATED = "estimated"
"""What estimated poses hang under, in the world."""

_COLOURS: Mapping[str, Colour] = {"seen": GREEN, "held": BLUE, "remembered": AMBER}
POINTS, TRACKS = "points", "tracks"
"""Under `ESTIMATED`: what was measured of items, and where identical ones came from."""

_TRACKS: Sequence[Colour] = (CYAN, PURPLE, WHITE, GREEN, RED)

_STEP, _LONGEST = 0.01, 200
"""m that a thing moves before its track grows, and the points of a track at most."""

_ABOVE = 0.03
"""m over an item at which its label stands."""

_SURE = 0.9
"""The probability from which on a label is not in doubt."""

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
        self._tracks: dict[str, list[FloatArray]] = {}

    def show_cloud(self, cloud: PointCloud) -> None:
        points = rr.Points3D(cloud.points, colors=cloud.colours, radii=rr.Radius.ui_points(1.2))
        self._record.log([WORLD, ESTIMATED, POINTS], points)

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
        for number, name in enumerate(sorted(estimate.identity)):
            if name in estimate.poses:
                colour = _TRACKS[number % len(_TRACKS)]
                self._show_track(name, colour, estimate.poses[name].pose, estimate.identity[name])

    def _show_track(self, name: str, colour: Colour, pose: FloatArray, identity: Mapping[str, float]) -> None:
        """Where an identical thing came from, and whether it is what it goes by."""
        track = self._tracks.setdefault(name, [])
        if not track or float(np.linalg.norm(pose[:3] - track[-1])) > _STEP:
            track.append(np.array(pose[:3]))
            del track[:-_LONGEST]
            way = rr.LineStrips3D([track], colors=colour, radii=rr.Radius.ui_points(1.5))
            self._record.log([WORLD, ESTIMATED, TRACKS, plain(name)], way)
        low, high = self._boxes.get(name, (np.full(3, -0.02), np.full(3, 0.02)))
        above = pose[:3] + [0.0, 0.0, float(np.abs(high - low).max()) / 2 + _ABOVE]
        is_sure = identity.get(name, 0.0) >= _SURE
        text = name if is_sure else f"{name}? {100 * identity.get(name, 0.0):.0f} %"
        label = rr.Points3D([above], radii=0.0, colors=colour if is_sure else AMBER, labels=[plain(text)],
                            show_labels=True)  # fmt: skip
        self._record.log([WORLD, ESTIMATED, TRACKS, plain(name), "label"], label)

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
