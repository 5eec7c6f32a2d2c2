"""Formulas written out for objects, simplified by what is static.

No product of objects is walked where a static literal says which of them are meant: bindings come from a join of the
literals' rows, the one with the fewest first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from executive.domain.pddl.formulas import And, Equality, Exists, Forall, Formula, Literal, Or, conjuncts, negated
from executive.domain.pddl.typing import Typing
from executive.types import ALWAYS, NEVER, Atom, Condition

Row = tuple[str, ...]
Variables = Sequence[tuple[str, str]]


class Grounding:
    """Writes formulas out.

    Args:
        true: the static atoms that are true.
        static: the predicates of which every atom is static.
        open_: the atoms that are neither: fluent and derived ones. Of every other atom it is known whether it is true.
    """

    def __init__(self, typing: Typing, true: Collection[Atom], static: Collection[str], open_: Iterable[Atom]) -> None:
        self._typing, self._static = typing, frozenset(static)
        self._true = {(atom.predicate, atom.args) for atom in true}
        self._open: dict[tuple[str, Row], Atom] = {(atom.predicate, atom.args): atom for atom in open_}
        self._literal: dict[tuple[str, Row, bool], Condition] = {}
        self._rows: dict[str, list[Row]] = {}
        for predicate, args in sorted(self._true):
            self._rows.setdefault(predicate, []).append(args)
        self._projections: dict[tuple[Literal, Variables, tuple[int, ...]], Literal] = {}
        self._indices: dict[tuple[str, tuple[int, ...]], dict[Row, list[Row]]] = {}

    def atom(self, literal: Literal, binding: Mapping[str, str]) -> Atom | None:
        """The atom of a literal; None for a static one."""
        return self._open.get((literal.predicate, tuple(binding.get(term, term) for term in literal.terms)))

    def condition(self, formula: Formula, binding: Mapping[str, str]) -> Condition:
        """A formula for objects."""
        match formula:
            case Literal(predicate, terms, positive):
                return self._of_literal(predicate, tuple(binding.get(term, term) for term in terms), positive)
            case Equality(left, right, positive):
                return ALWAYS if (binding.get(left, left) == binding.get(right, right)) is positive else NEVER
            case And(parts):
                return Condition.all_of(self._until(NEVER, (self.condition(part, binding) for part in parts)))
            case Or(parts):
                return Condition.any_of(self._until(ALWAYS, (self.condition(part, binding) for part in parts)))
            case Exists(variables, body):
                inner = self.bindings(variables, body, binding)
                return Condition.any_of(self._until(ALWAYS, (self.condition(body, each) for each in inner)))
            case Forall(variables, body):
                # Where a static literal of the body's negation does not hold, the body does.
                inner = self.bindings(variables, negated(body), binding)
                return Condition.all_of(self._until(NEVER, (self.condition(body, each) for each in inner)))

    def _of_literal(self, predicate: str, args: Row, positive: bool) -> Condition:
        key = predicate, args
        if key in self._open:
            found = self._literal.get((predicate, args, positive))
            if found is None:
                found = self._literal[predicate, args, positive] = Condition.literal(self._open[key], positive)
            return found
        return ALWAYS if (key in self._true) is positive else NEVER

    @staticmethod
    def _until(last: Condition, conditions: Iterable[Condition]) -> Iterator[Condition]:
        """The conditions up to the first one that settles it."""
        for condition in conditions:
            yield condition
            if condition == last:
                return

    def bindings(
        self, variables: Variables, formula: Formula, binding: Mapping[str, str]
    ) -> Iterator[Mapping[str, str]]:
        """Every binding of the variables under which the formula may hold, each with `binding`: those under which the
        static literals among its conjuncts do."""
        if not variables:
            yield binding
            return
        kinds = dict(variables)
        outer = {name: value for name, value in binding.items() if name not in kinds}
        guards = [
            each
            for each in conjuncts(formula)
            if isinstance(each, Literal) and each.positive and each.predicate in self._static
        ]
        yield from self._join(kinds, guards, outer)

    def size(self, formula: Formula) -> int:
        """How many literals and equalities a formula has at most once it is written out, without writing it."""
        match formula:
            case Literal() | Equality():
                return 1
            case And(parts) | Or(parts):
                return sum(map(self.size, parts))
            case Forall(variables, body) | Exists(variables, body):
                meant = body if isinstance(formula, Exists) else negated(body)
                return self.count(variables, meant) * self.size(body)

    def count(self, variables: Variables, formula: Formula) -> int:
        """How many bindings `bindings` gives at most, whatever is bound besides."""
        open_, known = {name: len(self._typing.members(kind)) for name, kind in variables}, 1
        whole = math.prod(open_.values())
        for each in conjuncts(formula):
            if isinstance(each, Literal) and each.positive and each.predicate in self._static:
                new = [open_.pop(term) for term in each.terms if term in open_]
                known *= min(math.prod(new), len(self._rows.get(each.predicate, ()))) if new else 1
        return min(whole, known * math.prod(open_.values()))

    def projections(
        self, variables: Mapping[str, str], formulas: Iterable[Formula], kept: Collection[str]
    ) -> Iterator[Mapping[str, str]]:
        """Every binding of those of the variables that are `kept`, of which the formulas leave open whether all of them
        can hold for some binding of the others. Each static literal is taken by itself, so that some bindings may be
        among them for which that cannot be.

        Args:
            variables: all that may occur in the formulas, each with its type.
        """
        guards: list[Literal] = []
        checks: list[Formula] = []
        for each in formulas:
            if isinstance(each, Literal) and each.positive and each.predicate in self._static:
                guards.append(self._projected(variables, each, kept))
            elif isinstance(each, Equality):
                checks += [each] if {each.left, each.right}.intersection(variables) <= frozenset(kept) else []
            elif isinstance(each, Literal) and each.predicate in self._static:
                checks += [each] if frozenset(each.terms).intersection(variables) <= frozenset(kept) else []
        for binding in self._join({name: variables[name] for name in kept}, guards, {}):
            if all(self.condition(check, binding) == ALWAYS for check in checks):
                yield binding

    def _projected(self, variables: Mapping[str, str], guard: Literal, kept: Collection[str]) -> Literal:
        """A literal of the rows of `guard` with the columns of variables that are not kept left out."""
        columns = [i for i, term in enumerate(guard.terms) if term in kept or term not in variables]
        if len(columns) == len(guard.terms):
            return guard
        free = {term: variables[term] for term in guard.terms if term in variables}
        key = guard, tuple(free.items()), tuple(columns)
        if key not in self._projections:
            rows = (row for row in self._matching(guard, {}) if self._extended(free, guard, row, {}) is not None)
            name = f"{guard.predicate} {len(self._projections)}"
            self._rows[name] = sorted({tuple(row[i] for i in columns) for row in rows})
            self._projections[key] = Literal(name, tuple(guard.terms[i] for i in columns))
        return self._projections[key]

    def _join(self, kinds: Mapping[str, str], guards: list[Literal], bound: dict[str, str]) -> Iterator[dict[str, str]]:
        if guards:
            rows = [self._matching(guard, bound) for guard in guards]
            chosen = min(range(len(guards)), key=lambda number: len(rows[number]))
            rest = guards[:chosen] + guards[chosen + 1 :]
            for row in rows[chosen]:
                extended = self._extended(kinds, guards[chosen], row, bound)
                if extended is not None:
                    yield from self._join(kinds, rest, extended)
            return
        variable = next((name for name in kinds if name not in bound), None)
        if variable is None:
            yield bound
            return
        for member in self._typing.members(kinds[variable]):
            yield from self._join(kinds, guards, {**bound, variable: member})

    def _matching(self, guard: Literal, bound: Mapping[str, str]) -> Sequence[Row]:
        """The rows of a static predicate that agree with the terms that are known."""
        known = tuple(i for i, term in enumerate(guard.terms) if term in bound or not term.startswith("?"))
        key = guard.predicate, known
        if key not in self._indices:
            index: dict[Row, list[Row]] = {}
            for row in self._rows.get(guard.predicate, ()):
                index.setdefault(tuple(row[i] for i in known), []).append(row)
            self._indices[key] = index
        values = tuple(bound.get(guard.terms[i], guard.terms[i]) for i in known)
        return self._indices[key].get(values, ())

    def _extended(
        self, kinds: Mapping[str, str], guard: Literal, row: Row, bound: dict[str, str]
    ) -> dict[str, str] | None:
        extended = dict(bound)
        for term, value in zip(guard.terms, row, strict=True):
            if term.startswith("?") and term not in extended:
                if not self._typing.descends(self._typing.objects[value], kinds[term]):
                    return None
                extended[term] = value
            elif extended.get(term, term) != value:
                return None
        return extended


def written_out(formula: Formula, typing: Typing, binding: Mapping[str, str] = MappingProxyType({})) -> Formula:
    """The same without quantifiers: with a part for each binding of their variables, whatever is static."""
    match formula:
        case Literal(predicate, terms, positive):
            return Literal(predicate, tuple(binding.get(term, term) for term in terms), positive)
        case Equality(left, right, positive):
            return Equality(binding.get(left, left), binding.get(right, right), positive)
        case And(parts):
            return And(tuple(written_out(part, typing, binding) for part in parts))
        case Or(parts):
            return Or(tuple(written_out(part, typing, binding) for part in parts))
        case Forall(variables, body) | Exists(variables, body):
            names = [name for name, _ in variables]
            rows = typing.tuples([kind for _, kind in variables])
            inner = ({**binding, **dict(zip(names, row, strict=True))} for row in rows)
            written = tuple(written_out(body, typing, each) for each in inner)
            return And(written) if isinstance(formula, Forall) else Or(written)
