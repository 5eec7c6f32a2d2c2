"""The outlines of items on a table, and whether there is room for them. Pure geometry.

An *outline* is what an item covers of the table that it rests on: a rectangle, or a disc where it stands on a round
foot. Lengths are in m, angles in rad about the vertical.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from executive.sim.fixtures import Floor
from executive.sim.spec import TableSpec
from executive.types import FloatArray

if TYPE_CHECKING:
    from executive.sim.scene import ItemShape

_TURNS = np.linspace(0.0, np.pi, 181)
"""Turns of an outline on a table that are tried: one for each degree."""


@dataclass(frozen=True, slots=True)
class Outline:
    """Half the extent of an outline along its own x and y; `is_round` for a disc, whose radius is both."""

    x: float
    y: float
    is_round: bool = False

    def extent(self, turn: FloatArray | float) -> FloatArray:
        """Half the extent (..., 2) along x and y of a frame in which the outline is turned by `turn` (...)."""
        cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        if self.is_round:
            cos, sin = np.ones_like(cos), np.zeros_like(sin)
        return np.stack([cos * self.x + sin * self.y, sin * self.x + cos * self.y], axis=-1)

    def fits(self, table: TableSpec | Floor, margin: float) -> bool:
        """Whether it can lie within a table's top in some direction, `margin` from every edge."""
        room = 0.5 * np.asarray(table.size[:2]) - margin
        return bool((self.extent(_TURNS) <= room + 1e-9).all(axis=-1).any())

    def __str__(self) -> str:
        wide, deep = (100.0 * 2.0 * half for half in (self.x, self.y))
        return f"{wide:.1f} cm across" if self.is_round else f"{wide:.1f} x {deep:.1f} cm"


def standing(shape: ItemShape) -> Outline:
    """The outline of an item that stands upright, along its own x and y."""
    return Outline(float(shape.half[0]), float(shape.half[1]), shape.axis == 2 or shape.is_ball)


def resting(shape: ItemShape) -> tuple[Outline, ...]:
    """Its outlines in every way in which an item can rest on a table, the one in which it stands upright first."""
    x, y, z = map(float, shape.half)
    if shape.is_ball:
        sides = [Outline(x, x, is_round=True)]
    elif shape.axis is None:
        sides = [Outline(a, b) for a, b in ((x, y), (y, z), (x, z))]
    else:
        along = float(shape.half[shape.axis])
        radius = max(float(half) for axis, half in enumerate(shape.half) if axis != shape.axis)
        sides = [Outline(radius, radius, is_round=True), Outline(along, radius)]
    upright = standing(shape)
    return tuple(sorted(sides, key=lambda side: side != upright))


def too_large(shape: ItemShape, table: TableSpec | Floor) -> bool:
    """Whether an item fits on a table in no way in which it can rest there."""
    return not any(outline.fits(table, 0.0) for outline in resting(shape))


def top(table: TableSpec | Floor) -> str:
    """A table's size in words."""
    wide, deep = (100.0 * extent for extent in table.size[:2])
    return f"{wide:.1f} x {deep:.1f} cm"


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """An outline, the point (2,) in the world that its centre is at, and how far it is turned there."""

    outline: Outline
    centre: FloatArray
    turn: float

    def apart(self, other: Placed) -> float:
        """How far in m two outlines are from each other, 0 where they overlap."""
        if self.outline.is_round and other.outline.is_round:
            return max(0.0, float(np.hypot(*(self.centre - other.centre))) - self.outline.x - other.outline.x)
        for one, disc in ((self, other), (other, self)):
            if disc.outline.is_round:
                beyond = np.abs(_axes(one.turn) @ (disc.centre - one.centre)) - [one.outline.x, one.outline.y]
                return max(0.0, float(np.hypot(*np.maximum(beyond, 0.0))) - disc.outline.x)
        mine, its = self._corners(), other._corners()
        axes = np.concatenate([_axes(self.turn), _axes(other.turn)])
        spans = ((mine @ axis, its @ axis) for axis in axes)
        if all(a.max() >= b.min() and b.max() >= a.min() for a, b in spans):
            return 0.0
        return min(_to_edges(mine, its), _to_edges(its, mine))

    def _corners(self) -> FloatArray:
        """Its corners (4, 2), one after the other around it."""
        signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        return np.asarray(self.centre + signs * [self.outline.x, self.outline.y] @ _axes(self.turn))


def _axes(turn: float) -> FloatArray:
    """The axes of a frame that is turned, one a row."""
    return np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


def _to_edges(points: FloatArray, corners: FloatArray) -> float:
    """The least distance of any of the points from the edges between the corners."""
    starts, edges = corners, np.roll(corners, -1, axis=0) - corners
    relative = points[:, None] - starts[None]
    along = np.clip((relative * edges).sum(-1) / (edges**2).sum(-1), 0.0, 1.0)
    return float(np.linalg.norm(relative - along[..., None] * edges, axis=-1).min())


def grid(centre: FloatArray, size: tuple[float, float], yaw: float, step: float) -> FloatArray:
    """Points (N, 3) of a rectangle of this size in m, turned by `yaw` (rad) about the vertical through its centre (3,),
    at most `step` m apart."""
    x, y = (np.linspace(-0.5, 0.5, int(np.ceil(extent / step)) + 1) * extent for extent in size)
    cos, sin = np.cos(yaw), np.sin(yaw)
    along, across = (each.ravel() for each in np.meshgrid(x, y))
    beside = np.stack([cos * along - sin * across, sin * along + cos * across, np.zeros(len(along))], axis=1)
    return np.asarray(centre + beside)
