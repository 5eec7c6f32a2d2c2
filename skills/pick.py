"""pick(item, table): take an item that is on a table, and hold it clear of everything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executive.protocols import SkillContext
from executive.skills import grasps, transforms
from executive.skills.arm import ArmSkill, Attempt, SkillError, go_home, perform
from executive.skills.collision import Held
from executive.types import FloatArray, Sense, SkillResult, SkillStatus, Step

_APPROACH = np.linspace(0.09, 0.0, 7)
"""Distances to the grasp in m at which the straight approach is planned, from first to last."""

_LIFT = np.linspace(0.015, 0.12, 8)
"""Heights above the grasp in m through which the item is lifted straight up."""

_MOST_PLANS = 8
"""The largest number of grasps for which a motion is planned."""

_LOOKS_AGAIN = 2
"""How often an item whose pose is estimated is looked for again when the fingers closed on nothing."""

_DEVIATIONS = 2.0
"""Standard deviations of an estimated position that the open fingers have room for on either side."""

_AGAIN = 1.0
"""The extra cost of a grasp per failure, in rad of the path to it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Reach:
    """A reachable grasp (4, 4): its approach and lift, (N, 6) each, and the cost of the pre-grasp."""

    grasp: FloatArray
    approach: FloatArray
    lift: FloatArray
    cost: float


@ArmSkill
def pick(step: Step, context: SkillContext) -> SkillResult:
    """Grasps `item` on `table` from above and lifts it; with a home pose, carries it there.

    It reports NOT_THERE when the item is not on the named table, UNREACHABLE when no grasp has a free and reachable
    configuration, NO_PATH when there is no motion to one, GRASP_MISSED when the fingers close on nothing, DROPPED when
    the item slips out, TIMED_OUT when the arm is blocked.
    """
    return perform(step, context, _pick)


def _pick(attempt: Attempt) -> None:
    item, table = attempt.item_and_table()
    if attempt.holding:
        raise SkillError(SkillStatus.GRASP_MISSED, "the gripper holds something already")
    attempt.open_gripper()
    for _ in range(_LOOKS_AGAIN):
        try:
            return _try(attempt, item, table)
        except SkillError as failure:
            if failure.status is not SkillStatus.GRASP_MISSED or attempt.body.estimated_poses() is None:
                raise
    return _try(attempt, item, table)


def _try(attempt: Attempt, item: str, table: str) -> None:
    """Locates the item, and takes it."""
    shape, top = attempt.handle.shapes[item], attempt.handle.tables[table]
    attempt.phase("plan", f"grasps of {item}")
    pose = transforms.matrix(attempt.locate(item))
    if not grasps.on_table(pose, shape, top):
        raise SkillError(SkillStatus.NOT_THERE, f"{item} is not on {table}")
    slack = _DEVIATIONS * attempt.spread(item)
    # Where the fingers open too little for that, it is tried all the same.
    candidates = grasps.candidates(pose, shape, top.centre[2], slack) or grasps.candidates(pose, shape, top.centre[2])
    if not candidates:
        raise SkillError(SkillStatus.UNREACHABLE, f"{item} is too wide for the gripper as it stands or lies")
    reaches = _reachable(attempt, item, candidates)
    if not reaches:
        raise SkillError(SkillStatus.UNREACHABLE, f"no grasp of {item} is within reach and free of collisions")
    for reach in reaches[:_MOST_PLANS]:
        path = attempt.plan([reach.approach[0]])
        if path is not None:
            break
    else:
        raise SkillError(SkillStatus.NO_PATH, f"no collision-free motion to {item}")
    attempt.move("approach", path, planned=True)
    attempt.move("approach", reach.approach, speed=0.5)
    try:
        _take(attempt, reach)
    except SkillError as failure:
        if failure.status is SkillStatus.GRASP_MISSED or failure.sense is Sense.FELT:
            attempt.arm.failed_grasps.add(item, pose, reach.grasp)
        raise
    attempt.arm.failed_grasps.forget(item)


def _take(attempt: Attempt, reach: _Reach) -> None:
    """Grips, lifts, and carries the item home if actions end there."""
    attempt.phase("grip")
    try:
        attempt.close_gripper()
    except SkillError:
        attempt.open_gripper()
        attempt.move("retreat", np.concatenate([reach.approach[-1:], reach.lift]), speed=0.6)
        raise
    attempt.move("lift", np.concatenate([reach.approach[-1:], reach.lift]), speed=0.6)
    if attempt.handle.home_pose:
        go_home(attempt)
    attempt.check_held()


def _reachable(attempt: Attempt, item: str, candidates: list[FloatArray]) -> list[_Reach]:
    """The grasps with free straight approach and lift, cheapest first."""
    arm, start = attempt.arm, attempt.body.joints()
    pose = transforms.matrix(attempt.obstacles()[item])
    found: list[_Reach] = []
    for preference, grasp in enumerate(candidates):
        if len(found) >= 2 * _MOST_PLANS:
            break
        attempt.check_cancelled()
        outward = -grasp[:3, 2]
        for seed in arm.kinematics.seeds(grasp, start):
            q = arm.kinematics.solve(grasp, seed)
            if q is None:
                continue
            back = [transforms.translated(grasp, distance * outward) for distance in _APPROACH[::-1]]
            approach = arm.kinematics.line(q, back)
            lift = arm.kinematics.line(q, [transforms.translated(grasp, np.array([0, 0, rise])) for rise in _LIFT])
            if approach is None or lift is None:
                continue
            attempt.update_collisions(ignored=[item])
            if not arm.collision.all_free(np.array([*approach, *lift])).all():
                continue
            held = Held(item, transforms.inverse(grasp) @ pose)
            attempt.update_collisions(held)
            # An item that leans on this one cannot be avoided; it is moved along a little.
            attempt.update_collisions(held, ignored=arm.collision.beside(q))
            if not arm.collision.all_free(np.array(lift[1:])).all():
                continue
            cost = float(np.linalg.norm(approach[-1] - start)) + 0.02 * preference
            cost += _AGAIN * arm.failed_grasps.times(item, pose, grasp)
            found.append(_Reach(grasp, np.array(approach[::-1]), np.array(lift), cost))
            break
    return sorted(found, key=lambda reach: reach.cost)
