"""What skills are made of: look, reach, approach, grasp, carry, release and retreat.

Each function works on an `Attempt`, the state of one execution of a step that `perform` hands to a skill, and raises a
`SkillError` where it fails, which ends the skill with a report. Positions and distances are in m, angles in rad, poses
are transforms (4, 4) in the world frame, configurations (6,) in rad. A pose of the hand is that of the grip point: z
out of the hand, x from pad to pad.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from executive.sim.scene import WIDEST_GRIP, ItemShape
from executive.skills import grasps, surfaces, transforms
from executive.skills.arm import CARRYING, Attempt, SkillError
from executive.skills.collision import Held
from executive.skills.in_the_way import no_motion
from executive.skills.surfaces import Surface
from executive.types import FloatArray, SkillStatus, about_vertical

APPROACH = np.linspace(0.09, 0.0, 7)
"""Distances in m from a grasp through which the hand comes to it in a straight line."""

LIFT = np.linspace(0.015, 0.12, 8)
"""Heights in m above a grasp through which an item is lifted straight up."""

LOWER = np.linspace(0.10, 0.0, 8)
"""Heights in m above where an item is put down through which it is lowered straight down."""

RETREAT = np.linspace(0.015, 0.10, 6)
"""Distances in m from a released item through which the hand withdraws."""

_MOST_GRASPS, _MOST_SPOTS = 8, 6
"""The largest number of grasps, and of spots to put an item down, for which a motion is planned."""

_TIPS, _PAD = 0.018, 0.004
"""m from the grip point to the tips of the fingers, and how thick the pads are."""

_OFF_WALL = 0.008
"""m from a wall at which an item is lifted straight up; from nearer it is moved so far off it on the way."""

_DEVIATIONS = 2.0
"""Standard deviations of an estimated position that the open fingers have room for on either side."""

_AGAIN = 1.0
"""The extra cost of a grasp per failure, in rad of the path to it."""

_CAREFULLY = 0.3
"""The share of the speed limits that is used while something rests on what is carried."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way to bring the hand to a pose and on from there, in straight lines.

    Attributes:
        hand: the pose (4, 4).
        into: the configurations (N, 6) that lead to it.
        out: those (M, 6) that lead on from it, the first of which is the last of `into`.
        cost: in rad of the path from where the arm is now; the less the better.
    """

    hand: FloatArray
    into: FloatArray
    out: FloatArray
    cost: float


def look(attempt: Attempt, item: str) -> FloatArray:
    """Returns the pose (4, 4) of an item; where it is estimated and not well known, it is looked at again.

    Raises:
        SkillError: NOT_THERE where it is seen nowhere.
    """
    return transforms.matrix(attempt.locate(item))


def surface(attempt: Attempt, name: str) -> Surface:
    """Returns a table, a region, the floor of a drawer or a container, or the top of an item as it is now, as a
    surface. A region in which something stands is the top of the highest item there, unless it is for several side by
    side.

    Raises:
        SkillError: NOT_THERE where the item is seen nowhere.
    """
    if name in attempt.handle.tables:
        handle = attempt.handle
        taken = [each.covers for each in handle.containers.values()]
        taken += [each.covers for each in handle.drawers.values()]
        return Surface.of_table(handle.tables[name], tuple(taken))
    if name in (floors := floors_of(attempt)):
        return floors[name]
    if name in attempt.handle.regions:
        region = region_of(attempt, name)
        if attempt.handle.regions[name].several:
            return region
        return max(_tops_in(attempt, region), key=lambda top: float(top.centre[2]), default=region)
    if (pose := attempt.obstacles().get(name)) is None:
        raise SkillError(SkillStatus.NOT_THERE, f"{name} is seen nowhere")
    return Surface.of_item(transforms.matrix(pose), attempt.handle.shapes[name])


def floors_of(attempt: Attempt) -> dict[str, Surface]:
    """Returns the floors of containers, and of drawers as far as they are open now, as surfaces by name."""
    opened = attempt.body.openings() if attempt.handle.drawers else {}
    floors = [container.floor for container in attempt.handle.containers.values()]
    floors += [drawer.floor(opened[name]) for name, drawer in attempt.handle.drawers.items()]
    return {floor.name: Surface.of_floor(floor) for floor in floors}


def floor_under(attempt: Attempt, pose: FloatArray, shape: ItemShape) -> str | None:
    """Returns the name of the drawer or the container that an item at `pose` (4, 4) is in; None where it is in none."""
    for name, floor in floors_of(attempt).items():
        if floor.holds(pose, shape, slack=0.0):
            return name
    return None


def rests_on(attempt: Attempt, pose: FloatArray, item: str, target: str, slack: float = 0.02) -> bool:
    """Whether an item at `pose` (4, 4) is one that rests on a surface. What is in a drawer or a container that stands
    on a table is not on the table."""
    shape = attempt.handle.shapes[item]
    if target in attempt.handle.tables and floor_under(attempt, pose, shape) is not None:
        return False
    where = region_of(attempt, target) if target in attempt.handle.regions else surface(attempt, target)
    return where.holds(pose, shape, slack)


def region_of(attempt: Attempt, name: str) -> Surface:
    """Returns a region of a table as a surface, whatever stands in it."""
    region = attempt.handle.regions[name]
    return Surface.of_region(region, attempt.handle.tables[region.table])


def _tops_in(attempt: Attempt, region: Surface) -> list[Surface]:
    """The tops of all items in a region but the held one."""
    held, shapes = attempt.held(), attempt.handle.shapes
    poses = {name: transforms.matrix(pose) for name, pose in attempt.obstacles().items()}
    there = [
        name for name in poses if name not in (held.carried if held else ()) and name not in attempt.handle.unknown
    ]
    return [Surface.of_item(poses[n], shapes[n]) for n in there if region.holds(poses[n], shapes[n], slack=0.0)]


def in_hand(attempt: Attempt, item: str) -> Held:
    """Returns the item in the gripper, with its pose in it and with what rests on it.

    Raises:
        SkillError: NOT_THERE where the gripper does not hold this item.
    """
    held = attempt.held()
    if held is None or held.item != item:
        raise SkillError(SkillStatus.NOT_THERE, f"the gripper does not hold {item}")
    return held


def is_free(
    attempt: Attempt, path: Sequence[FloatArray] | FloatArray, held: Held | None = None, ignored: Collection[str] = ()
) -> bool:
    """Whether the arm and the held item touch nothing at any configuration (6,) of a path, where the `ignored` items
    count as nothing."""
    attempt.update_collisions(held, ignored)
    return bool(attempt.arm.collision.all_free(np.array(path)).all())


def reach(
    attempt: Attempt, hand: FloatArray, into: FloatArray, out: FloatArray, free: Callable[[Way], bool]
) -> Way | None:
    """Returns a way to bring the hand to a pose (4, 4), or None where none is within reach and `free`.

    Args:
        into: the offsets (N, 3) of the straight line to it, the last of which is 0.
        out: the offsets (M, 3) of the straight line on from there.
        free: whether a way touches nothing that it must not (see `is_free`).
    """
    kinematics, start = attempt.arm.kinematics, attempt.body.joints()
    attempt.check_cancelled()
    for seed in kinematics.seeds(hand, start):
        q = kinematics.solve(hand, seed)
        if q is None:
            continue
        back = kinematics.line(q, [transforms.translated(hand, offset) for offset in into[::-1]])
        on = kinematics.line(q, [transforms.translated(hand, offset) for offset in out])
        if back is None or on is None:
            continue
        way = Way(hand, np.array(back[::-1]), np.array([back[0], *on]), float(np.linalg.norm(back[-1] - start)))
        if free(way):
            return way
    return None


def grasps_of(
    attempt: Attempt,
    item: str,
    pose: FloatArray,
    source: Surface,
    most: int = 2 * _MOST_GRASPS,
    widest: float = WIDEST_GRIP,
) -> list[Way]:
    """Returns ways to take an item at `pose` (4, 4) from a surface and lift it, cheapest first: of the first `most`
    that are found, the best; `widest` is the width in m that the fingers are around as far as they are open now.

    Raises:
        SkillError: UNREACHABLE where there are none.
    """
    shape, height = attempt.handle.shapes[item], float(source.centre[2])
    # Where the fingers open too little for that, it is tried all the same.
    slack = _DEVIATIONS * attempt.spread(item)
    candidates = grasps.candidates(pose, shape, height, slack, widest) or grasps.candidates(
        pose, shape, height, widest=widest
    )
    if not candidates:
        raise SkillError(SkillStatus.UNREACHABLE, f"{item} is too wide for the gripper as it stands or lies")
    there = transforms.matrix(attempt.obstacles()[item])
    riders = attempt.riders(item)
    lifts = [_up(LIFT)]
    if np.any(aside := _off_walls(pose, shape, source)):
        lifts.append(_up(LIFT) + aside)
    found: list[Way] = []
    for preference, grasp in enumerate(candidates):
        if len(found) >= most:
            break
        if not _is_between_walls(grasp, grasps.width_across(pose[:3, :3], shape, grasp[:3, 0]), source):
            continue
        held = Held(item, *_in_frame(grasp, there, riders))

        def free(way: Way, held: Held = held) -> bool:
            if not is_free(attempt, [*way.into, *way.out], ignored=[item]):
                return False
            attempt.update_collisions(held)
            # An item that leans on this one cannot be avoided; it is moved along a little.
            return is_free(attempt, way.out[2:], held, attempt.arm.collision.beside(way.into[-1]))

        into = APPROACH[:, None] * -grasp[:3, 2]
        if (way := next((w for out in lifts if (w := reach(attempt, grasp, into, out, free))), None)) is not None:
            again = attempt.arm.failed_grasps.times(item, pose, grasp)
            found.append(replace(way, cost=way.cost + 0.02 * preference + _AGAIN * again))
    if not found:
        raise SkillError(SkillStatus.UNREACHABLE, f"no grasp of {item} is within reach and free of collisions")
    return sorted(found, key=lambda way: way.cost)[:_MOST_GRASPS]


def _is_between_walls(hand: FloatArray, width: float, source: Surface) -> bool:
    """Whether fingers that close at `hand` (4, 4) on an item of this width, in m, have no wall of the surface between
    them: open, they may be on both sides of one."""
    if source.walls is None or hand[2, 3] - _TIPS > source.centre[2] + source.walls:
        return True
    pads = [hand[:2, 3] + side * (0.5 * width + _PAD) * hand[:2, 0] for side in (1.0, -1.0)]
    return all(bool((np.abs(source.local(pad)) <= 0.5 * np.asarray(source.size)).all()) for pad in pads)


def _off_walls(pose: FloatArray, shape: ItemShape, source: Surface) -> FloatArray:
    """How an item at `pose` (4, 4) is moved off the walls that it touches as it is lifted, (3,) in m; 0 where it
    touches none."""
    aside, local = np.zeros(3), source.local((pose[:3, 3] + pose[:3, :3] @ shape.centre)[:2])
    for at, size, axis in zip(local, source.size, about_vertical(source.yaw)[:, :2].T, strict=True):
        if source.walls is not None and 0.5 * size - abs(at) - shape.reach(pose[:3, :3].T @ axis) < _OFF_WALL:
            aside -= _OFF_WALL * np.sign(at) * axis
    return aside


def spots_for(attempt: Attempt, held: Held, target: Surface, most: int = _MOST_SPOTS) -> list[Way]:
    """Returns ways to lower the held item onto a free spot of a surface and to withdraw the hand, cheapest first: of
    the first `most` that are found, the best.

    Raises:
        SkillError: DOES_NOT_FIT where it is larger than the table as it is held and tipped onto its side, UNREACHABLE
            where there are none.
    """
    shape = attempt.handle.shapes[held.item]
    others = {name: pose for name, pose in attempt.obstacles().items() if name not in held.carried}
    hand_now = attempt.arm.kinematics.forward(attempt.body.joints())
    as_held = surfaces.resting(hand_now @ held.in_hand, shape)
    # An item that does not fit as it is held is tipped onto its side.
    uprights = [as_held] if surfaces.fits(as_held, shape, target) else surfaces.tipped(as_held, hand_now[:3, 0])
    uprights = [upright for upright in uprights if surfaces.fits(upright, shape, target)]
    if not uprights:
        raise SkillError(SkillStatus.DOES_NOT_FIT, f"{held.item} does not fit on {target}")

    def free(way: Way) -> bool:
        # The lowest points are left out: there the item is about to touch the surface.
        return is_free(attempt, way.into[:-2], held) and is_free(attempt, [*way.into, *way.out], ignored=held.carried)

    def at(upright: FloatArray, spot: FloatArray, yaw: float) -> Way | None:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix() @ upright
        pose[:3, 3] = spot - pose[:3, :3] @ shape.centre
        hand = pose @ transforms.inverse(held.in_hand)
        return reach(attempt, hand, _up(LOWER), RETREAT[:, None] * -hand[:3, 2], free)

    found: list[Way] = []
    searches = (surfaces.spots,) if target.is_item else (surfaces.spots, surfaces.tight_spots)
    for search, upright in product(searches, uprights):
        for spot, yaws in search(upright, shape, target, others, attempt.handle.shapes, attempt.context.rng):
            found += [way for yaw in yaws if (way := at(upright, spot, float(yaw))) is not None]
            if len(found) >= most or (found and target.is_item):
                break
        if found:
            break
    if not found:
        raise SkillError(SkillStatus.UNREACHABLE, f"no free spot on {target.name} is within reach")
    return sorted(found, key=lambda way: way.cost)[:_MOST_SPOTS]


def approach(attempt: Attempt, ways: Sequence[Way], what: str) -> Way:
    """Moves the empty hand to the first of some ways that there is a motion to, and along it to its pose; returns it.
    `what` is for the message.

    Raises:
        SkillError: BLOCKED where other items are in the way of all motions, NO_PATH where there is none without them
            either, or whatever ends the motion.
    """
    for way in ways:
        if (path := attempt.plan([way.into[0]])) is not None:
            attempt.move("approach", path, planned=True)
            attempt.move("approach", way.into, speed=0.5)
            return way
    raise no_motion(attempt, [way.into[0] for way in ways], None, what)


def grasp(attempt: Attempt, way: Way) -> None:
    """Closes the gripper on an item, and lifts it.

    Raises:
        SkillError: GRASP_MISSED with the hand withdrawn and open, or whatever ends the motion.
    """
    attempt.phase("grip")
    try:
        attempt.close_gripper()
    except SkillError:
        attempt.open_gripper()
        attempt.move("retreat", way.out, speed=0.6)
        raise
    attempt.move("lift", way.out, speed=0.6)


def close_fist(attempt: Attempt) -> None:
    """Closes the empty gripper, to push with.

    Raises:
        SkillError: GRASP_MISSED when it holds something.
    """
    if attempt.holding:
        raise SkillError(SkillStatus.GRASP_MISSED, "the gripper holds something already")
    attempt.phase("close")
    attempt.close_fist()


def carry(attempt: Attempt, held: Held, ways: Sequence[Way], what: str) -> Way:
    """Carries the held item to the first of some ways that there is a motion to, and along it to its pose; returns it.
    It goes carefully where something rests on the item. `what` is for the message.

    Raises:
        SkillError: BLOCKED where other items are in the way of all motions, NO_PATH where there is none without them
            either, DROPPED, or whatever ends the motion.
    """
    for way in ways:
        if (path := attempt.plan([way.into[0]], held)) is not None:
            speed = _CAREFULLY if held.riders else CARRYING
            attempt.move("transfer", path, speed=speed, planned=True, then=[way.into, way.out[1:]])
            attempt.move("lower", way.into, speed=0.5)
            attempt.check_held()
            return way
    raise no_motion(attempt, [way.into[0] for way in ways], held, what)


def release(attempt: Attempt) -> None:
    """Opens the gripper.

    Raises:
        SkillError: CANCELLED.
    """
    attempt.phase("release")
    attempt.open_gripper()


def retreat(attempt: Attempt, way: Way) -> None:
    """Moves the hand on along the end of a way.

    Raises:
        SkillError: whatever ends the motion.
    """
    attempt.move("retreat", way.out, speed=0.6)


def _in_frame(
    hand: FloatArray, item: FloatArray, riders: dict[str, FloatArray]
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """The transforms of an item and of what rests on it in the frame of the hand."""
    inverse = transforms.inverse(hand)
    return inverse @ item, {name: inverse @ pose for name, pose in riders.items()}


def _up(heights: FloatArray) -> FloatArray:
    """Offsets (N, 3) straight up by some heights in m."""
    return np.asarray(heights[:, None] * np.array([0.0, 0.0, 1.0]))
