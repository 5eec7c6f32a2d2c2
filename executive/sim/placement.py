"""Where items are put: upright, at random, apart, on a table or the floor of a drawer or container, and within the
robot's reach."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from executive.errors import DomainError, nearest
from executive.sim import footprint
from executive.sim.fixtures import Floor
from executive.sim.scene import ItemShape
from executive.sim.spec import RegionSpec, SceneSpec, TableSpec
from executive.types import FloatArray

Place = TableSpec | Floor
"""What an item can be put on."""

_ROUNDS, _TRIES = 200, 60
"""How often it is begun anew to find places by real outlines, and how many spots are tried for each item."""

_RASTER = np.linspace(-1.0, 1.0, 41)
"""Where it is looked on a table for a place within reach: shares of what is free along either axis."""


def draw(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    placed: Mapping[str, str],
    rng: np.random.Generator,
    file: Path,
    barred: Mapping[str, Collection[str]] = MappingProxyType({}),
    stacked: Mapping[str, str] = MappingProxyType({}),
    regions: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, FloatArray]:
    """A pose (7,) for every item. `placed` fixes the table, drawer or container of some, `barred` says where some do
    not stand, `stacked` which item some stand on, and `regions` in which region some are; the rest are on any table or
    in any drawer.

    Items are kept apart by the circles around them, which is quick; where no place is found so, by their outlines.

    Raises:
        DomainError: an item is declared to stand where there is no table, is too large for the tables that it may stand
            on, these are out of the arm's reach, or no room was found.
    """
    if stacked or regions:
        return _draw_towers(spec, shapes, placed, rng, file, barred, stacked, regions)
    for item, table in placed.items():
        if table not in (known := places(spec)):
            raise DomainError(
                f"{item} is declared to be on {table!r}, which is no table; {nearest(table, known)}", file=file
            )
    for _ in range(50):
        poses: dict[str, FloatArray] = {}
        # Items with a fixed table first: they have the least choice.
        for item in sorted(shapes, key=lambda name: name not in placed):
            found = free_spot(spec, shapes, item, poses, rng, placed.get(item), barred.get(item, ()))
            if found is None:
                break
            poses[item] = found[1]
        else:
            return {item: poses[item] for item in shapes}
    return _draw_by_outlines(spec, shapes, placed, rng, file, barred)


def _draw_towers(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    placed: Mapping[str, str],
    rng: np.random.Generator,
    file: Path,
    barred: Mapping[str, Collection[str]],
    stacked: Mapping[str, str],
    regions: Mapping[str, str],
) -> dict[str, FloatArray]:
    """What `draw` draws where some items stand on others, or in regions: the lowest item of each tower with room for
    the widest, those in regions first, and the others upon it, centred."""
    tables, where = places(spec), {region.name: region for region in spec.regions}
    towers = {item: [item] for item in shapes if item not in stacked}
    for item in shapes:
        base = item
        while base in stacked:
            base = stacked[base]
        if base in towers and base != item:
            towers[base].append(item)
    widest = {base: max((shapes[item] for item in tower), key=circle) for base, tower in towers.items()}
    region_of = {base: next((regions[i] for i in tower if i in regions), None) for base, tower in towers.items()}
    tops: dict[str, float] = {}
    for _ in range(_ROUNDS):
        poses: dict[str, FloatArray] = {}
        for base in sorted(towers, key=lambda base: (region_of[base] is None, base not in placed)):
            region = region_of[base]
            if region is None:
                found = free_spot(spec, widest, base, poses, rng, placed.get(base), barred.get(base, ()))
            else:
                found = _spot_in(spec, where[region], widest, base, poses, rng)
            if found is None:
                break
            table = tables[found[0]]
            poses[base] = upright(shapes[base], found[1][:2], table, float(rng.uniform(-np.pi, np.pi)))
            tops[base] = table.centre[2] + 2 * float(shapes[base].half[2])
        else:
            break
    else:
        raise DomainError(
            f"no room was found for {', '.join(towers)}: widen tables or regions, or lower the gap",
            file=file,
            key="placement.gap",
        )
    while len(poses) < len(shapes):
        for item, base in stacked.items():
            if item not in poses and base in poses:
                at = poses[base][:2]
                poses[item] = standing_at(shapes[item], at, tops[base], float(rng.uniform(-np.pi, np.pi)))
                tops[item] = tops[base] + 2 * float(shapes[item].half[2])
    return {item: poses[item] for item in shapes}


def _spot_in(
    spec: SceneSpec,
    region: RegionSpec,
    shapes: Mapping[str, ItemShape],
    item: str,
    others: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> tuple[str, FloatArray] | None:
    """A random place in a region for an item, apart from all others, or None."""
    table = next(table for table in spec.tables if table.name == region.table)
    radius = circle(shapes[item])
    free = np.maximum(0.5 * np.asarray(region.size) - radius, 0.0)
    for _ in range(_TRIES):
        spot = _on(table, np.asarray(region.centre) + rng.uniform(-1.0, 1.0, 2) * free)
        apart = (
            np.hypot(*(pose[:2] - spot)) >= radius + circle(shapes[name]) + spec.placement.gap
            for name, pose in others.items()
        )
        if _within_reach(spec, table, spot) and all(apart):
            return table.name, spot
    return None


def _draw_by_outlines(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    placed: Mapping[str, str],
    rng: np.random.Generator,
    file: Path,
    barred: Mapping[str, Collection[str]],
) -> dict[str, FloatArray]:
    """What `draw` draws where circles are too wide; or what is wrong: their size, their reach, or the room."""
    allowed = {
        item: tuple(
            table
            for table in among(spec, placed.get(item))
            if placed.get(item, table.name) == table.name and table.name not in barred.get(item, ())
        )
        for item in shapes
    }
    for item, shape in shapes.items():
        allowed[item] = _standable(spec, shape, allowed[item], file)
    largest_first = sorted(shapes, key=lambda item: (len(allowed[item]), -float(np.prod(shapes[item].half[:2]))))
    for _ in range(_ROUNDS):
        poses: dict[str, FloatArray] = {}
        there: list[footprint.Placed] = []
        for item in largest_first:
            outline = footprint.standing(shapes[item])
            clear = spec.placement.gap + float(np.hypot(outline.x, outline.y))
            for _ in range(_TRIES):
                table = allowed[item][int(rng.integers(len(allowed[item])))]
                yaw = float(rng.uniform(-np.pi, np.pi))
                free = _free_half(spec, outline, table, yaw)
                spot = _on(table, rng.uniform(-1.0, 1.0, 2) * free)
                here = footprint.Placed(outline, spot, yaw)
                if (
                    (free > 0).all()
                    and _within_reach(spec, table, spot)
                    and _apart_from_fixtures(spec, table, spot, clear)
                    and all(here.apart(other) >= spec.placement.gap for other in there)
                ):
                    poses[item] = upright(shapes[item], spot, table, yaw)
                    there.append(here)
                    break
            else:
                break
        else:
            return {item: poses[item] for item in shapes}
    names = sorted({table.name for item in shapes for table in allowed[item]})
    raise DomainError(
        f"no room was found for {', '.join(shapes)} on {', '.join(names)}: widen the tables or lower the gap "
        "(places are drawn by chance: where it is close, another seed may find some)",
        file=file,
        key="placement.gap",
    )


def _standable(spec: SceneSpec, shape: ItemShape, tables: tuple[Place, ...], file: Path) -> tuple[Place, ...]:
    """Those of the tables on which an item could stand if it were alone.

    Raises:
        DomainError: there are none, and whether for the item's size or for the arm's reach.
    """
    outline, margin = footprint.standing(shape), spec.placement.margin
    large = [table for table in tables if outline.fits(table, margin) and _is_low(shape, table)]
    if not large:
        sizes = " or ".join(f"{table.name}, {footprint.top(table)}" for table in tables)
        raise DomainError(
            f"{shape.name}, {outline}, does not fit on {sizes}, with a margin of {100 * margin:g} cm: make it smaller, "
            "or the table larger",
            file=file,
            key="table",
        )
    reachable = tuple(table for table in large if _somewhere_within_reach(spec, outline, table))
    if not reachable:
        near, far = spec.robot.reach
        names = " or ".join(table.name for table in large)
        raise DomainError(
            f"{shape.name} could stand on {names} only out of reach, which is {near:g} to {far:g} m from the robot",
            file=file,
            key="robot.reach",
        )
    return reachable


def _is_low(shape: ItemShape, place: Place) -> bool:
    """Whether an item that stands upright fits under what closes a place from above."""
    return not isinstance(place, Floor) or 2.0 * float(shape.half[2]) <= place.room


def _somewhere_within_reach(spec: SceneSpec, outline: footprint.Outline, table: Place) -> bool:
    across, along = np.meshgrid(_RASTER, _RASTER)
    shares = np.stack([across.ravel(), along.ravel()], axis=-1)
    for yaw in np.linspace(0.0, np.pi, 37):
        free = _free_half(spec, outline, table, table.yaw + float(yaw))
        if (free > 0).all() and any(_within_reach(spec, table, _on(table, share * free)) for share in shares):
            return True
    return False


def places(spec: SceneSpec) -> dict[str, Place]:
    """Everything that items can be put on, by name; drawers are as far open as the scene says."""
    return {**{table.name: table for table in spec.tables}, **spec.floors}


def among(spec: SceneSpec, named: str | None) -> tuple[Place, ...]:
    """Where an item may be put: on any table and in any drawer; in a container only if that is `named`."""
    every = places(spec)
    return tuple(each for name, each in every.items() if name == named or spec.kinds[name] != "container")


def _within_reach(spec: SceneSpec, place: Place, spot: FloatArray) -> bool:
    """Whether the arm reaches a spot (2,); in a drawer, once that is open."""
    near, far = spec.robot.reach
    drawer = next((drawer for drawer in spec.drawers if drawer.name == place.name), None)
    if drawer is not None:
        spot = spot + (1.0 - drawer.open) * drawer.stroke * drawer.axis[:2]
    return near <= float(np.hypot(spot[0] - spec.robot.position[0], spot[1] - spec.robot.position[1])) <= far


def _apart_from_fixtures(spec: SceneSpec, place: Place, spot: FloatArray, distance: float) -> bool:
    """Whether a spot (2,) of a table keeps a distance in m from containers, and from drawers wherever they slide."""
    if isinstance(place, Floor):
        return True
    return all(each.beside(spot) >= distance for each in spec.covered)


def has_room(spec: SceneSpec, shape: ItemShape, place: Place, spot: FloatArray, tipped: bool) -> bool:
    """Whether an item, upright or lying in any way, is under nothing at a spot (2,) of a place, nor inside a drawer's
    case or a container's walls."""
    if tipped and isinstance(place, Floor):
        return 2.0 * float(np.linalg.norm(shape.half)) <= place.room
    return _is_low(shape, place) and _apart_from_fixtures(spec, place, spot, circle(shape))


