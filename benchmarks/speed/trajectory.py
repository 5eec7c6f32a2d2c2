"""How much longer than necessary trajectories take, within limits of velocity, acceleration and jerk.

The reference is the fastest timing along the very same spline within the same limits, found by sequential linear
programming over b(s), the squared speed along the path: velocity and acceleration are linear in b and its slope; jerk
is |q''' b + 3/2 q'' b' + 1/2 q' b''| <= limit / sqrt(b), whose right side is convex in b, so that its tangent keeps the
limit. Each round maximises the linearised time; it starts from what TOPP-RA finds without jerk, slowed down.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import toppra
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, vstack

from benchmarks.speed.queries import read, stage
from benchmarks.speed.table import Row
from executive.sim.robot_api import ArmLimits
from executive.skills import trajectory
from executive.skills.arm import arm_of
from executive.types import FloatArray

_POINTS = 120
_ROUNDS = 60


def measure(everything: bool) -> list[Row]:
    queries, _ = read()
    world = stage()
    arm, limits = arm_of(world.handle), world.handle.limits
    paths = []
    for number, query in enumerate(queries[:: 4 if everything else 12]):
        query.set_up(arm)
        found = arm.planner.plan(query.start, [query.goal], number)
        if found is not None:
            paths += [found.configurations, np.stack([query.start, query.goal])]
    trajectory.timed(paths[0], limits)
    took, lengths, best, without = [], [], [], []
    worst = np.zeros(3)
    for path in paths:
        began = time.process_time()
        motion = trajectory.timed(path, limits)
        took.append(time.process_time() - began)
        lengths.append(motion.seconds)
        worst = np.maximum(worst, _rates(motion, limits))
        reference = fastest(trajectory._resampled(path), limits)
        best.append(reference[0])
        without.append(reference[1])
    over = np.array(lengths) / np.array(best)
    ratio = float(np.median(over))
    bound = np.array(lengths) / np.array(without)
    note = (
        f"ratio {ratio:.3f}; {len(paths)} paths, half of them straight; 90 % of them take at most "
        f"{np.percentile(over, 90):.3f} times as long as the reference (itself good to 3 %), and "
        f"{np.median(bound):.3f} times (median; at most {bound.max():.3f}) as long as without any limit of jerk; "
        f"{1e3 * float(np.median(took)):.1f} ms each"
    )
    return [
        Row("trajectory, duration, median", float(np.median(lengths)), float(np.median(best)), "s",
            "1.1 times the shortest", ratio <= 1.1, "the fastest timing of the same path", note),
        Row("trajectory, largest share of a limit", float(worst.max()), None, "", "1", bool(worst.max() <= 1 + 1e-6),
            "velocity, acceleration, jerk", ", ".join(f"{share:.4f}" for share in worst)),
    ]  # fmt: skip


def _rates(motion: trajectory.Trajectory, limits: ArmLimits) -> FloatArray:
    """The largest velocity, acceleration and jerk, as shares of their limits (3,)."""
    rate, shares = motion.velocities, []
    for limit in (limits.velocity, limits.acceleration, limits.jerk):
        shares.append(float((np.abs(rate) / limit).max()))
        rate = np.diff(np.pad(rate, ((1, 1), (0, 0))), axis=0) / motion.period
    return np.array(shares)


def fastest(points: FloatArray, limits: ArmLimits) -> tuple[float, float]:
    """The shortest time in s along the spline through (N, 6) `points`, and that without a limit of jerk."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline = toppra.SplineInterpolator(lengths, points, bc_type="natural").cspl
    # Finer towards the ends, where the speed rises as a power of the distance.
    s = lengths[-1] * 0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, _POINTS)))
    first, second, third = (spline(s, order) for order in (1, 2, 3))
    slope, curve = _differences(s)
    identity = coo_matrix(np.eye(_POINTS))
    rows, bounds = [], []
    for joint in range(points.shape[1]):
        q1, q2 = first[:, joint, None], second[:, joint, None]
        rows += [identity.multiply(q1**2), identity.multiply(q2) + slope.multiply(0.5 * q1)]
        rows += [-rows[-1]]
        bounds += [np.full(_POINTS, limits.velocity[joint] ** 2)] + 2 * [np.full(_POINTS, limits.acceleration[joint])]
    fixed, most = vstack(rows).tocsr(), np.concatenate(bounds)
    b = _best(s, np.full(_POINTS, 1e-4), fixed, most, spread=None)
    for _ in range(6):
        b = _best(s, b, fixed, most, spread=None)
    without = _duration(s, b)
    jerks = [
        identity.multiply(third[:, joint, None])
        + slope.multiply(1.5 * second[:, joint, None])
        + curve.multiply(0.5 * first[:, joint, None])
        for joint in range(points.shape[1])
    ]
    b = 0.05 * np.minimum(b, _bell(s) * b.max())
    inner = np.arange(1, _POINTS - 1)
    # The acceleration begins and ends with 0: next to the ends, s is j t^3 / 6 at most.
    ends = []
    for row, end in ((1, 0), (-2, -1)):
        most_jerk = float((limits.jerk / np.maximum(np.abs(first[end]), 1e-9)).min())
        ends.append(0.25 * most_jerk ** (2 / 3) * (6.0 * abs(s[row] - s[end])) ** (4 / 3))
    for _ in range(_ROUNDS):
        base = np.maximum(b, 1e-9)
        rows, bounds = [fixed], [most]
        for joint, jerk in enumerate(jerks):
            tangent = limits.jerk[joint] * 0.5 * base**-1.5
            for sign in (1.0, -1.0):
                rows.append((sign * jerk + identity.multiply(tangent[:, None])).tocsr()[inner])
                bounds.append((limits.jerk[joint] * 1.5 * base**-0.5)[inner])
        before, b = b, _best(s, b, vstack(rows).tocsr(), np.concatenate(bounds), spread=2.5, ends=ends)
        if abs(_duration(s, b) / _duration(s, before) - 1.0) < 1e-5:
            break
    return _duration(s, b), without


