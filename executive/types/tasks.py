"""Planning tasks, steps and plans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from executive.types.conditions import ALWAYS, Condition
from executive.types.derived import DerivedRules
from executive.types.facts import Atom, Facts
from executive.types.visibility import Visibility


@dataclass(frozen=True, slots=True)
class Effect:
    """What an action makes true and false where a condition holds before it."""

    condition: Condition
    facts: Facts


@dataclass(frozen=True, slots=True)
class Step:
    """A grounded action, with its precondition, its effects and its cost."""

    action: str
    args: tuple[str, ...]
    precondition: Condition = ALWAYS
    effects: tuple[Effect, ...] = ()
    cost: float = 1.0

    @classmethod
    def strips(
        cls,
        action: str,
        args: tuple[str, ...],
        preconditions: Mapping[Atom, bool] = Facts(),
        effects: Mapping[Atom, bool] = Facts(),
        cost: float = 1.0,
    ) -> Step:
        """A step that needs literals and whose effects come about whatever else holds."""
        own = (Effect(ALWAYS, Facts(effects)),) if effects else ()
        return cls(action, args, Condition.of(preconditions), own, cost)

    def __str__(self) -> str:
        return f"{self.action}({','.join(self.args)})"

    @property
    def unconditional(self) -> Facts:
        """The effects that come about whatever else holds."""
        return next((effect.facts for effect in self.effects if effect.condition == ALWAYS), Facts())

    @property
    def affects(self) -> tuple[Atom, ...]:
        """The atoms that the step may change, sorted."""
        if len(self.effects) == 1:
            return tuple(self.effects[0].facts)
        return tuple(sorted({atom for effect in self.effects for atom in effect.facts}))

    @property
    def atoms(self) -> frozenset[Atom]:
        """All atoms that the step is about: those of its precondition, of its effects and of their conditions."""
        parts = (part for effect in self.effects for part in (effect.condition.atoms, effect.facts))
        return self.precondition.atoms.union(*parts)

    def changes(self, state: Mapping[Atom, bool]) -> Mapping[Atom, bool | None]:
        """Return what the step makes of each atom that it affects in a state, in which its precondition holds: None
        where that cannot be told, as a condition's truth cannot. An atom both deleted and added is true afterwards.

        Args:
            state: with derived atoms where conditions name some.
        """
        if len(self.effects) == 1 and self.effects[0].condition == ALWAYS:
            return self.effects[0].facts
        told: dict[tuple[Atom, bool], bool | None] = {}  # whether each atom is added, or deleted
        for effect in self.effects:
            truth = effect.condition.truth(state)
            for key in effect.facts.items() if truth is not False else ():
                told[key] = told.get(key) or truth
        changes: dict[Atom, bool | None] = {}
        for atom in sorted({atom for atom, _ in told}):
            added, deleted, before = told.get((atom, True), False), told.get((atom, False), False), state.get(atom)
            values = {True} if added is not False else set()  # that it may have afterwards
            if not added and deleted is not False:
                values.add(False)
            if not added and not deleted:
                values |= {True, False} if before is None else {before}
            changes[atom] = values.pop() if len(values) == 1 else None
        return changes

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
class Fluent:
    """A numeric fluent, printed as `count(crate)`: a function over objects, and the atoms that say which of its values
    it has, in ascending order. One of them is true."""

    function: str
    args: tuple[str, ...]
    values: tuple[tuple[int, Atom], ...]

    def __str__(self) -> str:
        return f"{self.function}({','.join(self.args)})"

    def distribution(self, probability: Mapping[Atom, float]) -> Mapping[int, float] | None:
        """The probability of each value, adding up to 1; None where no atom of it has one."""
        known = {value: probability[atom] for value, atom in self.values if atom in probability}
        total = sum(known.values())
        return {value: share / total for value, share in known.items()} if total > 0.0 else None

    def mean(self, probability: Mapping[Atom, float]) -> float | None:
        """Return the mean of the values, weighted by the probabilities of their atoms."""
        shares = self.distribution(probability)
        return None if shares is None else sum(value * share for value, share in shares.items())

    def most_probable(self, probability: Mapping[Atom, float]) -> int | None:
        """Return the most probable value, the smallest of several."""
        shares = self.distribution(probability)
        return None if shares is None else max(shares, key=lambda value: (shares[value], -value))


@dataclass(frozen=True, slots=True)
class Task:
    """A planning task without its initial state, which the robot has to estimate.

    `objects` maps each object to its type, `atoms` are all grounded boolean fluents, `goal` is a condition whose
    conjuncts can be given up one by one. `declared` are the atoms that the problem file's :init names; a simulator
    places items accordingly, and the robot does not get them. `parameters` maps each of their predicates to the names
    of its parameters; `numeric` are the names of the numeric fluents, which have no atoms and are not estimated.
    `static` is what is true of what no action changes, as :init says; it is known, and neither estimated nor part of
    any state. `derived` are the rules of derived atoms, which are computed and neither estimated nor part of a state.
    `fluents` are the numeric fluents that are estimated, by the atoms that stand for their values. `visible` has the
    condition under which an atom can be seen, of those for which there is one.
    """

    name: str
    problem: str
    objects: Mapping[str, str]
    atoms: tuple[Atom, ...]
    goal: Condition
    declared: frozenset[Atom] = frozenset()
    parameters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    numeric: tuple[str, ...] = ()
    static: frozenset[Atom] = frozenset()
    derived: DerivedRules = field(default_factory=DerivedRules)
    fluents: tuple[Fluent, ...] = ()
    visible: Mapping[Atom, Condition] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = self.goal.atoms.difference(self.atoms, self.derived.rules)
        if unknown:
            raise ValueError(f"the goal names {sorted(map(str, unknown))}, which the task does not have")
        if both := self.static.intersection(self.atoms):
            raise ValueError(f"{min(map(str, both))} is static and a fluent at once")

    @property
    def visibility(self) -> Visibility:
        """When atoms can be seen."""
        return Visibility(self.visible, self.derived)


@dataclass(frozen=True, slots=True)
class Probed:
    """The planner's result for `goal` that is not executed: the question was only whether it can be reached, or the
    budget is used up. A plan, or the reason why there is none."""

    goal: Condition
    plan: Plan | None
    no_plan: NoPlan | None = None

    def __post_init__(self) -> None:
        if (self.plan is None) is (self.no_plan is None):
            raise ValueError("a planner returns either a plan or the reason why there is none")
