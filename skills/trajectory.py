"""From a path to a trajectory within the arm's limits of velocity, acceleration and jerk.

The corners of the path are rounded by a spline, TOPP-RA (Pham and Pham, 2018) finds the fastest timing within velocity
and acceleration, and a moving mean over a few hundredths of a second makes the acceleration come and go gradually: a
mean of positions keeps every limit that they keep, and its acceleration changes by no more than that of the first
moment in the window differs from that of the last. It lets the arm cut a corner by some milliradians (the acceleration
times the square of the window over 24), and takes longer by the window.
"""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from scipy.interpolate import PchipInterpolator

from executive.sim.robot_api import ArmLimits
from executive.types import FloatArray


@contextmanager
def _without_plots() -> Iterator[None]:
    """Stand-ins for matplotlib, which toppra imports for pictures that nobody asks for: a third of a second."""
    stand_ins = {name: ModuleType(name) for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules}
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for name in stand_ins:
            del sys.modules[name]


with _without_plots():
    import toppra
    from toppra import algorithm, constraint

logging.getLogger("toppra").setLevel(logging.ERROR)

_SPACING = 0.05
"""Distance in rad between the samples of a path that the spline goes through."""

_PERIOD = 0.002
"""The period of the samples of a trajectory, in s."""

_GRID = 8
"""Points on the grid that TOPP-RA keeps the limits at, for every sample of the path."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions (N, 6) in rad and velocities (N, 6) in rad/s at moments `period` s apart, joined by cubics."""

    positions: FloatArray
    velocities: FloatArray
    period: float

    @property
    def seconds(self) -> float:
        return (len(self.positions) - 1) * self.period

    def position(self, time: float) -> FloatArray:
        """The position (6,), in rad, at `time` s; its ends before and after it."""
        at, share = self._between(time)
        if share == 0.0:
            return np.array(self.positions[at])
        start, end = self.positions[at], self.positions[at + 1]
        rest = 1.0 - share
        turn = rest * self.velocities[at] - share * self.velocities[at + 1]
        return np.asarray(
            rest * rest * (1.0 + 2.0 * share) * start
            + share * share * (3.0 - 2.0 * share) * end
            + self.period * share * rest * turn
        )

    def velocity(self, time: float) -> FloatArray:
        """The velocity (6,), in rad/s, at `time` s; zero before, after and at its ends."""
        at, share = self._between(time)
        if share == 0.0:
            return np.array(self.velocities[at])
        return np.asarray((1.0 - share) * self.velocities[at] + share * self.velocities[at + 1])

    def samples(self, period: float) -> FloatArray:
        """(N, 6) positions every `period` seconds, the end included."""
        times = np.append(np.arange(0.0, self.seconds, period), self.seconds)
        return np.stack([self.position(float(time)) for time in times])

    def _between(self, time: float) -> tuple[int, float]:
        """The last moment that is kept before `time`, and the share of the period that has passed since."""
        last = len(self.positions) - 1
        periods = min(max(time, 0.0) / self.period, float(last)) if last else 0.0
        at = math.floor(periods)
        return at, periods - at


def timed(path: FloatArray, limits: ArmLimits, speed: float = 1.0) -> Trajectory:
    """The trajectory along (N, 6) `path`, at rest at both ends, at `speed` times the limits at most.

    The corners of a piecewise linear path are rounded by less than `_SPACING` rad.
    """
    points = _resampled(path)
    if len(points) < 2:
        return Trajectory(np.array(path[-1:]), np.zeros((1, path.shape[1])), _PERIOD)
    positions, velocities = _fastest(points, limits, speed)
    # Long enough for the acceleration to come or go within the limit of jerk; where it turns over, up to twice that.
    window = float((limits.acceleration / limits.jerk).max())
    smooth = _smoothed(positions, velocities, window)
    excess = float((np.abs(_jerks(smooth)) / (speed * limits.jerk)).max())
    if excess > 1.0:
        smooth = _smoothed(positions, velocities, window * min(2.0, excess))
    return _within(smooth, limits, speed)


