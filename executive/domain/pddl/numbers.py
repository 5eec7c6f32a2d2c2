"""Numeric fluents as atoms: one atom for each value that a fluent may have.

`(count ?c)` becomes the predicate `count(?c, ?number)`, of which exactly one atom is true for each crate: `count(k,n3)`
says that there are three. A comparison becomes a formula over these atoms, `increase` an effect for each value that
there may be before. So a number is estimated, believed, expected and planned with like everything else, as long as it
is a whole one from 0 to a largest one: the largest number in the files, nine, or the number of objects, whichever is
the largest. An action that would lead beyond is not possible.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from executive.domain.pddl.forms import Form, PddlFile
from executive.domain.pddl.formulas import And, Formula, LiftedEffect, Literal, Or, negated

COST = "total-cost"
"""The function that adds up what actions cost. It is no fluent."""

NUMERAL = "numeral"
"""The type of the objects that stand for numbers. No other type is above it."""

LEAST_MOST, MOST = 9, 100
"""What the largest value is at least and at most."""

MOST_COMBINATIONS = 20_000
"""Combinations of values that a comparison or an effect may have."""

Key: TypeAlias = "tuple[str, tuple[str, ...]]"
"""A function over terms."""

COMPARISONS: Mapping[str, Callable[[float, float], bool]] = MappingProxyType(
    {"<": operator.lt, "<=": operator.le, "=": operator.eq, ">=": operator.ge, ">": operator.gt}
)
CHANGES: Mapping[str, Callable[[float, float], float]] = MappingProxyType(
    {
        "assign": lambda old, new: new,
        "increase": operator.add,
        "decrease": operator.sub,
        "scale-up": operator.mul,
        "scale-down": operator.truediv,
    }
)
OPERATORS: Mapping[str, Callable[[float, float], float]] = MappingProxyType(
    {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
)


@dataclass(frozen=True, slots=True)
class Expression:
    """A number, a function over terms, or an operator over expressions."""

    constant: float | None = None
    key: Key | None = None
    operation: str = ""
    parts: tuple[Expression, ...] = ()

    def keys(self) -> tuple[Key, ...]:
        """The functions in it, each once."""
        if self.key is not None:
            return (self.key,)
        return tuple(dict.fromkeys(key for part in self.parts for key in part.keys()))  # noqa: SIM118

    def value(self, values: Mapping[Key, int]) -> float:
        """Its value.

        Raises:
            ZeroDivisionError: it has none.
        """
        if self.constant is not None:
            return self.constant
        if self.key is not None:
            return values[self.key]
        first, *others = (part.value(values) for part in self.parts)
        if not others:
            return -first
        for other in others:
            first = OPERATORS[self.operation](first, other)
        return first


@dataclass(slots=True)
class Numbers:
    """The numerals of a task, and the functions that are used as numeric fluents (with the types of their parameters).

    Raises:
        ValueError: the largest value is too large.
    """

    most: int
    prefix: str = "n"
    used: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.most <= MOST:
            raise ValueError(f"numbers up to {MOST} are expected, got {self.most}")

    @property
    def names(self) -> tuple[str, ...]:
        """The objects that stand for the numbers from 0 on."""
        return tuple(f"{self.prefix}{number}" for number in range(self.most + 1))

    def literal(self, key: Key, value: int, positive: bool = True) -> Literal:
        """That a function has a value."""
        return Literal(key[0], (*key[1], f"{self.prefix}{value}"), positive)

    def comparison(self, name: str, left: Expression, right: Expression) -> Formula:
        """A comparison as a formula.

        With one function it says which values it does not have, or else which it has: that may be known where it is not
        known which value it has, so that it is written, too.
        """
        keys = tuple(dict.fromkeys((*left.keys(), *right.keys())))
        holds: list[Formula] = []
        fails: list[Formula] = []
        for values in self._combinations(keys):
            try:
                truth = COMPARISONS[name](left.value(values), right.value(values))
            except ZeroDivisionError:
                truth = False
            (holds if truth else fails).append(self._all(values))
        if len(keys) == 1 and len(holds) > 1:
            others = And(tuple(map(negated, fails)))
            return others if len(fails) <= len(holds) else Or((*holds, others))
        return Or(tuple(holds)) if fails else And()

    def change(self, name: str, key: Key, amount: Expression, limits: list[Formula]) -> Iterator[LiftedEffect]:
        """What changing a function's value comes to; where that would lead beyond the numbers that there are goes into
        `limits`, as conditions that the action needs."""
        for values in self._combinations(tuple(dict.fromkeys((key, *amount.keys())))):
            condition = self._all(values)
            try:
                new = CHANGES[name](values[key], amount.value(values))
            except ZeroDivisionError:
                new = -1.0
            if new != int(new) or not 0 <= new <= self.most:
                limits.append(negated(condition))
            elif new != values[key]:
                yield LiftedEffect(self.literal(key, values[key], False), condition)
                yield LiftedEffect(self.literal(key, int(new)), condition)

    def combinations(self, keys: Sequence[Key]) -> int:
        """How many combinations of values some functions have."""
        return int((self.most + 1) ** len(keys))

    def _combinations(self, keys: Sequence[Key]) -> Iterator[dict[Key, int]]:
        for values in itertools.product(range(self.most + 1), repeat=len(keys)):
            yield dict(zip(keys, values, strict=True))

    def _all(self, values: Mapping[Key, int]) -> Formula:
        parts = tuple(self.literal(key, value) for key, value in values.items())
        return parts[0] if len(parts) == 1 else And(parts)


def survey(domain: PddlFile, problem: PddlFile, functions: Collection[str]) -> tuple[frozenset[str], int]:
    """The functions that some condition compares or some effect changes, but for the total cost; and the largest number
    that is compared, changed by or given to one of them.

    Raises:
        DomainError: such a number is none from 0 to `MOST`, or no whole one.
    """
    used: set[str] = set()
    found: list[tuple[PddlFile, Form]] = []
    values: list[Form] = []
    waiting = [(file, file.definition) for file in (domain, problem)]
    while waiting:
        file, form = waiting.pop()
        if form.head == ":metric":
            continue
        if form.head == ":init":
            values += form.rest
        elif form.head in COMPARISONS or (
            form.head in CHANGES and name_of(form.rest[0] if form.rest else form) != COST
        ):
            words = list(_words(form))
            used.update(each.word for each in words if each.word in functions)
            found += [(file, each) for each in words if is_number(each)]
        else:
            waiting += [(file, each) for each in form.items or ()]
    for form in values:
        if form.head == "=" and len(form.rest) == 2 and name_of(form.rest[0]) in used:
            found.append((problem, form.rest[1]))
    for file, form in found:
        if used and not (form.word.isdecimal() and int(form.word) <= MOST):
            file.fail(form.line, f"{form} is not supported: numeric fluents have whole values from 0 to {MOST}")
    return frozenset(used), max((int(form.word) for _, form in found if used), default=0)


def _words(form: Form) -> Iterator[Form]:
    if form.items is None:
        yield form
    for each in form.items or ():
        yield from _words(each)


def name_of(form: Form) -> str:
    """The function's name in `f` and `(f ?x)`."""
    return form.word or form.head


def is_number(form: Form) -> bool:
    """Whether a form is a number."""
    return form.items is None and form.word.lstrip("-").replace(".", "", 1).isdigit() and form.word.isascii()
