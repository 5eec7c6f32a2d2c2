"""Chooses and builds a planner, and asks it for a plan from a problem's initial state."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from importlib.util import find_spec

from executive.domain.loader import Domain
from executive.errors import InputError, MissingError
from executive.planning.fast_downward import ENGINE, FastDownwardPlanner
from executive.planning.mutex_groups import find_mutexes
from executive.planning.unified_planning import UnifiedPlanner
from executive.protocols import Planner
from executive.types import Atom, Facts, NoPlan, Plan
from executive.util.requirements import JAVA


def open_planner(
    domain: Domain, name: str = ENGINE, *, timeout: float = 30.0, optimal: bool = False
) -> FastDownwardPlanner | UnifiedPlanner:
    """Build the planner of that name for a domain's problem: `fast-downward`, or any that unified-planning has.

    Args:
        timeout: the wall time in seconds that a plan may take.
        optimal: only a plan that is proven to be one of the cheapest will do.

    Raises:
        InputError: there is no such planner, or it does not take what the task has.
        MissingError: it is not installed.
    """
    if name == ENGINE:
        return FastDownwardPlanner(domain.parsed, timeout=timeout, optimal=optimal)
    if optimal:
        raise InputError(f"goes with --planner {ENGINE}; others have an engine of their own for it", key="--optimal")
    if name.startswith("enhsp") and find_spec("up_enhsp") is not None and shutil.which("java") is None:
        raise MissingError("ENHSP needs Java, which is not installed", command=JAVA)
    return UnifiedPlanner(domain.parsed, name, timeout=timeout)


@dataclass(frozen=True, slots=True)
class Planned:
    """The answer to the question for a plan from a problem's initial state, and the seconds that it took; `assumed` are
    true atoms that :init leaves open."""

    answer: Plan | NoPlan
    seconds: float
    assumed: frozenset[Atom] = frozenset()


def plan_problem(domain: Domain, planner: Planner) -> Planned:
    """Plan from what a problem's :init says. Where that leaves open where things are, for a robot to see, they are
    taken to be somewhere."""
    began, task = time.perf_counter(), domain.task
    true = task.declared
    if domain.leaves_open or domain.parsed.unknown or domain.parsed.oneof:
        true = true | find_mutexes(domain.parsed, leaves_open=domain.leaves_open).state
    answer = planner.plan(Facts.closed(true, task.atoms), task.goal)
    return Planned(answer, time.perf_counter() - began, frozenset(true - task.declared))
