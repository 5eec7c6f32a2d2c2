"""Collision-free motions by OMPL's RRT* (Karaman and Frazzoli, 2011), which is led along a first path that RRT-Connect
finds. The only importer of ompl.

Alone, RRT* takes seconds for a first path through a narrow place, and RRT-Connect's are far from short. RRT* takes its
samples of the goal from a sampler of ours: it gives the points of the first path, one after the other, and so has that
path in the tree after as many iterations; from then on it samples only where a shorter one may lead.

Limits are iterations, never seconds, so that a seed repeats a motion on any machine.
"""

from __future__ import annotations

import time
from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from executive.sim.robot_api import ArmLimits
from executive.types import FloatArray

ou.setLogLevel(ou.LogLevel.LOG_NONE)

_NEAR = 0.8
"""rad around the box of start and goals in which paths are searched first."""

_REFINE = 100
"""Iterations after the first path."""

_GOAL_BIAS = 0.05
"""Share of the samples that are goals, where a goal is not in the tree yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """(N, 6) configurations in rad, joined by straight edges; their summed length; who found it in how many
    iterations; the wall seconds that took, and those of them until there was any path. `tree` are the (M, 2, 6) free
    edges that were tried, where they were asked for and there was a search."""

    configurations: FloatArray
    cost: float
    planner: str
    iterations: int
    seconds: float
    first: float
    tree: FloatArray | None = None


class Space(Protocol):
    """A collision check: `executive.skills.collision.CollisionModel` is one."""

    def free(self, q: FloatArray) -> bool:
        """Whether a configuration (6,) is free of contact."""
        ...

    def edge_free(self, start: FloatArray, goal: FloatArray) -> bool:
        """Whether the straight edge between two configurations is free, its ends included."""
        ...


class _States(ob.StateValidityChecker):  # type: ignore[misc]  # OMPL has no stubs
    def __init__(self, information: ob.SpaceInformation, space: Space, dof: int) -> None:
        super().__init__(information)
        self._free, self._joints = space.free, range(dof)

    def isValid(self, state: Sequence[float]) -> bool:  # noqa: N802
        return self._free(np.array([state[joint] for joint in self._joints]))


class _Edges(ob.MotionValidator):  # type: ignore[misc]
    """Checks a whole edge in one call, because most of the time goes into the bindings."""

    def __init__(self, information: ob.SpaceInformation, space: Space, dof: int) -> None:
        super().__init__(information)
        self._free, self._joints = space.edge_free, range(dof)
        self.kept: list[tuple[FloatArray, FloatArray]] | None = None
        """The free edges so far, where they are to be kept."""

    def checkMotion(self, start: Sequence[float], goal: Sequence[float]) -> bool:  # noqa: N802
        first, second = (np.array([state[joint] for joint in self._joints]) for state in (start, goal))
        free = self._free(first, second)
        if free and self.kept is not None:
            self.kept.append((first, second))
        return free


class _Goals(ob.GoalSampleableRegion):  # type: ignore[misc]
    """One of some configurations; while there are points of a path to lead along, these are told as samples instead."""

    def __init__(
        self, information: ob.SpaceInformation, goals: Sequence[FloatArray], lead: Sequence[FloatArray]
    ) -> None:
        super().__init__(information)
        self.setThreshold(1e-6)
        self._goals, self._lead, self._turn = np.stack(goals), iter(lead), 0
        self._leads = True

    def arrived(self) -> None:
        """The lead has been told."""
        self._leads = False

    def maxSampleCount(self) -> int:  # noqa: N802
        # RRT* takes no more samples than this, and the sampler of what may be shorter takes all of them at once.
        return 2**31 if self._leads else len(self._goals)

    def sampleGoal(self, state: MutableSequence[float]) -> None:  # noqa: N802
        q = next(self._lead, None) if self._leads else None
        if q is None:
            q = self._goals[self._turn % len(self._goals)]
            self._turn += 1
        for joint, value in enumerate(q):
            state[joint] = float(value)

    def distanceGoal(self, state: Sequence[float]) -> float:  # noqa: N802
        q = np.array([state[joint] for joint in range(self._goals.shape[1])])
        return float(np.linalg.norm(self._goals - q, axis=1).min())


class MotionPlanner:
    """RRT* over the arm's joints, whose bounds are in `limits`, through what is free in `space`; for `refine` more
    iterations once there is a path."""

    def __init__(self, limits: ArmLimits, space: Space, refine: int = _REFINE) -> None:
        self._refine = refine
        self._free, self.edge_free = space.free, space.edge_free
        dof = len(limits.lower)
        self._limits = limits
        self._space = ob.RealVectorStateSpace(dof)
        self._bound(limits.lower, limits.upper)
        self._information = ob.SpaceInformation(self._space)
        # Neither may hold `self`: OMPL's bindings keep them, and a cycle through them is never collected.
        self._information.setStateValidityChecker(_States(self._information, space, dof))
        self._edges = _Edges(self._information, space, dof)
        self._information.setMotionValidator(self._edges)
        self._information.setup()

    def plan(
        self,
        start: FloatArray,
        goals: Sequence[FloatArray],
        seed: int,
        iterations: int = 4000,
        keep_tree: bool = False,
    ) -> Path | None:
        """A path from `start` to the goal that is nearest by what is free; None when none is found in `iterations`.

        The straight edge is tried first; where it is free, there is nothing to search for. The same arguments give the
        same path, whether or not the tree is kept.
        """
        began = time.perf_counter()
        ordered = sorted(goals, key=lambda goal: float(np.linalg.norm(goal - start)))
        if not self._free(start):
            return None
        open_goals = [goal for goal in ordered if self._free(goal)]
        if not open_goals:
            return None
        for goal in open_goals:
            if self.edge_free(start, goal):
                seconds = time.perf_counter() - began
                return Path(
                    np.stack([start, goal]), float(np.linalg.norm(goal - start)), "straight", 0, seconds, seconds
                )
        # Most detours are short: look near the two ends first, and everywhere only when that fails.
        ends = np.stack([start, *open_goals])
        low, high = ends.min(axis=0) - _NEAR, ends.max(axis=0) + _NEAR
        for lower, upper in (
            (np.maximum(low, self._limits.lower), np.minimum(high, self._limits.upper)),
            (self._limits.lower, self._limits.upper),
        ):
            self._bound(lower, upper)
            self._edges.kept = [] if keep_tree else None
            found = self._search(start, open_goals, seed, iterations // 2)
            kept, self._edges.kept = self._edges.kept, None
            if found is not None:
                path, count, first = found
                tree = None if kept is None else np.reshape(kept, (-1, 2, len(start)))
                now = time.perf_counter()
                return Path(path, _length(path), "RRT*", count, now - began, first - began, tree)
        return None

    def _search(
        self, start: FloatArray, goals: Sequence[FloatArray], seed: int, iterations: int
    ) -> tuple[FloatArray, int, float] | None:
        """The path (N, dof), after how many iterations, and when the first one was there."""
        ou.RNG.setSeed(seed % (2**31 - 2) + 1)
        target = ob.GoalStates(self._information)
        for goal in goals:
            target.addState(self._state(goal))
        problem = self._problem(start, target)
        connect = og.RRTConnect(self._information)
        connect.setProblemDefinition(problem)
        connect.setup()
        connected = _Iterations(iterations)
        connect.solve(ob.PlannerTerminationCondition(connected))
        if not problem.hasExactSolution():
            return None
        first = time.perf_counter()
        lead = self._shortened(problem.getSolutionPath())
        path = self._star(start, goals, lead, self._refine) if self._refine else None
        best = lead if path is None or _length(lead) < _length(path) else path
        return best, connected.count + self._refine, first

    def _star(
        self, start: FloatArray, goals: Sequence[FloatArray], lead: FloatArray, iterations: int
    ) -> FloatArray | None:
        """What RRT* makes of a free path (N, dof), within some iterations more than it takes to go along it."""
        planner = og.RRTstar(self._information)
        planner.setup()
        points = _spaced(lead, 0.99 * planner.getRange())  # not its range itself: what is further is cut short
        target = _Goals(self._information, goals, points)
        problem = self._problem(start, target)
        planner.setProblemDefinition(problem)
        planner.setGoalBias(1.0)
        planner.solve(ob.PlannerTerminationCondition(_Iterations(len(points))))
        target.arrived()
        planner.setGoalBias(_GOAL_BIAS)
        planner.setInformedSampling(True)
        planner.solve(ob.PlannerTerminationCondition(_Iterations(iterations)))
        return self._shortened(problem.getSolutionPath()) if problem.hasExactSolution() else None

    def _problem(self, start: FloatArray, target: ob.Goal) -> ob.ProblemDefinition:
        problem = ob.ProblemDefinition(self._information)
        problem.addStartState(self._state(start))
        problem.setGoal(target)
        problem.setOptimizationObjective(ob.PathLengthOptimizationObjective(self._information))
        return problem

    def _shortened(self, path: og.PathGeometric) -> FloatArray:
        """The configurations (N, dof) of a path after OMPL's shortcutting."""
        simplifier = og.PathSimplifier(self._information)
        simplifier.reduceVertices(path)
        simplifier.partialShortcutPath(path, 60, 30)
        states = (path.getState(index) for index in range(path.getStateCount()))
        return np.array([[state[joint] for joint in range(self._space.getDimension())] for state in states])

    def _bound(self, lower: FloatArray, upper: FloatArray) -> None:
        bounds = ob.RealVectorBounds(len(lower))
        for joint, (low, high) in enumerate(zip(lower, upper, strict=True)):
            bounds.setLow(joint, float(low))
            bounds.setHigh(joint, float(high))
        self._space.setBounds(bounds)

    def _state(self, q: FloatArray) -> object:
        state = self._space.allocState()
        for joint, value in enumerate(q):
            state[joint] = float(value)
        return state


class _Iterations:
    """Stops a planner after a number of iterations."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.count = 0

    def __call__(self) -> bool:
        self.count += 1
        return self.count > self._limit


def _length(path: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _spaced(path: FloatArray, most: float) -> list[FloatArray]:
    """The points of a path after its first, with more between them where they are further apart than `most`."""
    points: list[FloatArray] = []
    for start, goal in pairwise(path):
        parts = max(1, int(np.ceil(np.linalg.norm(goal - start) / most)))
        points += [start + (goal - start) * (part / parts) for part in range(1, parts)] + [goal]
    return points
