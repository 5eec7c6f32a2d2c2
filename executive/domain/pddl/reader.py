"""Reads a PDDL domain and problem into a `Schema`, and says of every mistake what, in which file, on which line."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from executive.domain.pddl import fluents
from executive.domain.pddl.actions import read_action, read_axiom
from executive.domain.pddl.forms import Form, Fragment, PddlFile, shorten
from executive.domain.pddl.formulas import Axiom, Formula, Literal, conjuncts
from executive.domain.pddl.grounding import Grounding, Row
from executive.domain.pddl.numbers import COST, NUMERAL, survey
from executive.domain.pddl.schema import Action, Said, Schema, Unreachable
from executive.domain.pddl.words import Words, number
from executive.errors import DomainError, nearest
from executive.types import ALWAYS, NEVER, Atom, Condition, DerivedRules, Fluent, Task

MOST_ATOMS = 50_000
"""Every fluent atom is a question to the estimator; a task with more of them was not meant for one. What is static is
known, what is derived is computed, and neither counts."""

MOST_RULES = 200_000
"""Instances of axioms that a task may have."""

MOST_PARTS = 500_000
"""Conditions that an action, or the goal, may have once its quantifiers are written out."""


OPEN = ("unknown", "oneof")
"""What begins a form of :init about what is not known at first."""


class Stated(NamedTuple):
    """Formulas that a manifest states, as text: when an atom of a predicate can be seen, over the predicate's own
    parameters, and what every state keeps, by its name."""

    visible: Mapping[str, Fragment] = MappingProxyType({})
    invariants: Mapping[str, Fragment] = MappingProxyType({})


NOTHING_STATED = Stated()


def read_task(domain: Path, problem: Path, seen: Collection[str] = (), stated: Stated = NOTHING_STATED) -> Schema:
    """Read a domain and one of its problems. Atoms that no action changes are static, but for those of predicates in
    `seen`, which somebody is to look at all the same.

    Raises:
        DomainError: naming the file and the line of the first mistake, or of the first thing that is not supported.
    """
    source = PddlFile(domain, "domain")
    words = _declared(source)
    words.declare_functions(source)
    file: PddlFile | None = None
    if words.functions.keys() - {COST}:
        file = PddlFile(problem, "problem")
        used, largest = survey(source, file, words.functions)
        if used:
            _declare_problem(words, source, file)
            words.use_numbers(source, used, largest)
    actions: dict[str, Action] = {}
    axioms: list[tuple[Axiom, Form]] = []
    for form in source.actions:
        if form.head == ":derived":
            axioms.append((read_axiom(words, source, form), form))
    derived = frozenset(axiom.predicate for axiom, _ in axioms)
    for form in source.actions:
        if form.head == ":action":
            action = read_action(words, source, form, derived)
            if action.name in actions:
                source.fail(form.line, f"action {action.name} is declared twice")
            actions[action.name] = action
    if not actions:
        source.fail(1, "declares no actions")

    file = file or PddlFile(problem, "problem")
    if words.numbers is None:
        _declare_problem(words, source, file)
    return _Reading(words, source, file, actions, axioms, frozenset(seen) - derived, stated).schema()


def read_vocabulary(domain: Path, problem: Path, seen: Collection[str] = ()) -> Task:
    """Read what there is to ask about, for whoever estimates and does not plan: a task with all its atoms, without a
    goal. Whatever else the files say is passed over, supported or not; numeric fluents are named, and asked about if
    they are in `seen`. Predicates that no
    action changes are not asked about, but for those in `seen`; where there are no actions, nothing is known to stay.
    What axioms derive is not asked about.

    Raises:
        DomainError: naming the file and the line of the first mistake in what is read.
    """
    source = PddlFile(
        domain, "domain", frozenset([":requirements", ":types", ":constants", ":predicates", ":functions"])
    )
    words = _declared(source)
    words.declare_functions(source)
    file = PddlFile(problem, "problem", frozenset([":domain", ":requirements", ":objects"]))
    _declare_problem(words, source, file)
    if counted := words.functions.keys() & frozenset(seen) - {COST}:
        words.use_numbers(source, counted, 0)
    derived = {form.rest[0].head for form in source.actions if form.head == ":derived" and form.rest}
    actions = [form for form in source.actions if form.head != ":derived"]
    changed = {name for form in actions for name in _changed(form)}
    known = words.predicates.keys() - changed.union(seen) if actions else set[str]()
    asked = {name: kinds for name, kinds in words.predicates.items() if name not in known | derived}
    tuples = ((name, args) for name, kinds in asked.items() for args in words.typing.tuples(kinds))
    atoms = tuple(Atom(*each) for each in islice(tuples, MOST_ATOMS + 1))
    if len(atoms) > MOST_ATOMS:
        raise _too_many(file, asked)
    parameters = {name: words.parameters[name] for name in asked}
    numeric = tuple(name for name in words.functions if name != COST and name not in counted)
    return Task(
        source.name,
        file.name,
        _objects(words),
        atoms,
        ALWAYS,
        parameters=parameters,
        numeric=numeric,
        fluents=_numeric(words, atoms),
    )


def _declared(source: PddlFile) -> Words:
    """What a domain file declares."""
    words = Words()
    words.declare_types(source)
    words.declare_objects(source, ":constants")
    words.declare_predicates(source)
    return words


def _declare_problem(words: Words, source: PddlFile, file: PddlFile) -> None:
    """Add the objects of a problem, once it is clear that it is one of this domain."""
    named = file.section(":domain")
    if named is None or len(named.rest) != 1:
        file.fail(1, "expected (:domain <name>)")
    if named.rest[0].word != source.name:
        file.fail(named.line, f"is for domain {named.rest[0]}, and {source.path.name} defines {source.name}")
    words.declare_objects(file, ":objects")


def _changed(form: Form) -> Iterator[str]:
    """The words that may be predicates which an action of any kind changes."""
    waiting = [value for key, value in zip(form.rest, form.rest[1:], strict=False) if key.word == ":effect"]
    while waiting:
        part = waiting.pop()
        yield part.head
        waiting += part.rest[1:] if part.head == "when" else part.items or ()


def _too_many(file: PddlFile, predicates: Collection[str]) -> DomainError:
    section = file.section(":objects")
    message = f"there are more than {MOST_ATOMS} fluent atoms, of {', '.join(sorted(predicates))}"
    return DomainError(message, file=file.path, key=f"line {section.line if section else 1}")


class _Reading:
    """Puts a schema together once both files have been read."""

    def __init__(
        self,
        words: Words,
        domain: PddlFile,
        problem: PddlFile,
        actions: Mapping[str, Action],
        axioms: Sequence[tuple[Axiom, Form]],
        seen: frozenset[str],
        stated: Stated,
    ) -> None:
        self._stated = stated
        self._words, self._typing, self._domain, self._problem = words, words.typing, domain, problem
        self._actions, self._seen = actions, seen
        self._axioms, self._axiom_forms = tuple(axiom for axiom, _ in axioms), [form for _, form in axioms]
        self._derived = frozenset(axiom.predicate for axiom in self._axioms)
        changed = {effect.literal.predicate for action in actions.values() for effect in action.effects}
        self._static = frozenset(words.predicates.keys() - changed - seen - self._derived)
        self._said: dict[Atom, Said] = {}
        self._unknown: dict[Atom, int] = {}
        self._oneof: list[tuple[tuple[Atom, ...], int]] = []
        self._values: dict[tuple[str, Row], float] = {}
        self._unreachable: Unreachable | None = None

    def schema(self) -> Schema:
        words, problem = self._words, self._problem
        self._read_init()
        true = frozenset(atom for atom, (value, _) in self._said.items() if value)
        atoms = self._fluents(frozenset(atom for atom in true if atom.predicate in self._static))
        fluent = frozenset(atoms)
        self._check_sizes(Grounding(self._typing, true - fluent, self._static, ()))
        rules, always = self._rules(atoms, true - fluent)
        static = (true - fluent) | always
        grounding = Grounding(self._typing, static, self._static, (*atoms, *rules.rules))
        goal, formula, order = self._goal(grounding)
        init = {atom: said for atom, said in self._said.items() if atom in fluent}
        self._check_open(fluent)
        known = self._static | self._derived
        task = Task(
            self._domain.name,
            problem.name,
            _objects(words),
            atoms,
            goal,
            frozenset(atom for atom, (value, _) in init.items() if value),
            {name: names for name, names in words.parameters.items() if name not in known},
            static=static,
            derived=rules,
            fluents=_numeric(words, atoms),
            visible=self._visible(grounding, atoms),
        )
        return Schema(
            task,
            self._typing,
            dict(words.predicates),
            dict(self._actions),
            order,
            formula,
            self._static,
            init,
            self._axioms,
            self._values,
            self._has_costs(),
            self._unreachable,
            self._invariants(grounding),
            frozenset(self._unknown),
            tuple(atoms for atoms, _ in self._oneof),
        )

    def _visible(self, grounding: Grounding, atoms: Sequence[Atom]) -> dict[Atom, Condition]:
        """When each atom can be seen; those that always can are left out."""
        words, found = self._words, dict[Atom, Condition]()
        for name, text in self._stated.visible.items():
            if name not in words.predicates:
                text.fail(1, f"there is no predicate {name!r}; {nearest(name, words.predicates)}")
            if name in self._static | self._derived:
                why = "derived by axioms" if name in self._derived else "static"
                text.fail(1, f"{name} is {why}: nobody looks at it")
            kinds = zip(words.parameters[name], words.predicates[name], strict=True)
            scope = {f"?{each}": kind for each, kind in kinds}
            formula = self._formula(text, grounding, scope, len(atoms))
            for atom in atoms:
                if atom.predicate == name:
                    condition = grounding.condition(formula, dict(zip(scope, atom.args, strict=True)))
                    found.update({} if condition == ALWAYS else {atom: condition})
        return found

    def _invariants(self, grounding: Grounding) -> dict[str, Condition]:
        """What every state keeps, by its name."""
        found = {}
        for name, text in self._stated.invariants.items():
            found[name] = grounding.condition(self._formula(text, grounding, {}, 1), {})
            if found[name] == NEVER:
                text.fail(1, "no state at all is like this")
        return found

    def _formula(self, text: Fragment, grounding: Grounding, scope: Mapping[str, str], times: int) -> Formula:
        formula = self._words.formula(text, text.definition, scope, str(text.definition)[:60])
        if (size := times * grounding.size(formula)) > MOST_PARTS:
            text.fail(1, f"has {size} conditions once written out; {MOST_PARTS} are supported")
        return formula

    def _read_init(self) -> None:
        words, problem = self._words, self._problem
        init = problem.section(":init")
        for form in init.rest if init else ():
            if form.head == "=":
                self._read_value(form)
                continue
            if form.head in OPEN and form.head not in words.predicates:
                self._read_open(form)
                continue
            negated = form.head == "not" and len(form.rest) == 1
            literal = words.literal(problem, form.rest[0] if negated else form, {}, ":init")
            if literal.predicate in self._derived:
                problem.fail(form.line, f":init: {shorten(form)}: {literal.predicate} is derived by axioms")
            atom = Atom(literal.predicate, literal.terms)
            if self._said.setdefault(atom, Said(not negated, form.line)).value is negated:
                problem.fail(form.line, f":init says {atom} and its opposite, on line {self._said[atom].line}")

    def _read_open(self, form: Form) -> None:
        """What is not known at first: `(unknown <atom>)`, or `(oneof <atom> <atom> ...)`, of which one is so."""
        words, problem = self._words, self._problem
        least, most = (1, 1) if form.head == "unknown" else (2, MOST_ATOMS)
        if not least <= len(form.rest) <= most:
            wanted = "(unknown <atom>)" if form.head == "unknown" else "(oneof <atom> <atom> ...)"
            problem.fail(form.line, f":init: {shorten(form)}: expected {wanted}")
        literals = [words.literal(problem, each, {}, ":init") for each in form.rest]
        atoms = tuple(Atom(each.predicate, each.terms) for each in literals)
        for atom in atoms:
            if atoms.count(atom) > 1 or any(atom in others for others, _ in self._oneof):
                problem.fail(form.line, f":init: {shorten(form)}: {atom} stands in a (oneof ...) twice")
        if form.head == "unknown":
            self._unknown.setdefault(atoms[0], form.line)
        else:
            self._oneof.append((atoms, form.line))

    def _check_open(self, fluent: frozenset[Atom]) -> None:
        """What is called unknown can change and is seen, and :init does not say of it whether it is so."""
        problem = self._problem
        named = [(atom, line) for atom, line in self._unknown.items()]
        named += [(atom, line) for atoms, line in self._oneof for atom in atoms]
        for atom, line in named:
            if atom in self._said:
                told = f"says on line {self._said[atom].line} whether it is so"
                problem.fail(line, f":init: {atom} is called unknown, and :init {told}")
            if atom not in fluent:
                derived = atom.predicate in self._derived
                why = "is derived by axioms" if derived else "is static: no action changes it and nobody looks at it"
                problem.fail(line, f":init: {atom} is called unknown, and {why}")

    def _read_value(self, form: Form) -> None:
        words, problem = self._words, self._problem
        parts = form.rest
        value = number(parts[1]) if len(parts) == 2 else None
        name = parts[0].word or parts[0].head if parts else ""
        if name not in words.functions or value is None:
            problem.fail(form.line, f":init: {shorten(form)}: expected (= (<function> <objects>) <number>)")
        for term in parts[0].rest:
            words.term(problem, term, {}, ":init")
        args = tuple(term.word for term in parts[0].rest)
        if self._values.setdefault((name, args), value) != value:
            problem.fail(form.line, f":init gives {shorten(parts[0])} two values")
        if words.numbers is not None and name in words.numbers.used:
            literal = words.numbers.literal((name, args), int(value))
            self._said[Atom(literal.predicate, literal.terms)] = Said(True, form.line)

    def _fluents(self, static: frozenset[Atom]) -> tuple[Atom, ...]:
        """The atoms that some action may change and those that somebody looks at, in the order of the files."""
        words = self._words
        grounding = Grounding(self._typing, static, self._static, ())
        found: set[tuple[str, Row]] = set()

        def keep(keys: Iterator[tuple[str, Row]]) -> None:
            for key in keys:
                found.add(key)
                if len(found) > MOST_ATOMS:
                    raise _too_many(self._problem, {name for name, _ in found})

        for name in words.predicates:
            if name in self._seen:
                keep((name, args) for args in self._typing.tuples(words.predicates[name]))
        keep(fluents.changed(self._actions.values(), grounding, self._typing))
        rank = {name: index for index, name in enumerate(words.predicates)}
        place = {name: index for index, name in enumerate(words.objects)}
        return tuple(
            Atom(*key) for key in sorted(found, key=lambda key: (rank[key[0]], [place[each] for each in key[1]]))
        )

    def _check_sizes(self, grounding: Grounding) -> None:
        """Refuse what has too many parts once it is written out, before that is tried."""
        lines = {form.rest[0].word: form.line for form in self._domain.actions if form.head == ":action"}
        for name, action in self._actions.items():
            size = grounding.size(action.precondition)
            for effect in action.effects:
                size += grounding.count(effect.variables, effect.condition) * (grounding.size(effect.condition) + 1)
            if size > MOST_PARTS:
                self._domain.fail(lines[name], f"action {name} has {size} conditions once written out")
        for axiom, form in zip(self._axioms, self._axiom_forms, strict=True):
            if (size := grounding.size(axiom.condition)) > MOST_PARTS:
                self._domain.fail(form.line, f":derived {axiom.predicate} has {size} conditions once written out")

    def _rules(self, atoms: Sequence[Atom], static: frozenset[Atom]) -> tuple[DerivedRules, frozenset[Atom]]:
        """How derived atoms follow from fluent ones, and the derived atoms that are always true."""
        if not self._axioms:
            return DerivedRules(), frozenset()
        found = []
        for each in fluents.heads(self._axioms, Grounding(self._typing, static, self._static, ())):
            found.append(each)
            if len(found) > MOST_RULES:
                line = self._axiom_forms[each[0]].line
                self._domain.fail(line, f":derived: there are more than {MOST_RULES} instances of axioms")
        derived = {key: Atom(*key) for _, _, key in found}
        grounding = Grounding(self._typing, static, self._static, (*atoms, *derived.values()))
        rules, always = fluents.rules(self._axioms, found, grounding, derived)
        try:
            return DerivedRules(rules), always
        except ValueError as error:
            self._domain.fail(self._axiom_forms[0].line, f":derived: {error}")

    def _goal(self, grounding: Grounding) -> tuple[Condition, Formula, tuple[Atom, ...]]:
        problem = self._problem
        goal = problem.section(":goal")
        if goal is None or len(goal.rest) != 1:
            problem.fail(goal.line if goal else 1, "expected (:goal <condition>)")
        formula = self._words.formula(problem, goal.rest[0], {}, ":goal")
        if (size := grounding.size(formula)) > MOST_PARTS:
            problem.fail(goal.line, f":goal has {size} conditions once written out")
        order: dict[Atom, None] = {}
        parts = []
        for part in conjuncts(formula):
            condition = grounding.condition(part, {})
            if condition == NEVER:
                told = Atom(part.predicate, part.terms) if isinstance(part, Literal) else None
                what = "a condition of it can never hold" if told is None else f"{told} {_is_so(part)} by :init"
                self._unreachable = Unreachable(goal.line, f":goal: {what}, and no action changes that")
            order.update(dict.fromkeys(sorted(condition.atoms)))
            parts.append(condition)
        wanted = Condition.all_of(parts)
        if wanted == NEVER and self._unreachable is None:
            self._unreachable = Unreachable(goal.line, ":goal asks for something and for its opposite")
        return wanted, formula, tuple(atom for atom in order if atom in wanted.atoms)

    def _has_costs(self) -> bool:
        metric = self._problem.section(":metric")
        if metric is None:
            return False
        told = [form.word or form.head for form in metric.rest]
        if "is-violated" in str(metric):
            self._problem.fail(metric.line, f"{shorten(metric)} is not supported: a preference")
        if told == ["minimize", "total-time"]:
            self._problem.fail(metric.line, f"{shorten(metric)} is not supported: actions that take time")
        if told != ["minimize", COST]:
            self._problem.fail(metric.line, f"{shorten(metric)} is not supported: numeric fluents")
        return True


def _is_so(part: Formula) -> str:
    return "is not so" if isinstance(part, Literal) and part.positive else "is so"


def _numeric(words: Words, atoms: Sequence[Atom]) -> tuple[Fluent, ...]:
    """The numeric fluents, each with the atoms of its values."""
    numbers = words.numbers
    if numbers is None:
        return ()
    value = {name: number for number, name in enumerate(numbers.names)}
    found: dict[tuple[str, Row], list[tuple[int, Atom]]] = {}
    for atom in atoms:
        if atom.predicate in numbers.used:
            found.setdefault((atom.predicate, atom.args[:-1]), []).append((value[atom.args[-1]], atom))
    return tuple(Fluent(name, args, tuple(sorted(values))) for (name, args), values in found.items())


def _objects(words: Words) -> dict[str, str]:
    """The objects that the files name, without those that stand for numbers."""
    return {name: kind for name, kind in words.objects.items() if kind != NUMERAL}
