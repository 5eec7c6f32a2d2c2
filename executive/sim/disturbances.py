"""Disturbances of the simulated world: the gripper opens, an item is moved, taken, swapped, tipped over or pushed off,
a tower is toppled, boxes are put on a table, or a drawer is stuck or rolls shut. No item is taken out of the gripper,
and none is put where it touches the arm.

The boxes for blocking a table, and items that were taken away, are kept on the floor behind all cameras.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import product
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from executive.errors import InputError, nearest
from executive.sim import placement, scene
from executive.sim.spec import ItemSpec, SceneSpec, TableSpec
from executive.types import FloatArray

if TYPE_CHECKING:
    from executive.sim.world import MujocoWorld

BOXES = 16
"""The number of boxes that block an empty table, four by four."""

_BOX_HEIGHT = 0.16
"""m; a gripper that holds an item by its top cannot pass over them."""

_BOX_ROOM = 0.01
"""m of clearance per box in a row of four on a table."""

_GRID = 0.02
"""m between the candidate positions of boxes on a table."""

_ASIDE = 4.0
"""m between the robot and the objects that are kept aside, which are 0.4 m apart."""

_LIFTS, _ASIDES = (0.14, 0.28), (0.18, 0.30)
"""m by which things are lifted that someone carries in view, and go round the middle of their way on the side away from
the robot: one, and another at the same time."""

_TRIES, _CLOSE = 20, -0.02
"""How often a place is looked for, and m by which the circles around things overlap where they are put close together:
whether they touch is looked at."""

_SLIP_ANGLE = (0.2, 0.5)
_SLIP_WAY = (0.002, 0.008)
"""How far, in rad about the axis from pad to pad and in m out of the hand, an item slips in the grip."""

_MOST_PENETRATION = 0.004
"""The largest penetration in m of an item that slipped; the fingers give way."""


def boxes(spec: SceneSpec, blockings: int) -> tuple[ItemSpec, ...]:
    """The boxes for a number of blockings of a table."""
    names = {item.name for item in spec.items} | {table.name for table in spec.tables}
    free = (name for number in range(1, 10**6) if (name := f"box-{number}") not in names)
    across, along = (min(table.size[axis] for table in spec.tables) / 4 - _BOX_ROOM for axis in (0, 1))
    size = (max(0.02, across), max(0.02, along), _BOX_HEIGHT)
    return tuple(
        ItemSpec(name=next(free), shape="box", size=size, rgba=(0.55, 0.45, 0.35, 1.0), mass=1.0)
        for _ in range(BOXES * blockings)
    )


def aside(spec: SceneSpec, number: int, height: float) -> FloatArray:
    """The pose (7,) of the `number`-th object that is kept aside: behind all cameras, `height` m above the floor."""
    away = sum((np.subtract(camera.position, camera.target)[:2] for camera in spec.cameras), np.zeros(2))
    away = away / np.linalg.norm(away) if np.linalg.norm(away) > 1e-6 else np.array([1.0, 0.0])
    spot = np.asarray(spec.robot.position[:2]) + (_ASIDE + 0.4 * number) * away
    return np.array([*spot, height, 1.0, 0.0, 0.0, 0.0])


def disturb(world: MujocoWorld, kind: str, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    """Applies a disturbance now, and returns a text of what was done; see `executive.protocols.Simulator`.

    Raises:
        InputError: no such kind, or an argument names nothing that there is.
    """
    if kind not in _DISTURBANCES:
        raise InputError(f"this world cannot be disturbed by {kind!r}; {nearest(kind, _DISTURBANCES)}")
    for key in ("item", "with"):
        if key in arguments and arguments[key] not in world.items:
            raise InputError(f"no item {arguments[key]!r} to {kind}; {nearest(arguments[key], world.items)}")
    for key, known in (("table", world.places()), ("drawer", world.drawers.specs)):
        if key in arguments and arguments[key] not in known:
            raise InputError(f"no {key} {arguments[key]!r}; {nearest(arguments[key], known)}")
    done = _DISTURBANCES[kind](world, rng, arguments)
    mujoco.mj_forward(world.model, world.data)
    return done


def _drop(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    world.force_open(1.0)
    return "the gripper opened by itself"


def _miss(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    direction = rng.uniform(-np.pi, np.pi)
    world.mislead(0.075 * np.array([np.cos(direction), np.sin(direction), 0.0]))
    return "the next grasp is aimed 75 mm beside the item"


def _slip(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    item = world.gripped()
    if item is None:
        return "nothing slipped: the hand is empty"
    hand = world.data.site(scene.GRIP_SITE)
    centre, (closing, _, out) = np.array(hand.xpos), np.array(hand.xmat).reshape(3, 3).T
    before = world.pose(item)
    for _ in range(_TRIES):
        angle = rng.uniform(*_SLIP_ANGLE) * rng.choice([-1.0, 1.0])
        way = rng.uniform(*_SLIP_WAY)
        turn, turned, moved = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_axisAngle2Quat(turn, closing, angle)
        mujoco.mju_mulQuat(turned, turn, before[3:])
        mujoco.mju_rotVecQuat(moved, before[:3] - centre, turn)
        _place(world, item, np.array([*(centre + moved + way * out), *turned]))
        if _penetration(world, item) < _MOST_PENETRATION:
            degrees = abs(math.degrees(angle))
            return f"{item} turned by {degrees:.0f} degrees and slid {1000 * way:.0f} mm in the grip"
    _place(world, item, before)
    return f"{item} was to slip, but is held all around"


def _shove(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    item = _loose(world, rng, arguments.get("item"))
    if item is None:
        return "nothing was shoved: the robot holds it"
    before, others = world.pose(item), {name: pose for name, pose in world.poses().items() if name != item}
    spec, gap = world.spec_now(), None
    for _ in range(_TRIES):
        found = placement.free_spot(spec, world.shapes, item, others, rng, arguments.get("table"), gap=gap)
        if found is None and gap is None:  # whoever moves things puts them closer together
            gap = _CLOSE
            continue
        if found is None:
            break
        table, pose = found
        if _put(world, item, pose, table):
            _carry(world, {item: before}, arguments)
            world.settle(0.3)
            return f"someone moved {item} {'into' if table in world.drawers.specs else 'to'} {table}"
    _place(world, item, before)
    return f"{item} was to be moved, but no table has room"


def _take(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    item = _loose(world, rng, arguments.get("item"))
    if item is None:
        return "nothing was taken: the robot holds it"
    shape, waiting = world.shapes[item], len(world.boxes) + sorted(world.items).index(item)
    _place(world, item, aside(world.spec, waiting, float(shape.half[2] - shape.centre[2]) + 0.001))
    return f"someone took {item} away"


def _swap(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    one = _loose(world, rng, arguments.get("item"), besides=arguments.get("with"))
    other = None if one is None else _loose(world, rng, arguments.get("with"), besides=one)
    if one is None or other is None:
        return f"nothing was swapped: {'the robot holds one of them' if len(world.items) > 1 else 'there is one item'}"
    poses = {item: world.pose(item) for item in (one, other)}
    if any(_neighbours(world, item) for item in (one, other)):
        return _swap_in_towers(world, one, other)
    under_one, under_other = _under(world, one), _under(world, other)
    if under_one is None or under_other is None:
        return f"{one} and {other} were not swapped: one of them is on no table"
    there = aside(world.spec, len(world.boxes) + len(world.items), 0.5)
    _place(world, one, there)  # out of the other's way
    for _ in range(_TRIES):
        yaw, way = rng.uniform(-np.pi, np.pi, 2)
        for_other = placement.upright(world.shapes[other], poses[one][:2], under_one, float(yaw))
        for_one = placement.upright(world.shapes[one], poses[other][:2], under_other, float(way))
        if _put(world, other, for_other, under_one.name) and _put(world, one, for_one, under_other.name):
            _carry(world, poses, arguments)
            world.settle(0.3)
            return f"someone swapped {one} and {other}"
        _place(world, one, there)
    for item, pose in poses.items():
        _place(world, item, pose)
    return f"{one} and {other} were to be swapped, but do not fit"


def _neighbours(world: MujocoWorld, item: str) -> set[str]:
    """The items that touch an item."""
    return world.touched_by(item) & set(world.items)


def _swap_in_towers(world: MujocoWorld, one: str, other: str) -> str:
    """Each stands in the other's place, whatever is under or on it; what is on it stays on top."""
    above = {item: _all_upon(world, item) for item in (one, other)}
    if one in above[other] or other in above[one]:
        return f"{one} and {other} were not swapped: one stands on the other"
    places = {item: (world.pose(item)[:2], _top(world, item) - 2 * _height(world, item)) for item in (one, other)}
    for item, partner in ((one, other), (other, one)):
        rise = 2 * (float(world.shapes[item].half[2]) - _height(world, partner))
        for rider in above[partner]:
            _place(world, rider, world.pose(rider) + np.array([0.0, 0.0, rise, 0.0, 0.0, 0.0, 0.0]))
    for item, partner in ((one, other), (other, one)):
        _place(world, item, placement.standing_at(world.shapes[item], *places[partner], 0.0))
    world.settle(0.6)
    return f"someone swapped {one} and {other}"