def _free_half(spec: SceneSpec, outline: footprint.Outline, table: Place, yaw: float) -> FloatArray:
    """Half the extents (2,) of where on a table, along its axes, the centre of an outline turned by `yaw` may be."""
    return 0.5 * np.asarray(table.size[:2]) - spec.placement.margin - outline.extent(yaw - table.yaw)


def free_spot(
    spec: SceneSpec,
    shapes: Mapping[str, ItemShape],
    item: str,
    others: Mapping[str, FloatArray],
    rng: np.random.Generator,
    table: str | None = None,
    barred: Collection[str] = (),
    gap: float | None = None,
) -> tuple[str, FloatArray] | None:
    """A random upright pose for one item that keeps its distance from all others, the scene's or another one: (table,
    pose), or None."""
    shape, gap = shapes[item], spec.placement.gap if gap is None else gap
    radius = circle(shape)
    choice = among(spec, table)
    for _ in range(200):
        top = choice[int(rng.integers(len(choice)))]
        yaw = float(rng.uniform(-np.pi, np.pi))
        spot = random_point(top, radius + spec.placement.margin, rng)
        if spot is None or (table is not None and top.name != table) or top.name in barred or not _is_low(shape, top):
            continue
        if not _within_reach(spec, top, spot) or not _apart_from_fixtures(spec, top, spot, radius + spec.placement.gap):
            continue
        apart = (np.hypot(*(pose[:2] - spot)) >= radius + circle(shapes[other]) + gap for other, pose in others.items())
        if all(apart):
            return top.name, upright(shape, spot, top, yaw)
    return None


