"""What items rest on, tables and the tops of other items: how an item can lie there, and where there is room for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executive.sim import footprint
from executive.sim.fixtures import Floor, Rectangle
from executive.sim.scene import ItemShape
from executive.sim.spec import RegionSpec, TableSpec
from executive.skills import transforms
from executive.types import FloatArray, about_vertical

_EDGE = 0.015
"""m from a table's edges, where there is room for that."""

_YAWS = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
"""Turns about the vertical in which an item is put down, in rad."""

_ABOVE = 0.003
"""m above a surface at which an item is let go of."""

_LEVEL = 0.02
"""The largest height in m between the top of an item and the lowest point of what rests on it."""

_TIGHT_TRIES = 300
"""How many places between other items are looked at."""

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Where items can be put: a table, the floor of a drawer or a container, or the top of an item. `centre` (3,) is
    the middle of its top in the world frame and `size` its full extents along its own x and y, in m; `yaw` is how it is
    turned about the vertical, in rad, `walls` how high in m the walls around it are, if there are any, and `taken` what
    is no place to put anything on it."""

    name: str
    centre: FloatArray
    size: tuple[float, float]
    yaw: float = 0.0
    is_item: bool = False
    walls: float | None = None
    taken: tuple[Rectangle, ...] = ()

    @classmethod
    def of_table(cls, table: TableSpec, taken: tuple[Rectangle, ...] = ()) -> Surface:
        return cls(table.name, np.array(table.centre), (table.size[0], table.size[1]), table.yaw, taken=taken)

    @classmethod
    def of_floor(cls, floor: Floor) -> Surface:
        return cls(floor.name, np.array(floor.centre), floor.size, floor.yaw, walls=floor.height)

    @classmethod
    def of_region(cls, region: RegionSpec, table: TableSpec) -> Surface:
        cos, sin = np.cos(table.yaw), np.sin(table.yaw)
        x, y = region.centre
        centre = np.array(table.centre) + [cos * x - sin * y, sin * x + cos * y, 0.0]
        return cls(region.name, centre, region.size, table.yaw)

    @classmethod
    def of_item(cls, item: FloatArray, shape: ItemShape) -> Surface:
        """The top of an item that is at `item` (4, 4)."""
        rotation = item[:3, :3]
        centre = item[:3, 3] + rotation @ shape.centre
        centre = centre + shape.reach(rotation.T @ _UP) * _UP
        x, y = sorted(range(3), key=lambda axis: abs(float(rotation[2, axis])))[:2]
        yaw = float(np.arctan2(rotation[1, x], rotation[0, x]))
        return cls(shape.name, centre, (2 * float(shape.half[x]), 2 * float(shape.half[y])), yaw, is_item=True)

    def holds(self, item: FloatArray, shape: ItemShape, slack: float = 0.02) -> bool:
        """Whether the pose (4, 4) of an item is that of something that rests there, on a table if only by lying on
        other things; `slack` is how far in m its centre may be beyond the edges."""
        centre = item[:3, 3] + item[:3, :3] @ shape.centre
        inside = np.abs(self.local(centre[:2])) <= 0.5 * np.asarray(self.size) + slack
        height = centre[2] - shape.reach(item[:3, :3].T @ _UP) - self.centre[2]
        low, high = (-_LEVEL, _LEVEL) if self.is_item else (-0.05, 0.30 if self.walls is None else self.walls)
        return bool(inside.all()) and low < float(height) < high

    def is_taken(self, point: FloatArray, radius: float) -> bool:
        """Whether something that reaches `radius` m around a horizontal point (2,) would be where nothing is put."""
        return any(each.beside(point) < radius for each in self.taken)

    def local(self, point: FloatArray) -> FloatArray:
        """A horizontal point (2,) relative to the centre, along the surface's own axes."""
        x, y = point - self.centre[:2]
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([cos * x + sin * y, -sin * x + cos * y])

    def grid(self, step: float) -> FloatArray:
        """Points of the top in the world frame, at most `step` m apart, (N, 3)."""
        return footprint.grid(self.centre, self.size, self.yaw, step)

    def __str__(self) -> str:
        wide, deep = (100.0 * extent for extent in self.size)
        return f"{self.name}, {wide:.1f} x {deep:.1f} cm"


