"""Where a two-finger gripper can take hold of an item, and where on a table it can be put down.

A grasp is the transform (4, 4) of the grip point in the world: z out of the hand (the approach), x from pad to pad.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from executive.sim.scene import GRIP_DEPTH, WIDEST_GRIP, ItemShape
from executive.sim.spec import TableSpec
from executive.skills import transforms
from executive.types import FloatArray

_DEPTHS = (GRIP_DEPTH, 0.020)
"""How far below an item's top the grip point is, in m."""

_PAD = 0.022
"""m from an item's end at which the pads, 22 mm wide, still press on it with all their face."""

_LOWEST = 0.021
"""m between grip point and table: closed, the finger tips reach 18 mm beyond it."""

_TILTS = (0.0, 0.3, -0.3, 0.6, -0.6)
"""Rotations of the hand about its closing axis away from straight down, in rad, in order of preference."""

_EDGE = 0.015
"""m from a table's edges, where there is room for that."""

_YAWS = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
"""Turns about the vertical in which an item is put down, in rad."""

_UP = np.array([0.0, 0.0, 1.0])


def candidates(item: FloatArray, shape: ItemShape, table_top: float, slack: float = 0.0) -> list[FloatArray]:
    """Grasps of an item, best first.

    Args:
        item: the item's transform (4, 4) in the world.
        shape: its bounding box.
        table_top: height in m of what it stands on.
        slack: how far in m the item may be from there; the fingers leave as much room on either side.
    """
    rotation = item[:3, :3]
    centre = item[:3, 3] + rotation @ shape.centre
    result: list[FloatArray] = []
    off_centre: list[FloatArray] = []
    for tilt in _TILTS:
        for closing in _closing_axes(rotation, shape, slack):
            straight = -(_UP - (_UP @ closing) * closing)
            straight /= np.linalg.norm(straight)
            approach = np.cos(tilt) * straight + np.sin(tilt) * np.cross(closing, straight)
            above = shape.reach(rotation.T @ approach)
            for depth in _DEPTHS:
                point = centre - max(0.0, above - depth) * approach
                point[2] = max(point[2], table_top + _LOWEST)
                along = np.cross(approach, closing)
                spare = shape.reach(rotation.T @ along) - _PAD
                for offset in (0.0, spare, -spare) if spare > 0.02 and shape.axis != 2 else (0.0,):
                    for sign in (1.0, -1.0):
                        grasp = np.eye(4)
                        grasp[:3, :3] = np.stack([sign * closing, sign * along, approach], axis=1)
                        grasp[:3, 3] = point + offset * along
                        (result if offset == 0.0 else off_centre).append(grasp)
                if above <= depth:
                    break  # a flatter item is gripped at its centre either way
    return [*result, *off_centre]


def _closing_axes(rotation: FloatArray, shape: ItemShape, slack: float = 0.0) -> list[FloatArray]:
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
    return [axis for axis in axes if 2 * (shape.reach(rotation.T @ axis) + slack) < WIDEST_GRIP]


def on_table(item: FloatArray, shape: ItemShape, table: TableSpec, slack: float = 0.02) -> bool:
    """Whether the item's pose (4, 4) is that of something on the table, if only by lying on other things there."""
    centre = item[:3, 3] + item[:3, :3] @ shape.centre
    inside = np.abs(in_table_frame(centre[:2], table)) <= 0.5 * np.asarray(table.size[:2]) + slack
    lowest = centre[2] - shape.reach(item[:3, :3].T @ _UP)
    return bool(inside.all()) and -0.05 < float(lowest) - table.centre[2] < 0.30


def in_table_frame(point: FloatArray, table: TableSpec) -> FloatArray:
    """A horizontal point (2,) relative to the table's centre, along its own axes."""
    x, y = point - np.asarray(table.centre[:2])
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    return np.array([cos * x + sin * y, -sin * x + cos * y])


