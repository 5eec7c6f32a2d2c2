"""What a domain and a problem declare, and the formulas that are made of it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

from executive.domain.pddl.forms import Form, PddlFile, shorten
from executive.domain.pddl.formulas import (
    And,
    Equality,
    Exists,
    Forall,
    Formula,
    LiftedEffect,
    Literal,
    Or,
    negated,
)
from executive.domain.pddl.numbers import (
    CHANGES,
    COMPARISONS,
    COST,
    LEAST_MOST,
    MOST,
    MOST_COMBINATIONS,
    NUMERAL,
    OPERATORS,
    Expression,
    Key,
    Numbers,
    is_number,
    name_of,
)
from executive.domain.pddl.schema import CostTerm
from executive.domain.pddl.typing import EITHER, OBJECT, Typing
from executive.errors import nearest

_REFUSED = {
    "preference": "a preference",
    **dict.fromkeys(("<", "<=", ">", ">=", "+", "-", "*", "/"), "numeric fluents"),
    **dict.fromkeys(("assign", "increase", "decrease", "scale-up", "scale-down"), "numeric fluents"),
    **dict.fromkeys(("always", "sometime", "within", "at-most-once", "at-end"), "a trajectory constraint"),
    **dict.fromkeys(("sometime-after", "sometime-before", "always-within"), "a trajectory constraint"),
    **dict.fromkeys(("hold-during", "hold-after"), "a trajectory constraint"),
    **dict.fromkeys(("probabilistic",), "probabilities"),
    **dict.fromkeys(("oneof", "unknown", "sensed"), "effects or facts that are not determined"),
    **dict.fromkeys(("change",), "object fluents"),
}


@dataclass(slots=True)
class Words:
    """What has been declared so far."""

    supertypes: dict[str, tuple[str, ...]] = field(default_factory=lambda: {OBJECT: ()})
    objects: dict[str, str] = field(default_factory=dict)
    predicates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: dict[str, tuple[str, ...]] = field(default_factory=dict)
    functions: dict[str, int] = field(default_factory=dict)
    function_parameters: dict[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    numbers: Numbers | None = None
    """The numerals, where functions are used as numeric fluents."""
    typing: Typing = field(init=False)

    def __post_init__(self) -> None:
        self.typing = Typing(self.supertypes, self.objects)

    def kind(self, file: PddlFile, form: Form | None) -> str:
        """A type, or a union of types."""
        if form is None:
            return OBJECT
        kinds = form.rest if form.head == "either" else (form,)
        for each in kinds:
            if each.word not in self.supertypes:
                file.fail(each.line, f"unknown type {each}; {nearest(each.word, self.supertypes)}")
        return EITHER.join(dict.fromkeys(each.word for each in kinds))

    def declare_types(self, file: PddlFile) -> None:
        section = file.section(":types")
        lines: dict[str, int] = {}
        for form, name, parent in file.typed(section.rest if section else (), "a type"):
            above = () if parent is None else parent.rest if parent.head == "either" else (parent,)
            if name != OBJECT:
                own = self.supertypes.get(name, ()) if name in lines else ()
                lines[name] = form.line
                self.supertypes[name] = tuple(dict.fromkeys((*own, *(each.word for each in above))))
        for name, parents in list(self.supertypes.items()):
            for each in parents:  # a supertype may go without a declaration of its own
                self.supertypes.setdefault(each, (OBJECT,))
            if name != OBJECT and not parents:
                self.supertypes[name] = (OBJECT,)
        for name, line in lines.items():
            seen, waiting = set[str](), list(self.supertypes[name])
            while waiting:
                if (current := waiting.pop()) == name:
                    file.fail(line, f"type {name} descends from itself")
                if current not in seen:
                    seen.add(current)
                    waiting += self.supertypes[current]

    def declare_objects(self, file: PddlFile, section: str) -> None:
        found = file.section(section)
        for form, name, kind in file.typed(found.rest if found else (), "an object"):
            if name in self.objects:
                file.fail(form.line, f"object {name} is declared twice")
            self.objects[name] = self.kind(file, kind)

    def declare_predicates(self, file: PddlFile) -> None:
        section = file.section(":predicates")
        for form in section.rest if section else ():
            name = file.identifier(form.items[0] if form.items else form, "a predicate")
            if name in self.predicates:
                file.fail(form.line, f"predicate {name} is declared twice")
            parameters = file.typed(form.rest, "a parameter", "?")
            self.predicates[name] = tuple(self.kind(file, kind) for _, _, kind in parameters)
            self.parameters[name] = tuple(variable.removeprefix("?") for _, variable, _ in parameters)
        if not self.predicates:
            file.fail(section.line if section else 1, "declares no predicates")

    def declare_functions(self, file: PddlFile) -> None:
        section = file.section(":functions")
        forms = iter(section.rest if section else ())
        for form in forms:
            if form.word == "-":  # and the type of what the functions before it give
                next(forms, None)
            else:
                name = file.identifier(form.items[0] if form.items else form, "a function")
                self.functions.setdefault(name, form.line)
                parameters = file.typed(form.rest, "a parameter", "?")
                self.function_parameters[name] = tuple((own, self.kind(file, kind)) for _, own, kind in parameters)

    def use_numbers(self, file: PddlFile, used: Collection[str], largest: int) -> None:
        """Make predicates of the functions that are numeric fluents, and objects of the numbers up to the largest."""
        names = {name for name in self.objects if name[-1:].isdigit()}
        prefix = next(
            each
            for each in ("n", "number-", "numeral-", "value-is-")
            if not any(name.startswith(each) and name[len(each) :].isdigit() for name in names)
        )
        self.numbers = Numbers(min(MOST, max(LEAST_MOST, largest, len(self.objects))), prefix)
        if NUMERAL in self.supertypes:
            file.fail(1, f"a type cannot be called {NUMERAL} where there are numeric fluents")
        self.supertypes[NUMERAL] = ()
        self.objects.update(dict.fromkeys(self.numbers.names, NUMERAL))
        for name in (name for name in self.functions if name in used):
            if name in self.predicates:
                file.fail(self.functions[name], f"{name} is both a function and a predicate")
            self.numbers.used[name] = kinds = tuple(kind for _, kind in self.function_parameters[name])
            self.predicates[name] = (*kinds, NUMERAL)
            own = (variable.removeprefix("?") for variable, _ in self.function_parameters[name])
            self.parameters[name] = (*own, "number")

    def _no_function(self, file: PddlFile, form: Form, where: str) -> NoReturn:
        hint = nearest(name_of(form.rest[0]) if form.rest else "", self.functions)
        file.fail(form.line, f"{where}: expected a declared function and a number in {shorten(form)}; {hint}")

    def _comparison(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> Formula:
        if self.numbers is None or len(form.rest) != 2:
            self._no_function(file, form, where)
        left, right = (self._expression(file, each, scope, where) for each in form.rest)
        self._check_size(file, form, (*left.keys(), *right.keys()), where)
        return self.numbers.comparison(form.head, left, right)

    def _change(
        self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str, limits: list[Formula]
    ) -> Iterator[LiftedEffect]:
        if self.numbers is None or len(form.rest) != 2 or name_of(form.rest[0]) not in self.numbers.used:
            self._no_function(file, form, where)
        target, amount = (self._expression(file, each, scope, where) for each in form.rest)
        assert target.key is not None
        self._check_size(file, form, (target.key, *amount.keys()), where)
        yield from self.numbers.change(form.head, target.key, amount, limits)

    def _check_size(self, file: PddlFile, form: Form, keys: Sequence[Key], where: str) -> None:
        assert self.numbers is not None
        if self.numbers.combinations(tuple(dict.fromkeys(keys))) > MOST_COMBINATIONS:
            file.fail(form.line, f"{where}: {shorten(form)} is not supported: it has too many numeric fluents at once")

    def _expression(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> Expression:
        if is_number(form):
            return Expression(constant=float(form.word))
        if form.head in OPERATORS and (len(form.rest) > 1 or (form.head == "-" and form.rest)):
            parts = tuple(self._expression(file, each, scope, where) for each in form.rest)
            return Expression(operation=form.head, parts=parts)
        name = name_of(form)
        if self.numbers is None or name not in self.numbers.used:
            file.fail(
                form.line, f"{where}: {shorten(form)} is no number and no function; {nearest(name, self.functions)}"
            )
        kinds = self.numbers.used[name]
        if len(form.rest) != len(kinds):
            file.fail(form.line, f"{where}: {shorten(form)} does not fit the declared ({' '.join((name, *kinds))})")
        for term, kind in zip(form.rest, kinds, strict=True):
            own = self.term(file, term, scope, where)
            if not (self.typing.descends(own, kind) or self.typing.descends(kind, own)):
                file.fail(term.line, f"{where}: in {form}, {term} is of type {own}, expected {kind}")
        return Expression(key=(name, tuple(term.word for term in form.rest)))

    def literal(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> Literal:
        """An atom over the variables in scope and the objects, checked against the predicate's declaration."""
        head = form if form.items is None else form.items[0] if form.items else form
        if head.word not in self.predicates:
            refusal = _REFUSED.get(head.word)
            if refusal:
                file.fail(form.line, f"{where}: {head} is not supported: {refusal}")
            if head.word == "at" and len(form.rest) == 2 and form.rest[0].word.replace(".", "").isdigit():
                file.fail(form.line, f"{where}: {shorten(form)} is not supported: facts that come about at a time")
            hint = nearest(head.word, self.predicates)
            file.fail(form.line, f"{where}: unknown predicate in {shorten(form)}; {hint}")
        kinds = self.predicates[head.word]
        if form.items is None or len(form.rest) != len(kinds):
            usage = f"({' '.join((head.word, *kinds))})"
            file.fail(form.line, f"{where}: {shorten(form)} does not fit the declared {usage}")
        for term, kind in zip(form.rest, kinds, strict=True):
            own = self.term(file, term, scope, where)
            if not (self.typing.descends(own, kind) or self.typing.descends(kind, own)):
                file.fail(term.line, f"{where}: in {form}, {term} is of type {own}, expected {kind}")
        return Literal(head.word, tuple(term.word for term in form.rest))

    def term(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> str:
        """The type of a variable in scope or of an object."""
        known = scope if form.word.startswith("?") else self.objects
        if form.word not in known:
            what = "variable" if known is scope else "object"
            file.fail(form.line, f"{where}: unknown {what} {shorten(form)}; {nearest(form.word, known)}")
        return known[form.word]

    def variables(
        self, file: PddlFile, form: Form, where: str
    ) -> tuple[tuple[tuple[str, str], ...], tuple[Literal, ...]]:
        """The variables of a quantifier, each with its type, and what has to hold of them besides: some files of the
        planning competitions name a predicate of one parameter where a type belongs, and mean those of which it is
        true."""
        if len(form.rest) != 2 or form.rest[0].items is None:
            file.fail(form.line, f"{where}: expected ({form.head} (?variable - type) condition)")
        listed = file.typed(form.rest[0].items, "a variable", "?")
        kinds: dict[str, str] = {}
        guards = []
        for _, name, kind in listed:
            word = kind.word if kind is not None else ""
            if word not in self.supertypes and len(self.predicates.get(word, ())) == 1:
                kinds[name] = self.predicates[word][0]
                guards.append(Literal(word, (name,)))
            else:
                kinds[name] = self.kind(file, kind)
        return tuple(kinds.items()), tuple(guards)

    def formula(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> Formula:
        """A condition. Anything that is none is refused with its line and name."""
        if form.items == ():
            return And()
        if form.head in ("and", "or"):
            parts = tuple(self.formula(file, part, scope, where) for part in form.rest)
            return And(parts) if form.head == "and" else Or(parts)
        if form.head == "imply":
            if len(form.rest) != 2:
                file.fail(form.line, f"{where}: (imply ...) takes two conditions")
            condition, consequence = (self.formula(file, part, scope, where) for part in form.rest)
            return Or((negated(condition), consequence))
        if form.head in ("forall", "exists"):
            variables, guards = self.variables(file, form, where)
            body = self.formula(file, form.rest[1], {**scope, **dict(variables)}, where)
            if form.head == "forall":
                return Forall(variables, Or((*map(negated, guards), body)) if guards else body)
            return Exists(variables, And((*guards, body)) if guards else body)
        if form.head == "not":
            if len(form.rest) != 1:
                file.fail(form.line, f"{where}: (not ...) takes one condition")
            return negated(self.formula(file, form.rest[0], scope, where))
        if form.head == "=":
            terms = form.rest
            if any(term.items is not None or term.word in self.functions or is_number(term) for term in terms):
                return self._comparison(file, form, scope, where)
            if len(terms) != 2:
                file.fail(form.line, f"{where}: {shorten(form)}: = compares two objects")
            for term in terms:
                self.term(file, term, scope, where)
            return Equality(terms[0].word, terms[1].word)
        if form.head in COMPARISONS and form.head not in self.predicates:
            return self._comparison(file, form, scope, where)
        return self.literal(file, form, scope, where)

    def effects(
        self,
        file: PddlFile,
        form: Form,
        scope: Mapping[str, str],
        where: str,
        cost: list[CostTerm],
        limits: list[Formula],
    ) -> Iterator[LiftedEffect]:
        """The effects of an action, each literal by itself; what it adds to the total cost goes into `cost`, and what
        has to hold for numbers to stay among those that there are into `limits`."""
        if form.items == ():
            return
        if form.head == "and":
            for part in form.rest:
                yield from self.effects(file, part, scope, where, cost, limits)
        elif form.head in ("forall", "when"):
            variables: tuple[tuple[str, str], ...] = ()
            condition: Formula = And()
            if form.head == "forall":
                variables, guards = self.variables(file, form, where)
                condition = And(guards)
            elif len(form.rest) != 2:
                file.fail(form.line, f"{where}: expected (when condition effect)")
            else:
                condition = self.formula(file, form.rest[0], scope, where)
            inner: list[CostTerm] = []
            bounds: list[Formula] = []
            for each in self.effects(file, form.rest[1], {**scope, **dict(variables)}, where, inner, bounds):
                parts = tuple(part for part in (condition, each.condition) if part != And())
                combined = parts[0] if len(parts) == 1 else And(parts)
                yield LiftedEffect(each.literal, combined, (*variables, *each.variables))
            for bound in bounds:
                wanted = bound if condition == And() else Or((negated(condition), bound))
                limits.append(Forall(variables, wanted) if variables else wanted)
            if inner:
                file.fail(form.line, f"{where}: a cost that depends on a condition is not supported: numeric fluents")
        elif form.head == "not":
            if len(form.rest) != 1:
                file.fail(form.line, f"{where}: (not ...) takes one atom")
            literal = self.literal(file, form.rest[0], scope, where)
            yield LiftedEffect(Literal(literal.predicate, literal.terms, False))
        elif form.head == "increase" and len(form.rest) == 2 and name_of(form.rest[0]) == COST:
            cost.append(self._cost(file, form.rest[1], scope, where))
        elif form.head in CHANGES and form.head not in self.predicates:
            yield from self._change(file, form, scope, where, limits)
        else:
            if form.head in ("or", "imply", "exists", "="):
                file.fail(form.line, f"{where}: {form.head} is no effect")
            yield LiftedEffect(self.literal(file, form, scope, where))

    def _cost(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> CostTerm:
        if is_number(form):
            return float(form.word)
        name = name_of(form)
        if name not in self.functions:
            file.fail(form.line, f"{where}: {shorten(form)} is not supported: numeric fluents")
        for term in form.rest:
            self.term(file, term, scope, where)
        return name, tuple(term.word for term in form.rest)


def number(form: Form) -> float | None:
    """A number, or None for anything else."""
    return float(form.word) if is_number(form) else None
