"""What a skill drives: the arm's and the gripper's commands, what the joints feel, and where things are said to be.

As in the paper (Section 6.1), grasp poses are inferred from "privileged information": `locate` and `obstacles` give
poses that come from the simulator, with noise where a run asks for it. No atom's truth is to be had here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import mujoco

from executive.sim.scene import ItemShape
from executive.sim.spec import TableSpec
from executive.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ArmLimits:
    """Joint ranges (rad), velocities (rad/s), accelerations (rad/s^2) and jerks (rad/s^3) to stay within, and the home
    configuration, each (6,)."""

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    home: FloatArray


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Handle:
    """The robot as a skill sees it. All poses are (7,): position in m, then quaternion (w, x, y, z), world frame."""

    limits: ArmLimits
    tables: Mapping[str, TableSpec]
    shapes: Mapping[str, ItemShape]
    eyes: Mapping[str, FloatArray]
    """Where each camera stands, (3,) in m, world frame: the robot is to know what it hides from whom."""
    planning_spec: Callable[[], mujoco.MjSpec]
    """A fresh specification of the scene without visuals, to build a model for planning from."""
    control_period: float
    """Seconds of the world's time that one `advance` takes."""
    home_pose: bool
    """Whether an action ends at the home pose (the paper's "Pose") or where it happened to be done."""
    body: Body
    keep_trees: bool = False
    """Whether a motion is to be told with the tree that was searched for it, for the people who watch."""


class Body(Protocol):
    """The live part of the handle, kept by the world."""

    @property
    def time(self) -> float: ...

    def joints(self) -> FloatArray:
        """Measured joint positions (6,), rad."""
        ...

    def gripper_width(self) -> float:
        """Distance between the finger pads in m, as the finger joints' encoders give it."""
        ...

    def gripper_joints(self) -> FloatArray:
        """All finger joints (rad), in the model's order."""
        ...

    def locate(self, item: str) -> FloatArray:
        """The pose of the item that is to be grasped, as well as the robot knows it."""
        ...

    def obstacles(self) -> dict[str, FloatArray]:
        """The poses of all items, to keep clear of."""
        ...

    def command(self, position: FloatArray, velocity: FloatArray) -> None:
        """Set the joints' target (rad) and the velocity (rad/s) with which it moves."""
        ...

    def command_gripper(self, closed: float) -> None:
        """Drive the fingers: 0 open, 1 closed."""
        ...

    def advance(self) -> None:
        """Let one control period pass."""
        ...
