"""Reads a PDDL domain and problem into a `Schema`, and says of every mistake what, in which file, on which line."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from executive.domain.pddl.forms import Form, PddlFile, shorten
from executive.domain.pddl.schema import (
    OBJECT,
    Action,
    Condition,
    Equality,
    Forall,
    Literal,
    Said,
    Schema,
    Typing,
    literals,
)
from executive.errors import DomainError, nearest
from executive.types import ALWAYS, Atom, Task
from executive.types import Condition as Goal

MOST_ATOMS = 10_000
"""Every atom is a question to the estimator at every look; a task with more of them was not meant for one. What is
static is known, and does not count."""

_REFUSED = {
    "or": "a disjunction",
    "imply": "an implication",
    "exists": "an existential condition",
    "when": "a conditional effect",
    "preference": "a preference",
    **dict.fromkeys(("<", "<=", ">", ">=", "+", "-", "*", "/"), "arithmetic"),
    **dict.fromkeys(("assign", "increase", "decrease", "scale-up", "scale-down"), "a numeric effect"),
    **dict.fromkeys(("always", "sometime", "within", "at-most-once", "at-end"), "a trajectory constraint"),
}


@dataclass(slots=True)
class _Words:
    """What has been declared so far."""

    supertypes: dict[str, str | None] = field(default_factory=lambda: {OBJECT: None})
    objects: dict[str, str] = field(default_factory=dict)
    predicates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: dict[str, tuple[str, ...]] = field(default_factory=dict)
    functions: list[str] = field(default_factory=list)

    @property
    def typing(self) -> Typing:
        return Typing(self.supertypes, self.objects)

    def kind(self, file: PddlFile, form: Form | None) -> str:
        if form is None:
            return OBJECT
        if form.word not in self.supertypes:
            file.fail(form.line, f"unknown type {form}; {nearest(form.word, self.supertypes)}")
        return form.word

    def declare_types(self, file: PddlFile) -> None:
        section = file.section(":types")
        lines: dict[str, int] = {}
        for form, name, parent in file.typed(section.rest if section else (), "a type"):
            if name in lines:
                file.fail(form.line, f"type {name} is declared twice")
            if name != OBJECT:
                lines[name], self.supertypes[name] = form.line, parent.word if parent else OBJECT
        for parent_name in [parent for parent in self.supertypes.values() if parent is not None]:
            self.supertypes.setdefault(parent_name, OBJECT)  # a supertype may go without a declaration of its own
        for name, line in lines.items():
            seen, current = {name}, self.supertypes[name]
            while current is not None:
                if current in seen:
                    file.fail(line, f"type {name} descends from itself")
                seen.add(current)
                current = self.supertypes[current]

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
                self.functions.append(file.identifier(form.items[0] if form.items else form, "a function"))

    def literal(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> Literal:
        """An atom over the variables in scope and the objects, checked against the predicate's declaration."""
        head = form if form.items is None else form.items[0] if form.items else form
        if head.word not in self.predicates:
            refusal = _REFUSED.get(head.word)
            if refusal:
                file.fail(form.line, f"{where}: {head} is not supported: {refusal}")
            hint = nearest(head.word, self.predicates)
            file.fail(form.line, f"{where}: unknown predicate in {shorten(form)}; {hint}")
        kinds = self.predicates[head.word]
        if form.items is None or len(form.rest) != len(kinds):
            usage = f"({' '.join((head.word, *kinds))})"
            file.fail(form.line, f"{where}: {shorten(form)} does not fit the declared {usage}")
        for term, kind in zip(form.rest, kinds, strict=True):
            own = self.term(file, term, scope, where)
            if not self.typing.descends(own, kind):
                file.fail(term.line, f"{where}: in {form}, {term} is of type {own}, expected {kind}")
        return Literal(head.word, tuple(term.word for term in form.rest))

    def term(self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str) -> str:
        """The type of a variable in scope or of an object."""
        known = scope if form.word.startswith("?") else self.objects
        if form.word not in known:
            what = "variable" if known is scope else "object"
            file.fail(form.line, f"{where}: unknown {what} {shorten(form)}; {nearest(form.word, known)}")
        return known[form.word]

    def conditions(
        self, file: PddlFile, form: Form, scope: Mapping[str, str], where: str, *, equality: bool
    ) -> tuple[Condition, ...]:
        """A conjunction, taken apart. Anything that is not one is refused with its line and name."""
        if form.items == ():
            return ()
        if form.head == "and":
            parts = (self.conditions(file, part, scope, where, equality=equality) for part in form.rest)
            return tuple(condition for part in parts for condition in part)
        if form.head == "forall":
            if len(form.rest) != 2 or form.rest[0].items is None:
                file.fail(form.line, f"{where}: expected (forall (?variable - type) condition)")
            listed = file.typed(form.rest[0].items, "a variable", "?")
            variables = [(name, self.kind(file, kind)) for _, name, kind in listed]
            body = self.conditions(file, form.rest[1], {**scope, **dict(variables)}, where, equality=equality)
            return (Forall(tuple(variables), body),)
        if form.head == "=":
            if not equality:
                file.fail(form.line, f"{where}: = is not supported here: only preconditions compare")
            if len(form.rest) != 2 or any(term.items is not None for term in form.rest):
                file.fail(form.line, f"{where}: {shorten(form)} is not supported: = compares two objects")
            for term in form.rest:
                self.term(file, term, scope, where)
            return (Equality(form.rest[0].word, form.rest[1].word),)
        if form.head == "not":
            if len(form.rest) != 1:
                file.fail(form.line, f"{where}: (not ...) takes one condition")
            inner = form.rest[0]
            if inner.head in ("and", "forall"):
                file.fail(form.line, f"{where}: (not ({inner.head} ...)) is not supported: it is a disjunction")
            (condition,) = self.conditions(file, inner, scope, where, equality=equality) or (None,)
            if isinstance(condition, Literal):
                return (Literal(condition.predicate, condition.terms, not condition.positive),)
            if isinstance(condition, Equality):
                return (Equality(condition.left, condition.right, not condition.positive),)
            file.fail(form.line, f"{where}: (not ()) can never hold")
        return (self.literal(file, form, scope, where),)


