"""Formulas with variables, as the files have them: negation stands before literals and equalities alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Literal:
    """A predicate over terms, or its negation. A term is a variable (`?item`) or an object (`lemon`)."""

    predicate: str
    terms: tuple[str, ...]
    positive: bool = True


@dataclass(frozen=True, slots=True)
class Equality:
    """`(= left right)`, or its negation. It is known as soon as its terms are bound."""

    left: str
    right: str
    positive: bool = True


@dataclass(frozen=True, slots=True)
class And:
    """All parts hold; so it does where it has none."""

    parts: tuple[Formula, ...] = ()


@dataclass(frozen=True, slots=True)
class Or:
    """One of the parts holds."""

    parts: tuple[Formula, ...] = ()


@dataclass(frozen=True, slots=True)
class Forall:
    """The body holds for every binding of the variables, each given with its type."""

    variables: tuple[tuple[str, str], ...]
    body: Formula


@dataclass(frozen=True, slots=True)
class Exists:
    """The body holds for some binding of the variables, each given with its type."""

    variables: tuple[tuple[str, str], ...]
    body: Formula


Formula: TypeAlias = Literal | Equality | And | Or | Forall | Exists


@dataclass(frozen=True, slots=True)
class LiftedEffect:
    """A literal that an action makes so for every binding of `variables` under which the condition held before."""

    literal: Literal
    condition: Formula = And()
    variables: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Axiom:
    """A derived predicate is true of the parameters where the condition holds; of others, unless another axiom says so,
    it is false."""

    predicate: str
    parameters: tuple[tuple[str, str], ...]
    condition: Formula


def negated(formula: Formula) -> Formula:
    """The opposite of a formula."""
    match formula:
        case Literal(predicate, terms, positive):
            return Literal(predicate, terms, not positive)
        case Equality(left, right, positive):
            return Equality(left, right, not positive)
        case And(parts):
            return Or(tuple(map(negated, parts)))
        case Or(parts):
            return And(tuple(map(negated, parts)))
        case Forall(variables, body):
            return Exists(variables, negated(body))
        case Exists(variables, body):
            return Forall(variables, negated(body))


def conjuncts(formula: Formula) -> Iterator[Formula]:
    """The parts that all have to hold, conjunctions within conjunctions taken apart."""
    if isinstance(formula, And):
        for part in formula.parts:
            yield from conjuncts(part)
    else:
        yield formula


def literals(formula: Formula) -> Iterator[Literal]:
    """All literals in a formula."""
    match formula:
        case Literal():
            yield formula
        case And(parts) | Or(parts):
            for part in parts:
                yield from literals(part)
        case Forall(_, body) | Exists(_, body):
            yield from literals(body)
        case Equality():
            pass
