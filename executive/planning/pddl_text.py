"""A task as PDDL for programs that plan, under names that hit no word of PDDL's own, whatever the task calls things."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from math import prod

from executive.domain.pddl import And, Equality, Exists, Forall, Formula, Literal, Or, Schema, conjuncts, written_out
from executive.domain.pddl.text import Writer
from executive.types import Atom, Condition, Step

FLAG = "done"
"""A flag that is the goal where the translator is only to look at the task."""

FINISH = f"(:action finish :parameters () :precondition () :effect ({FLAG}))"
"""An action that sets the flag: so it can be reached from any state."""

MOST_PARTS = 1_000
"""Literals that a quantified condition may become."""

_BARRED = "n"
"""Before an action's number, the predicate of the arguments that it must not have."""


class PddlText:
    """A task's PDDL, and what is called how in it."""

    def __init__(self, schema: Schema) -> None:
        self._schema, self._write = schema, Writer(schema)
        self._number = {name: number for number, name in enumerate(schema.actions)}
        self._actions = list(schema.actions)
        self._object_of = {new: name for name, new in self._write.objects.items()}
        self._predicate_of = {new: name for name, new in self._write.predicates.items()}
        self._known = frozenset((*schema.task.atoms, *schema.task.derived.rules))

    def atoms(self, name: str) -> Iterator[Atom]:
        """The fluent atoms of the predicate that is called `p1`; none of the flag."""
        return (atom for atom in self._schema.task.atoms if self._write.predicates[atom.predicate] == name)

    def atom(self, text: str) -> Atom | None:
        """The atom that the translator calls `Atom p1(o2, o3)`; None for what is neither fluent nor derived."""
        head, _, tail = text.removeprefix("Atom ").removesuffix(")").partition("(")
        if head not in self._predicate_of:
            return None
        atom = Atom(self._predicate_of[head], tuple(self._object_of[name] for name in tail.split(", ") if name))
        return atom if atom in self._known else None

    def action(self, text: str) -> tuple[str, tuple[str, ...]] | None:
        """The action and the arguments of the operator that is called `a1 o2 o3`; None for one that the task does not
        have."""
        head, *args = text.split()
        if not head.removeprefix("a").isdecimal():
            return None
        return self._actions[int(head[1:])], tuple(self._object_of[name] for name in args)

    def call(self, step: Step) -> str:
        """What the operator of a step is called."""
        return " ".join((f"a{self._number[step.action]}", *(self._write.objects[arg] for arg in step.args)))

    def domain(self, *more: str, avoid: Collection[Step] = ()) -> str:
        """The domain file. `more` are actions beside the task's own; no step in `avoid` can be carried out."""
        schema, write, barred = self._schema, self._write, {step.action for step in avoid}
        actions, declared = [], [f"({FLAG})", *write.declarations()]
        for name, action in schema.actions.items():
            call, needed = f"{_BARRED}{self._number[name]}", []
            if name in barred:
                scope = write.scope(action.parameters)
                needed.append(f"(not ({' '.join((call, *scope.values()))}))")
                declared.append(f"({call} {write.parameters(action.parameters, scope)})")
            # What is quantified is written out where it is a condition, as far as no disjunctions come of it: the
            # translator would make axioms of it. Where it is an effect, it stays as it is: groups are found by looking
            # at effects before they are grounded.
            precondition = self._written_out(action.precondition)
            actions.append(write.action(f"a{self._number[name]}", action, precondition, *needed))
        lines = [
            "(define (domain task)",
            "(:requirements :adl :typing :equality)",
            write.types(),
            write.constants(),
            f"(:predicates {' '.join(declared)})",
            *write.axioms(),
            *more,
            *actions,
            ")",
        ]
        return "\n".join(lines)

    def problem(self, true: Iterable[Atom], goal: Condition | None = None, avoid: Collection[Step] = ()) -> str:
        """The problem file that starts where exactly the static atoms and those in `true` are true. Without a goal, it
        is the flag."""
        task, derived = self._schema.task, self._schema.derived
        facts = [self._write.atom(atom) for atom in sorted(task.static.union(true)) if atom.predicate not in derived]
        facts += [f"({_BARRED}{self.call(step)[1:]})" for step in sorted(avoid, key=str)]
        wanted = f"({FLAG})" if goal is None else self._write.condition(goal)
        init = " ".join((*facts, *self._write.facts()))
        return f"(define (problem task) (:domain task) (:init {init}) (:goal {wanted}))"

    def maker(self, predicate: str) -> str:
        """An action that makes any atom of a predicate true."""
        kinds = self._schema.predicates[predicate]
        variables = [(f"?v{index}", kind) for index, kind in enumerate(kinds)]
        scope = self._write.scope(variables)
        name, needed = self._write.predicates[predicate], " ".join(self._write.guards(variables, scope))
        return (
            f"(:action make-{name} :parameters ({self._write.parameters(variables, scope)})"
            f" :precondition (and {needed}) :effect ({' '.join((name, *scope.values()))}))"
        )

    def asker(self, number: int, atom: Atom) -> str:
        """An action that does nothing but need an atom."""
        return f"(:action ask-{number} :parameters () :precondition {self._write.atom(atom)} :effect ({FLAG}))"

    def _written_out(self, formula: Formula) -> Formula:
        """A formula with conjunctions in the place of those universal quantifiers that are over literals."""
        match formula:
            case And(parts):
                return And(tuple(map(self._written_out, parts)))
            case Or(parts):
                return Or(tuple(map(self._written_out, parts)))
            case Exists(variables, body):
                return Exists(variables, self._written_out(body))
            case Forall(variables, body):
                inner, typing = self._written_out(body), self._schema.typing
                parts = tuple(conjuncts(inner))
                size = len(parts) * prod(len(typing.members(kind)) for _, kind in variables)
                if size <= MOST_PARTS and all(isinstance(part, Literal | Equality) for part in parts):
                    return written_out(Forall(variables, inner), typing)
                return Forall(variables, inner)
            case _:
                return formula
