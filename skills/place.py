"""place(item, on): put the held item down on a free spot of a table, a drawer or a container, or on top of another
item."""

from __future__ import annotations

from executive.protocols import SkillContext
from executive.skills import manipulation, towers
from executive.skills.arm import ArmSkill, Attempt
from executive.skills.perform import go_home, perform
from executive.types import SkillResult, Step


@ArmSkill
def place(step: Step, context: SkillContext) -> SkillResult:
    """Puts the held `item` on a free spot of a table, into an open drawer, or on the middle of another item; with a
    home pose, moves there afterwards. At the end it looks whether the item rests there.

    It reports NOT_THERE when the hand does not hold the item, CLOSED when the target is a drawer that is, DOES_NOT_FIT
    when it is larger than the table as it is held, BLOCKED when other items leave no room or no way, UNREACHABLE when
    no free spot is within reach, NO_PATH when none can be got to, DROPPED when the item slips out on the way, FELL when
    it did not stay where it was put, COLLAPSED when what it was put on fell, TIMED_OUT when the arm is held up.
    """
    return perform(step, context, _place)


def _place(attempt: Attempt) -> None:
    item, target = attempt.arguments("item", "surface")
    below = towers.tower(attempt, target)
    manipulation.put(attempt, item, target)
    if attempt.handle.home_pose:
        go_home(attempt)
    towers.check_stands(attempt, below)
    manipulation.check_rests(attempt, item, target)
