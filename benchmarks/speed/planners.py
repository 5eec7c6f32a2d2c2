"""Other ways to find a motion, as the motion row holds them beside ours. The only benchmark that imports ompl."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from executive.sim.robot_api import ArmLimits
from executive.types import FloatArray

ou.setLogLevel(ou.LogLevel.LOG_NONE)

PLANNERS: dict[str, Callable[[Any], Any]] = {
    "RRT*": og.RRTstar,
    "AORRTC": og.AORRTC,
    "RRTConnect": og.RRTConnect,
}


@dataclass(frozen=True, slots=True)
class Found:
    """The length of the path in rad (infinite where none was found), and the seconds of processor time until the
    first one was there."""

    cost: float
    first: float


class Alternative:
    """One of OMPL's planners as it comes, over all of the joints' ranges.

    Args:
        name: one of `PLANNERS`.
        free: whether a configuration touches nothing: the validity callback in Python.
        edge_free: whether an edge does; without it, OMPL asks `free` along every edge as finely as our planner does.
        simplified: whether a path is shortened by OMPL's `PathSimplifier` in the end.
    """

    def __init__(
        self,
        name: str,
        limits: ArmLimits,
        free: Callable[[FloatArray], bool],
        edge_free: Callable[[FloatArray, FloatArray], bool] | None = None,
        simplified: bool = False,
    ) -> None:
        self._make, self._simplified, self._dof = PLANNERS[name], simplified, len(limits.lower)
        self._space = ob.RealVectorStateSpace(self._dof)
        bounds = ob.RealVectorBounds(self._dof)
        for joint, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
            bounds.setLow(joint, float(low))
            bounds.setHigh(joint, float(high))
        self._space.setBounds(bounds)
        self._information = ob.SpaceInformation(self._space)
        # Nothing that OMPL keeps may refer to `self`: a cycle through its bindings is never collected.
        read = _reader(self._dof)
        self._read = read
        self._information.setStateValidityChecker(lambda state: free(read(state)))
        self._information.setStateValidityCheckingResolution(0.05 / self._space.getMaximumExtent())
        if edge_free is not None:
            self._information.setMotionValidator(_Edges(self._information, edge_free, read))
        self._information.setup()

    def solve(self, start: FloatArray, goal: FloatArray, seed: int, seconds: float, until_first: bool = False) -> Found:
        """What is found within `seconds` of processor time, or until there is any path at all."""
        ou.RNG.setSeed(seed + 1)
        problem = ob.ProblemDefinition(self._information)
        problem.addStartState(self._state(start))
        target = ob.GoalStates(self._information)
        target.addState(self._state(goal))
        problem.setGoal(target)
        problem.setOptimizationObjective(ob.PathLengthOptimizationObjective(self._information))
        planner = self._make(self._information)
        planner.setProblemDefinition(problem)
        planner.setup()
        # Emptied afterwards: a planner keeps what it is stopped by, and that must not keep the planner.
        best = [planner.bestCost] if hasattr(planner, "bestCost") else []
        began, first = time.process_time(), [np.inf]

        def enough() -> bool:
            now = time.process_time() - began
            if first[0] == np.inf and (problem.hasExactSolution() or any(np.isfinite(cost().value()) for cost in best)):
                first[0] = now
            return now > seconds or (until_first and first[0] < np.inf)

        planner.solve(ob.PlannerTerminationCondition(enough))
        best.clear()
        if not problem.hasExactSolution():
            return Found(np.inf, np.inf)
        path = problem.getSolutionPath()
        if self._simplified:
            og.PathSimplifier(self._information).simplify(path, max(0.001, seconds - (time.process_time() - began)))
        states = [self._read(path.getState(index)) for index in range(path.getStateCount())]
        cost = float(np.linalg.norm(np.diff(states, axis=0), axis=1).sum())
        return Found(cost, min(first[0], time.process_time() - began))

    def _state(self, q: FloatArray) -> object:
        state = self._space.allocState()
        for joint, value in enumerate(q):
            state[joint] = float(value)
        return state


def _reader(dof: int) -> Callable[[Sequence[float]], FloatArray]:
    return lambda state: np.array([state[joint] for joint in range(dof)])


class _Edges(ob.MotionValidator):  # type: ignore[misc]  # OMPL has no stubs
    def __init__(
        self,
        information: ob.SpaceInformation,
        free: Callable[[FloatArray, FloatArray], bool],
        read: Callable[[Sequence[float]], FloatArray],
    ) -> None:
        super().__init__(information)
        self._free, self._read = free, read

    def checkMotion(self, start: Sequence[float], goal: Sequence[float]) -> bool:  # noqa: N802
        return self._free(self._read(start), self._read(goal))