def rests_on(upper: FloatArray, shape: ItemShape, lower: FloatArray, below: ItemShape) -> bool:
    """Whether an item at `upper` (4, 4) rests on one at `lower` (4, 4), by their shapes alone."""
    return Surface.of_item(lower, below).holds(upper, shape, slack=0.0)


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


def tipped(rotation: FloatArray, axis: FloatArray) -> list[FloatArray]:
    """The rotations (3, 3) of an item that rests with `rotation`, tipped onto its side by a quarter turn about a
    horizontal `axis` (3,), such as the line between the fingers."""
    flat = np.array([axis[0], axis[1], 0.0]) / np.hypot(axis[0], axis[1])
    return [Rotation.from_rotvec(side * 0.5 * np.pi * flat).as_matrix() @ rotation for side in (1.0, -1.0)]


def _turned_onto(start: FloatArray, end: FloatArray) -> FloatArray:
    """The smallest rotation (3, 3) that takes one unit vector to another that is not its opposite."""
    cross = np.cross(start, end)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + float(start @ end)))


def fits(rotation: FloatArray, shape: ItemShape, surface: Surface) -> bool:
    """Whether an item with the resting `rotation` (3, 3) lies within a table's edges in some turn; on another item it
    is balanced."""
    return surface.is_item or bool(_turned(rotation, shape, surface))


def _turned(rotation: FloatArray, shape: ItemShape, surface: Surface) -> list[tuple[float, FloatArray]]:
    """The turns in which an item with the resting `rotation` lies within a table's edges, along these first, and how
    far its centre may then be from the table's (2,), along its axes."""
    flat = np.abs(rotation[2])
    own = rotation[:, int(np.argmin(flat))]
    along = surface.yaw - float(np.arctan2(own[1], own[0]))
    found = []
    for yaw in (*(along + 0.5 * np.pi * np.arange(4)), *_YAWS):
        local = about_vertical(float(yaw) - surface.yaw) @ rotation
        free = 0.5 * np.asarray(surface.size) - [shape.reach(local.T @ axis) for axis in np.eye(3)[:2]]
        if (free >= -1e-9).all():
            found.append((float(yaw), np.maximum(free, 0.0)))
    return found


def tight_spots(
    rotation: FloatArray,
    shape: ItemShape,
    table: Surface,
    others: Mapping[str, FloatArray],
    shapes: Mapping[str, ItemShape],
    rng: np.random.Generator,
    count: int = 24,
) -> list[tuple[FloatArray, FloatArray]]:
    """What `spots` returns for a table, by the outlines of items where that takes them for circles: free places between
    them, each in one turn."""
    turned = _turned(rotation, shape, table)
    there = [
        _outline(transforms.matrix(pose), shapes[name])
        for name, pose in others.items()
        if _is_above(pose, shapes[name], table)
    ]
    across = about_vertical(table.yaw)[:2, :2]
    radius = min(shape.reach(rotation.T @ axis) for axis in np.eye(3)[:2])
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for number, share in enumerate(rng.uniform(-1.0, 1.0, (_TIGHT_TRIES if turned else 0, 2))):
        yaw, free = turned[number % len(turned)]
        point = table.centre[:2] + across @ (share * free)
        item = np.eye(4)
        item[:3, :3] = about_vertical(yaw) @ rotation
        item[:2, 3] = point - (item[:3, :3] @ shape.centre)[:2]
        here = _outline(item, shape)
        room = min((here.apart(other) for other in there), default=1.0)
        if table.is_taken(point, radius):
            continue
        if room > 0.0:
            height = table.centre[2] + shape.reach(rotation.T @ _UP) + _ABOVE
            found.append((room, np.array([*point, height]), np.array([yaw])))
    found.sort(key=lambda entry: -entry[0])
    return [(place, yaws) for _, place, yaws in found[:count]]


