"""move(item, to): take an item from wherever it is, and put it on a table, into a region, or on top of another item."""

from __future__ import annotations

from executive.protocols import SkillContext
from executive.skills import manipulation, towers
from executive.skills.arm import ArmSkill, Attempt, SkillError
from executive.skills.perform import go_home, perform
from executive.types import SkillResult, SkillStatus, Step


@ArmSkill
def move(step: Step, context: SkillContext) -> SkillResult:
    """Takes `item`, if the hand does not hold it already, and puts it down as `place` does; with a home pose, moves
    there afterwards. In a region where something stands it is put on top of that.

    It reports what `pick` and `place` report.
    """
    return perform(step, context, _move)


def _move(attempt: Attempt) -> None:
    item, target = attempt.arguments("item", "surface")
    held = attempt.held()
    if held is None or held.item != item:
        if attempt.holding:
            raise SkillError(SkillStatus.GRASP_MISSED, "the gripper holds something already")
        attempt.open_gripper()
        source = towers.carrier(attempt, item)
        if source is None:
            raise SkillError(SkillStatus.NOT_THERE, f"{item} is on nothing that it can be taken from")
        manipulation.take(attempt, item, source)
    below = towers.tower(attempt, target)
    manipulation.put(attempt, item, target)
    if attempt.handle.home_pose:
        go_home(attempt)
    towers.check_stands(attempt, below)
    manipulation.check_rests(attempt, item, target)
