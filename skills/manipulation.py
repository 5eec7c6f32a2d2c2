"""Taking items and putting them down, on tables and on the tops of items, and around what is in the way."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from scipy.spatial.transform import Rotation

from executive.skills import grasps, surfaces, transforms
from executive.skills.arm import Attempt, SkillError, go_home, withdraw
from executive.skills.collision import Held
from executive.skills.library import (
    Way,
    approach,
    carry,
    close_fist,
    floor_under,
    grasp,
    grasps_of,
    in_hand,
    is_free,
    look,
    reach,
    release,
    rests_on,
    retreat,
    spots_for,
    surface,
)
from executive.skills.surfaces import Surface
from executive.types import FloatArray, Sense, SkillStatus

_LOOKS_AGAIN = 2
"""How often an item whose pose is estimated is looked for again when the fingers closed on nothing."""

_BESIDE = 0.12
"""m between two items within which one can be in the way of the hand that takes the other."""

_NUDGE = 0.06
"""m by which an item is dragged out of a corner."""

_BEHIND = 0.45
"""How far behind its middle the fingers press on such an item, as a share of half its length."""

_FINGERTIP, _PRESS = 0.018, 0.005
"""m from the grip point to the tips of closed fingers, and by which these are sent into what they press on."""

_WAIT, _MOST_WAITS = 0.25, 40
"""Seconds from one look to the next at what was put on another item, and how many there are at most: a box takes some
seconds to roll off a ball."""

_HALF = 0.5
"""The share of its travel by which a drawer has to be open for a hand to get into it."""

_GRID = 0.03
"""m between the places where something may be hidden."""

_STILL = 0.0003
"""m by which an item that is at rest seems to move from one look to the next, beside the error of its pose."""

STAYS = frozenset({SkillStatus.UNREACHABLE, SkillStatus.NO_PATH, SkillStatus.NOT_THERE, SkillStatus.BLOCKED})
"""How an item is left where it is, with an empty hand."""


def take(attempt: Attempt, item: str, source: str, home: bool = False) -> None:
    """Takes an item from a table, or from the top of another item, and lifts it; with `home`, carries it to the home
    pose. What rests on it or is in the way is put down beside it before. Where poses are estimated, a grasp that misses
    looks again.

    Raises:
        SkillError: NOT_THERE when it is not there, BLOCKED when other items are in the way and cannot be moved,
            UNREACHABLE when no grasp has a free and reachable configuration without them either, CLOSED when it is in a
            drawer that is, NO_PATH when there is no motion to one, GRASP_MISSED when the fingers close on nothing,
            DROPPED when it slips out, TIMED_OUT when the arm is blocked.
    """
    for _ in range(_LOOKS_AGAIN):
        try:
            return _take(attempt, item, source, home)
        except SkillError as failure:
            if failure.status is not SkillStatus.GRASP_MISSED or attempt.body.estimated_poses() is None:
                raise
    _take(attempt, item, source, home)


def _take(attempt: Attempt, item: str, source: str, home: bool, clears: bool = True) -> None:
    check_open(attempt, source)
    attempt.phase("plan", f"grasps of {item}")
    below = surface(attempt, source)
    try:
        pose = look(attempt, item)
    except SkillError as failure:
        if failure.status is not SkillStatus.NOT_THERE or not clears:
            raise
        pose = _uncover_from_view(attempt, item, below, failure)
    if not rests_on(attempt, pose, item, source):
        raise SkillError(SkillStatus.NOT_THERE, f"{item} is not on {source}")
    if attempt.riders(item) and uncover(attempt, item):
        pose = look(attempt, item)
    try:
        ways = grasps_of(attempt, item, pose, below)
    except SkillError as failure:
        if failure.status is not SkillStatus.UNREACHABLE or not clears:
            raise
        _clear(attempt, item, source, failure)
        pose = look(attempt, item)
        ways = grasps_of(attempt, item, pose, below)
    way = approach(attempt, ways, item)
    try:
        grasp(attempt, way)
        if home:
            go_home(attempt)
        attempt.check_held()
    except SkillError as failure:
        if failure.status is SkillStatus.GRASP_MISSED or failure.sense is Sense.FELT:
            attempt.arm.failed_grasps.add(item, pose, way.hand)
        raise
    attempt.arm.failed_grasps.forget(item)


def check_open(attempt: Attempt, place: str) -> None:
    """Checks that a place is no drawer that hardly anything can be taken from or put into.

    Raises:
        SkillError: CLOSED where it is open by less than half of its travel.
    """
    if (drawer := attempt.handle.drawers.get(place)) is not None:
        opening = attempt.body.openings()[place]
        if opening < _HALF * drawer.stroke:
            share = f"{1000.0 * opening:.0f} of {1000.0 * drawer.stroke:.0f} mm"
            raise SkillError(SkillStatus.CLOSED, f"{place} is open by {share}")


def _uncover_from_view(attempt: Attempt, item: str, below: Surface, failure: SkillError) -> FloatArray:
    """Moves aside what may hide an item that is seen nowhere and should be on a surface, one thing after the other;
    returns its pose (4, 4) once it is seen.

    Raises:
        SkillError: `failure` where nothing may hide it, or it is not there; BLOCKED where what may hide it stays.
    """
    attempt.phase("plan", f"what hides {item}")
    stays: list[str] = []
    for hider in attempt.body.hiders(item, below.grid(_GRID)):
        try:
            move_aside(attempt, hider)
        except SkillError as kept:
            if kept.status not in STAYS or attempt.holding:
                raise
            stays.append(hider)
            continue
        if (pose := attempt.body.locate(item)) is not None:
            return transforms.matrix(pose)
    if not stays:
        raise failure
    raise SkillError(SkillStatus.BLOCKED, f"{', '.join(stays)} may hide {item}", blockers=tuple(stays))


def _clear(attempt: Attempt, item: str, source: str, failure: SkillError) -> None:
    """Moves aside what keeps an item from being taken.

    Raises:
        SkillError: `failure` where no item beside it is in the way, BLOCKED where one is and stays there.
    """
    pose, below, shapes = look(attempt, item), surface(attempt, source), attempt.handle.shapes
    away = {
        name: float(np.linalg.norm(other[:2] - pose[:2, 3]))
        for name, other in attempt.obstacles().items()
        if name not in (item, source, *attempt.handle.unknown)
    }
    near = [name for name, far in away.items() if far - shapes[name].half.max() < _BESIDE + shapes[item].half.max()]
    found = blockers(attempt, near, lambda: grasps_of(attempt, item, pose, below, most=1))
    if not found:
        if below.is_item or below.walls is not None or not nudge(attempt, item, source):
            raise failure
        return
    for blocker in sorted(found, key=away.__getitem__):
        try:
            move_aside(attempt, blocker)
        except SkillError as stays:
            if stays.status not in STAYS or attempt.holding:
                raise
        else:
            return
    raise SkillError(SkillStatus.BLOCKED, f"{', '.join(found)} in the way of {item}", blockers=found)


def nudge(attempt: Attempt, item: str, table: str) -> bool:
    """Drags an item that stands in a corner a little towards the middle of its table, by closed fingers that press on
    its top; returns False, without a motion, where it would tip over or that is out of reach.

    Raises:
        SkillError: whatever ends the motions.
    """
    pose, middle, shape = look(attempt, item), surface(attempt, table).centre, attempt.handle.shapes[item]
    top = Surface.of_item(pose, shape).centre
    away = (middle - top) * [1.0, 1.0, 0.0]
    along = away / max(float(np.linalg.norm(away)), 1e-6)
    half = shape.reach(pose[:3, :3].T @ along)
    # Pressed on behind its middle, it turns about its front edge only if it is higher than that is far away.
    if np.linalg.norm(away) < _NUDGE or top[2] - middle[2] > (1.0 + _BEHIND) * half - 0.005:
        return False
    down = np.linspace(0.08, 0.0, 5)[:, None] * [0.0, 0.0, 1.0]
    on = np.arange(0.01, _NUDGE + 0.005, 0.01)[:, None] * along
    close_fist(attempt)
    ways = []
    for turn in np.linspace(0.0, np.pi, 4, endpoint=False):
        hand = np.eye(4)
        hand[:3, :3] = Rotation.from_euler("z", turn).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        hand[:3, 3] = top - _BEHIND * half * along + [0.0, 0.0, _FINGERTIP - _PRESS]
        out = np.concatenate([on, on[-1] + down[-2::-1]])
        way = reach(attempt, hand, down, out, lambda way: is_free(attempt, [*way.into, *way.out], ignored=[item]))
        ways += [] if way is None else [way]
    if ways:
        attempt.phase("nudge", item)
        attempt.move("nudge", approach(attempt, ways, item).out, speed=0.3)
    attempt.open_gripper()
    return bool(ways)


def uncover(attempt: Attempt, item: str) -> bool:
    """Puts what rests on an item down beside it, on the table below; returns whether nothing is left on it. What cannot
    be taken, or finds no room, stays.

    Raises:
        SkillError: something that was taken could not be put down, or slipped out of the hand.
    """
    for rider in attempt.riders(item):
        if rider not in attempt.riders(item):
            continue  # it was put down with what it rested on
        if (table := table_under(attempt, rider)) is None:
            return False
        try:
            take(attempt, rider, item)
        except SkillError as failure:
            if failure.status not in STAYS:
                raise
            return False
        put(attempt, rider, table)
        check_rests(attempt, rider, table)
    return True


def table_under(attempt: Attempt, item: str) -> str | None:
    """Returns the name of the table that an item is over, if only by lying on other things, or of the drawer or the
    container that it is in; None where there is none.

    Raises:
        SkillError: NOT_THERE where the item is seen nowhere.
    """
    pose, shape = look(attempt, item), attempt.handle.shapes[item]
    if (floor := floor_under(attempt, pose, shape)) is not None:
        return floor
    for name, table in attempt.handle.tables.items():
        if Surface.of_table(table).holds(pose, shape, slack=0.0):
            return name
    return None


def put(attempt: Attempt, item: str, target: str) -> None:
    """Puts the held item down on a free spot of a table, or on the middle of another item, and withdraws the hand.
    Where that takes another grasp, it is put down on another table before, and taken so.

    Raises:
        SkillError: NOT_THERE when the hand does not hold it, CLOSED when the target is a drawer that is, DOES_NOT_FIT
            when it is larger than the table as it is held, BLOCKED when other items leave no room, UNREACHABLE when no
            spot is within reach, NO_PATH when none can be got to, DROPPED when the item slips out on the way, TIMED_OUT
    when the arm is held up."""
    held = in_hand(attempt, item)
    withdraw(attempt, held)  # where it was gripped and not yet lifted
    check_open(attempt, target)
    attempt.phase("plan", f"a spot on {target}")
    try:
        ways = _spots(attempt, held, surface(attempt, target))
    except SkillError as failure:
        if failure.status is not SkillStatus.UNREACHABLE or not regrasp(attempt, held, target):
            raise
        held = in_hand(attempt, item)
        ways = _spots(attempt, held, surface(attempt, target))
    way = carry(attempt, held, ways, target)
    release(attempt)
    retreat(attempt, way)


def regrasp(attempt: Attempt, held: Held, target: str) -> bool:
    """Puts the held item down on another table and takes it across other sides; returns False, with the item still in
    the hand, where the target is within reach with no other grasp either, or no other table has room.

    Raises:
        SkillError: whatever ends the motions.
    """
    item, shape = held.item, attempt.handle.shapes[held.item]
    hand = attempt.arm.kinematics.forward(attempt.body.joints())
    pose = hand @ held.in_hand
    pose[:3, :3] = surfaces.resting(pose, shape)
    across = pose[:3, :3].T @ hand[:3, 0]
    candidates = grasps.candidates(pose, shape, -np.inf)
    other = next((grasp for grasp in candidates if _is_across(pose[:3, :3].T @ grasp[:3, 0], across)), None)
    if other is None:
        return False
    otherwise = Held(item, transforms.inverse(other) @ pose)
    if not works(lambda: spots_for(attempt, otherwise, surface(attempt, target), most=1)):
        return False
    for table in sorted(attempt.handle.tables.keys() - {target}):
        there = surface(attempt, table)
        try:
            ways = spots_for(attempt, held, there)
        except SkillError as failure:
            if failure.status is SkillStatus.CANCELLED:
                raise
            continue
        attempt.phase("regrasp", table)
        way = carry(attempt, held, ways, table)
        release(attempt)
        retreat(attempt, way)
        pose = look(attempt, item)
        ways = grasps_of(attempt, item, pose, there)
        grasp(attempt, approach(attempt, [w for w in ways if _is_across(pose[:3, :3].T @ w.hand[:3, 0], across)], item))
        return True
    return False


def _is_across(closing: FloatArray, before: FloatArray) -> bool:
    """Whether the fingers would close across other sides of an item than before, by the axes (3,) in its frame."""
    return abs(float(closing @ before)) < 0.5


def _spots(attempt: Attempt, held: Held, target: Surface) -> list[Way]:
    """Ways to put the held item down, or what is in the way.

    Raises:
        SkillError: BLOCKED, UNREACHABLE or DOES_NOT_FIT.
    """
    try:
        return spots_for(attempt, held, target)
    except SkillError as failure:
        shapes, poses = attempt.handle.shapes, attempt.obstacles()
        there = [
            name
            for name in poses.keys() - held.carried.keys() - attempt.handle.unknown - {target.name}
            if target.holds(transforms.matrix(poses[name]), shapes[name])
        ]
        if failure.status is not SkillStatus.UNREACHABLE:
            raise
        found = blockers(attempt, sorted(there), lambda: spots_for(attempt, held, target, most=1))
        if not found:
            raise
        message = f"{', '.join(found)} on {target.name} in the way: no room for {held.item}"
        raise SkillError(SkillStatus.BLOCKED, message, blockers=found) from None


def check_rests(attempt: Attempt, item: str, target: str) -> None:
    """Looks whether an item that was put down rests where it was put; on another item, once it is seen to be at rest.
    What is not seen is not in question.

    Raises:
        SkillError: FELL where it does not.
    """
    pose = attempt.obstacles().get(item)
    for _ in range(_MOST_WAITS if target in attempt.handle.shapes else 0):
        attempt.wait(_WAIT)
        before, pose = pose, attempt.obstacles().get(item)
        if before is None or pose is None or np.linalg.norm(pose[:3] - before[:3]) < _STILL + attempt.spread(item):
            break
    if pose is not None and not rests_on(attempt, transforms.matrix(pose), item, target):
        raise SkillError(SkillStatus.FELL, f"{item} did not stay on {target}")


def blockers(attempt: Attempt, among: Collection[str], what: Callable[[], object]) -> tuple[str, ...]:
    """Returns those of some items without any one of which something works; all of them where it takes more than one,
    and none where they are not what is in the way.

    Args:
        what: raises a `SkillError` where it does not work.
    """

    def works_without(items: Collection[str]) -> bool:
        with attempt.without(items):
            return works(what)

    if not among or not works_without(among):
        return ()
    return tuple(item for item in among if len(among) == 1 or works_without([item])) or tuple(among)


def works(what: Callable[[], object]) -> bool:
    """Whether something raises no `SkillError`.

    Raises:
        SkillError: CANCELLED.
    """
    try:
        what()
    except SkillError as failure:
        if failure.status is SkillStatus.CANCELLED:
            raise
        return False
    return True


def move_aside(attempt: Attempt, item: str) -> None:
    """Takes an item and puts it down elsewhere on its table.

    Raises:
        SkillError: whatever ends that.
    """
    if (table := table_under(attempt, item)) is None:
        raise SkillError(SkillStatus.NOT_THERE, f"{item} is on no table")
    attempt.phase("clear", item)
    _take(attempt, item, table, home=False, clears=False)
    put(attempt, item, table)
    check_rests(attempt, item, table)
