"""The arm as skills use it: planned motions that are executed under supervision, and a gripper with grasp detection."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import update_wrapper
from typing import Literal
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
from executive.skills.surfaces import rests_on
from executive.types import FloatArray, Motion, Phase, PosesEstimated, Sense, SkillResult, SkillStatus, Step

OPEN_WIDTH = 0.080
"""m; wider than this the fingers are open."""

CARRYING = 0.7
"""The share of the speed limits that is used while carrying."""

_EMPTY_WIDTH = 0.004
"""m; narrower than this the fingers have closed on nothing."""

_SLACK = 0.008
"""m by which a held item may shift between the pads before it counts as dropped."""

_FIRM = 0.002
"""m of shift between the pads below which an item is held, whatever the cameras report."""

_PRIED = 0.003
"""m of shift between the pads from which on something forces them apart."""

_BLOCKED = 0.15
"""rad of tracking error of a joint from which on it counts as blocked. Unhindered, it lags by less than 0.01."""

_AT_GRIP = 0.02
"""The largest distance in m of the grip point from an item that the fingers are around."""

_UNCERTAIN = 0.004
"""m of standard deviation above which an estimated position is looked at again."""

_LOOKS_AGAIN, _LOOK_SECONDS = 2, 0.2

_KINDS = {
    "item": "an item",
    "table": "a table",
    "surface": "a table, a region, a drawer, a container or another item",
    "drawer": "a drawer",
}

_WIDTH_OF = (-0.0093, -0.0752, 0.0854)
"""The width in m between the pads of fingers that are closed by a share s, as a s^2 + b s + c."""

_GRIP_SECONDS = 0.6
_BRAKE_SECONDS = 0.25


class SkillError(Exception):
    """Ends a skill early with a status and a reason; a drop also has the sense that detected it. It is raised and
    caught inside this package alone."""

    def __init__(
        self, status: SkillStatus, reason: str, sense: Sense | None = None, blockers: Sequence[str] = ()
    ) -> None:
        super().__init__(reason)
        self.status, self.reason, self.sense, self.blockers = status, reason, sense, tuple(blockers)


class Arm:
    """Kinematics, collision model and motion planner of one handle, and its failed grasps; built once, and shared by
    all skills."""

    def __init__(self, handle: Handle) -> None:
        self.limits = handle.limits  # not the handle itself: it is the weak key under which the arm is kept
        self.kinematics = Kinematics(handle)
        self.collision = CollisionModel(handle)
        self.planner = MotionPlanner(handle.limits, self.collision)
        self.failed_grasps = FailedGrasps()


_ARMS: WeakKeyDictionary[Handle, Arm] = WeakKeyDictionary()


def arm_of(handle: Handle) -> Arm:
    """The arm of a handle, built at its first use."""
    if handle not in _ARMS:
        _ARMS[handle] = Arm(handle)
    return _ARMS[handle]


class ArmSkill:
    """A skill that moves the arm: `prepare` compiles the collision kernels before they are needed, and `warm_up` builds
    the arm."""

    def __init__(self, skill: Skill) -> None:
        self._skill = skill
        update_wrapper(self, skill)

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        return self._skill(step, context)

    def prepare(self, tell: Tell) -> None:
        collision_kernels.ready(tell)

    def warm_up(self, handle: Handle) -> None:
        """Build the handle's arm, unless `prepare` has something to compile first, and to say so."""
        if collision_kernels.are_kept():
            arm_of(handle)


