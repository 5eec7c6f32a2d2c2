"""The drawers of a simulated world: how far each is open, and what keeps one from sliding or has it roll shut."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from executive.sim.fixtures import DrawerSpec, Floor
from executive.sim.scene import slide_of
from executive.types import FloatArray

_STUCK = 150.0
"""The friction in N of a drawer that jams: more than the arm pulls with before it gives up."""

_ROLLING = 6.0
"""N beyond its own friction with which a drawer rolls shut."""


class Drawers:
    """The drawers of a model and its state."""

    def __init__(self, specs: Mapping[str, DrawerSpec], model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.specs, self._model, self._data = specs, model, data
        joints = {name: model.joint(slide_of(name)) for name in specs}
        self._at = {name: int(joint.qposadr[0]) for name, joint in joints.items()}
        self._dof = {name: int(joint.dofadr[0]) for name, joint in joints.items()}
        self._jammed_until = dict.fromkeys(specs, -math.inf)

    def opening(self, drawer: str) -> float:
        """How far a drawer is open, in m."""
        return float(self._data.qpos[self._at[drawer]])

    def openings(self) -> dict[str, float]:
        """How far each is open, in m."""
        return {name: self.opening(name) for name in self.specs}

    def floors(self) -> dict[str, Floor]:
        """The floor of each where it is now."""
        return {name: drawer.floor(self.opening(name)) for name, drawer in self.specs.items()}

    def slide(self, drawer: str, opening: float) -> None:
        """Have a drawer be open by so many m at once, at rest."""
        self._data.qpos[self._at[drawer]] = np.clip(opening, 0.0, self.specs[drawer].stroke)
        self._data.qvel[self._dof[drawer]] = 0.0

    def show(self, poses: Mapping[str, FloatArray]) -> None:
        """Have each be where its body's pose (7,) says."""
        for name, drawer in self.specs.items():
            if name in poses:
                self.slide(name, float((poses[name][:3] - drawer.front) @ drawer.axis))

    def jam(self, drawer: str, until: float) -> None:
        """Have a drawer slide no more until some time of the world."""
        self._jammed_until[drawer] = until

    def roll(self, drawer: str, shut: bool) -> None:
        """Have a force push a drawer shut, from now on or no more."""
        force = -(self.specs[drawer].friction + _ROLLING) if shut else 0.0
        self._data.qfrc_applied[self._dof[drawer]] = force

    def before_step(self) -> None:
        """Bring the friction up to date."""
        for name, drawer in self.specs.items():
            jammed = self._data.time < self._jammed_until[name]
            self._model.dof_frictionloss[self._dof[name]] = _STUCK if jammed else drawer.friction

    @property
    def state(self) -> FloatArray:
        """What the model's own state leaves out, (N,)."""
        return np.array([self._jammed_until[name] for name in self.specs])

    @state.setter
    def state(self, saved: FloatArray) -> None:
        self._jammed_until = dict(zip(self.specs, map(float, saved.reshape(len(self.specs))), strict=True))