def _tip(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    item = _loose(world, rng, arguments.get("item"))
    if item is None:
        return "nothing was tipped over: the robot holds it"
    table, before, shape = _under(world, item), world.pose(item), world.shapes[item]
    if table is None:
        return f"{item} was not tipped over: it is on no table"
    start = rng.uniform(-np.pi, np.pi)
    for step in range(_TRIES):
        angle = start + 2 * np.pi * step / _TRIES
        quarter, turned, middle = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_axisAngle2Quat(quarter, np.array([np.cos(angle), np.sin(angle), 0.0]), 0.5 * np.pi)
        mujoco.mju_mulQuat(turned, quarter, before[3:])
        mujoco.mju_rotVecQuat(middle, shape.centre, turned)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, turned)
        height = table.centre[2] + shape.reach(rotation.reshape(3, 3).T @ np.array([0.0, 0.0, 1.0])) + 0.002
        spot = np.array([*before[:2], height]) - middle
        if _put(world, item, np.array([*spot, *turned]), table.name):
            world.settle(0.5)
            return f"{item} was tipped over"
    _place(world, item, before)
    return f"{item} was to be tipped over, but has no room to lie"


_TOPPLED = 0.7
"""m/s that everything above the foot of a toppled tower is given."""


def _topple(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    above = {item: upon for item in world.items if (upon := _upon(world, item)) and item != world.gripped()}
    if (foot := arguments.get("item")) is None and above:
        foot = sorted(above)[int(rng.integers(len(above)))]
    if foot is None or foot not in above:
        return "nothing was toppled: nothing stands on " + ("anything" if foot is None else foot)
    heading = rng.uniform(-np.pi, np.pi)
    push, before = _TOPPLED * np.array([np.cos(heading), np.sin(heading)]), world.pose(above[foot])
    for _ in range(_TRIES):
        for rider in _all_upon(world, foot):
            dof = world.model.joint(f"{rider}/free").dofadr[0]
            world.data.qvel[dof : dof + 2] = push
        world.settle(0.5)
        if world.pose(above[foot])[2] < before[2] - 0.01:
            world.settle(1.0)
            return f"someone toppled what stood on {foot}"
    return f"what stands on {foot} was to be toppled, but stands"


def _all_upon(world: MujocoWorld, item: str) -> list[str]:
    """What rests on an item, and on that, from the lowest on."""
    found: list[str] = []
    while (upon := _upon(world, found[-1] if found else item)) is not None and upon not in found:
        found.append(upon)
    return found


def _upon(world: MujocoWorld, item: str) -> str | None:
    """What rests on an item: one that touches it and whose middle is above its top."""
    top = _top(world, item)
    return next((other for other in sorted(_neighbours(world, item)) if world.pose(other)[2] > top), None)


def _top(world: MujocoWorld, item: str) -> float:
    """How high in m an item reaches."""
    pose, rotation = world.pose(item), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, pose[3:])
    middle = pose[:3] + rotation.reshape(3, 3) @ world.shapes[item].centre
    return float(middle[2]) + _height(world, item)


