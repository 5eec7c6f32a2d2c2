"""Two skills of one's own for the arm of the included simulator, made of the parts in `executive.skills`."""

from __future__ import annotations

import numpy as np

from executive import SkillContext, SkillResult, SkillStatus, Step
from executive.skills import (
    ArmSkill,
    Attempt,
    SkillError,
    approach,
    carry,
    check_rests,
    close_fist,
    go_home,
    in_hand,
    is_free,
    look,
    perform,
    reach,
    release,
    retreat,
    spots_for,
    surface,
)


@ArmSkill
def stack(step: Step, context: SkillContext) -> SkillResult:
    """stack(item, below): put the item in the hand on top of another one."""

    def work(attempt: Attempt) -> None:
        item, below = attempt.arguments("item", "item")
        held, top = in_hand(attempt, item), surface(attempt, below)
        way = carry(attempt, held, spots_for(attempt, held, top), below)
        release(attempt)
        retreat(attempt, way)
        go_home(attempt)
        check_rests(attempt, item, below)

    return perform(step, context, work)


@ArmSkill
def push(step: Step, context: SkillContext) -> SkillResult:
    """push(item, table): push an item to the middle of its table with closed fingers."""

    def work(attempt: Attempt) -> None:
        item, table = attempt.arguments("item", "table")
        close_fist(attempt)
        pose, top = look(attempt, item), surface(attempt, table)
        away = (top.centre - pose[:3, 3]) * [1.0, 1.0, 0.0]
        distance = float(np.linalg.norm(away))
        along = away / max(distance, 1e-6)
        behind = attempt.handle.shapes[item].reach(pose[:3, :3].T @ along) + 0.03
        hand = np.eye(4)  # straight down, its broad side towards the item
        hand[:3, :3] = np.stack([np.cross(along, [0, 0, 1]), -along, [0, 0, -1]], axis=1)
        hand[:3, 3] = [*(pose[:2, 3] - behind * along[:2]), top.centre[2] + 0.03]
        down = np.linspace(0.12, 0.0, 8)[:, None] * [0.0, 0.0, 1.0]
        on = np.arange(0.01, distance + 0.03, 0.01)[:, None] * along
        way = reach(attempt, hand, down, on, lambda way: is_free(attempt, [*way.into, *way.out], ignored=[item]))
        if way is None:
            raise SkillError(SkillStatus.UNREACHABLE, f"there is no way to push {item} along")
        approach(attempt, [way], item)
        attempt.move("push", way.out, speed=0.3)
        attempt.move("retreat", way.out[:-5:-1], speed=0.6)
        go_home(attempt)
        check_rests(attempt, item, table)

    return perform(step, context, work)
