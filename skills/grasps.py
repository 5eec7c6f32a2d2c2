"""Where a two-finger gripper can take hold of an item.

A grasp is the transform (4, 4) of the grip point in the world: z out of the hand (the approach), x from pad to pad.
"""

from __future__ import annotations

import numpy as np

from executive.sim.scene import GRIP_DEPTH, WIDEST_GRIP, ItemShape
from executive.types import FloatArray

_DEPTHS = (GRIP_DEPTH, 0.020)
"""How far below an item's top the grip point is, in m."""

_PAD = 0.022
"""m from an item's end at which the pads, 22 mm wide, still press on it with all their face."""

_LOWEST = 0.021
"""m between grip point and table: closed, the finger tips reach 18 mm beyond it."""

_TILTS = (0.0, 0.3, -0.3, 0.6, -0.6)
"""Rotations of the hand about its closing axis away from straight down, in rad, in order of preference."""

_UP = np.array([0.0, 0.0, 1.0])


def candidates(
    item: FloatArray, shape: ItemShape, table_top: float, slack: float = 0.0, widest: float = WIDEST_GRIP
) -> list[FloatArray]:
    """Grasps of an item, best first.

    Args:
        item: the item's transform (4, 4) in the world.
        shape: its bounding box.
        table_top: height in m of what it stands on.
        slack: how far in m the item may be from there; the fingers leave as much room on either side.
        widest: what is wider than this, in m, is not between the fingers.
    """
    rotation = item[:3, :3]
    held = shape.gripped_at
    centre = item[:3, 3] + rotation @ held
    result: list[FloatArray] = []
    off_centre: list[FloatArray] = []
    for tilt in _TILTS:
        for closing in _closing_axes(rotation, shape, widest - 2.0 * slack):
            straight = -(_UP - (_UP @ closing) * closing)
            straight /= np.linalg.norm(straight)
            approach = np.cos(tilt) * straight + np.sin(tilt) * np.cross(closing, straight)
            above = shape.reach_from(held, rotation.T @ -approach)
            for depth in _DEPTHS:
                point = centre - max(0.0, above - depth) * approach
                point[2] = max(point[2], table_top + _LOWEST)
                along, level = np.cross(approach, closing), np.cross(closing, _UP)
                level /= np.linalg.norm(level)
                spare = shape.reach(rotation.T @ level) - _PAD
                # What has a place to be taken at is taken there alone.
                shifts = spare > 0.02 and shape.axis != 2 and shape.grip is None
                for offset in (0.0, spare, -spare) if shifts else (0.0,):
                    for sign in (1.0, -1.0):
                        grasp = np.eye(4)
                        grasp[:3, :3] = np.stack([sign * closing, sign * along, approach], axis=1)
                        grasp[:3, 3] = point + offset * level
                        (result if offset == 0.0 else off_centre).append(grasp)
                if above <= depth:
                    break  # a flatter item is gripped at its centre either way
    return [*result, *off_centre]


def narrowest(item: FloatArray, shape: ItemShape) -> float:
    """The width in m across which an item at `item` (4, 4) takes the fingers to be least apart."""
    axes = _closing_axes(item[:3, :3], shape)
    return min((width_across(item[:3, :3], shape, axis) for axis in axes), default=WIDEST_GRIP)


def _closing_axes(rotation: FloatArray, shape: ItemShape, widest: float = WIDEST_GRIP) -> list[FloatArray]:
    """Nearly horizontal directions across which the item is narrow enough, in the world frame."""
    if shape.axis is not None:
        axle = rotation[:, shape.axis]
        if abs(float(axle[2])) > 0.8:  # upright: from any side
            angles = np.linspace(0.0, np.pi, 8, endpoint=False)
            axes = [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in angles]
        else:  # lying: across
            across = np.cross(axle, _UP)
            axes = [across / np.linalg.norm(across)]
    else:
        axes = [rotation[:, index] for index in range(3) if abs(float(rotation[2, index])) < 0.5]
    return [axis for axis in axes if width_across(rotation, shape, axis) < widest]


def width_across(rotation: FloatArray, shape: ItemShape, axis: FloatArray) -> float:
    """How far apart the fingers are that close on an item along an axis (3,), in m."""
    held = shape.gripped_at
    return 2.0 * max(shape.reach_from(held, rotation.T @ way) for way in (axis, -axis))
