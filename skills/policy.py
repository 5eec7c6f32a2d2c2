"""A learned skill: a policy says ten times a second where the hand goes next, and the arm follows under supervision.

What the policy is given is what a robot has: where the hand is by its joints, what the fingers measure and were told,
the item's size, and where the item was seen before the motion began. It is not looked at again meanwhile. What
the policy wants is a small motion of the hand and whether the fingers shall close.

The skill ends where the hand feels that the effect came about (something is between the fingers, and the hand has risen
with it), where the guard says so (what was held is lost, the arm is blocked, the run is cancelled), or when its time is
over. Whether it took what it should, is for the next look to say.

A policy is a file in safetensors: numbers, and no code.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from executive.errors import InputError
from executive.protocols import SkillContext, Tell
from executive.sim.scene import ItemShape
from executive.skills import collision_kernels, transforms
from executive.skills.arm import Attempt, SkillError
from executive.skills.ik import Kinematics
from executive.skills.perform import go_home, perform
from executive.types import FloatArray, SkillResult, SkillStatus, Step

POLICY_FORMAT = "executive-policy-1"

LARGEST = 16_000_000
"""Bytes of a policy's file, at most."""

RISEN = 0.05
"""m by which the hand has to rise with what it holds for the skill to end."""

_MOST_SECONDS = 12.0
_FIRM = 0.95
"""The fingers are told to be closed from here on."""

_EMPTY_FOR = 0.5
"""Seconds after the fingers closed on nothing until that is a missed grasp."""

_FASTEST = 0.06, 0.35
"""m and rad by which the hand moves in one period at most, whatever a policy says."""

