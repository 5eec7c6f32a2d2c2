"""The robot interface of skills: commands of arm and gripper, joint measurements, and poses of items.

Where things are, `locate` and `obstacles` answer from depth pictures where a run estimates poses, and else, as in the
paper (Section 6.1), from "privileged information": the simulator's poses, with noise where a run asks for it. The truth
of atoms is not available here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

import mujoco

from executive.sim.fixtures import ContainerSpec, DrawerSpec
from executive.sim.scene import ItemShape
from executive.sim.spec import RegionSpec, TableSpec
from executive.types import FloatArray, PointCloud, PosesEstimated


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
    """The robot handle of skills. All poses are (7,): position in m, then quaternion (w, x, y, z), world frame."""

    limits: ArmLimits
    tables: Mapping[str, TableSpec]
    shapes: Mapping[str, ItemShape]
    camera_positions: Mapping[str, FloatArray]
    """The position of each camera, (3,) in m, world frame, for avoiding occlusion."""
    planning_spec: Callable[[], mujoco.MjSpec]
    """Makes a specification of the scene without visuals, for the model of motion planning."""
    control_period: float
    """The world's time of one `advance`, in s."""
    home_pose: bool
    """Whether an action ends at the home pose (the paper's "Pose") or where its motion ends."""
    body: Body
    unknown: frozenset[str] = frozenset()
    """The boxes among the shapes that stand for what is there and is no known item."""
    regions: Mapping[str, RegionSpec] = field(default_factory=lambda: MappingProxyType({}))
    """The named parts of tables."""
    containers: Mapping[str, ContainerSpec] = field(default_factory=lambda: MappingProxyType({}))
    drawers: Mapping[str, DrawerSpec] = field(default_factory=lambda: MappingProxyType({}))
    keep_trees: bool = False
    """Whether motions are reported with their search tree, for the viewer."""


class PoseSource(Protocol):
    """Estimates where things are."""

    def now(self) -> PosesEstimated:
        """The poses at this moment."""
        ...

    def cloud(self) -> PointCloud:
        """Some of the points that the last poses were estimated from, for those who watch."""
        ...

    def hiders(self, item: str, spots: FloatArray) -> tuple[str, ...]:
        """The items that may hide one that is seen nowhere, if it were at one of the spots (N, 3), in m."""
        ...


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

    def locate(self, item: str) -> FloatArray | None:
        """The pose of the item that is to be grasped; None where it is seen nowhere."""
        ...

    def obstacles(self) -> dict[str, FloatArray]:
        """The poses of all that is in the way: of the items that are found, and of as many of the handle's `unknown`
        boxes as it takes to cover everything else."""
        ...

    def openings(self) -> dict[str, float]:
        """How far each drawer is open, in m, as far as it can be seen."""
        ...

    def locate_handle(self, drawer: str) -> FloatArray:
        """The middle (3,) of the bar of a drawer's handle, which is to be grasped."""
        ...

    def estimated_poses(self) -> PosesEstimated | None:
        """What `locate` and `obstacles` answered from last; None where that was the simulator."""
        ...

    def hiders(self, item: str, spots: FloatArray) -> tuple[str, ...]:
        """The items behind which an item may be that is seen nowhere, the likeliest first.

        Args:
            spots: where its lowest point may be, (N, 3) in m, world frame.
        """
        ...

    def command(self, position: FloatArray, velocity: FloatArray) -> None:
        """Set the joints' target (rad) and the velocity (rad/s) with which it moves."""
        ...

    def command_gripper(self, closed: float) -> None:
        """Sets the target of the fingers: 0 open, 1 closed."""
        ...

    def advance(self) -> None:
        """Advances the world by one control period."""
        ...
