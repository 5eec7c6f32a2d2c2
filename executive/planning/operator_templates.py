"""Grounded operators straight from a lifted action, for actions whose conditions and effects are literals.

`Schema.ground` writes any formula out as values that the loop can work with. A planner with tens of thousands of
grounded actions needs none of that: it needs, of each, the numbers of the atoms that it looks at and changes. Where an
action is a conjunction of literals, these follow from its arguments by looking names up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from executive.domain.pddl import And, Equality, Literal, Schema, conjuncts
from executive.types import ALWAYS, Atom, Step

Args: TypeAlias = "tuple[str, ...]"
_Pick: TypeAlias = "Callable[[Args], Args]"


class NoLiteralsError(Exception):
    """A grounded action needs more than literals, or its effects hang on conditions."""


class Grounded(NamedTuple):
    """A grounded action that can change something: what it needs and gives, by the numbers of the atoms, in the order
    of the atoms."""

    action: str
    args: Args
    needs: Mapping[int, bool]
    gives: Mapping[int, bool]
    cost: float


class _Pattern(NamedTuple):
    """A literal of an action: which of its arguments are the literal's."""

    predicate: str
    pick: _Pick
    positive: bool


class OperatorTemplates:
    """Grounds the actions of a task without derived atoms.

    Args:
        number: the number of each fluent atom of the task.
    """

    def __init__(self, schema: Schema, number: Mapping[Atom, int]) -> None:
        self._schema, self._number = schema, number
        self._key = {(atom.predicate, atom.args): each for atom, each in number.items()}
        self._static = {(atom.predicate, atom.args) for atom in schema.task.static}
        self._rank = {number[atom]: rank for rank, atom in enumerate(sorted(number))}

    def grounded(self, name: str) -> Iterator[Grounded | None]:
        """Yield every instance of an action, None for one that can never be carried out or changes nothing.

        Raises:
            NoLiteralsError: one has other conditions than conjunctions of literals.
        """
        return self._instances(name) if is_literal(self._schema, name) else self._written_out(name)

    def _instances(self, name: str) -> Iterator[Grounded | None]:
        schema, action = self._schema, self._schema.actions[name]
        place = {variable: index for index, (variable, _) in enumerate(action.parameters)}
        parts = list(conjuncts(action.precondition))
        needed = [_pattern(part, place) for part in parts if isinstance(part, Literal)]
        equal = [(_pick((part.left, part.right), place), part.positive) for part in parts if isinstance(part, Equality)]
        # What is both deleted and added is true afterwards.
        given = [_pattern(effect.literal, place) for effect in action.effects]
        given.sort(key=lambda each: each.positive)
        for args in schema.arguments(name):
            needs, gives = self._needs(needed, args), {}
            if needs is None or any((len({*pick(args)}) == 1) is not positive for pick, positive in equal):
                yield None
                continue
            for predicate, pick, positive in given:
                number = self._key.get((predicate, pick(args)))
                if number is not None:
                    gives[number] = positive
            found = None
            if any(needs.get(number) is not value for number, value in gives.items()):
                with suppress(ValueError):  # without a value for its cost it can never be carried out
                    cost = schema.cost(name, args) if schema.has_costs else 1.0
                    found = Grounded(name, args, self._in_order(needs), self._in_order(gives), cost)
            yield found

    def _needs(self, patterns: Sequence[_Pattern], args: Args) -> dict[int, bool] | None:
        """Return what an instance needs of fluent atoms; None where a static one is otherwise, or it contradicts
        itself."""
        needs: dict[int, bool] = {}
        for predicate, pick, positive in patterns:
            key = predicate, pick(args)
            number = self._key.get(key)
            if number is None:
                if (key in self._static) is not positive:
                    return None
            elif needs.setdefault(number, positive) is not positive:
                return None
        return needs

    def _written_out(self, name: str) -> Iterator[Grounded | None]:
        for args in self._schema.arguments(name):
            found = None
            with suppress(ValueError):  # this one contradicts itself
                step = self._schema.ground(name, args)
                if step.precondition.choices or any(effect.condition != ALWAYS for effect in step.effects):
                    raise NoLiteralsError
                if any(not step.precondition.facts.entails(effect.facts) for effect in step.effects):
                    found = self._of_step(step)
            yield found

    def _of_step(self, step: Step) -> Grounded:
        needs = {self._number[atom]: value for atom, value in step.precondition.facts.items()}
        gives = {self._number[atom]: value for atom, value in step.unconditional.items()}
        return Grounded(step.action, step.args, needs, gives, step.cost)

    def _in_order(self, facts: dict[int, bool]) -> dict[int, bool]:
        return {number: facts[number] for number in sorted(facts, key=self._rank.__getitem__)}


def is_literal(schema: Schema, name: str) -> bool:
    """Return whether an action is a conjunction of literals and equalities, with effects that hang on nothing."""
    action = schema.actions[name]
    return all(isinstance(part, Literal | Equality) for part in conjuncts(action.precondition)) and all(
        effect.condition == And() and not effect.variables for effect in action.effects
    )


def _pattern(literal: Literal, place: Mapping[str, int]) -> _Pattern:
    return _Pattern(literal.predicate, _pick(literal.terms, place), literal.positive)


def _pick(terms: Sequence[str], place: Mapping[str, int]) -> _Pick:
    """Return what picks a literal's arguments from those of its action."""
    if not all(term in place for term in terms):  # an object stands for itself
        return lambda args: tuple(args[place[term]] if term in place else term for term in terms)
    columns = [place[term] for term in terms]
    if len(columns) > 1:
        several: _Pick = itemgetter(*columns)
        return several
    return lambda args: tuple(args[column] for column in columns)
