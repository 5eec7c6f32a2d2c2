"""How a skill begins and ends: what it reports, and the way home."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from executive.protocols import SkillContext
from executive.skills import transforms
from executive.skills.arm import CARRYING, Attempt, SkillError
from executive.skills.collision import Held
from executive.skills.in_the_way import no_motion
from executive.types import Sense, SkillResult, SkillStatus, Step

_WITHDRAW = np.linspace(0.01, 0.10, 10)
"""Heights in m of the waypoints of a withdrawal from a contact."""


def perform(step: Step, context: SkillContext, work: Callable[[Attempt], None]) -> SkillResult:
    """Runs a skill and reports how it ended. After a failure the arm goes home, if actions end there."""
    attempt = Attempt(step, context)
    try:
        work(attempt)
    except SkillError as failure:
        reason = failure.reason
        if failure.status is not SkillStatus.CANCELLED:
            if failure.sense is Sense.FELT:
                attempt.open_gripper()  # on a felt drop alone: cameras may be wrong, and opening would drop the item
            attempt.wait(0.4)  # let what fell come to rest
            if attempt.handle.home_pose:
                try:
                    go_home(attempt)
                except SkillError as second:
                    reason = f"{reason}; then, on the way home: {second.reason}"
        return attempt.result(failure.status, reason, failure.sense, failure.blockers)
    return attempt.result(SkillStatus.DONE)


def withdraw(attempt: Attempt, held: Held | None) -> None:
    """Moves straight up until the arm and the held item are free of contact; does nothing if they are free already, or
    if there is no such path.

    Raises:
        SkillError: whatever ends the motion.
    """
    start = attempt.body.joints()
    attempt.update_collisions(held)
    if attempt.arm.collision.free(start):
        return
    here = attempt.arm.kinematics.forward(start)
    up = attempt.arm.kinematics.line(start, [transforms.translated(here, np.array([0, 0, rise])) for rise in _WITHDRAW])
    clear = [index for index, q in enumerate(up or []) if attempt.arm.collision.free(q)]
    if up is not None and clear:
        attempt.move("retreat", np.array([start, *up[: clear[0] + 1]]), speed=0.4)


def go_home(attempt: Attempt) -> None:
    """Moves to the home pose with the held item; straight up first where the arm is in contact.

    Raises:
        SkillError: NO_PATH when none is found, BLOCKED where items are in the way of all, or whatever ends the motion.
    """
    held, home = attempt.held(), attempt.handle.limits.home
    withdraw(attempt, held)
    path = attempt.plan([home], held)
    if path is None:
        raise no_motion(attempt, [home], held, "the home pose")
    if held is None:
        attempt.move("home", path, planned=True)
    else:
        attempt.move("transfer", path, speed=CARRYING, planned=True)