def _height(world: MujocoWorld, item: str) -> float:
    """Half of how high in m an item is as it stands or lies."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, world.pose(item)[3:])
    return world.shapes[item].reach(rotation.reshape(3, 3).T @ np.array([0.0, 0.0, 1.0]))


def _push(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    item = _loose(world, rng, arguments.get("item"))
    if item is None:
        return "nothing was pushed: the robot holds it"
    table, shape = _under(world, item), world.shapes[item]
    if not isinstance(table, TableSpec):
        return f"{item} was not pushed: it is on no table"
    here, robot = world.pose(item), np.asarray(world.spec.robot.position[:2])
    away = np.asarray(table.centre[:2]) - robot
    away /= np.linalg.norm(away)
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    axes = [np.array([cos, sin]), np.array([-sin, cos])]
    axis = max((sign * axis for axis in axes for sign in (1.0, -1.0)), key=lambda axis: float(axis @ away))
    half = 0.5 * float(table.size[0] if abs(axis @ axes[0]) > 0.5 else table.size[1])
    beyond = half - float((here[:2] - np.asarray(table.centre[:2])) @ axis) + placement.circle(shape) + 0.03
    here[:2] += beyond * axis
    _place(world, item, here)
    world.settle(1.0)
    return f"{item} was pushed off {table.name}"


def _block(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    tables = {table.name: table for table in world.spec.tables}
    if arguments.get("table", "") not in ("", *tables):
        return f"{arguments['table']} was not blocked: boxes are put on tables"
    table = tables[arguments.get("table") or str(rng.choice(sorted(tables)))]
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    waiting = [name for name in world.boxes if world.pose(name)[2] < _BOX_HEIGHT]
    put = 0
    for x, y in _grid(table, world.shapes[waiting[0]].half) if waiting else ():
        if put == len(waiting):
            break
        spot = np.array([table.centre[0] + cos * x - sin * y, table.centre[1] + sin * x + cos * y])
        box, before = waiting[put], world.pose(waiting[put])
        if _put(world, box, placement.upright(world.shapes[box], spot, table, table.yaw), table.name):
            put += 1
        else:
            _place(world, box, before)
    if not put:
        return f"{table.name} was to be blocked, but {'has no room' if waiting else 'no boxes are left'}"
    world.settle(0.2)
    return f"someone put {put} {'box' if put == 1 else 'boxes'} on {table.name}"


_JAMMED, _ROLL = 12.0, 3.0
"""Seconds for which a drawer is stuck, and for which one rolls at most."""


def _jam(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    drawer = next((name for name in arguments.get("about", "").split() if name in world.drawers.specs), None)
    if (drawer := arguments.get("drawer", drawer)) is None:
        return "nothing jammed: the action is about no drawer"
    seconds = float(arguments.get("seconds", _JAMMED))
    world.drawers.jam(drawer, world.time + seconds)
    return f"{drawer} is stuck for {seconds:g} s"


def _roll(world: MujocoWorld, rng: np.random.Generator, arguments: Mapping[str, str]) -> str:
    opened = [name for name in sorted(world.drawers.specs) if world.drawers.opening(name) > _AJAR]
    drawer = arguments.get("drawer") or (opened[int(rng.integers(len(opened)))] if opened else None)
    if drawer is None or drawer not in opened:
        return "no drawer rolled shut: none is open" if drawer is None else f"{drawer} did not roll: it is not open"
    world.drawers.roll(drawer, shut=True)
    end = world.time + _ROLL
    while world.time < end and world.drawers.opening(drawer) > _AJAR:
        world.advance()
    world.drawers.roll(drawer, shut=False)
    world.settle(0.2)
    return f"{drawer} rolled shut" if world.drawers.opening(drawer) <= _AJAR else f"{drawer} rolled, and was stopped"


_AJAR = 0.002
"""m up to which a drawer counts as shut."""

_DISTURBANCES: Mapping[str, Callable[[MujocoWorld, np.random.Generator, Mapping[str, str]], str]] = {
    "drop": _drop,
    "miss": _miss,
    "slip": _slip,
    "shove": _shove,
    "take": _take,
    "swap": _swap,
    "tip": _tip,
    "topple": _topple,
    "push": _push,
    "block": _block,
    "jam": _jam,
    "roll": _roll,
}


def _grid(table: TableSpec, half: FloatArray) -> list[tuple[float, float]]:
    """Positions on a table, in its own frame, at which a box with half extents `half` is on its top: those of as many
    as fit beside each other, and then a grid for where things are in the way."""
    rooms = [0.5 * size - float(extent) for size, extent in zip(table.size[:2], half[:2], strict=True)]
    counts = [int(size // (2.0 * float(extent))) for size, extent in zip(table.size[:2], half[:2], strict=True)]
    packed = product(*(np.linspace(-room, room, count) for room, count in zip(rooms, counts, strict=True)))
    between = product(*(np.arange(-room, room + 1e-9, _GRID) for room in rooms))
    return [(float(x), float(y)) for x, y in (*packed, *between)]


def _loose(world: MujocoWorld, rng: np.random.Generator, item: str | None, besides: str | None = None) -> str | None:
    """The named item, or one drawn at random; None if the gripper holds it."""
    gripped = world.gripped()
    loose = [name for name in world.items if name not in (gripped, besides)]
    if item is None and loose:
        return loose[int(rng.integers(len(loose)))]
    return None if item == gripped else item


def _under(world: MujocoWorld, item: str) -> placement.Place | None:
    """The table under an item, or the floor of the drawer or container that it is in, by its position."""
    pose, shape = world.pose(item), world.shapes[item]
    for table in sorted(world.places().values(), key=lambda place: isinstance(place, TableSpec)):  # the uppermost first
        cos, sin = np.cos(table.yaw), np.sin(table.yaw)
        x, y = pose[:2] - np.asarray(table.centre[:2])
        inside = abs(cos * x + sin * y) <= 0.5 * table.size[0] and abs(cos * y - sin * x) <= 0.5 * table.size[1]
        if inside and -0.05 < pose[2] - table.centre[2] < 0.05 + 2 * float(max(shape.half)):
            return table
    return None


def _place(world: MujocoWorld, item: str, pose: FloatArray) -> None:
    """Sets an item's pose, with zero velocity."""
    world.put(item, pose)
    dof = world.model.joint(f"{item}/free").dofadr[0]
    world.data.qvel[dof : dof + 6] = 0.0


