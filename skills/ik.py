"""Inverse kinematics by mink: configurations that bring the grip point to a pose, and straight lines of them."""

from __future__ import annotations

import mink
import numpy as np

from executive.sim.robot_api import Handle
from executive.sim.scene import GRIP_SITE, JOINTS
from executive.types import FloatArray

_POSITION, _ORIENTATION = 5e-4, 3e-3
"""A pose is reached within this many m and rad."""


class Kinematics:
    """Forward and inverse kinematics of the arm alone. The grip point's frame: z out of the hand, x from pad to pad."""

    def __init__(self, handle: Handle) -> None:
        spec = handle.planning_spec()
        for moved in (*handle.shapes, *handle.drawers):
            spec.delete(spec.body(moved))
        self._limits = handle.limits
        self._model = spec.compile()
        self._configuration = mink.Configuration(self._model)
        self._qpos = np.array([self._model.joint(name).qposadr[0] for name in JOINTS])
        self._task = mink.FrameTask(GRIP_SITE, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-3)
        self._site = self._model.site(GRIP_SITE).id
        self._base = np.array(self._configuration.data.body("shoulder_link").xpos[:2])

    def forward(self, q: FloatArray) -> FloatArray:
        """The grip point's transform (4, 4) in the world frame."""
        self._set(q)
        result = np.eye(4)
        data = self._configuration.data
        result[:3, :3] = data.site_xmat[self._site].reshape(3, 3)
        result[:3, 3] = data.site_xpos[self._site]
        return result

    def solve(self, target: FloatArray, seed: FloatArray, iterations: int = 40) -> FloatArray | None:
        """A configuration within the limits that reaches `target` (4, 4), by descent from `seed`; None if none."""
        self._set(seed)
        self._task.set_target(mink.SE3.from_matrix(target))
        best = np.inf
        for iteration in range(iterations):
            error = self._task.compute_error(self._configuration)
            position, orientation = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
            q = np.array(self._configuration.q[self._qpos])
            if position < _POSITION and orientation < _ORIENTATION:
                return self._within(q)
            if iteration % 10 == 9:  # no progress over ten steps: a dead end
                if position + orientation > 0.9 * best:
                    return None
                best = position + orientation
            velocity = mink.solve_ik(
                self._configuration, [self._task], 1.0, solver="daqp", damping=1e-6, safety_break=False, limits=[]
            )
            step = float(np.abs(velocity).max())
            self._configuration.integrate_inplace(velocity * min(1.0, 0.5 / step) if step > 0 else velocity, 1.0)
        return None

    def seeds(self, target: FloatArray, start: FloatArray) -> list[FloatArray]:
        """Where to descend from: `start`, and the home configuration turned towards the target, with each of the
        wrist's two ways round."""
        home = self._limits.home
        at_home = self.forward(home)
        turn = _bearing(target, self._base) - _bearing(at_home, self._base)
        turned = home.copy()
        turned[0] += (turn + np.pi) % (2 * np.pi) - np.pi
        now = self.forward(turned)
        # Rotation about the approach axis that is still missing is the last wrist joint's to make.
        relative = now[:3, :3].T @ target[:3, :3]
        roll = float(np.arctan2(relative[1, 0], relative[0, 0]))
        result = []
        for wrist in (roll, roll - np.sign(roll or 1.0) * 2 * np.pi):
            candidate = turned.copy()
            candidate[5] += wrist
            if self._limits.lower[5] <= candidate[5] <= self._limits.upper[5]:
                result.append(candidate)
        return [*result, start]

    def line(self, start: FloatArray, transforms: list[FloatArray]) -> list[FloatArray] | None:
        """Configurations that follow `transforms` in turn from `start`, without a jump; None where there are none."""
        path, previous = [], start
        for target in transforms:
            q = self.solve(target, previous, iterations=20)
            if q is None or float(np.abs(q - previous).max()) > 0.35:
                return None
            path.append(q)
            previous = q
        return path

    def _set(self, q: FloatArray) -> None:
        full = np.array(self._configuration.q)
        full[self._qpos] = q
        self._configuration.update(full)

    def _within(self, q: FloatArray) -> FloatArray | None:
        lower, upper = self._limits.lower, self._limits.upper
        wrapped = lower + (q - lower) % (2 * np.pi)
        return np.asarray(wrapped) if bool((wrapped <= upper).all()) else None


def _bearing(transform: FloatArray, base: FloatArray) -> float:
    return float(np.arctan2(transform[1, 3] - base[1], transform[0, 3] - base[0]))
