"""The arm as skills use it: planned motions followed with the senses awake, and fingers that know when they hold."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import update_wrapper
from weakref import WeakKeyDictionary

import numpy as np

from executive.errors import InputError
from executive.protocols import Skill, SkillContext, Tell
from executive.sim.robot_api import Handle
from executive.skills import collision_kernels, trajectory, transforms
from executive.skills.collision import CollisionModel, Held
from executive.skills.failed_grasps import FailedGrasps
from executive.skills.ik import Kinematics
from executive.skills.motion_planning import MotionPlanner, Path
from executive.types import FloatArray, Motion, Phase, Sense, SkillResult, SkillStatus, Step

OPEN_WIDTH = 0.080
"""m; wider than this the fingers are open."""

CARRYING = 0.7
"""Share of the speed that is gone at with something in the hand."""

_EMPTY_WIDTH = 0.004
"""m; narrower than this the fingers have closed on nothing."""

_SLACK = 0.008
"""m; what is held may shift between the pads by this much before it counts as dropped."""

_FIRM = 0.002
"""m; what has shifted between the pads by less than this is held firmly, whatever those who look on may see."""

_BLOCKED = 0.15
"""rad; a joint that is this far from where it is commanded to be is held up by something. Unhindered, it lags by less
than 0.01."""

_AT_GRIP = 0.02
"""m between the grip point and an item that the fingers are around, at most."""

_WITHDRAW = np.linspace(0.01, 0.10, 10)
"""Heights in m through which a hand that touches something withdraws."""

_GRIP_SECONDS = 0.6
_BRAKE_SECONDS = 0.25


class SkillError(Exception):
    """Ends a skill early with a status and a reason; a drop also by what it was noticed. Raised and caught inside this
    package alone."""

    def __init__(self, status: SkillStatus, reason: str, sense: Sense | None = None) -> None:
        super().__init__(reason)
        self.status, self.reason, self.sense = status, reason, sense


class Arm:
    """Kinematics, collision model and motion planner of one handle, and the grasps that failed with it; built once,
    used by all its skills."""

    def __init__(self, handle: Handle) -> None:
        self.limits = handle.limits  # not the handle itself: it is the weak key under which the arm is kept
        self.kinematics = Kinematics(handle)
        self.collision = CollisionModel(handle)
        self.planner = MotionPlanner(handle.limits, self.collision)
        self.tried = FailedGrasps()


_ARMS: WeakKeyDictionary[Handle, Arm] = WeakKeyDictionary()


def arm_of(handle: Handle) -> Arm:
    """The arm of a handle, built at its first use."""
    if handle not in _ARMS:
        _ARMS[handle] = Arm(handle)
    return _ARMS[handle]


class ArmSkill:
    """A skill that moves the arm: what it calls is compiled before it is first needed."""

    def __init__(self, skill: Skill) -> None:
        self._skill = skill
        update_wrapper(self, skill)

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        return self._skill(step, context)

    def prepare(self, tell: Tell) -> None:
        collision_kernels.ready(tell)


class Attempt:
    """One execution of one step: what it has planned, done and felt so far."""

    def __init__(self, step: Step, context: SkillContext) -> None:
        self.step, self.context = step, context
        self.handle: Handle = context.handle
        self.body = self.handle.body
        self.arm = arm_of(self.handle)
        self._began = self.body.time
        self._ahead = 0.0
        self._last_plan: Path | None = None
        self._grip_width = self.body.gripper_width() if self.holding else None
        self._heard = False

    def item_and_table(self) -> tuple[str, str]:
        """What the step names.

        Raises:
            InputError: the domain gives this skill an action with other parameters.
        """
        match self.step.args:
            case (item, table) if item in self.handle.shapes and table in self.handle.tables:
                return item, table
        raise InputError(f"the skill takes an item and a table, not {self.step}", key=f"actions.{self.step.action}")

    @property
    def holding(self) -> bool:
        """Whether the fingers are around something, as their encoders tell."""
        width = float(self.body.gripper_width())
        return _EMPTY_WIDTH < width < OPEN_WIDTH

    def phase(self, name: str, detail: str = "", seconds: float = 0.0) -> None:
        self.context.announce(Phase(name, detail, seconds))

    def plan(self, goals: Sequence[FloatArray], held: Held | None = None) -> FloatArray | None:
        """A free path (N, 6) from here to one of `goals`, among all items where they are now; None when none is found.

        Raises:
            SkillError: CANCELLED.
        """
        self.heed()
        self.look_around(held)
        seed = int(self.context.rng.integers(2**31))
        found = self.arm.planner.plan(self.body.joints(), goals, seed, keep_tree=self.handle.keep_trees)
        self._last_plan = found
        return None if found is None else found.configurations

    def held(self) -> Held | None:
        """What the fingers are around, as it lies in the hand at this moment; None for an empty hand."""
        if not self.holding:
            return None
        hand, items = self.arm.kinematics.forward(self.body.joints()), self.body.obstacles()
        away = {item: self.handle.shapes[item].distance(pose, hand[:3, 3]) for item, pose in items.items()}
        item = min(away, key=away.__getitem__)
        return Held(item, transforms.inverse(hand) @ transforms.matrix(items[item])) if away[item] < _AT_GRIP else None

    def look_around(self, held: Held | None = None, ignored: Collection[str] = ()) -> None:
        """Bring the collision model up to date."""
        self.arm.collision.update(self.body.obstacles(), self.body.gripper_joints(), held, ignored)

    def move(
        self,
        name: str,
        path: FloatArray,
        *,
        speed: float = 1.0,
        planned: bool = False,
        then: Sequence[FloatArray] = (),
    ) -> None:
        """Follow a path in a phase of its own, and stop early when what is held slips out, when something is in the
        way, or when the run is cancelled. `then` are the paths that were to follow, for telling what time that saves.

        Raises:
            SkillError: DROPPED, TIMED_OUT or CANCELLED, once the arm stands still.
        """
        course = trajectory.timed(path, self.handle.limits, speed)
        found = self._last_plan if planned else None
        configurations = course.samples(0.05)
        tree = None if found is None or found.tree is None else self._ways(found.tree).round(3)
        self.context.announce(
            Motion(
                configurations,
                self._ways(configurations),
                course.seconds,
                "line" if found is None else found.planner,
                0.0 if found is None else found.seconds,
                float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
                tree,
            )
        )
        self.phase(name, seconds=course.seconds)
        period = self.handle.control_period
        elapsed, rate, failure = 0.0, 1.0, None
        while elapsed < course.seconds and rate > 0.0:
            failure = failure or self._felt() or self._blocked(course.position(elapsed))
            if failure is not None:
                rate -= period / _BRAKE_SECONDS  # slow down along the path rather than jerk to a stop
            elapsed += period * max(rate, 0.0)
            self.body.command(course.position(elapsed), course.velocity(elapsed) * max(rate, 0.0))
            self.body.advance()
        if failure is not None:
            later = sum(trajectory.timed(other, self.handle.limits, 0.5).seconds for other in then)
            self._ahead += max(0.0, course.seconds - elapsed) + later
            if failure.status is SkillStatus.TIMED_OUT:
                self.body.command(self.body.joints(), np.zeros_like(path[0]))  # push no further
            raise failure
        self._arrive(course.position(course.seconds))

    def close_gripper(self) -> None:
        """Close until something is held.

        Raises:
            SkillError: GRASP_MISSED when there is nothing between the fingers.
        """
        self._drive_gripper(1.0)
        if not self.holding:
            raise SkillError(SkillStatus.GRASP_MISSED, "the gripper closed on nothing")
        self._grip_width = self.body.gripper_width()

    def open_gripper(self) -> None:
        self._grip_width = None
        self._drive_gripper(0.0)

    def wait(self, seconds: float) -> None:
        """Let the world's time pass."""
        for _ in range(max(1, round(seconds / self.handle.control_period))):
            self.body.advance()

    def still_held(self) -> None:
        """Raises: SkillError: DROPPED when the hand no longer holds what it gripped."""
        failure = self._felt()
        if failure is not None:
            raise failure

    def result(self, status: SkillStatus, reason: str = "", sense: Sense | None = None) -> SkillResult:
        seconds = self.body.time - self._began
        return SkillResult(self.step, status, reason, seconds, seconds + self._ahead, sense, self.holding)

    def heed(self) -> None:
        """The place to stop at, at rest, when the run is cancelled.

        Raises:
            SkillError: CANCELLED.
        """
        if self.context.cancelled():
            raise SkillError(SkillStatus.CANCELLED, "cancelled")

    def _ways(self, configurations: FloatArray) -> FloatArray:
        """Where the end effector is in each of the configurations (..., 6): (..., 3) in m, world frame."""
        points = [self.arm.kinematics.forward(q)[:3, 3] for q in configurations.reshape(-1, configurations.shape[-1])]
        return np.reshape(points, (*configurations.shape[:-1], 3))

    def _felt(self) -> SkillError | None:
        if self.context.cancelled():
            return SkillError(SkillStatus.CANCELLED, "cancelled")
        if self._grip_width is not None:
            shift = abs(self.body.gripper_width() - self._grip_width)
            if shift > _SLACK:
                self._grip_width = None
                return SkillError(SkillStatus.DROPPED, "the fingers no longer feel what they gripped", Sense.FELT)
            if shift > _FIRM and not self._heard and (why := self.context.lost()):
                self._heard = True  # said once; on the way home it is known
                return SkillError(SkillStatus.DROPPED, why, Sense.SEEN)
        return None

    def _blocked(self, commanded: FloatArray) -> SkillError | None:
        if float(np.abs(self.body.joints() - commanded).max()) <= _BLOCKED:
            return None
        return SkillError(SkillStatus.TIMED_OUT, "the arm does not get where it is sent: something is in the way")

    def _arrive(self, goal: FloatArray) -> None:
        """Wait for the servos to come to rest at `goal`.

        Raises:
            SkillError: TIMED_OUT when they are far from it after a second.
        """
        for _ in range(round(1.0 / self.handle.control_period)):
            if float(np.abs(self.body.joints() - goal).max()) < 0.004:
                return
            self.body.command(goal, np.zeros_like(goal))
            self.body.advance()
        if failure := self._blocked(goal):
            raise failure

    def _drive_gripper(self, closed: float) -> None:
        steps = round(_GRIP_SECONDS / self.handle.control_period)
        start = 1.0 - closed
        for index in range(steps):
            self.body.command_gripper(start + (closed - start) * min(1.0, 1.5 * (index + 1) / steps))
            self.body.advance()


