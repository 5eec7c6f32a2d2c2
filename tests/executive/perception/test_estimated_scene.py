"""Scenes that are drawn by what is estimated: as uncertain as the poses are, and the same every time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from executive.perception.estimated_scene import EstimatedScenes
from executive.relations import Scene, Solid, gripper_empty, gripping, on
from executive.types import EstimatedPose, FloatArray, Lump, PosesEstimated
from tests.executive.perception.room import box, pose

BOX = box("box", (0.06, 0.06, 0.1))
CLOSED, OPEN = 0.05, 0.085


class Surroundings:
    """Two tables side by side, and fingers 6 cm apart, half a metre up."""

    tables: Mapping[str, Solid] = {
        "left": Solid.box(np.array([-0.255, 0.0, -0.05]), np.array([0.25, 0.5, 0.05])),
        "right": Solid.box(np.array([0.255, 0.0, -0.05]), np.array([0.25, 0.5, 0.05])),
    }

    def drawers(self, openings: Mapping[str, float]) -> tuple[Mapping[str, Solid], Mapping[str, float]]:
        return {}, {}

    def finger_solids(self, joints: FloatArray, fingers: FloatArray) -> tuple[Solid, Solid]:
        half = np.array([0.01, 0.005, 0.02])
        return Solid.box(np.array([0.0, -0.035, 0.5]), half), Solid.box(np.array([0.0, 0.035, 0.5]), half)


SCENES = EstimatedScenes([BOX], Surroundings())


def drawn(at: FloatArray, spread: float, width: float = OPEN, lumps: tuple[Lump, ...] = ()) -> list[Scene]:
    covariance = np.diag([spread**2] * 3 + [1e-6] * 3)
    poses = PosesEstimated({"box": EstimatedPose(at, covariance, 0.0, ())}, (), lumps)
    return SCENES.drawn(poses, np.zeros(6), np.zeros(6), width)


def share(scenes: list[Scene], table: str) -> float:
    return sum(on(scene, "box", table) for scene in scenes) / len(scenes)


def test_where_a_table_is_certain_it_is_in_every_scene() -> None:
    scenes = drawn(pose(0.2, 0.0, 0.05), 0.001)
    assert (share(scenes, "right"), share(scenes, "left")) == (1.0, 0.0)
    assert [scene.items["box"].position.tolist() for scene in scenes] == [
        scene.items["box"].position.tolist() for scene in drawn(pose(0.2, 0.0, 0.05), 0.001)
    ]


@pytest.mark.parametrize(("x", "least", "most"), [(0.0, 0.1, 0.9), (0.008, 0.9, 1.0), (-0.008, 0.0, 0.1)])
def test_across_two_edges_it_is_as_certain_as_the_pose(x: float, least: float, most: float) -> None:
    """Depth tells an item's table by millimetres, where the item stands on the edges of two."""
    scenes = drawn(pose(x, 0.0, 0.05), 0.002)
    assert least <= share(scenes, "right") <= most
    assert all(on(scene, "box", "left") is not on(scene, "box", "right") for scene in scenes)


def test_above_a_table_is_not_on_it_unless_something_carries_it() -> None:
    high = pose(0.2, 0.0, 0.15)
    assert share(drawn(high, 0.001), "right") == 0.0
    assert share(drawn(high, 0.001, lumps=(Lump(np.array([0.2, 0.0, 0.05]), np.full(3, 0.05)),)), "right") == 1.0


def test_fingers_that_are_stopped_around_an_item_hold_it() -> None:
    between = pose(0.0, 0.0, 0.5)
    assert all(gripping(scene, "box") and not gripper_empty(scene) for scene in drawn(between, 0.0005, CLOSED))
    assert not any(gripping(scene, "box") for scene in drawn(between, 0.0005, OPEN))
    assert not any(gripping(scene, "box") for scene in drawn(pose(0.3, 0.0, 0.05), 0.0005, CLOSED))