_CLOSING = 2.5
"""The share of their way by which the fingers close in a second, as `Attempt.close_gripper` does."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """What a policy is given of one moment, but for the item: `hand` is the grip point's transform (4, 4) in the
    world's frame, in m, by the joints; `gripper` is the fingers' opening in m; `closed` what they were told."""

    hand: FloatArray
    gripper: float
    closed: float

    def features(self, item: FloatArray, half: FloatArray, centre: FloatArray) -> FloatArray:
        """Return the numbers that a policy computes with, (22,): the item's place and axes in the hand's frame, its
        half size, the hand in the world, and the fingers.

        Args:
            item: the transform (4, 4) of the item as it was seen before the motion began.
            half, centre: of its bounding box in its own frame, (3,) in m each.
        """
        there = transforms.inverse(self.hand) @ item
        middle = there[:3, :3] @ centre + there[:3, 3]
        turn = there[:3, :2].T.ravel()
        place = [*middle, *turn, *half, *self.hand[:3, 3], *self.hand[:3, 2], *self.hand[:2, 0]]
        return np.array([*place, self.gripper, self.closed])


class Policy(Protocol):
    """What decides where the hand goes next."""

    @property
    def period(self) -> float:
        """Seconds from one decision to the next."""
        ...

    def act(self, features: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, bool]:
        """Return the motion of the hand in its own frame within a period, (6,): m, and a rotation vector in rad; and
        whether the fingers shall close. What is drawn, is drawn from `rng`."""
        ...


@dataclass(frozen=True, eq=False)
class NetworkPolicy:
    """A multilayer perceptron. Its file has the layers' `weight.N` (outputs, inputs) and `bias.N`, with rectified
    linear units between them, and mean and deviation of features and motions; its last output is the logit of
    closing the fingers. A motion is drawn from a normal distribution around what the network says, with the deviations
    `motion.noise` (6,), so that another try is another one.

    Raises:
        InputError: the file is none of such a policy.
    """

    file: Path

    def __post_init__(self) -> None:
        _ = self.period, self._layers

    @cached_property
    def _content(self) -> tuple[dict[str, str], dict[str, FloatArray]]:
        from safetensors import SafetensorError, safe_open

        try:
            size = self.file.stat().st_size
            if size > LARGEST:
                raise InputError(f"has {size:,} bytes; a policy has {LARGEST:,} at most", file=self.file)
            with safe_open(str(self.file), "numpy") as opened:
                tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118 (no mapping)
                return dict(opened.metadata() or {}), tensors
        except FileNotFoundError:
            raise InputError("there is no such file", file=self.file) from None
        except (OSError, SafetensorError) as error:
            raise InputError(f"is no policy ({error})", file=self.file) from None

    @cached_property
    def about(self) -> dict[str, Any]:
        """What the file says of itself: the action it was trained for, the period, and how it was made."""
        try:
            found = json.loads(self._content[0]["executive"])
            if found["format"] != POLICY_FORMAT or not 0.02 <= float(found["period"]) <= 1.0:
                raise ValueError
        except (KeyError, TypeError, ValueError):
            raise InputError(f"is no policy of the format {POLICY_FORMAT}", file=self.file) from None
        return dict(found)

    @property
    def period(self) -> float:
        return float(self.about["period"])

    @cached_property
    def _layers(self) -> list[tuple[FloatArray, FloatArray]]:
        tensors = self._content[1]
        count = sum(name.startswith("weight.") for name in tensors)
        try:
            layers = [(tensors[f"weight.{n}"], tensors[f"bias.{n}"]) for n in range(count)]
            ends = [tensors["features.mean"], *(bias for _, bias in layers)]
            shapes = [(len(after), len(before)) for before, after in pairwise(ends)]
            fits = [weight.shape for weight, _ in layers] == shapes and ends[-1].shape == (7,)
            fits = fits and tensors["features.deviation"].shape == ends[0].shape == (_FEATURES,)
            fits = fits and tensors["motion.mean"].shape == tensors["motion.deviation"].shape == (6,)
            fits = fits and tensors["motion.noise"].shape == (6,)
            if not fits or not all(np.isfinite(tensor).all() for tensor in tensors.values()):
                raise KeyError
        except (KeyError, TypeError):
            raise InputError("has not the layers of a policy", file=self.file) from None
        return layers

    def act(self, features: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, bool]:
        tensors = self._content[1]
        values = (features - tensors["features.mean"]) / tensors["features.deviation"]
        for weight, bias in self._layers[:-1]:
            values = np.maximum(weight @ values + bias, 0.0)
        weight, bias = self._layers[-1]
        values = weight @ values + bias
        motion = values[:6] * tensors["motion.deviation"] + tensors["motion.mean"]
        return motion + rng.normal(0.0, 1.0, 6) * tensors["motion.noise"], bool(values[6] > 0.0)


_FEATURES = 22


def turned(item: FloatArray, centre: FloatArray, rng: np.random.Generator) -> FloatArray:
    """One of the four descriptions of an item by its bounding box, which looks the same after half a turn about any of
    its axes: its transform (4, 4) with its axes so, and its middle, `centre` (3,) in m in its own frame, where it was.

    A policy has no way to tell them apart, and errs otherwise in each, so that another try has another chance.
    """
    signs = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)][int(rng.integers(4))], dtype=float)
    result = item.copy()
    result[:3, :3] = item[:3, :3] * signs
    result[:3, 3] = item[:3, 3] + (item[:3, :3] - result[:3, :3]) @ centre
    return result


class PolicySkill:
    """Takes an item by a policy: `item` is the first parameter of the action.

    It reports NOT_THERE when the item is seen nowhere or the hand is not empty, GRASP_MISSED when the fingers close on
    nothing, UNREACHABLE where the policy leads the hand to where the arm cannot, TIMED_OUT when the arm is blocked or
    the policy comes to no end, DROPPED when the item slips out.

    Raises:
        InputError: the file is no policy.
    """

    def __init__(self, policy: Policy | Path) -> None:
        self.policy: Policy = NetworkPolicy(policy) if isinstance(policy, Path) else policy

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        return perform(step, context, self._take)

    def prepare(self, tell: Tell) -> None:
        collision_kernels.ready(tell)

    def _take(self, attempt: Attempt) -> None:
        item = next((name for name in attempt.step.args if name in attempt.handle.shapes), None)
        if item is None:
            raise InputError(f"the skill takes an item, not {attempt.step}", key=f"actions.{attempt.step.action}")
        if attempt.holding:
            raise SkillError(SkillStatus.NOT_THERE, "the gripper holds something already")
        attempt.open_gripper()
        seen, shape = transforms.matrix(attempt.locate(item)), attempt.handle.shapes[item]
        attempt.phase("approach", f"{item}, by a policy")
        self._follow(attempt, turned(seen, shape.centre, attempt.context.rng), shape)
        attempt.check_held()
        if attempt.handle.home_pose:
            go_home(attempt)
            attempt.check_held()

    def _follow(self, attempt: Attempt, item: FloatArray, shape: ItemShape) -> None:
        """Do what the policy says until something is held and lifted.

        Raises:
            SkillError: whatever ends it otherwise.
        """
        body, arm, period = attempt.body, attempt.arm.kinematics, self.policy.period
        closed, lowest, empty, goal = 0.0, np.inf, 0.0, body.joints()
        until = body.time + _MOST_SECONDS
        while body.time < until:
            hand = arm.forward(body.joints())
            sensed = Sensed(hand, body.gripper_width(), closed)
            motion, closes = self.policy.act(sensed.features(item, shape.half, shape.centre), attempt.context.rng)
            before = closed
            closed = min(1.0, closed + _CLOSING * period) if closes else 0.0
            if closed >= _FIRM:
                lowest = min(lowest, float(hand[2, 3]))
                empty = 0.0 if attempt.holding else empty + period
                if empty > _EMPTY_FOR:
                    raise SkillError(SkillStatus.GRASP_MISSED, "the fingers closed on nothing")
                if attempt.holding and hand[2, 3] > lowest + RISEN:
                    attempt.note_grip()
                    return
            else:
                lowest, empty = np.inf, 0.0
            goal = _solved(arm, hand, motion, goal)
            attempt.servo(goal, period, before, closed)
        raise SkillError(SkillStatus.TIMED_OUT, f"the policy came to no end within {_MOST_SECONDS:g} s")


def _solved(arm: Kinematics, hand: FloatArray, motion: FloatArray, near: FloatArray) -> FloatArray:
    """The configuration (6,) with the hand moved from where it is, as far as it may move at once."""
    shift, turn = (
        part * min(1.0, most / max(float(np.linalg.norm(part)), 1e-9))
        for part, most in zip((motion[:3], motion[3:]), _FASTEST, strict=True)
    )
    target = np.eye(4)
    target[:3, :3] = hand[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    target[:3, 3] = hand[:3, 3] + hand[:3, :3] @ shift
    found = arm.solve(target, near, iterations=20)
    if found is None or float(np.abs(found - near).max()) > 0.5:
        raise SkillError(SkillStatus.UNREACHABLE, "the policy leads the hand to where the arm cannot go on to")
    return found