def _put(world: MujocoWorld, item: str, pose: FloatArray, table: str) -> bool:
    """Sets an item's pose; returns whether it touches nothing but its table. The arm may be there."""
    _place(world, item, pose)
    return world.touched_by(item) <= {table}


def _carry(world: MujocoWorld, before: Mapping[str, FloatArray], arguments: Mapping[str, str]) -> None:
    """Has items that were put somewhere come there from where they were before, in view and in `seconds` of time, if
    those are given."""
    seconds = float(arguments.get("seconds", 0.0))
    if seconds <= 0.0:
        return
    after = {item: world.pose(item) for item in before}
    robot, start = np.asarray(world.spec.robot.position[:2]), world.time
    share = 0.0
    while share < 1.0:
        share = min(1.0, (world.time - start) / seconds)
        smooth = share * share * (3.0 - 2.0 * share)
        for item, lift, aside_by in zip(before, _LIFTS, _ASIDES, strict=False):
            one, other = before[item], after[item]
            pose = one + smooth * (other - one)
            away = pose[:2] - robot
            pose[:2] += aside_by * np.sin(np.pi * smooth) * away / max(1e-6, float(np.linalg.norm(away)))
            pose[2] += lift * min(1.0, 2.0 * np.sin(np.pi * smooth))
            pose[3:] = (one if smooth < 0.5 else other)[3:]
            _place(world, item, pose)
        world.advance()
    for item, pose in after.items():
        _place(world, item, pose)


def _penetration(world: MujocoWorld, item: str) -> float:
    """The deepest penetration, in m, of an item's contacts."""
    world.touched_by(item)  # brings the contacts up to date
    mine, roots = world.model.body(item).id, world.model.body_rootid
    contacts = world.data.contact[: world.data.ncon]
    return max(
        (-float(c.dist) for c in contacts if mine in {int(roots[world.model.geom_bodyid[geom]]) for geom in c.geom}),
        default=0.0,
    )
