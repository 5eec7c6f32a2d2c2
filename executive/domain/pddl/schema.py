"""A planning task whose actions are still lifted: what a pair of PDDL files says once read, and how it is grounded.

Pure values. Conditions are conjunctions of literals, equalities and universally quantified conjunctions.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from executive.types import Atom, Step, Task

OBJECT = "object"
"""The type that every other type descends from."""


@dataclass(frozen=True, slots=True)
class Literal:
    """A predicate over terms, or its negation. A term is a variable (`?item`) or an object (`lemon`)."""

    predicate: str
    terms: tuple[str, ...]
    positive: bool = True


@dataclass(frozen=True, slots=True)
class Equality:
    """`(= left right)`, or its negation. It is static: known as soon as its terms are bound."""

    left: str
    right: str
    positive: bool = True


@dataclass(frozen=True, slots=True)
class Forall:
    """The body holds for every binding of the variables, each given with its type."""

    variables: tuple[tuple[str, str], ...]
    body: tuple[Condition, ...]


Condition: TypeAlias = Literal | Equality | Forall


def literals(conditions: Iterable[Condition]) -> Iterator[Literal]:
    """All literals among conditions, those under quantifiers too."""
    for condition in conditions:
        if isinstance(condition, Forall):
            yield from literals(condition.body)
        elif isinstance(condition, Literal):
            yield condition


@dataclass(frozen=True, slots=True)
class Action:
    """A lifted action. `parameters` are (variable, type) pairs; effects hold neither equalities nor conditions."""

    name: str
    parameters: tuple[tuple[str, str], ...]
    preconditions: tuple[Condition, ...]
    effects: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class Typing:
    """Which objects there are, of which types. `supertypes` maps each type to its parent, `object` to None."""

    supertypes: Mapping[str, str | None]
    objects: Mapping[str, str]

    def descends(self, kind: str, ancestor: str) -> bool:
        """Whether `kind` is `ancestor` or one of its subtypes."""
        current: str | None = kind
        while current is not None:
            if current == ancestor:
                return True
            current = self.supertypes[current]
        return False

    def members(self, kind: str) -> tuple[str, ...]:
        """The objects of a type, subtypes included, in the order of the files."""
        return tuple(name for name, own in self.objects.items() if self.descends(own, kind))

    def tuples(self, kinds: Sequence[str]) -> Iterator[tuple[str, ...]]:
        """Every tuple of objects that fits a sequence of types; the one empty tuple for no types."""
        return itertools.product(*(self.members(kind) for kind in kinds))

    def expand(self, conditions: Sequence[Condition], binding: Mapping[str, str]) -> Iterator[Literal | Equality]:
        """The conditions with bound variables replaced by objects and every `Forall` written out."""
        for condition in conditions:
            if isinstance(condition, Literal):
                terms = tuple(binding.get(term, term) for term in condition.terms)
                yield Literal(condition.predicate, terms, condition.positive)
            elif isinstance(condition, Equality):
                left, right = (binding.get(term, term) for term in (condition.left, condition.right))
                yield Equality(left, right, condition.positive)
            else:
                names = [name for name, _ in condition.variables]
                for objects in self.tuples([kind for _, kind in condition.variables]):
                    yield from self.expand(condition.body, {**binding, **dict(zip(names, objects, strict=True))})

    def size(self, conditions: Sequence[Condition]) -> int:
        """How many literals and equalities `expand` yields, without yielding them."""
        total = 0
        for condition in conditions:
            factor = 1
            if isinstance(condition, Forall):
                factor = self.size(condition.body)
                for _, kind in condition.variables:
                    factor *= len(self.members(kind))
            total += factor
        return total


class Said(NamedTuple):
    """What `:init` says of an atom: whether it is true, and on which line of the problem file."""

    value: bool
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Schema:
    """Everything that a planner needs, read once: the task, and its actions and goals as the files have them.

    `predicates` maps each name to the types of its parameters; `goals` are the goal's atoms in the order in which the
    problem file names them (`Task.goal` is sorted). `static` are the predicates that are what `:init` says, and `init`
    is all that `:init` says of the others.
    """

    task: Task
    typing: Typing
    predicates: Mapping[str, tuple[str, ...]]
    actions: Mapping[str, Action]
    goals: tuple[Atom, ...]
    static: frozenset[str] = frozenset()
    init: Mapping[Atom, Said] = field(default_factory=lambda: MappingProxyType({}))

    def giving(self, atoms: Collection[Atom]) -> frozenset[Step]:
        """All steps that make any of the atoms true."""
        predicates, found = {atom.predicate for atom in atoms}, set[Step]()
        for name, action in self.actions.items():
            adds = {each.predicate for each in literals(action.effects) if each.positive}
            for args in self.typing.tuples([kind for _, kind in action.parameters]) if adds & predicates else ():
                with suppress(ValueError):  # this one can never be carried out
                    step = self.ground(name, args)
                    found |= {step} if step.unconditional.true.intersection(atoms) else set()
        return frozenset(found)

    def ground(self, name: str, args: Sequence[str]) -> Step:
        """The step `name(args)`. What is static is known, and so is no precondition of it. An atom both deleted and
        added is true afterwards, as in PDDL.

        Raises:
            ValueError: no such action, arguments that do not fit, or an instance that can never be carried out.
        """
        if name not in self.actions:
            raise ValueError(f"there is no action {name!r}")
        action, shown = self.actions[name], f"{name}({','.join(args)})"
        kinds = [kind for _, kind in action.parameters]
        fits = len(args) == len(kinds) and all(
            arg in self.typing.objects and self.typing.descends(self.typing.objects[arg], kind)
            for arg, kind in zip(args, kinds, strict=True)
        )
        if not fits:
            raise ValueError(f"{shown} does not fit {name}({','.join(kinds)})")
        binding = dict(zip((variable for variable, _ in action.parameters), args, strict=True))
        preconditions: dict[Atom, bool] = {}
        for condition in self.typing.expand(action.preconditions, binding):
            if isinstance(condition, Equality):
                possible = (condition.left == condition.right) is condition.positive
            elif condition.predicate in self.static:
                holds = Atom(condition.predicate, condition.terms) in self.task.static
                possible = holds is condition.positive
            else:
                atom = Atom(condition.predicate, condition.terms)
                possible = preconditions.setdefault(atom, condition.positive) is condition.positive
            if not possible:
                raise ValueError(f"{shown} can never be carried out: {condition}")
        changes = [c for c in self.typing.expand(action.effects, binding) if isinstance(c, Literal)]
        deletes = {Atom(c.predicate, c.terms): False for c in changes if not c.positive}
        adds = {Atom(c.predicate, c.terms): True for c in changes if c.positive}
        return Step.strips(name, tuple(args), preconditions, {**deletes, **adds})