def _outline(item: FloatArray, shape: ItemShape) -> footprint.Placed:
    """What an item at `item` (4, 4) covers from above: a disc where it stands on a round foot, else a rectangle around
    it, along its longest side."""
    rotation, centre = item[:3, :3], (item[:3, 3] + item[:3, :3] @ shape.centre)[:2]
    longest = int(np.argmax(np.linalg.norm(rotation[:2], axis=0) * shape.half))
    turn = float(np.arctan2(rotation[1, longest], rotation[0, longest]))
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    x, y = (shape.reach(rotation.T @ direction) for direction in (along, np.cross(_UP, along)))
    is_round = shape.axis is not None and abs(float(rotation[2, shape.axis])) > 0.99
    return footprint.Placed(footprint.Outline(x, y, is_round), centre, turn)


def _is_above(pose: FloatArray, shape: ItemShape, table: Surface) -> bool:
    """Whether an item at `pose` (7,) is so high that it can be in the way on a table."""
    corners = transforms.box_corners(transforms.matrix(pose), shape.centre, shape.half)
    return bool(corners[:, 2].max() > table.centre[2] - _LEVEL)


def spots(
    rotation: FloatArray,
    shape: ItemShape,
    surface: Surface,
    others: Mapping[str, FloatArray],
    shapes: Mapping[str, ItemShape],
    rng: np.random.Generator,
    count: int = 24,
) -> list[tuple[FloatArray, FloatArray]]:
    """Free places on a surface, roomiest first: the centre (3,) of an item with the resting `rotation`, and the turns
    about the vertical in which it can be put there.

    On a table they are such that it can be turned there in any way; on one that is too small for that, such that it
    lies within the edges in the turn that is drawn. On another item, its middle is the only one, edge along edge first.

    Args:
        others: poses (7,) of everything else that could be in the way.
    """
    half = np.array([shape.reach(rotation.T @ axis) for axis in np.eye(3)])
    if surface.is_item:
        own = rotation[:, int(np.argmin(np.abs(rotation[2])))]
        turn = surface.yaw - float(np.arctan2(own[1], own[0]))
        top: FloatArray = surface.centre + np.array([0.0, 0.0, half[2] + _ABOVE])
        return [(top, np.array([turn + 0.5 * np.pi * quarter for quarter in range(4)])), (top, _YAWS)]
    radius = float(np.hypot(half[0], half[1]))
    inset = 0.5 * np.asarray(surface.size) - radius - _EDGE
    turned = _turned(rotation, shape, surface) if (inset <= 0).any() else []
    if not turned and (inset <= 0).any():
        return []
    cos, sin = np.cos(surface.yaw), np.sin(surface.yaw)
    obstacles = []
    for name, pose in others.items():
        corners = transforms.box_corners(transforms.matrix(pose), shapes[name].centre, shapes[name].half)
        if corners[:, 2].max() > surface.centre[2] - 0.02:
            middle = corners[:, :2].mean(axis=0)
            obstacles.append((middle, float(np.linalg.norm(corners[:, :2] - middle, axis=1).max())))
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for number, share in enumerate(rng.uniform(-1.0, 1.0, (120, 2))):
        local, yaws = share * inset, _YAWS
        if turned:
            yaw, free = turned[number % len(turned)]
            local, yaws = share * free, np.array([yaw])
        point = surface.centre[:2] + np.array([[cos, -sin], [sin, cos]]) @ local
        room = min((float(np.linalg.norm(point - middle)) - size - radius for middle, size in obstacles), default=1.0)
        if room > -0.04 and not surface.is_taken(
            point, radius
        ):  # the outlines are circles; whether the shapes themselves touch is for the collision check
            # Beyond what the fingers need, more room is no better; then a place near the middle is easier to reach.
            worth = min(room, 0.07) - 0.1 * float(np.linalg.norm(local))
            found.append((worth, np.array([*point, surface.centre[2] + half[2] + _ABOVE]), yaws))
    found.sort(key=lambda entry: -entry[0])
    return [(place, yaws) for _, place, yaws in found[:count]]
