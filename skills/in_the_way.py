"""What is in the way: the items but for which something would work."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import pairwise

from executive.skills.arm import Attempt, SkillError
from executive.skills.collision import Held
from executive.types import FloatArray, SkillStatus


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


def no_motion(attempt: Attempt, goals: Sequence[FloatArray], held: Held | None, what: str) -> SkillError:
    """Returns the failure of a motion to one of `goals` (6,) for which no path was found: BLOCKED where there would be
    one but for other items, else NO_PATH. `what` the motion leads to, an item or something else, is for the message."""
    found = _on_the_path(attempt, goals, held, what)
    if found:
        message = f"{', '.join(found)} in the way of every motion to {what}"
        return SkillError(SkillStatus.BLOCKED, message, blockers=found)
    return SkillError(SkillStatus.NO_PATH, f"no collision-free motion to {what}")


def _on_the_path(attempt: Attempt, goals: Sequence[FloatArray], held: Held | None, to: str) -> tuple[str, ...]:
    """The items that stand on a path which there would be without any items but the one that it leads to; where there
    would be another path without some of these alone, those (see `blockers`)."""
    carried = set[str]() if held is None else set(held.carried)
    known = sorted(attempt.obstacles().keys() - attempt.handle.unknown - carried - {to})
    attempt.update_collisions(held)
    if not attempt.arm.collision.free(attempt.body.joints()):
        return ()  # the arm touches something, and with another item elsewhere it would not get away either
    with attempt.without(known):
        path = attempt.plan(goals, held)
    if path is None:
        return ()
    touched = [item for item in known if _touches(attempt, path, held, set(known) - {item})]

    def plan() -> None:
        if attempt.plan(goals, held) is None:
            raise SkillError(SkillStatus.NO_PATH, "")

    return tuple(touched) if len(touched) == 1 else blockers(attempt, touched, plan)


def _touches(attempt: Attempt, path: FloatArray, held: Held | None, absent: Collection[str]) -> bool:
    """Whether something is touched along a path (N, 6) where some items are absent."""
    with attempt.without(absent):
        attempt.update_collisions(held)
        return not all(attempt.arm.collision.edge_free(start, goal) for start, goal in pairwise(path))
