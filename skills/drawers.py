"""open(drawer) and close(drawer): slide a drawer by contact alone.

To open it, the fingers close around the bar of its handle and pull; to close it, the closed fingers push against the
bar. Where it ends is felt: the hand is held back, by the arm's own joints. How far the drawer is open is seen before,
and told afterwards by how far the hand went.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from executive.protocols import SkillContext
from executive.sim.fixtures import DrawerSpec
from executive.skills import transforms
from executive.skills.arm import ArmSkill, Attempt, SkillError
from executive.skills.library import APPROACH, RETREAT, Way, approach, close_fist, floors_of, is_free, reach, release
from executive.skills.manipulation import STAYS, move_aside
from executive.skills.perform import go_home, perform
from executive.types import FloatArray, SkillResult, SkillStatus, Step

_AROUND = 0.024
"""m by which the fingers are wider apart than the bar when they come down on it."""

_TIPS = 0.006
"""How far above the bar the grip point is, in m: the bar is between the tips, which have more room beside the front."""

_HELD_BACK = 0.005
"""m of lag of the hand behind its command at which it is held back: some 50 N."""

_BEYOND = 0.012
"""m beyond where a drawer should end to which the hand is sent, to feel that end."""

_SHORT = 0.012
"""m by which a drawer may seem to end too early and have moved all of the way: the bar gives way between the
fingers."""

_STUCK = 0.008
"""m of motion of the hand at most of a drawer that does not move."""

_FINGER, _OFF = 0.012, 0.015
"""Half the width of a finger across its pad, and how far from the bar the closed fingers come down, in m."""

_LEANS = (0.0, 0.3, -0.3, 0.6, -0.6)
"""Rotations of the hand about the axis of the drawer's motion or across it, away from straight down, in rad."""

_SPACING = 0.01
"""m between the points of a straight line along which a drawer is slid."""

_SLOWLY = 0.25
"""The share of the speed limits that is used while a drawer slides: things in it stay where they are."""


@ArmSkill
def open_(step: Step, context: SkillContext) -> SkillResult:
    """Grasps the handle of a `drawer` and pulls until the end is felt. What stands before it is put aside before.

    It reports BLOCKED when something stands before it, or in the way of the hand, and stays there, UNREACHABLE and
    NO_PATH when the handle cannot be got to, GRASP_MISSED when the fingers close on nothing, JAMMED when the drawer
    does not move, STOPPED_SHORT when it moves and not all of the way, SLIPPED when the fingers lose the handle,
    TIMED_OUT when the arm is blocked.
    """
    return perform(step, context, _open)


@ArmSkill
def close(step: Step, context: SkillContext) -> SkillResult:
    """Pushes a `drawer` shut by its handle until the end is felt.

    It reports UNREACHABLE, BLOCKED and NO_PATH when the handle cannot be got to, GRASP_MISSED when the gripper holds
    something, JAMMED when the drawer does not move, STOPPED_SHORT when it moves and not all of the way, SLIPPED when
    the hand meets no end, TIMED_OUT when the arm is blocked.
    """
    return perform(step, context, _close)


def _open(attempt: Attempt) -> None:
    (drawer,) = attempt.arguments("drawer")
    pull(attempt, drawer)
    if attempt.handle.home_pose:
        go_home(attempt)


def _close(attempt: Attempt) -> None:
    (drawer,) = attempt.arguments("drawer")
    push(attempt, drawer)
    if attempt.handle.home_pose:
        go_home(attempt)


def pull(attempt: Attempt, drawer: str) -> None:
    """Pulls a drawer fully open; does nothing where it is.

    Raises:
        SkillError: as `open_` reports it, with the hand off the handle.
    """
    spec = attempt.handle.drawers[drawer]
    if (left := spec.stroke - attempt.body.openings()[drawer]) < _SHORT:
        return
    if attempt.holding:
        raise SkillError(SkillStatus.GRASP_MISSED, "the gripper holds something already")
    _clear_before(attempt, drawer)
    attempt.phase("plan", f"the handle of {drawer}")
    attempt.shape_gripper(spec.handle.thickness + _AROUND)
    bar = attempt.body.locate_handle(drawer) + [0.0, 0.0, _TIPS]
    try:
        way = _to_handle(attempt, drawer, bar, spec.axis, left + _BEYOND, closing=spec.axis)
    except SkillError:
        release(attempt)
        raise
    attempt.phase("grip", f"the handle of {drawer}")
    try:
        attempt.close_gripper()
        _slide(attempt, "pull", way, spec, spec.axis, left, f"{drawer} opens")
    except SkillError as failure:
        lost = failure.status is SkillStatus.DROPPED
        _let_go(attempt, spec, failure)
        if lost:
            raise SkillError(SkillStatus.SLIPPED, f"the fingers slipped off the handle of {drawer}") from None
        raise
    _let_go(attempt, spec)


def push(attempt: Attempt, drawer: str) -> None:
    """Pushes a drawer shut; does nothing where it is.

    Raises:
        SkillError: as `close` reports it, with the hand off the handle.
    """
    spec, opening = attempt.handle.drawers[drawer], attempt.body.openings()[drawer]
    if opening < 0.5 * _SHORT:
        return
    close_fist(attempt)
    attempt.phase("plan", f"the handle of {drawer}")
    before = 0.5 * spec.handle.thickness + _FINGER
    bar, along = attempt.body.locate_handle(drawer) + (before + _OFF) * spec.axis, -spec.axis
    across = np.cross(along, [0.0, 0.0, 1.0])
    try:
        way = _to_handle(attempt, drawer, bar, along, _OFF + opening + _BEYOND, closing=across)
    except SkillError:
        release(attempt)
        raise
    try:
        _slide(attempt, "push", way, spec, along, opening, f"{drawer} closes", ahead=_OFF)
    except SkillError as failure:
        _let_go(attempt, spec, failure)
        raise
    _let_go(attempt, spec)


