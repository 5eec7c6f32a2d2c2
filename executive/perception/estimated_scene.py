"""From estimated poses to scenes that relations can be asked about: one drawn after another, as likely as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from executive.perception.localizer import HOLDING, matrix
from executive.perception.models import ItemModel
from executive.relations import Part, Scene, Solid
from executive.types import EstimatedPose, FloatArray, Lump, PosesEstimated

TOLERANCE = 0.004
"""m within which things touch: what an estimated pose is off by, with room for how the points lie on a surface."""

DRAWN = 16
"""Scenes that are drawn: a relation that holds in none of them is still possible, but no more than that."""


class Surroundings(Protocol):
    """What the robot knows of its room and its hand without looking."""

    @property
    def tables(self) -> Mapping[str, Solid]:
        """The tables by name."""
        ...

    def drawers(self, openings: Mapping[str, float]) -> tuple[Mapping[str, Solid], Mapping[str, float]]:
        """The floors of drawers that are open by so many m, and which shares of their travel that is."""
        ...

    def finger_solids(self, joints: FloatArray, fingers: FloatArray) -> tuple[Solid, Solid]:
        """The left and the right finger at measured joint positions of arm and fingers (rad)."""
        ...


class EstimatedScenes:
    """Draws scenes by what perception estimates of them."""

    def __init__(self, models: Sequence[ItemModel], surroundings: Surroundings) -> None:
        self._surroundings = surroundings
        self._solids = {model.name: _solid(model) for model in models}

    def drawn(self, poses: PosesEstimated, joints: FloatArray, fingers: FloatArray, width: float) -> list[Scene]:
        """Return scenes, each with every pose off its estimate by as much as its covariance says. The first has the
        poses as they are estimated; the same estimate draws the same scenes.

        Args:
            joints, fingers: measured positions of arm and fingers (rad).
            width: the opening between the pads in m; that they are stopped half way is what is felt.
        """
        solids = self._surroundings.finger_solids(joints, fingers)
        feels = HOLDING[0] < width < HOLDING[1]
        others = [_lump(lump) for lump in poses.lumps]
        floors, shares = self._surroundings.drawers(poses.openings) if poses.openings else ({}, {})
        tables = {**self._surroundings.tables, **floors}
        rng = np.random.default_rng(0)
        found = []
        for number in range(DRAWN):
            items = {
                name: self._solids[name].moved(*_off(pose, rng.standard_normal(6) if number else np.zeros(6)))
                for name, pose in poses.poses.items()
            }
            found.append(Scene(items, tables, solids, feels, others, TOLERANCE, openings=shares))
        return found


def _off(pose: EstimatedPose, by: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rotation and translation of a body that is off its estimated pose by so many standard deviations (6,)."""
    values, axes = np.linalg.eigh(pose.covariance)
    error = axes @ (np.sqrt(np.maximum(values, 0.0)) * by)
    body = matrix(pose.pose)
    return Rotation.from_rotvec(error[3:]).as_matrix() @ body[:3, :3], body[:3, 3] + error[:3]


def _solid(model: ItemModel) -> Solid:
    """A shape in its body's frame, with its centre of mass where it would be if it were of one material."""
    corners = model.vertices[np.unique(ConvexHull(model.vertices).vertices)]
    a, b, c = (model.vertices[model.faces[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = float(volume.sum())
    centre = ((a + b + c) * volume[:, None]).sum(axis=0) / (4.0 * total) if abs(total) > 1e-12 else model.centre
    return Solid((Part(corners),), np.eye(3), np.zeros(3), np.asarray(centre))


def _lump(lump: Lump) -> Solid:
    return Solid.box(lump.centre, lump.half)