def perform(step: Step, context: SkillContext, work: Callable[[Attempt], None]) -> SkillResult:
    """Run a skill's work and report how it ended. After a failure the arm goes home, if that is how actions end."""
    attempt = Attempt(step, context)
    try:
        work(attempt)
    except SkillError as failure:
        reason = failure.reason
        if failure.status is not SkillStatus.CANCELLED:
            if failure.sense is Sense.FELT:
                attempt.open_gripper()  # for all to see; who looks on may be mistaken, and let fall what is held
            attempt.wait(0.4)  # let what fell come to rest
            if attempt.handle.home_pose:
                try:
                    go_home(attempt)
                except SkillError as second:
                    reason = f"{reason}; then, on the way home: {second.reason}"
        return attempt.result(failure.status, reason, failure.sense)
    return attempt.result(SkillStatus.DONE)


def withdraw(attempt: Attempt, held: Held | None) -> None:
    """Move straight up until nothing touches any more, where the arm or what it holds touches something; not at all
    where there is no such way.

    Raises:
        SkillError: whatever ends the motion.
    """
    start = attempt.body.joints()
    attempt.look_around(held)
    if attempt.arm.collision.free(start):
        return
    here = attempt.arm.kinematics.forward(start)
    up = attempt.arm.kinematics.line(start, [transforms.translated(here, np.array([0, 0, rise])) for rise in _WITHDRAW])
    clear = [index for index, q in enumerate(up or []) if attempt.arm.collision.free(q)]
    if up is not None and clear:
        attempt.move("retreat", np.array([start, *up[: clear[0] + 1]]), speed=0.4)


def go_home(attempt: Attempt) -> None:
    """Move to the home pose, with what the hand holds; straight up first where the arm touches something.

    Raises:
        SkillError: NO_PATH when none is found, or whatever ends the motion.
    """
    held = attempt.held()
    withdraw(attempt, held)
    path = attempt.plan([attempt.handle.limits.home], held)
    if path is None:
        raise SkillError(SkillStatus.NO_PATH, "no collision-free motion to the home pose")
    if held is None:
        attempt.move("home", path, planned=True)
    else:
        attempt.move("transfer", path, speed=CARRYING, planned=True)