def circle(shape: ItemShape) -> float:
    """Radius in m of the circle around an upright item's outline."""
    return float(shape.half[0] if shape.axis == 2 or shape.is_ball else np.hypot(shape.half[0], shape.half[1]))


def random_point(table: Place, inset: float, rng: np.random.Generator) -> FloatArray | None:
    """A uniformly random point (2,) of the table's top, `inset` from every edge; None when nothing is left."""
    half = 0.5 * np.asarray(table.size[:2]) - inset
    local = rng.uniform(-1.0, 1.0, 2) * half
    return None if (half <= 0).any() else _on(table, local)


def random_point_in(region: RegionSpec, table: Place, rng: np.random.Generator) -> FloatArray:
    """A uniformly random point (2,) of a region of the table."""
    return _on(table, np.asarray(region.centre) + rng.uniform(-0.5, 0.5, 2) * np.asarray(region.size))


def _on(table: Place, local: FloatArray) -> FloatArray:
    """The point (2,) in the world of a point (2,) of a table's top in its own frame."""
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    return np.array(
        [table.centre[0] + cos * local[0] - sin * local[1], table.centre[1] + sin * local[0] + cos * local[1]]
    )


def upright(shape: ItemShape, spot: FloatArray, table: Place, yaw: float) -> FloatArray:
    """The pose (7,) of an item that stands on the table with the centre of its outline at `spot`."""
    return standing_at(shape, spot, table.centre[2], yaw)


def standing_at(shape: ItemShape, spot: FloatArray, height: float, yaw: float) -> FloatArray:
    """The pose (7,) of an item that stands upright at a `height` in m with the centre of its outline at `spot` (2,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = spot[0] - (cos * shape.centre[0] - sin * shape.centre[1])
    y = spot[1] - (sin * shape.centre[0] + cos * shape.centre[1])
    z = height + shape.half[2] - shape.centre[2] + 0.001
    return np.array([x, y, z, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