def _to_handle(
    attempt: Attempt, drawer: str, point: FloatArray, along: FloatArray, length: float, closing: FloatArray
) -> Way:
    """Brings the hand down to a point (3,) at a drawer's handle from above; returns the way on `along` (3,) the axis on
    which it slides by `length` m. The fingers close along `closing`.

    Raises:
        SkillError: UNREACHABLE, BLOCKED, NO_PATH, or whatever ends the motion.
    """
    line = np.linspace(0.0, length, max(2, round(length / _SPACING) + 1))[1:, None] * along

    floor = floors_of(attempt)[drawer]
    poses = {name: transforms.matrix(pose) for name, pose in attempt.obstacles().items()}
    along_with_it = [drawer, *(name for name in poses if floor.holds(poses[name], attempt.handle.shapes[name]))]

    def free(way: Way) -> bool:
        return is_free(attempt, way.into) and is_free(attempt, way.out, ignored=along_with_it)

    ways = []
    for lean in _LEANS:
        for sign in (1.0, -1.0):
            x = sign * closing
            down = Rotation.from_rotvec(lean * x).apply([0.0, 0.0, -1.0])
            hand = np.eye(4)
            hand[:3, :3] = np.stack([x, np.cross(down, x), down], axis=1)
            hand[:3, 3] = point
            if (way := reach(attempt, hand, APPROACH[:, None] * -down, line, free)) is not None:
                ways.append(way)
        if ways:
            break
    if not ways:
        raise SkillError(SkillStatus.UNREACHABLE, f"the handle of {drawer} is out of reach, or there is no room at it")
    return approach(attempt, sorted(ways, key=lambda way: way.cost), f"the handle of {drawer}")


def _slide(
    attempt: Attempt,
    phase: str,
    way: Way,
    spec: DrawerSpec,
    along: FloatArray,
    length: float,
    what: str,
    ahead: float = 0.0,
) -> None:
    """Moves the hand on along a way until it is held back, and tells by how far it went what became of the drawer,
    which has `length` m to go once the hand has gone `ahead` m.

    Raises:
        SkillError: JAMMED, STOPPED_SHORT, SLIPPED, or whatever ends the motion.
    """
    start = attempt.arm.kinematics.forward(attempt.body.joints())[:3, 3]
    arrived = attempt.move(phase, way.out, speed=_SLOWLY, yields=_HELD_BACK)
    went = float((attempt.arm.kinematics.forward(attempt.body.joints())[:3, 3] - start) @ along) - ahead
    if went >= length - _SHORT:
        if arrived and went > length + 0.75 * _BEYOND:
            raise SkillError(SkillStatus.SLIPPED, f"the hand met no end where {what} no further")
        return
    share = f"{1000.0 * max(went, 0.0):.0f} of {1000.0 * length:.0f} mm"
    if went < _STUCK:
        raise SkillError(SkillStatus.JAMMED, f"{spec.name} is stuck: {what} by {share}")
    raise SkillError(SkillStatus.STOPPED_SHORT, f"{what} by {share} only")


def _let_go(attempt: Attempt, spec: DrawerSpec, failure: SkillError | None = None) -> None:
    """Takes the hand off a handle, straight out of where it is, and opens it.

    Raises:
        SkillError: `failure` where the run was cancelled, or whatever ends the motion where there is none.
    """
    if failure is not None and failure.status is SkillStatus.CANCELLED:
        raise failure
    attempt.phase("release")
    attempt.shape_gripper(spec.handle.thickness + _AROUND)
    here = attempt.arm.kinematics.forward(attempt.body.joints())
    up = [transforms.translated(here, -rise * here[:3, 2]) for rise in RETREAT]
    if (line := attempt.arm.kinematics.line(attempt.body.joints(), up)) is not None:
        attempt.move("retreat", np.array([attempt.body.joints(), *line]), speed=0.6)
    release(attempt)


def _clear_before(attempt: Attempt, drawer: str) -> None:
    """Puts aside what stands where a drawer is going to slide.

    Raises:
        SkillError: BLOCKED where something stays there, or whatever ends a motion with an item in the hand.
    """
    for _ in range(len(attempt.handle.shapes)):
        if not (there := _before(attempt, drawer)):
            return
        try:
            if there[0] in attempt.handle.unknown:
                break
            attempt.open_gripper()
            move_aside(attempt, there[0])
        except SkillError as stays:
            if stays.status not in STAYS or attempt.holding:
                raise
            break
    there = _before(attempt, drawer)
    known = [name for name in there if name not in attempt.handle.unknown]
    if there:
        what = ", ".join(known) or "something unknown"
        raise SkillError(SkillStatus.BLOCKED, f"{what} stands before {drawer}", blockers=known)


def _before(attempt: Attempt, drawer: str) -> Sequence[str]:
    """What stands where a drawer is going to slide: in the way of its front, or of its handle."""
    spec, shapes = attempt.handle.drawers[drawer], attempt.handle.shapes
    room, low = spec.before(attempt.body.openings()[drawer]), spec.front[2]
    found = []
    for name, pose in attempt.obstacles().items():
        corners = transforms.box_corners(transforms.matrix(pose), shapes[name].centre, shapes[name].half)
        middle = corners[:, :2].mean(axis=0)
        radius = float(np.linalg.norm(corners[:, :2] - middle, axis=1).max()) * 0.8
        if room.beside(middle) < radius and corners[:, 2].max() > low and corners[:, 2].min() < low + spec.rise:
            found.append(name)
    return found