def resting(item: FloatArray, shape: ItemShape) -> FloatArray:
    """The rotation (3, 3) nearest to the item's own with which it can stand or lie on a table."""
    rotation = item[:3, :3]
    if shape.axis is not None:
        axle = rotation[:, shape.axis]
        upright = abs(float(axle[2])) > 0.7
        target = np.sign(axle[2]) * _UP if upright else np.array([axle[0], axle[1], 0.0]) / np.hypot(axle[0], axle[1])
        return _turned_onto(axle, target) @ rotation
    nearest = int(np.argmax(np.abs(rotation[2])))
    return _turned_onto(rotation[:, nearest], np.sign(rotation[2, nearest]) * _UP) @ rotation


def _turned_onto(start: FloatArray, end: FloatArray) -> FloatArray:
    """The smallest rotation (3, 3) that takes one unit vector to another that is not its opposite."""
    cross = np.cross(start, end)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + float(start @ end)))


def fits(rotation: FloatArray, shape: ItemShape, table: TableSpec) -> bool:
    """Whether an item with the resting `rotation` (3, 3) lies within a table's edges in some turn."""
    return bool(_turned(rotation, shape, table))


def _turned(rotation: FloatArray, shape: ItemShape, table: TableSpec) -> list[tuple[float, FloatArray]]:
    """The turns in which an item with the resting `rotation` lies within a table's edges, along these first, and how
    far its centre may then be from the table's (2,), along its axes."""
    flat = np.abs(rotation[2])
    own = rotation[:, int(np.argmin(flat))]
    along = table.yaw - float(np.arctan2(own[1], own[0]))
    found = []
    for yaw in (*(along + 0.5 * np.pi * np.arange(4)), *_YAWS):
        local = _turn(float(yaw) - table.yaw) @ rotation
        free = 0.5 * np.asarray(table.size[:2]) - [shape.reach(local.T @ axis) for axis in np.eye(3)[:2]]
        if (free >= -1e-9).all():
            found.append((float(yaw), np.maximum(free, 0.0)))
    return found


def _turn(yaw: float) -> FloatArray:
    """The rotation (3, 3) about the vertical."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def spots(
    rotation: FloatArray,
    shape: ItemShape,
    table: TableSpec,
    others: Mapping[str, FloatArray],
    shapes: Mapping[str, ItemShape],
    rng: np.random.Generator,
    count: int = 24,
) -> list[tuple[FloatArray, FloatArray]]:
    """Free places on a table, roomiest first: the centre (3,) of an item with the resting `rotation`, and the turns
    about the vertical in which it can be put there.

    They are such that it can be turned there in any way; on a table that is too small for that, such that it lies
    within the edges in the turn that is drawn.

    Args:
        others: poses (7,) of everything else that could be in the way.
    """
    half = np.array([shape.reach(rotation.T @ axis) for axis in np.eye(3)])
    radius = float(np.hypot(half[0], half[1]))
    inset = 0.5 * np.asarray(table.size[:2]) - radius - _EDGE
    turned = _turned(rotation, shape, table) if (inset <= 0).any() else []
    if not turned and (inset <= 0).any():
        return []
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    obstacles = []
    for name, pose in others.items():
        corners = transforms.box_corners(transforms.matrix(pose), shapes[name].centre, shapes[name].half)
        if corners[:, 2].max() > table.centre[2] - 0.02:
            middle = corners[:, :2].mean(axis=0)
            obstacles.append((middle, float(np.linalg.norm(corners[:, :2] - middle, axis=1).max())))
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for number, share in enumerate(rng.uniform(-1.0, 1.0, (120, 2))):
        local, yaws = share * inset, _YAWS
        if turned:
            yaw, free = turned[number % len(turned)]
            local, yaws = share * free, np.array([yaw])
        point = np.array(table.centre[:2]) + np.array([[cos, -sin], [sin, cos]]) @ local
        room = min((float(np.linalg.norm(point - middle)) - size - radius for middle, size in obstacles), default=1.0)
        if room > -0.04:  # the outlines are circles; whether the shapes themselves touch is for the collision check
            # Beyond what the fingers need, more room is no better; then a place near the middle is easier to reach.
            worth = min(room, 0.07) - 0.1 * float(np.linalg.norm(local))
            found.append((worth, np.array([*point, table.centre[2] + half[2] + 0.003]), yaws))
    found.sort(key=lambda entry: -entry[0])
    return [(place, yaws) for _, place, yaws in found[:count]]
