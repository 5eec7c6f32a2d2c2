"""pick(item, from): take an item from a table, from a drawer, a container or the top of another item, and hold it clear
of everything."""

from __future__ import annotations

from executive.protocols import SkillContext
from executive.skills import manipulation
from executive.skills.arm import ArmSkill, Attempt, SkillError
from executive.skills.perform import perform
from executive.types import SkillResult, SkillStatus, Step


@ArmSkill
def pick(step: Step, context: SkillContext) -> SkillResult:
    """Grasps `item` from above and lifts it; with a home pose, carries it there. What rests on it or is in the way is
    put down beside it before.

    It reports NOT_THERE when the item is not where the step says, CLOSED when that is a drawer that is, BLOCKED when
    other items are in the way and stay there, UNREACHABLE when no grasp has a free and reachable configuration, NO_PATH
    when there is no motion to one, GRASP_MISSED when the fingers close on nothing, DROPPED when the item slips out,
    TIMED_OUT when the arm is blocked."""
    return perform(step, context, _pick)


def _pick(attempt: Attempt) -> None:
    item, source = attempt.arguments("item", "surface")
    if attempt.holding:
        raise SkillError(SkillStatus.GRASP_MISSED, "the gripper holds something already")
    attempt.open_gripper()
    manipulation.take(attempt, item, source, home=attempt.handle.home_pose)
