"""place(item, table): put the held item down on a free spot of a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executive.protocols import SkillContext
from executive.sim import footprint
from executive.skills import grasps, transforms
from executive.skills.arm import CARRYING, ArmSkill, Attempt, SkillError, go_home, perform, withdraw
from executive.skills.collision import Held
from executive.types import FloatArray, SkillResult, SkillStatus, Step

_LOWER = np.linspace(0.10, 0.0, 8)
"""Heights above the final pose in m through which the item is lowered straight down."""

_RETREAT = np.linspace(0.015, 0.10, 6)
"""Distances from the released item in m through which the hand withdraws."""

_MOST_PLANS = 6


@dataclass(frozen=True, slots=True, eq=False)
class _Lowering:
    """A way to put the item down: the lowering and the retreat, (N, 6) each, and what getting there costs."""

    lower: FloatArray
    retreat: FloatArray
    cost: float


@ArmSkill
def place(step: Step, context: SkillContext) -> SkillResult:
    """Puts the held `item` on a free spot of `table`; with a home pose, moves there afterwards.

    It reports NOT_THERE when the hand does not hold the item, DOES_NOT_FIT when it is larger than the table as it is
    held, UNREACHABLE when no free spot is within reach, NO_PATH when none can be got to, DROPPED when the item slips
    out on the way, TIMED_OUT when the arm is held up.
    """
    return perform(step, context, _place)


def _place(attempt: Attempt) -> None:
    item, table = attempt.item_and_table()
    held = attempt.held()
    if held is None or held.item != item:
        raise SkillError(SkillStatus.NOT_THERE, f"the gripper does not hold {item}")
    withdraw(attempt, held)  # where it was gripped and not yet lifted
    attempt.phase("plan", f"a spot on {table}")
    lowerings = _lowerings(attempt, held, table)
    if not lowerings:
        raise SkillError(SkillStatus.UNREACHABLE, f"no free spot on {table} is within reach")
    for lowering in lowerings[:_MOST_PLANS]:
        path = attempt.plan([lowering.lower[0]], held)
        if path is not None:
            break
    else:
        raise SkillError(SkillStatus.NO_PATH, f"no collision-free motion to {table}")
    attempt.move("transfer", path, speed=CARRYING, planned=True, then=[lowering.lower, lowering.retreat])
    attempt.move("lower", lowering.lower, speed=0.5)
    attempt.check_held()
    attempt.phase("release")
    attempt.open_gripper()
    attempt.move("retreat", np.concatenate([lowering.lower[-1:], lowering.retreat]), speed=0.6)
    if attempt.handle.home_pose:
        go_home(attempt)


def _lowerings(attempt: Attempt, held: Held, table: str) -> list[_Lowering]:
    """Ways to put the held item down that are reachable and free, the roomiest spot's cheapest first."""
    arm, start = attempt.arm, attempt.body.joints()
    shape, top = attempt.handle.shapes[held.item], attempt.handle.tables[table]
    others = {name: pose for name, pose in attempt.obstacles().items() if name != held.item}
    now = arm.kinematics.forward(start) @ held.in_hand
    upright = grasps.resting(now, shape)
    found: list[_Lowering] = []
    if not grasps.fits(upright, shape, top):
        raise SkillError(SkillStatus.DOES_NOT_FIT, f"{held.item} does not fit on {table}, {footprint.top(top)}")
    for spot, yaws in grasps.spots(upright, shape, top, others, attempt.handle.shapes, attempt.context.rng):
        attempt.check_cancelled()
        for yaw in yaws:
            target = np.eye(4)
            target[:3, :3] = Rotation.from_euler("z", float(yaw)).as_matrix() @ upright
            target[:3, 3] = spot - target[:3, :3] @ shape.centre
            lowering = _lowering(attempt, held, target @ transforms.inverse(held.in_hand), start)
            if lowering is not None:
                found.append(lowering)
        if len(found) >= _MOST_PLANS:
            break
    return sorted(found, key=lambda lowering: lowering.cost)


def _lowering(attempt: Attempt, held: Held, hand: FloatArray, start: FloatArray) -> _Lowering | None:
    arm = attempt.arm
    for seed in arm.kinematics.seeds(hand, start):
        q = arm.kinematics.solve(hand, seed)
        if q is None:
            continue
        lower = arm.kinematics.line(q, [transforms.translated(hand, np.array([0, 0, rise])) for rise in _LOWER[::-1]])
        retreat = arm.kinematics.line(q, [transforms.translated(hand, -away * hand[:3, 2]) for away in _RETREAT])
        if lower is None or retreat is None:
            continue
        attempt.update_collisions(held)
        if not arm.collision.all_free(np.array(lower[2:])).all():
            continue  # the lowest points are left out: there the item is about to touch the table
        attempt.update_collisions(ignored=[held.item])
        if not arm.collision.all_free(np.array([*lower, *retreat])).all():
            continue
        return _Lowering(np.array(lower[::-1]), np.array(retreat), float(np.linalg.norm(lower[-1] - start)))
    return None
