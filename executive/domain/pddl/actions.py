"""Reads actions and axioms."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from executive.domain.pddl.forms import Form, PddlFile, shorten
from executive.domain.pddl.formulas import And, Axiom, Formula
from executive.domain.pddl.schema import Action, CostTerm
from executive.domain.pddl.words import Words
from executive.errors import nearest

_REFUSED = {
    ":observe": "partial observability",
    ":duration": "actions that take time",
    ":condition": "actions that take time",
    ":vars": "variables that are no parameters",
}


def read_action(words: Words, file: PddlFile, form: Form, derived: Collection[str]) -> Action:
    """Read an action, whose effects are to be none of the `derived` predicates."""
    if not form.rest:
        file.fail(form.line, "an :action without a name")
    name = file.identifier(form.rest[0], "an action's name")
    parts: dict[str, Form] = {}
    keys = (":parameters", ":precondition", ":effect")
    queue = iter(form.rest[1:])
    for key in queue:
        value = next(queue, None)
        if key.word in _REFUSED:
            file.fail(key.line, f"action {name}: {key} is not supported: {_REFUSED[key.word]}")
        if key.word not in keys:
            file.fail(key.line, f"action {name}: unknown {shorten(key)}; {nearest(key.word, keys)}")
        if value is None or value.items is None or key.word in parts:
            file.fail(key.line, f"action {name}: expected one bracketed list after {key}")
        parts[key.word] = value
    if ":effect" not in parts:
        file.fail(form.line, f"action {name} has no :effect")
    listed = parts[":parameters"].items if ":parameters" in parts else ()
    parameters = _parameters(words, file, listed or (), f"action {name}")
    before = parts.get(":precondition", Form(form.line, items=()))
    precondition = words.formula(file, before, parameters, f"action {name}: :precondition")
    cost: list[CostTerm] = []
    limits: list[Formula] = []
    effects = tuple(words.effects(file, parts[":effect"], parameters, f"action {name}: :effect", cost, limits))
    for effect in effects:
        if effect.literal.predicate in derived:
            file.fail(parts[":effect"].line, f"action {name}: :effect: {effect.literal.predicate} is derived by axioms")
    if limits:
        precondition = And((precondition, *dict.fromkeys(limits)))
    return Action(name, tuple(parameters.items()), precondition, effects, tuple(cost))


def read_axiom(words: Words, file: PddlFile, form: Form) -> Axiom:
    """Read an axiom."""
    head = form.rest[0] if form.rest else form
    if len(form.rest) != 2 or not head.items:
        file.fail(form.line, "expected (:derived (<predicate> <?parameters>) <condition>)")
    if head.head not in words.predicates:
        file.fail(head.line, f":derived: unknown predicate {head.head}; {nearest(head.head, words.predicates)}")
    parameters = _parameters(words, file, head.rest, f":derived {head.head}")
    kinds = words.predicates[head.head]
    if len(parameters) != len(kinds):
        file.fail(head.line, f":derived: {shorten(head)} does not fit the declared ({' '.join((head.head, *kinds))})")
    typed = any(each.word == "-" for each in head.rest)
    if not typed:
        parameters = dict(zip(parameters, kinds, strict=True))
    condition = words.formula(file, form.rest[1], parameters, f":derived {head.head}")
    return Axiom(head.head, tuple(parameters.items()), condition)


def _parameters(words: Words, file: PddlFile, listed: Sequence[Form], where: str) -> dict[str, str]:
    parameters: dict[str, str] = {}
    for own, variable, kind in file.typed(listed, "a parameter", "?"):
        if variable in parameters:
            file.fail(own.line, f"{where}: parameter {variable} is declared twice")
        parameters[variable] = words.kind(file, kind)
    return parameters