def _best(
    s: FloatArray,
    b: FloatArray,
    rows: object,
    most: FloatArray,
    spread: float | None,
    ends: Sequence[float] = (np.inf, np.inf),
) -> FloatArray:
    """The squared speeds that shorten the time most, as it is linearised at `b`, within `spread` times of that, and
    next to the ends no higher than `ends`."""
    root = np.sqrt(np.maximum(b, 1e-9))
    step = np.diff(s)
    gain = np.zeros(len(s))
    for side in (0, 1):
        here = root[side : len(s) - 1 + side]
        np.add.at(gain, np.arange(len(step)) + side, step / (root[:-1] + root[1:]) ** 2 / here)
    high = np.full(len(s), np.inf) if spread is None else spread * np.maximum(b, 1e-7)
    low = np.zeros(len(s)) if spread is None else b / spread
    high[[1, -2]] = np.minimum(high[[1, -2]], ends)
    low[[1, -2]] = np.minimum(low[[1, -2]], ends)
    high[[0, -1]] = low[[0, -1]] = 0.0
    solved = linprog(-gain, A_ub=rows, b_ub=most, bounds=np.stack([low, high], axis=1), method="highs")
    return np.asarray(solved.x) if solved.status == 0 else b


def _duration(s: FloatArray, b: FloatArray) -> float:
    root = np.sqrt(np.maximum(b, 0.0))
    return float((2.0 * np.diff(s) / np.maximum(root[:-1] + root[1:], 1e-9)).sum())


def _bell(s: FloatArray) -> FloatArray:
    """Squared speeds of a motion that starts and ends gently, from 0 to 1 and back."""
    share = s / s[-1]
    return np.asarray(np.minimum(1.0, 4.0 * share * (1.0 - share)) ** (4.0 / 3.0))


def _differences(s: FloatArray) -> tuple[coo_matrix, coo_matrix]:
    """What gives a function's first and second derivative from its values at `s`."""
    count = len(s)
    slope, curve = np.zeros((count, count)), np.zeros((count, count))
    for row in range(count):
        middle = min(max(row, 1), count - 2)
        at = np.arange(middle - 1, middle + 2)
        powers = np.stack([np.ones(3), s[at] - s[row], 0.5 * (s[at] - s[row]) ** 2])
        slope[row, at], curve[row, at] = np.linalg.solve(powers, np.eye(3))[:, 1:].T
    return coo_matrix(slope), coo_matrix(curve)