class Attempt:
    """The state of one execution of a step."""

    def __init__(self, step: Step, context: SkillContext) -> None:
        self.step, self.context = step, context
        self.handle: Handle = context.handle
        self.body = self.handle.body
        self.arm = arm_of(self.handle)
        self._began = self.body.time
        self._ahead = 0.0
        self._last_plan: Path | None = None
        self._grip_width = self.body.gripper_width() if self.holding else None
        self._reported_lost = False
        self._announced: PosesEstimated | None = None
        self._absent: frozenset[str] = frozenset()

    def arguments(self, *kinds: Literal["item", "table", "surface", "drawer"]) -> tuple[str, ...]:
        """Returns the arguments of the step, each of the kind that is named for it: an item, a table, a drawer, or a
        surface, which is a table, a region of one, a drawer, a container, or another item.

        Raises:
            InputError: the domain gives this skill an action with other parameters.
        """
        args, handle = self.step.args, self.handle
        items, tables, drawers = handle.shapes.keys() - handle.unknown, handle.tables.keys(), handle.drawers.keys()
        surfaces = items | tables | handle.regions.keys() | drawers | handle.containers.keys()
        names = {"item": items, "table": tables, "surface": surfaces, "drawer": drawers}
        fit = len(args) == len(kinds) and all(arg in names[kind] for arg, kind in zip(args, kinds, strict=True))
        if fit and len(set(args)) == len(args):
            return args
        wanted = " and ".join(_KINDS[kind] for kind in kinds)
        raise InputError(f"the skill takes {wanted}, not {self.step}", key=f"actions.{self.step.action}")

    @property
    def holding(self) -> bool:
        """Whether the gripper holds something, by its encoders."""
        width = float(self.body.gripper_width())
        return _EMPTY_WIDTH < width < OPEN_WIDTH

    def phase(self, name: str, detail: str = "", seconds: float = 0.0) -> None:
        self.context.announce(Phase(name, detail, seconds))

    def plan(self, goals: Sequence[FloatArray], held: Held | None = None) -> FloatArray | None:
        """Plans a free path (N, 6) to one of `goals`, among all items where they are now; None when none is found.

        Raises:
            SkillError: CANCELLED.
        """
        self.check_cancelled()
        self.update_collisions(held)
        seed = int(self.context.rng.integers(2**31))
        found = self.arm.planner.plan(self.body.joints(), goals, seed, keep_tree=self.handle.keep_trees)
        self._last_plan = found
        return None if found is None else found.configurations

    def locate(self, item: str) -> FloatArray:
        """The pose (7,) of an item. Where it is estimated and not well known, it is looked at again.

        Raises:
            SkillError: NOT_THERE where it is seen nowhere.
        """
        pose: FloatArray | None = self.body.locate(item)
        for _ in range(_LOOKS_AGAIN):
            if pose is not None and self.spread(item) <= _UNCERTAIN:
                break
            if self.body.estimated_poses() is None:
                break
            self.wait(_LOOK_SECONDS)  # another moment, other noise
            pose = self.body.locate(item)
        self._announce_poses()
        if pose is None:
            raise SkillError(SkillStatus.NOT_THERE, f"{item} is seen nowhere")
        return pose

    def spread(self, item: str) -> float:
        """How uncertain the last estimate of an item's position is, as a standard deviation in m; 0 where positions are
        not estimated."""
        estimate = self.body.estimated_poses()
        return 0.0 if estimate is None or item not in estimate.poses else estimate.poses[item].spread

    def obstacles(self) -> dict[str, FloatArray]:
        """The poses (7,) of all that is in the way."""
        poses: dict[str, FloatArray] = self.body.obstacles()
        self._announce_poses()
        return {name: pose for name, pose in poses.items() if name not in self._absent}

    @contextmanager
    def without(self, items: Collection[str]) -> Iterator[None]:
        """Has some items count as absent meanwhile, to find out what is in the way."""
        self._absent, before = self._absent | frozenset(items), self._absent
        try:
            yield
        finally:
            self._absent = before

    def held(self) -> Held | None:
        """The item in the gripper with its present pose in it; None for an empty gripper."""
        if not self.holding:
            return None
        hand = self.arm.kinematics.forward(self.body.joints())
        items = {item: pose for item, pose in self.obstacles().items() if item not in self.handle.unknown}
        away = {item: self.handle.shapes[item].distance(pose, hand[:3, 3]) for item, pose in items.items()}
        item = min(away, key=away.__getitem__, default="")
        if not item or away[item] >= _AT_GRIP:
            return None
        inverse = transforms.inverse(hand)
        riders = {name: inverse @ pose for name, pose in self.riders(item).items()}
        return Held(item, inverse @ transforms.matrix(items[item]), riders)

    def riders(self, item: str) -> dict[str, FloatArray]:
        """The poses (4, 4) of what rests on an item, directly or on other such things, the lowest first."""
        shapes, poses = self.handle.shapes, {name: transforms.matrix(pose) for name, pose in self.obstacles().items()}
        found: dict[str, FloatArray] = {}
        below = [item]
        while below:
            lower = below.pop(0)
            for name in poses.keys() - {item} - found.keys() - self.handle.unknown if lower in poses else ():
                if rests_on(poses[name], shapes[name], poses[lower], shapes[lower]):
                    found[name] = poses[name]
                    below.append(name)
        return found

    def update_collisions(self, held: Held | None = None, ignored: Collection[str] = ()) -> None:
        """Updates the collision model."""
        opened = self.body.openings() if self.handle.drawers else {}
        self.arm.collision.update(self.obstacles(), self.body.gripper_joints(), held, ignored, opened)

    def _announce_poses(self) -> None:
        """Puts estimated poses into the trace, once."""
        estimate = self.body.estimated_poses()
        if estimate is not None and estimate is not self._announced:
            self._announced = estimate
            self.context.announce(estimate)

    def move(
        self,
        name: str,
        path: FloatArray,
        *,
        speed: float = 1.0,
        planned: bool = False,
        then: Sequence[FloatArray] = (),
        yields: float | None = None,
    ) -> bool:
        """Executes a path as a phase, and stops early when the held item slips out, when the arm is blocked, or when
        the run is cancelled. `then` are the paths that were to follow, for the estimate of the time saved.

        With `yields`, it stops where the hand is held back: where it lags so many m behind what was commanded, or the
        fingers are pried apart; returns whether it got to the end.

        Raises:
            SkillError: DROPPED, TIMED_OUT or CANCELLED, once the arm stands still.
        """
        motion = trajectory.timed(path, self.handle.limits, speed)
        found = self._last_plan if planned else None
        configurations = motion.samples(0.05)
        tree = None if found is None or found.tree is None else self._grip_points(found.tree).round(3)
        self.context.announce(
            Motion(
                configurations,
                self._grip_points(configurations),
                motion.seconds,
                "line" if found is None else found.planner,
                0.0 if found is None else found.seconds,
                float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
                tree,
            )
        )
        self.phase(name, seconds=motion.seconds)
        period = self.handle.control_period
        elapsed, rate, failure = 0.0, 1.0, None
        while elapsed < motion.seconds and rate > 0.0:
            if yields is not None and (self._pried() or self._lag(motion.position(elapsed)) > yields):
                self.body.command(self.body.joints(), np.zeros_like(path[0]))
                self.wait(_BRAKE_SECONDS)
                self.check_held()
                return False
            failure = failure or self._felt() or self._blocked(motion.position(elapsed))
            if failure is not None:
                rate -= period / _BRAKE_SECONDS  # slow down along the path rather than jerk to a stop
            elapsed += period * max(rate, 0.0)
            self.body.command(motion.position(elapsed), motion.velocity(elapsed) * max(rate, 0.0))
            self.body.advance()
        if failure is not None:
            later = sum(trajectory.timed(other, self.handle.limits, 0.5).seconds for other in then)
            self._ahead += max(0.0, motion.seconds - elapsed) + later
            if failure.status is SkillStatus.TIMED_OUT:
                self.body.command(self.body.joints(), np.zeros_like(path[0]))  # push no further
            raise failure
        self._arrive(motion.position(motion.seconds))
        return True

    def close_gripper(self) -> None:
        """Closes the gripper on an item.

        Raises:
            SkillError: GRASP_MISSED when there is nothing between the fingers.
        """
        self._drive_gripper(1.0)
        if not self.holding:
            raise SkillError(SkillStatus.GRASP_MISSED, "the gripper closed on nothing")
        self.note_grip()

    def note_grip(self) -> None:
        """What is between the fingers now is held: from here on it counts as dropped where they feel it no longer."""
        self._grip_width = self.body.gripper_width()
        if self.body.estimated_poses() is not None:
            self.held()  # whoever estimates poses learns that it is held while it still is where it was

    def servo(self, goal: FloatArray, seconds: float, closed_from: float, closed_to: float) -> None:
        """Moves straight to a configuration (6,) near by within some seconds, and the fingers from one share of their
        way to another. For a motion that is decided upon while it goes on: nothing plans it or checks for collisions.

        Raises:
            SkillError: DROPPED, TIMED_OUT or CANCELLED, with the arm told to stand where it is.
        """
        start, period = self.body.joints(), self.handle.control_period
        ticks = max(1, round(seconds / period))
        # No faster than the limits, wherever the goal is.
        slower = max(1.0, float((np.abs(goal - start) / (seconds * self.handle.limits.velocity)).max()))
        for tick in range(1, ticks + 1):
            at = start + tick / ticks / slower * (goal - start)
            if failure := self._felt() or self._blocked(at):
                self.body.command(self.body.joints(), np.zeros_like(start))
                self.wait(_BRAKE_SECONDS)
                raise failure
            self.body.command(at, (goal - start) / slower / seconds)
            self.body.command_gripper(closed_from + tick / ticks * (closed_to - closed_from))
            self.body.advance()

    def close_fist(self) -> None:
        """Closes the gripper on nothing."""
        self._drive_gripper(1.0)

    def shape_gripper(self, width: float) -> None:
        """Opens or closes the gripper to a width in m between the pads, with nothing in its way."""
        self._grip_width = None
        self._drive_gripper(_closed(width), _closed(float(self.body.gripper_width())))

    def open_gripper(self) -> None:
        self._grip_width = None
        self._drive_gripper(0.0)

    def wait(self, seconds: float) -> None:
        """Waits for a span of the world's time."""
        for _ in range(max(1, round(seconds / self.handle.control_period))):
            self.body.advance()

    def check_held(self) -> None:
        """Raises: SkillError: DROPPED when the gripper no longer holds the item."""
        failure = self._felt()
        if failure is not None:
            raise failure

    def result(
        self, status: SkillStatus, reason: str = "", sense: Sense | None = None, blockers: tuple[str, ...] = ()
    ) -> SkillResult:
        seconds = self.body.time - self._began
        return SkillResult(self.step, status, reason, seconds, seconds + self._ahead, sense, self.holding, blockers)

    def check_cancelled(self) -> None:
        """Ends the skill at rest when the run is cancelled.

        Raises:
            SkillError: CANCELLED.
        """
        if self.context.cancelled():
            raise SkillError(SkillStatus.CANCELLED, "cancelled")

    def _grip_points(self, configurations: FloatArray) -> FloatArray:
        """The positions of the grip point at configurations (..., 6): (..., 3) in m, world frame."""
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
            if shift > _FIRM and not self._reported_lost and (why := self.context.lost()):
                self._reported_lost = True  # reported once; on the way home it is known
                return SkillError(SkillStatus.DROPPED, why, Sense.SEEN)
        return None

    def _pried(self) -> bool:
        """Whether what is gripped forces the fingers apart."""
        return self._grip_width is not None and abs(self.body.gripper_width() - self._grip_width) > _PRIED

    def _lag(self, commanded: FloatArray) -> float:
        """How far in m the grip point is from where the arm is commanded to have it, by its own joints."""
        here, there = (self.arm.kinematics.forward(q)[:3, 3] for q in (self.body.joints(), commanded))
        return float(np.linalg.norm(here - there))

    def _blocked(self, commanded: FloatArray) -> SkillError | None:
        if float(np.abs(self.body.joints() - commanded).max()) <= _BLOCKED:
            return None
        return SkillError(SkillStatus.TIMED_OUT, "the arm does not get where it is sent: something is in the way")

    def _arrive(self, goal: FloatArray) -> None:
        """Waits until the servos come to rest at `goal`.

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

    def _drive_gripper(self, closed: float, start: float | None = None) -> None:
        steps = round(_GRIP_SECONDS / self.handle.control_period)
        start = 1.0 - closed if start is None else start
        for index in range(steps):
            self.body.command_gripper(start + (closed - start) * min(1.0, 1.5 * (index + 1) / steps))
            self.body.advance()


def _closed(width: float) -> float:
    """How far the fingers are closed, from 0 to 1, at a width in m between the pads."""
    a, b, c = _WIDTH_OF
    return float(np.clip((-b - np.sqrt(b * b - 4.0 * a * (c - min(width, c)))) / (2.0 * a), 0.0, 1.0))