def _fastest(points: FloatArray, limits: ArmLimits, speed: float) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities, (N, 6) each and `_PERIOD` apart, along the spline through `points`, as fast as velocity
    and acceleration may be."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    grid = np.concatenate([[0.0], np.cumsum(lengths)])
    spline = toppra.SplineInterpolator(grid, points, bc_type="natural")
    limited = [
        constraint.JointVelocityConstraint(_both(speed * limits.velocity)),
        constraint.JointAccelerationConstraint(_both(speed * limits.acceleration)),
    ]
    gridpoints = np.linspace(0.0, grid[-1], max(50, _GRID * len(points)))
    solved = algorithm.TOPPRA(
        limited, spline, gridpoints=gridpoints, parametrizer="ParametrizeConstAccel"
    ).compute_trajectory(0.0, 0.0)
    if solved is None:  # a spline too kinked for the solver: go along the polyline, slowly
        return _slow(points, grid, limits, speed)
    times = np.arange(0.0, float(solved.duration) + _PERIOD, _PERIOD)
    inside = np.minimum(times, float(solved.duration))
    positions, velocities = np.asarray(solved(inside)), np.asarray(solved(inside, 1))
    positions[-1], velocities[0], velocities[-1] = points[-1], 0.0, 0.0
    return positions, velocities


def _smoothed(positions: FloatArray, velocities: FloatArray, window: float) -> Trajectory:
    """The mean over the last `window` s at every moment, until all of the window is at the end."""
    count = max(1, math.ceil(window / _PERIOD))
    still = np.zeros((count, positions.shape[1]))
    before, after = still + positions[0], still + positions[-1]
    q, v = np.concatenate([before, positions, after]), np.concatenate([still, velocities, still])
    pieces = 0.5 * _PERIOD * (q[1:] + q[:-1]) + _PERIOD**2 / 12.0 * (v[:-1] - v[1:])
    total = np.concatenate([np.zeros((1, q.shape[1])), np.cumsum(pieces, axis=0)])
    mean = (total[count:] - total[:-count]) / (count * _PERIOD)
    mean[0], mean[-1] = positions[0], positions[-1]
    return Trajectory(mean, (q[count:] - q[:-count]) / (count * _PERIOD), _PERIOD)


def _within(motion: Trajectory, limits: ArmLimits, speed: float) -> Trajectory:
    """The same motion, as much slower as it takes to keep the limits everywhere: between the points of TOPP-RA's grid
    they may have been overstepped a little."""
    slower = max(
        1.0,
        float((np.abs(motion.velocities) / limits.velocity).max() / speed),
        math.sqrt(float((np.abs(_accelerations(motion)) / limits.acceleration).max() / speed)),
        float((np.abs(_jerks(motion)) / limits.jerk).max() / speed) ** (1.0 / 3.0),
    )
    return Trajectory(motion.positions, motion.velocities / slower, motion.period * slower)


def _accelerations(motion: Trajectory) -> FloatArray:
    """Mean accelerations (N + 1, 6) between the moments, at rest before and after, in rad/s^2."""
    return np.asarray(np.diff(np.pad(motion.velocities, ((1, 1), (0, 0))), axis=0) / motion.period)


def _jerks(motion: Trajectory) -> FloatArray:
    """How the accelerations change (N, 6), in rad/s^3."""
    return np.asarray(np.diff(_accelerations(motion), axis=0) / motion.period)


def _slow(points: FloatArray, grid: FloatArray, limits: ArmLimits, speed: float) -> tuple[FloatArray, FloatArray]:
    """A monotone interpolation with a smooth start and stop, stretched until it keeps the limits."""
    end = 1.0
    for _ in range(30):
        rising = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, len(grid)))
        times = end * np.interp(grid / grid[-1], rising, np.linspace(0.0, 1.0, len(grid)))
        curve = PchipInterpolator(times, points, axis=0)
        check = np.linspace(0.0, end, 200)
        fast = np.abs(curve(check, 1)).max(axis=0) / (speed * limits.velocity)
        hard = np.abs(curve(check, 2)).max(axis=0) / (speed * limits.acceleration)
        if fast.max() <= 1.0 and hard.max() <= 1.0:
            break
        end *= 1.3
    inside = np.minimum(np.arange(0.0, end + _PERIOD, _PERIOD), end)
    velocities = np.asarray(curve(inside, 1))
    velocities[0] = velocities[-1] = 0.0
    return np.asarray(curve(inside)), velocities


def _both(limit: FloatArray) -> FloatArray:
    return np.stack([-limit, limit], axis=1)


def _resampled(path: FloatArray) -> FloatArray:
    """Points along the polyline, about `_SPACING` apart, corners left out so that the spline rounds them."""
    keep = np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-6)
    path = path[keep]
    if len(path) < 2:
        return path
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(2, round(lengths[-1] / _SPACING))
    at = np.linspace(0.0, lengths[-1], count + 1)
    return np.stack([np.interp(at, lengths, path[:, joint]) for joint in range(path.shape[1])], axis=1)