def read_task(domain: Path, problem: Path, seen: Collection[str] = ()) -> Schema:
    """Read a domain and one of its problems. Predicates that no action changes are static, but for those in `seen`,
    which somebody is to look at all the same.

    Raises:
        DomainError: naming the file and the line of the first mistake, or of the first thing that is not supported.
    """
    source = PddlFile(domain, "domain")
    words = _declared(source)
    actions: dict[str, Action] = {}
    for form in source.actions:
        action = _action(words, source, form)
        if action.name in actions:
            source.fail(form.line, f"action {action.name} is declared twice")
        actions[action.name] = action
    if not actions:
        source.fail(1, "declares no actions")

    file = PddlFile(problem, "problem")
    _declare_problem(words, source, file)
    changed = {each.predicate for action in actions.values() for each in literals(action.effects)}
    return _schema(words, source, file, actions, frozenset(words.predicates.keys() - changed.union(seen)))


def read_vocabulary(domain: Path, problem: Path, seen: Collection[str] = ()) -> Task:
    """Read what there is to ask about, for whoever estimates and does not plan: a task with all its atoms, without a
    goal. Whatever else the files say is passed over, supported or not; numeric fluents are named. Predicates that no
    action changes are not asked about, but for those in `seen`; where there are no actions, nothing is known to stay.

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
    changed = {name for form in source.actions for name in _changed(form)}
    static = words.predicates.keys() - changed.union(seen) if source.actions else ()
    parameters = {name: known for name, known in words.parameters.items() if name not in static}
    numeric, atoms = tuple(words.functions), _atoms(words, file, static)
    return Task(source.name, file.name, dict(words.objects), atoms, ALWAYS, parameters=parameters, numeric=numeric)


def _declared(source: PddlFile) -> _Words:
    """What a domain file declares."""
    words = _Words()
    words.declare_types(source)
    words.declare_objects(source, ":constants")
    words.declare_predicates(source)
    return words


def _declare_problem(words: _Words, source: PddlFile, file: PddlFile) -> None:
    """Add the objects of a problem, once it is clear that it is one of this domain."""
    named = file.section(":domain")
    if named is None or len(named.rest) != 1:
        file.fail(1, "expected (:domain <name>)")
    if named.rest[0].word != source.name:
        file.fail(named.line, f"is for domain {named.rest[0]}, and {source.path.name} defines {source.name}")
    words.declare_objects(file, ":objects")
    if not words.objects:
        file.fail(1, "there are no objects")


def _changed(form: Form) -> Iterator[str]:
    """The words that may be predicates which an action of any kind, or an axiom, changes."""
    if form.head == ":derived":
        waiting = list(form.rest[:1])
    else:
        waiting = [value for key, value in zip(form.rest, form.rest[1:], strict=False) if key.word == ":effect"]
    while waiting:
        part = waiting.pop()
        yield part.head
        waiting += part.rest[1:] if part.head == "when" else part.items or ()


def _atoms(words: _Words, problem: PddlFile, static: Collection[str]) -> tuple[Atom, ...]:
    """Every predicate that is not static over every tuple of objects that fits its types."""
    fluents = ((name, kinds) for name, kinds in words.predicates.items() if name not in static)
    tuples = ((name, args) for name, kinds in fluents for args in words.typing.tuples(kinds))
    atoms = tuple(Atom(name, args) for name, args in islice(tuples, MOST_ATOMS + 1))
    if len(atoms) > MOST_ATOMS:
        raise DomainError(f"there are more than {MOST_ATOMS} atoms", file=problem.path, key=":objects")
    return atoms


def _action(words: _Words, file: PddlFile, form: Form) -> Action:
    if not form.rest:
        file.fail(form.line, "an :action without a name")
    name = file.identifier(form.rest[0], "an action's name")
    parts: dict[str, Form] = {}
    keys = (":parameters", ":precondition", ":effect")
    queue = iter(form.rest[1:])
    for key in queue:
        value = next(queue, None)
        if key.word not in keys:
            file.fail(key.line, f"action {name}: unknown {shorten(key)}; {nearest(key.word, keys)}")
        if value is None or value.items is None or key.word in parts:
            file.fail(key.line, f"action {name}: expected one bracketed list after {key}")
        parts[key.word] = value
    if ":effect" not in parts:
        file.fail(form.line, f"action {name} has no :effect")
    parameters: dict[str, str] = {}
    listed = parts[":parameters"].items if ":parameters" in parts else ()
    for own, variable, kind in file.typed(listed or (), "a parameter", "?"):
        if variable in parameters:
            file.fail(own.line, f"action {name}: parameter {variable} is declared twice")
        parameters[variable] = words.kind(file, kind)
    before = parts.get(":precondition", Form(form.line, items=()))
    preconditions = words.conditions(file, before, parameters, f"action {name}: :precondition", equality=True)
    effects = words.conditions(file, parts[":effect"], parameters, f"action {name}: :effect", equality=False)
    literals = {(c.predicate, c.terms, c.positive) for c in effects if isinstance(c, Literal)}
    for predicate, terms, positive in sorted(literals):
        if positive and (predicate, terms, False) in literals:
            atom = f"({' '.join((predicate, *terms))})"
            file.fail(parts[":effect"].line, f"action {name}: :effect both adds and deletes {atom}")
    return Action(name, tuple(parameters.items()), preconditions, effects)


def _schema(
    words: _Words, domain: PddlFile, problem: PddlFile, actions: Mapping[str, Action], static: frozenset[str]
) -> Schema:
    typing = words.typing
    for action in actions.values():
        size = typing.size(action.preconditions) + typing.size(action.effects)
        if size > MOST_ATOMS:
            raise DomainError(f"action {action.name} has {size} conditions once written out", file=domain.path)
    atoms = _atoms(words, problem, static)
    said: dict[Atom, Said] = {}
    init = problem.section(":init")
    for form in init.rest if init else ():
        if form.head == "=":
            problem.fail(form.line, f":init: {shorten(form)} is not supported: numeric fluents")
        negated = form.head == "not" and len(form.rest) == 1
        literal = words.literal(problem, form.rest[0] if negated else form, {}, ":init")
        atom = Atom(literal.predicate, literal.terms)
        if said.setdefault(atom, Said(not negated, form.line)).value is negated:
            problem.fail(form.line, f":init says {atom} and its opposite, on line {said[atom].line}")
    facts = frozenset(atom for atom, (value, _) in said.items() if value and atom.predicate in static)
    staged = {atom: entry for atom, entry in said.items() if atom.predicate not in static}

    goal = problem.section(":goal")
    if goal is None or len(goal.rest) != 1:
        problem.fail(goal.line if goal else 1, "expected (:goal <condition>)")
    conditions = words.conditions(problem, goal.rest[0], {}, ":goal", equality=False)
    if typing.size(conditions) > MOST_ATOMS:
        problem.fail(goal.line, f":goal has more than {MOST_ATOMS} conditions once written out")
    goals: dict[Atom, bool] = {}
    for condition in typing.expand(conditions, {}):
        if isinstance(condition, Literal):
            atom = Atom(condition.predicate, condition.terms)
            if atom.predicate in static:
                if (atom in facts) is not condition.positive:
                    is_so = "is not" if condition.positive else "is"
                    problem.fail(goal.line, f":goal: {atom} {is_so} so by :init, and no action changes that")
            elif goals.setdefault(atom, condition.positive) is not condition.positive:
                problem.fail(goal.line, f":goal asks for {atom} and for its opposite")
    if not goals:
        problem.fail(goal.line, ":goal asks for nothing that is not so already")
    task = Task(
        domain.name,
        problem.name,
        dict(words.objects),
        atoms,
        Goal.of(goals),
        frozenset(atom for atom, (value, _) in staged.items() if value),
        {name: known for name, known in words.parameters.items() if name not in static},
        static=facts,
    )
    return Schema(task, typing, dict(words.predicates), dict(actions), tuple(goals), static, staged)
