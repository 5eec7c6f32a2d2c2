"""From a path to a trajectory: rounded corners, then the fastest timing within the arm's limits, by TOPP-RA."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import toppra
from scipy.interpolate import PchipInterpolator
from toppra import algorithm, constraint

from executive.sim.handle import ArmLimits
from executive.types import FloatArray

logging.getLogger("toppra").setLevel(logging.ERROR)

_SPACING = 0.05
"""Distance in rad between the samples of a path that the spline goes through."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Position (rad) and velocity (rad/s) over `seconds`, both (6,)."""

    seconds: float
    position: Callable[[float], FloatArray]
    velocity: Callable[[float], FloatArray]

    def samples(self, period: float) -> FloatArray:
        """(N, 6) positions every `period` seconds, the end included."""
        times = np.append(np.arange(0.0, self.seconds, period), self.seconds)
        return np.stack([self.position(float(time)) for time in times])


def timed(path: FloatArray, limits: ArmLimits, speed: float = 1.0) -> Trajectory:
    """The trajectory along (N, 6) `path`, at rest at both ends, at `speed` times the limits at most.

    The corners of a piecewise linear path are rounded by less than `_SPACING` rad.
    """
    points = _resampled(path)
    if len(points) < 2:
        only = np.array(path[-1])
        return Trajectory(0.0, lambda _: only, lambda _: np.zeros_like(only))
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    grid = np.concatenate([[0.0], np.cumsum(lengths)])
    spline = toppra.SplineInterpolator(grid, points, bc_type="natural")
    limited = [
        constraint.JointVelocityConstraint(_both(speed * limits.velocity)),
        constraint.JointAccelerationConstraint(_both(speed * limits.acceleration)),
    ]
    gridpoints = np.linspace(0.0, grid[-1], max(50, 4 * len(points)))
    solved = algorithm.TOPPRA(
        limited, spline, gridpoints=gridpoints, parametrizer="ParametrizeConstAccel"
    ).compute_trajectory(0.0, 0.0)
    if solved is None:  # a spline too kinked for the solver: go along the polyline, slowly
        return _slow(points, grid, limits, speed)
    end = float(solved.duration)
    return Trajectory(
        end,
        lambda time: np.asarray(solved(min(max(time, 0.0), end))),
        lambda time: np.asarray(solved(min(max(time, 0.0), end), 1)),
    )


def _slow(points: FloatArray, grid: FloatArray, limits: ArmLimits, speed: float) -> Trajectory:
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
    seconds = end
    return Trajectory(
        seconds,
        lambda time: np.asarray(curve(min(max(time, 0.0), seconds))),
        lambda time: np.asarray(curve(min(max(time, 0.0), seconds), 1)),
    )


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
