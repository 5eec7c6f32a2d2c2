"""Taking items and putting them down, on tables and on the tops of items, and around what is in the way."""

from __future__ import annotations

from collections import Counter

import numpy as np
from scipy.spatial.transform import Rotation

from executive.sim.scene import ItemShape
from executive.skills import grasps, surfaces, transforms
from executive.skills.arm import OPEN_WIDTH, Attempt, SkillError
from executive.skills.collision import Held
from executive.skills.in_the_way import blockers, works
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
from executive.skills.perform import go_home, withdraw
from executive.skills.surfaces import Surface
from executive.types import FloatArray, Sense, SkillStatus, about_vertical

_LOOKS_AGAIN = 2
"""How often an item whose pose is estimated is looked for again when the fingers closed on nothing."""

_BESIDE = 0.12
"""m between two items within which one can be in the way of the hand that takes the other."""

_NUDGE = 0.06
"""m by which an item is dragged out of a corner or away from a wall."""

_MOST_NUDGES = 4
"""How often room is made around one item: a corner has two walls."""

_AROUND = 0.012
"""m by which fingers that are closed as far as an item lets them are wider apart than the item."""

_FINGER_ROOM = 0.05
"""m between an item and a wall that a finger gets into."""

_LEANS = (0.0, 0.35, 0.7)
"""rad by which closed fingers lean over what they drag."""

_BEHIND = 0.45
"""How far behind its middle the fingers press on such an item, as a share of half its length."""

_FINGERTIP = 0.018
"""m from the grip point to the tips of closed fingers."""

_OVER, _FEELS_FOR = 0.004, 0.010
"""m above an item's top from which it is felt for, and how far down."""

_TOUCHING, _TOUCHED = 0.05, 0.001
"""The share of the speed limits at which it is felt for, and m of lag of the hand at which it is felt."""

_PRESS, _ROLLING_PRESS = 0.0015, 0.001
"""m by which closed fingers are sent into what they drag: some 25 N and 8 N. What rolls takes no more, and more would
have a drawer slide with it."""

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
    cleared = Counter[str]()
    while True:
        try:
            way = approach(attempt, _grasps_in(attempt, item, pose, below), item)
            break
        except SkillError as failure:
            if failure.status not in (SkillStatus.UNREACHABLE, SkillStatus.BLOCKED) or not clears:
                raise
            if failure.status is SkillStatus.BLOCKED:
                attempt.open_gripper()  # it may have been shaped for the item
            _clear(attempt, item, source, failure, cleared)
        pose, below = look(attempt, item), surface(attempt, source)
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


def _grasps_in(attempt: Attempt, item: str, pose: FloatArray, below: Surface) -> list[Way]:
    """What `grasps_of` returns; between walls, where there is no room for open fingers, ways with the fingers closed as
    far as the item lets them, and they are closed so far.

    Raises:
        SkillError: UNREACHABLE where there are none.
    """
    try:
        return grasps_of(attempt, item, pose, below)
    except SkillError as failure:
        width = grasps.narrowest(pose, attempt.handle.shapes[item]) + 2.0 * attempt.spread(item) + _AROUND
        if failure.status is not SkillStatus.UNREACHABLE or below.walls is None or width > OPEN_WIDTH:
            raise
    attempt.shape_gripper(width)
    try:
        return grasps_of(attempt, item, pose, below, widest=width - 0.5 * _AROUND)
    except SkillError:
        attempt.open_gripper()
        raise


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


def _clear(attempt: Attempt, item: str, source: str, failure: SkillError, cleared: Counter[str]) -> None:
    """Moves one thing aside that keeps an item from being taken, or drags the item to where there is room around it;
    `cleared` counts by name what was moved: others once, the item `_MOST_NUDGES` times.

    Raises:
        SkillError: `failure` where nothing is known to be in the way, BLOCKED where something is and stays there.
    """
    found = failure.blockers or _beside(attempt, item, source)
    if not found:
        is_item = surface(attempt, source).is_item
        if is_item or cleared[item] == _MOST_NUDGES or not nudge(attempt, item, source):
            raise failure
        cleared[item] += 1
        return
    poses, at = attempt.obstacles(), look(attempt, item)[:2, 3]
    for blocker in sorted(found, key=lambda name: float(np.linalg.norm(poses[name][:2] - at))):
        if cleared[blocker]:
            continue
        cleared[blocker] += 1
        try:
            move_aside(attempt, blocker)
        except SkillError as stays:
            if stays.status not in STAYS or attempt.holding:
                raise
        else:
            return
    raise SkillError(SkillStatus.BLOCKED, f"{', '.join(found)} in the way of {item}", blockers=found)


def _beside(attempt: Attempt, item: str, source: str) -> tuple[str, ...]:
    """The items beside another one that are in the way of the hand that takes it."""
    pose, below, shapes = look(attempt, item), surface(attempt, source), attempt.handle.shapes
    away = {
        name: float(np.linalg.norm(other[:2] - pose[:2, 3]))
        for name, other in attempt.obstacles().items()
        if name not in (item, source, *attempt.handle.unknown)
    }
    near = [name for name, far in away.items() if far - shapes[name].half.max() < _BESIDE + shapes[item].half.max()]
    return blockers(attempt, sorted(near, key=away.__getitem__), lambda: grasps_of(attempt, item, pose, below, most=1))


