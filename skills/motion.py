"""Collision-free motions by OMPL's AORRTC (Wilson et al., 2025): RRT-Connect for a first path, then again and again
for a shorter one. The only importer of ompl.

Limits are iterations, never seconds, so that a seed repeats a motion on any machine.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from executive.sim.handle import ArmLimits
from executive.types import FloatArray

ou.setLogLevel(ou.LogLevel.LOG_NONE)

_NEAR = 0.8
"""rad around the box of start and goals in which a detour is looked for first."""

_REFINE = 100
"""Iterations after the first solution."""


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
    """What is free: `skills.collision.CollisionModel` is one."""

    def free(self, q: FloatArray) -> bool:
        """Whether a configuration (6,) touches nothing."""
        ...

    def edge_free(self, start: FloatArray, goal: FloatArray) -> bool:
        """Whether the straight edge between two configurations touches nothing, its ends included."""
        ...


class _States(ob.StateValidityChecker):  # type: ignore[misc]  # OMPL has no stubs
    def __init__(self, information: ob.SpaceInformation, space: Space, dof: int) -> None:
        super().__init__(information)
        self._free, self._joints = space.free, range(dof)

    def isValid(self, state: Sequence[float]) -> bool:  # noqa: N802
        return self._free(np.array([state[joint] for joint in self._joints]))


class _Edges(ob.MotionValidator):  # type: ignore[misc]
    """A whole edge in one call: what takes time is going through the bindings."""

    def __init__(self, information: ob.SpaceInformation, space: Space, dof: int) -> None:
        super().__init__(information)
        self._free, self._joints = space.edge_free, range(dof)
        self.kept: list[tuple[FloatArray, FloatArray]] | None = None
        """The free edges so far, where anybody wants to know."""

    def checkMotion(self, start: Sequence[float], goal: Sequence[float]) -> bool:  # noqa: N802
        first, second = (np.array([state[joint] for joint in self._joints]) for state in (start, goal))
        free = self._free(first, second)
        if free and self.kept is not None:
            self.kept.append((first, second))
        return free


class MotionPlanner:
    """AORRTC over the arm's joints, whose bounds are in `limits`, through what is free in `space`; for `refine` more
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

        The straight edge is tried first: AORRTC makes nothing of it (ompl #1420). The same arguments give the same
        path, whether or not the tree is kept.
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
            found = self._search(start, open_goals, seed, iterations // 2, keep_tree)
            if found is not None:
                path, progress, tree = found
                cost = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
                return Path(
                    path, cost, "AORRTC", progress.count, time.perf_counter() - began, progress.first - began, tree
                )
        return None

    def _search(
        self, start: FloatArray, goals: Sequence[FloatArray], seed: int, iterations: int, keep_tree: bool
    ) -> tuple[FloatArray, _Progress, FloatArray | None] | None:
        """AORRTC, then OMPL's shortcutting: the path, how it went, and the tree if it is wanted."""
        ou.RNG.setSeed(seed % (2**31 - 2) + 1)
        problem = ob.ProblemDefinition(self._information)
        problem.addStartState(self._state(start))
        target = ob.GoalStates(self._information)
        for goal in goals:
            target.addState(self._state(goal))
        problem.setGoal(target)
        problem.setOptimizationObjective(ob.PathLengthOptimizationObjective(self._information))
        planner = og.AORRTC(self._information)
        planner.setProblemDefinition(problem)
        planner.setup()
        progress = _Progress(problem.hasExactSolution, iterations, self._refine)
        self._edges.kept = [] if keep_tree else None
        planner.solve(ob.PlannerTerminationCondition(progress))
        tree = None if self._edges.kept is None else np.reshape(self._edges.kept, (-1, 2, len(start)))
        self._edges.kept = None
        if not problem.hasExactSolution():
            return None
        found = problem.getSolutionPath()
        simplifier = og.PathSimplifier(self._information)
        simplifier.reduceVertices(found)
        simplifier.partialShortcutPath(found, 60, 30)
        states = [found.getState(index) for index in range(found.getStateCount())]
        return np.array([[state[joint] for joint in range(len(start))] for state in states]), progress, tree

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


class _Progress:
    """Stops the planner after a number of iterations, or some after it has a first solution; when that was, too."""

    def __init__(self, found: Callable[[], bool], limit: int, refine: int) -> None:
        self._found, self._limit, self._refine = found, limit, refine
        self.count = 0
        self.first = math.inf
        self._since_found = 0

    def __call__(self) -> bool:
        self.count += 1
        if self._since_found or self._found():
            self._since_found += 1
            self.first = min(self.first, time.perf_counter())
        return self.count > self._limit or self._since_found > self._refine
