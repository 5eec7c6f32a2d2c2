"""Records demonstrations at the robot interface of skills: in between, where a robot's driver would be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from scipy.spatial.transform import Rotation

from executive.lab.collection.demonstrations import Located, Sample
from executive.sim.robot_api import Body, Handle
from executive.sim.scene import GRIP_SITE
from executive.sim.world import MujocoWorld
from executive.types import FloatArray, News, Phase

PERIOD = 0.1
"""Seconds of the world's time between two samples, to the nearest whole control period."""


@dataclass(slots=True)
class Recorder:
    """Stands between a skill and the world's robot, and notes what passes. The rest of the robot is as it was."""

    world: MujocoWorld
    samples: list[Sample] = field(default_factory=list)
    located: list[Located] = field(default_factory=list)
    phase: str = ""
    _ticks: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.world, name)

    @property
    def handle(self) -> Handle:
        """Return the world's handle with this one in between."""
        return replace(self.world.handle, body=cast(Body, self))

    def begin(self) -> None:
        """Forget what was noted: another action begins."""
        self.samples, self.located, self.phase, self._ticks = [], [], "", 0

    def hear(self, news: News) -> None:
        """Note the phase that a skill announces."""
        if isinstance(news, Phase):
            self.phase = news.name

    def advance(self) -> None:
        if self._ticks % round(PERIOD / self.world.handle.control_period) == 0:
            self.samples.append(self._sample())
        self._ticks += 1
        self.world.advance()

    def locate(self, item: str) -> FloatArray | None:
        pose = self.world.locate(item)
        if pose is not None:
            shape = self.world.shapes[item]
            self.located.append(Located(self.world.time, item, np.array(pose), shape.centre, shape.half))
        return pose

    def _sample(self) -> Sample:
        world, frame = self.world, self.world.frame()
        assert frame.command is not None
        hand = world.data.site(GRIP_SITE)
        turn = Rotation.from_matrix(hand.xmat.reshape(3, 3)).as_quat(scalar_first=True)
        pose = np.concatenate([hand.xpos, turn])
        return Sample(world.time, frame.joints, frame.gripper, pose, frame.command, self.phase, world.data.qpos.copy())
