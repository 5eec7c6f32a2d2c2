"""Where items are put: upright, at random, apart, on a table and within the robot's reach."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from executive.errors import DomainError, nearest
from executive.sim.scene import ItemShape
from executive.sim.spec import SceneSpec, TableSpec
from executive.types import FloatArray


def draw(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    placed: Mapping[str, str],
    rng: np.random.Generator,
    file: Path,
) -> dict[str, FloatArray]:
    """A pose (7,) for every item. `placed` fixes the table of some; the rest stand on any.

    Raises:
        DomainError: an item is declared to stand where there is no table, or the items do not fit.
    """
    tables = [table.name for table in spec.tables]
    for item, table in placed.items():
        if table not in tables:
            raise DomainError(
                f"{item} is declared to be on {table!r}, which is no table; {nearest(table, tables)}", file=file
            )
    for _ in range(50):
        poses: dict[str, FloatArray] = {}
        # Items with a fixed table first: they have the least choice.
        for item in sorted(shapes, key=lambda name: name not in placed):
            found = free_spot(spec, shapes, item, poses, rng, placed.get(item))
            if found is None:
                break
            poses[item] = found[1]
        else:
            return {item: poses[item] for item in shapes}
    raise DomainError("the items do not fit on the tables: widen them or lower the gap", file=file, key="placement.gap")


def free_spot(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    item: str,
    others: Mapping[str, FloatArray],
    rng: np.random.Generator,
    table: str | None = None,
) -> tuple[str, FloatArray] | None:
    """A random upright pose for one item that keeps its distance from all others: (table, pose), or None."""
    shape = shapes[item]
    radius = footprint(shape)
    nearest_reach, farthest_reach = spec.robot.reach
    for _ in range(200):
        top = spec.tables[int(rng.integers(len(spec.tables)))]
        yaw = float(rng.uniform(-np.pi, np.pi))
        spot = random_point(top, radius + spec.placement.margin, rng)
        if spot is None or (table is not None and top.name != table):
            continue
        distance = float(np.hypot(spot[0] - spec.robot.position[0], spot[1] - spec.robot.position[1]))
        if not nearest_reach <= distance <= farthest_reach:
            continue
        apart = (
            np.hypot(*(pose[:2] - spot)) >= radius + footprint(shapes[other]) + spec.placement.gap
            for other, pose in others.items()
        )
        if all(apart):
            return top.name, upright(shape, spot, top, yaw)
    return None


def footprint(shape: ItemShape) -> float:
    """Radius in m of the circle around an upright item's outline."""
    return float(shape.half[0] if shape.axis == 2 else np.hypot(shape.half[0], shape.half[1]))


def random_point(table: TableSpec, inset: float, rng: np.random.Generator) -> FloatArray | None:
    """A uniformly random point (2,) of the table's top, `inset` from every edge; None when nothing is left."""
    half = 0.5 * np.asarray(table.size[:2]) - inset
    local = rng.uniform(-1.0, 1.0, 2) * half
    if (half <= 0).any():
        return None
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    return np.array(
        [table.centre[0] + cos * local[0] - sin * local[1], table.centre[1] + sin * local[0] + cos * local[1]]
    )


def upright(shape: ItemShape, spot: FloatArray, table: TableSpec, yaw: float) -> FloatArray:
    """The pose (7,) of an item that stands on the table with the centre of its outline at `spot`."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = spot[0] - (cos * shape.centre[0] - sin * shape.centre[1])
    y = spot[1] - (sin * shape.centre[0] + cos * shape.centre[1])
    z = table.centre[2] + shape.half[2] - shape.centre[2] + 0.001
    return np.array([x, y, z, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
