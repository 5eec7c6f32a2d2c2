"""A scene: what is where, in which shape, and what the fingers feel. Relations are functions of it, whoever made it:
the simulator, which knows, or perception, which estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from executive.relations import convex
from executive.relations.convex import Part
from executive.types import FloatArray

CONTACT = 1e-7
"""m within which two solids touch, where poses are exact: what rests on something is pressed into it a little, and what
bounces is above it by micrometres at times. Of the order of what a distance may be off by."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A rigid thing where it is.

    Attributes:
        parts: its convex parts, in the world frame.
        rotation: the axes of its body as columns, (3, 3), in the world frame.
        position: the origin of its body, (3,) in m, world frame.
        centre: its centre of mass, (3,) in m, world frame.
    """

    parts: tuple[Part, ...]
    rotation: FloatArray
    position: FloatArray
    centre: FloatArray

    @classmethod
    def box(cls, centre: FloatArray, half: FloatArray, rotation: FloatArray | None = None) -> Solid:
        """Return a box of half extents `half` (3,) around `centre` (3,), in m."""
        turned = np.eye(3) if rotation is None else rotation
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        return cls((Part(corners @ turned.T + centre),), turned, np.asarray(centre), np.asarray(centre))

    def moved(self, rotation: FloatArray, translation: FloatArray) -> Solid:
        """Return the solid after a turn (3, 3) about the world's origin and a translation (3,) in m."""
        parts = tuple(Part(part.corners @ rotation.T + translation, part.radius) for part in self.parts)
        return Solid(
            parts,
            rotation @ self.rotation,
            rotation @ self.position + translation,
            rotation @ self.centre + translation,
        )

    def beside(self, point: FloatArray) -> float:
        """Return how far a point (3,) is from the rectangle that the solid fills along its own x and y axes: 0 over or
        under it, in m."""
        local = np.concatenate([(part.corners - self.position) @ self.rotation[:, :2] for part in self.parts])
        at = (point - self.position) @ self.rotation[:, :2]
        return float(np.linalg.norm(np.maximum(np.maximum(local.min(axis=0) - at, at - local.max(axis=0)), 0.0)))


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle of a table's top: where its middle is from the table's, and half its extent, (2,) each in m along the
    table's own x and y."""

    table: str
    centre: tuple[float, float]
    half: tuple[float, float]

    def holds(self, point: FloatArray, table: Solid) -> bool:
        """Return whether a point (3,) is over the region."""
        local = (point - table.position) @ table.rotation[:, :2]
        return bool((np.abs(local - self.centre) <= self.half).all())


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is where.

    Attributes:
        items, tables, regions: by name. The floors of containers and of drawers are tables, too.
        fingers: the left and the right one.
        feels: whether the fingers feel something between them.
        others: things that are there and of which nothing else is known.
        tolerance: m within which two solids touch.
        openings: how far each drawer is open, as a share of its travel.
    """

    items: Mapping[str, Solid]
    tables: Mapping[str, Solid]
    fingers: tuple[Solid, Solid]
    feels: bool
    others: Sequence[Solid] = ()
    tolerance: float = CONTACT
    regions: Mapping[str, Region] = field(default_factory=lambda: MappingProxyType({}))
    openings: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    _told: dict[tuple[int, int], tuple[bool, Solid, Solid]] = field(default_factory=dict, init=False, repr=False)
    """What was found to touch, with what keeps the numbers that it is filed under from being given away."""

    def touch(self, one: Solid, other: Solid) -> bool:
        """Return whether two solids touch, to within the tolerance."""
        key = (min(id(one), id(other)), max(id(one), id(other)))
        if key not in self._told:
            near = any(convex.within(first, second, self.tolerance) for first in one.parts for second in other.parts)
            self._told[key] = near, one, other
        return self._told[key][0]

    def supports(self, item: str) -> list[str]:
        """Return the tables that carry an item: those that it touches, and those that anything touches which it rests
        on or leans at, directly or not. Sorted."""
        start = self.items[item]
        every = [*self.items.values(), *self.others]
        reached, frontier = [start], [start]
        while frontier:
            here = frontier.pop()
            beside = [
                other for other in every if all(other is not each for each in reached) and self.touch(here, other)
            ]
            reached += beside
            frontier += beside
        return sorted(name for name, table in self.tables.items() if any(self.touch(each, table) for each in reached))

    def carrier(self, item: str) -> str | None:
        """Return the item or table that carries an item itself: of those that it touches and that it is above the
        middle of, the one whose centre is nearest beside its own. None where it is on nothing."""
        here = self.items[item]
        lowest = min(float(part.bounds[0][2]) for part in here.parts)
        below = {
            name: float(np.hypot(*(other.centre - here.centre)[:2]))
            if name in self.items
            else other.beside(here.centre)
            for name, other in {**self.tables, **self.items}.items()
            if name != item and lowest > other.centre[2] and self.touch(here, other)
        }
        return min(sorted(below), key=below.__getitem__, default=None)


Relation = Callable[..., bool]
"""A relation: a function of a scene and of the names of things in it."""
