"""Planning tasks, steps and plans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from executive.types.facts import Atom, Facts


@dataclass(frozen=True, slots=True)
class Step:
    """A grounded action, with its preconditions and effects."""

    action: str
    args: tuple[str, ...]
    preconditions: Facts
    effects: Facts

    def __str__(self) -> str:
        return f"{self.action}({','.join(self.args)})"

    def about(self, predicates: Mapping[str, tuple[str, tuple[int, ...]]]) -> Atom | None:
        """Return an atom about this step's arguments. `predicates` has, by action, a predicate and the positions of its
        arguments among the step's; without an entry for this action, the result is None."""
        if self.action not in predicates:
            return None
        predicate, positions = predicates[self.action]
        return Atom(predicate, tuple(self.args[position] for position in positions))


@dataclass(frozen=True, slots=True)
class Plan:
    """A sequence of steps, its cost, the planner and its wall seconds; `without` are the steps that the planner had to
    avoid, as text."""

    steps: tuple[Step, ...]
    cost: float
    planner: str
    seconds: float
    without: tuple[str, ...] = ()


class NoPlanReason(StrEnum):
    UNSOLVABLE = "unsolvable"
    TIMED_OUT = "timed out"
    CRASHED = "crashed"


@dataclass(frozen=True, slots=True)
class NoPlan:
    """The reason why there is no plan. Unsolvable, timed out and crashed lead to different decisions. `without` are the
    steps that the planner had to avoid, as text."""

    reason: NoPlanReason
    detail: str = ""
    planner: str = ""
    seconds: float = 0.0
    without: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Task:
    """A planning task without its initial state, which the robot has to estimate.

    `objects` maps each object to its type, `atoms` are all grounded boolean fluents, `goal` is signed. `declared` are
    the atoms that the problem file's :init names; a simulator places items accordingly, and the robot does not get
    them. `parameters` maps each of their predicates to the names of its parameters; `numeric` are the
    names of the numeric fluents, which have no atoms and are not estimated. `static` is what is true of what no action
    changes, as :init says; it is known, and neither estimated nor part of any state.
    """

    name: str
    problem: str
    objects: Mapping[str, str]
    atoms: tuple[Atom, ...]
    goal: Facts
    declared: frozenset[Atom] = frozenset()
    parameters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    numeric: tuple[str, ...] = ()
    static: frozenset[Atom] = frozenset()

    def __post_init__(self) -> None:
        unknown = set(self.goal) - set(self.atoms)
        if unknown:
            raise ValueError(f"the goal names {sorted(map(str, unknown))}, which the task does not have")
        if both := self.static.intersection(self.atoms):
            raise ValueError(f"{min(map(str, both))} is static and a fluent at once")


@dataclass(frozen=True, slots=True)
class Probed:
    """The planner's result for `goal` that is not executed: the question was only whether it can be reached, or the
    budget is used up. A plan, or the reason why there is none."""

    goal: Facts
    plan: Plan | None
    no_plan: NoPlan | None = None

    def __post_init__(self) -> None:
        if (self.plan is None) is (self.no_plan is None):
            raise ValueError("a planner returns either a plan or the reason why there is none")
