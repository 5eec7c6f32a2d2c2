"""Moving the arm out of the cameras' view: home(...) and aside(...), which change the view alone.

They are skills like any other, but no action of a plan names them: a domain lists them under [looking], and the loop
calls them when a relevant atom is uncertain. A held item is carried along.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from executive.protocols import SkillContext
from executive.skills.arm import CARRYING, ArmSkill, Attempt, SkillError
from executive.skills.perform import go_home, perform
from executive.types import FloatArray, SkillResult, SkillStatus, Step, about_vertical

_THERE = 0.02
"""rad of distance from the target below which a joint need not move."""

_TURNS = (0.0, 0.35, -0.35, 0.7, -0.7, 1.05, -1.05)
_LEANS = (0.0, -0.25, -0.5)
"""rad by which the base is turned and the shoulder leant back, relative to the present configuration."""

_ABOVE = (0.03, 0.15)
"""The range of heights in m over a table's top that items occupy."""

_ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)
"""The grid of view points on a table, as shares of its sides from its centre."""


@ArmSkill
def home(step: Step, context: SkillContext) -> SkillResult:
    """Moves to the home pose, in no time if the arm is there already.

    It reports NO_PATH, DROPPED, TIMED_OUT or CANCELLED as the motion ends.
    """
    return perform(step, context, _home)


@ArmSkill
def aside(step: Step, context: SkillContext) -> SkillResult:
    """Moves to a nearby configuration that occludes less of the tables among the step's arguments (of all, if none is
    among them). It takes no time if the arm occludes nothing, or no nearby configuration is better.

    It reports NO_PATH, DROPPED, TIMED_OUT or CANCELLED as the motion ends.
    """
    return perform(step, context, _aside)


def view_points(attempt: Attempt) -> FloatArray:
    """The points (N, 3) over the tables that the cameras should see."""
    tables = attempt.handle.tables
    wanted = [tables[name] for name in attempt.step.args if name in tables] or list(tables.values())
    points = []
    for table in wanted:
        turn = about_vertical(table.yaw)[:2, :2]
        for x, y, z in product(_ACROSS, _ACROSS, _ABOVE):
            flat = turn @ (np.array([x, y]) * np.array(table.size[:2]))
            points.append(np.array(table.centre) + np.array([*flat, z]))
    return np.array(points)


def _home(attempt: Attempt) -> None:
    if float(np.abs(attempt.body.joints() - attempt.handle.limits.home).max()) > _THERE:
        go_home(attempt)


def _aside(attempt: Attempt) -> None:
    held, here = attempt.held(), attempt.body.joints()
    attempt.update_collisions(held)
    cameras, points = np.stack(list(attempt.handle.camera_positions.values())), view_points(attempt)
    hidden = attempt.arm.collision.hides(here, cameras, points)
    if not hidden:
        return
    better = sorted(
        (count, float(np.abs(q - here).max()), index, q)
        for index, q in enumerate(_near(attempt, here))
        if (count := attempt.arm.collision.hides(q, cameras, points)) < hidden
    )
    if not better:
        return
    path = attempt.plan([better[0][3]], held)
    if path is None:
        raise SkillError(SkillStatus.NO_PATH, "no collision-free motion out of the line of sight")
    if held is None:
        attempt.move("aside", path, planned=True)
    else:
        attempt.move("transfer", path, speed=CARRYING, planned=True)


def _near(attempt: Attempt, here: FloatArray) -> list[FloatArray]:
    """Free configurations around `here`, within the joints' limits."""
    limits, found = attempt.handle.limits, []
    for turn in _TURNS:
        for lean in _LEANS:
            q = here + np.array([turn, lean, 0.0, 0.0, 0.0, 0.0])
            if np.all(q > limits.lower) and np.all(q < limits.upper) and attempt.arm.collision.free(q):
                found.append(q)
    return found