def nudge(attempt: Attempt, item: str, source: str) -> bool:
    """Drags an item a little away from the walls that it is at, or from a table's corner towards the middle, by closed
    fingers that press on its top; returns False, without a motion, where that is out of reach, or it would fall over
    with nothing around it to keep it there.

    Raises:
        SkillError: whatever ends the motions.
    """
    pose, shape, below = look(attempt, item), attempt.handle.shapes[item], surface(attempt, source)
    ways = []
    close_fist(attempt)
    for along, far in _directions(attempt, pose, shape, below):
        top = Surface.of_item(pose, shape).centre
        half, rolls = shape.reach(pose[:3, :3].T @ along), _rolls(pose, shape, along)
        # Pressed on behind its middle, it turns about its front edge only if it is higher than that is far away.
        if below.walls is None and not rolls and top[2] - below.centre[2] > (1.0 + _BEHIND) * half - 0.005:
            continue
        point = top - (0.0 if rolls else _BEHIND) * half * along
        ways = _presses(attempt, item, point, along, min(_NUDGE, 2.0 * far if rolls else far))
        if ways:
            attempt.phase("nudge", item)
            _drag(attempt, approach(attempt, ways, item), _ROLLING_PRESS if rolls else _PRESS)
            break
    attempt.open_gripper()
    return bool(ways)


def _directions(attempt: Attempt, pose: FloatArray, shape: ItemShape, below: Surface) -> list[tuple[FloatArray, float]]:
    """In which directions (3,) an item is dragged so that fingers get around it, and how many m it has to go there, the
    best first: away from walls, and where it rolls before where it slides. What slides into a drawer's case would take
    the drawer along."""
    spot = Surface.of_item(pose, shape).centre
    if below.walls is None:
        away = (below.centre - spot) * [1.0, 1.0, 0.0]
        far = float(np.linalg.norm(away))
        return [] if far < _NUDGE else [(away / far, _NUDGE)]
    local = below.local(spot[:2])
    drawer = attempt.handle.drawers.get(below.name)
    found = []
    for at, size, axis in zip(local, below.size, about_vertical(below.yaw)[:, :2].T, strict=True):
        room = 0.5 * size - abs(at) - shape.reach(pose[:3, :3].T @ axis)
        along = -np.sign(at) * axis
        slides = not _rolls(pose, shape, along)
        if room < _FINGER_ROOM and not (slides and drawer is not None and along @ drawer.axis < -0.5):
            found.append((slides, room, along, min(2.0 * abs(float(at)) + room, _NUDGE)))
    return [(along, far) for _, _, along, far in sorted(found, key=lambda each: each[:2])]


def _rolls(pose: FloatArray, shape: ItemShape, along: FloatArray) -> bool:
    """Whether an item rolls where its top is dragged, and goes half as far."""
    if shape.axis is None:
        return shape.is_ball
    axle = pose[:3, shape.axis]
    return abs(float(axle[2])) < 0.5 and abs(float(axle @ along)) < 0.7


def _presses(attempt: Attempt, item: str, point: FloatArray, along: FloatArray, far: float) -> list[Way]:
    """Ways to bring closed fingers to just above a `point` (3,) of an item's top, down onto it, and `far` m `along` an
    axis (3,). The hand is upright, or leans over what is ahead, where something is behind it."""
    up = np.array([0.0, 0.0, 1.0])
    on = np.linspace(0.0, max(far, 0.02), max(3, round(far / 0.01)))[:, None] * along - _FEELS_FOR * up
    ways = []
    for lean in _LEANS:
        tilted = Rotation.from_rotvec(lean * np.cross(up, along)).as_matrix()
        for turn in np.linspace(0.0, np.pi, 4, endpoint=False):
            hand = np.eye(4)
            hand[:3, :3] = tilted @ Rotation.from_euler("z", turn).as_matrix() @ np.diag([1.0, -1.0, -1.0])
            hand[:3, 3] = point - _FINGERTIP * hand[:3, 2] + _OVER * up
            into = np.linspace(0.08, 0.0, 5)[:, None] * up
            way = reach(attempt, hand, into, on, lambda way: is_free(attempt, [*way.into, *way.out], ignored=[item]))
            ways += [] if way is None else [way]
        if ways:
            break
    return ways


def _drag(attempt: Attempt, way: Way, press: float) -> None:
    """Feels for what is below the closed fingers, which are just above it, presses on it by `press` m and drags it on
    along the rest of a way; lifts the hand.

    Raises:
        SkillError: whatever ends the motions.
    """
    kinematics, up = attempt.arm.kinematics, np.array([0.0, 0.0, 1.0])
    attempt.move("touch", way.out[:2], speed=_TOUCHING, yields=_TOUCHED)
    touched, above = (kinematics.forward(q)[:3, 3] for q in (attempt.body.joints(), way.out[1]))
    there = [kinematics.forward(q) for q in way.out[1:]]
    lower = touched - above - press * up
    there = [transforms.translated(hand, lower) for hand in there]
    there += [transforms.translated(there[-1], rise * up) for rise in np.linspace(0.02, 0.08, 4)]
    if (line := kinematics.line(attempt.body.joints(), there)) is not None:
        attempt.move("nudge", np.array([attempt.body.joints(), *line]), speed=0.3)


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
            when it is larger than the table as it is held, BLOCKED when other items leave no room or no way,
            UNREACHABLE when no spot is within reach, NO_PATH when none can be got to, DROPPED when the item slips out
            on the way, TIMED_OUT when the arm is held up.
    """
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
