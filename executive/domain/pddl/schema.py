"""A planning task whose actions are still lifted: what a pair of PDDL files says once read, and how it is grounded."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from executive.domain.pddl.formulas import And, Axiom, Equality, Exists, Forall, Formula, LiftedEffect, Literal, Or
from executive.domain.pddl.grounding import Grounding
from executive.domain.pddl.typing import Typing
from executive.types import NEVER, Atom, Condition, Effect, Facts, Step, Task

CostTerm: TypeAlias = float | tuple[str, tuple[str, ...]]
"""A number, or a function over terms whose value `:init` gives."""

_KEPT_STEPS = 4_096


@dataclass(frozen=True, slots=True)
class Action:
    """A lifted action. `parameters` are (variable, type) pairs; `cost` is a sum, where `total-cost` is minimised."""

    name: str
    parameters: tuple[tuple[str, str], ...]
    precondition: Formula
    effects: tuple[LiftedEffect, ...]
    cost: tuple[CostTerm, ...] = (1.0,)


class Said(NamedTuple):
    """What `:init` says of an atom: whether it is true, and on which line of the problem file."""

    value: bool
    line: int


class Unreachable(NamedTuple):
    """Why a goal can be reached from no state at all, and on which line of the problem file it stands."""

    line: int
    reason: str


@dataclass(frozen=True, eq=False)
class Schema:
    """Everything that a planner needs, read once: the task, and its actions and goal as the files have them.

    `predicates` maps each name to the types of its parameters; `goals` are the goal's atoms in the order in which the
    problem file names them, and `goal` is the goal as it stands there. `static` are the predicates that are what
    `:init` says, `derived` those that axioms define, and `init` is all that `:init` says of fluent atoms. `values` are
    those of static functions, for costs. `has_costs`: the sum of costs is minimised, and not the number of steps.
    `unreachable` says of a goal that no state can reach why that is so. `invariants` are what the domain states that
    every state keeps, by name. What is not known at first: each atom in `unknown` may be so or not, and of each of
    `oneof` exactly one is so.
    """

    task: Task
    typing: Typing
    predicates: Mapping[str, tuple[str, ...]]
    actions: Mapping[str, Action]
    goals: tuple[Atom, ...]
    goal: Formula
    static: frozenset[str] = frozenset()
    init: Mapping[Atom, Said] = field(default_factory=lambda: MappingProxyType({}))
    axioms: tuple[Axiom, ...] = ()
    values: Mapping[tuple[str, tuple[str, ...]], float] = field(default_factory=lambda: MappingProxyType({}))
    has_costs: bool = False
    unreachable: Unreachable | None = None
    invariants: Mapping[str, Condition] = field(default_factory=lambda: MappingProxyType({}))
    unknown: frozenset[Atom] = frozenset()
    oneof: tuple[tuple[Atom, ...], ...] = ()

    @cached_property
    def features(self) -> frozenset[str]:
        """What it uses of PDDL beyond conjunctions of atoms, by the names of PDDL's requirements."""
        found = {"derived-predicates"} if self.axioms else set[str]()
        found |= {"action-costs"} if self.has_costs else set()
        found |= {"numeric-fluents"} if self.task.fluents else set()
        found |= {"typing"} if len(self.typing.supertypes) > 1 else set()
        waiting = [self.goal, *(axiom.condition for axiom in self.axioms)]
        for action in self.actions.values():
            waiting.append(action.precondition)
            for effect in action.effects:
                waiting.append(effect.condition)
                found |= {"conditional-effects"} if effect.condition != And() or effect.variables else set()
        while waiting:
            match waiting.pop():
                case Literal(positive=False):
                    found.add("negative-preconditions")
                case Equality():
                    found.add("equality")
                case And(parts):
                    waiting += parts
                case Or(parts):
                    found.add("disjunctive-preconditions")
                    waiting += parts
                case Forall(_, body):
                    found.add("universal-preconditions")
                    waiting.append(body)
                case Exists(_, body):
                    found.add("existential-preconditions")
                    waiting.append(body)
        return frozenset(found)

    @cached_property
    def derived(self) -> frozenset[str]:
        """The predicates that axioms define."""
        return frozenset(axiom.predicate for axiom in self.axioms)

    @cached_property
    def grounding(self) -> Grounding:
        """Writes formulas out for objects, simplified by what is static."""
        rules = self.task.derived.rules
        return Grounding(self.typing, self.task.static, self.static, (*self.task.atoms, *rules))

    def giving(self, atoms: Collection[Atom]) -> frozenset[Step]:
        """All steps that make any of the atoms true, whatever else holds."""
        predicates, found = {atom.predicate for atom in atoms}, set[Step]()
        for name, action in self.actions.items():
            adds = {each.literal.predicate for each in action.effects if each.literal.positive}
            for args in self.arguments(name) if adds & predicates else ():
                with suppress(ValueError):  # this one can never be carried out
                    step = self.ground(name, args)
                    found |= {step} if step.unconditional.true.intersection(atoms) else set()
        return frozenset(found)

    def arguments(self, name: str) -> Iterator[tuple[str, ...]]:
        """Every tuple of objects for which the static literals of an action's precondition hold, and maybe others, for
        which they do not."""
        action = self.actions[name]
        order = [variable for variable, _ in action.parameters]
        for binding in self.grounding.bindings(action.parameters, action.precondition, {}):
            yield tuple(binding[variable] for variable in order)

    def ground(self, name: str, args: Sequence[str]) -> Step:
        """The step `name(args)`. What is static is known, and so is no part of it. An atom both deleted and added is
        true afterwards, as in PDDL.

        Raises:
            ValueError: no such action, arguments that do not fit, or an instance that can never be carried out.
        """
        if name not in self.actions:
            raise ValueError(f"there is no action {name!r}")
        return self._grounded(name, tuple(args))

    @cached_property
    def _grounded(self) -> Callable[[str, tuple[str, ...]], Step]:
        """Plans repeat their steps, and to write out one with many conditional effects may take seconds."""
        return lru_cache(_KEPT_STEPS)(self._ground)

    def _ground(self, name: str, args: tuple[str, ...]) -> Step:
        action, shown = self.actions[name], f"{name}({','.join(args)})"
        kinds = [kind for _, kind in action.parameters]
        fits = len(args) == len(kinds) and all(
            arg in self.typing.objects and self.typing.descends(self.typing.objects[arg], kind)
            for arg, kind in zip(args, kinds, strict=True)
        )
        if not fits:
            raise ValueError(f"{shown} does not fit {name}({','.join(kinds)})")
        binding = dict(zip((variable for variable, _ in action.parameters), args, strict=True))
        precondition = self.grounding.condition(action.precondition, binding)
        if precondition == NEVER:
            raise ValueError(f"{shown} can never be carried out")
        return Step(name, args, precondition, self._effects(action, binding), self._cost(action, binding))

    def cost(self, name: str, args: Sequence[str]) -> float:
        """What the step `name(args)` costs.

        Raises:
            ValueError: `:init` does not say.
        """
        action = self.actions[name]
        return self._cost(action, dict(zip((variable for variable, _ in action.parameters), args, strict=True)))

    def _effects(self, action: Action, binding: Mapping[str, str]) -> tuple[Effect, ...]:
        deletes: dict[Condition, dict[Atom, bool]] = {}
        adds: dict[Condition, dict[Atom, bool]] = {}
        for effect in action.effects:
            for inner in self.grounding.bindings(effect.variables, effect.condition, binding):
                condition = self.grounding.condition(effect.condition, inner)
                atom = self.grounding.atom(effect.literal, inner)
                if condition != NEVER and atom is not None:
                    sign = effect.literal.positive
                    (adds if sign else deletes).setdefault(condition, {})[atom] = sign
        conditions = sorted({*deletes, *adds}, key=lambda each: (bool(each.atoms), str(each)))
        return tuple(Effect(each, Facts({**deletes.get(each, {}), **adds.get(each, {})})) for each in conditions)

    def _cost(self, action: Action, binding: Mapping[str, str]) -> float:
        total = 0.0
        for term in action.cost if self.has_costs else (1.0,):
            if isinstance(term, tuple):
                function, terms = term
                key = function, tuple(binding.get(each, each) for each in terms)
                if key not in self.values:
                    raise ValueError(f"{action.name}: {Atom(*key)} has no value")
                total += self.values[key]
            else:
                total += term
        return total
