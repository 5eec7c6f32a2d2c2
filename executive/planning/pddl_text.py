"""A task written as PDDL for Fast Downward's translator, under names that hit no word of PDDL's own, whatever the task
calls things."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from executive.domain.pddl import Action, Equality, Forall, Schema
from executive.domain.pddl import Condition as Lifted
from executive.types import Atom, Condition, Step

FLAG = "done"
"""A flag that is the goal where the translator is only to look at the task."""

FINISH = f"(:action finish :parameters () :precondition () :effect ({FLAG}))"
"""An action that sets the flag: so it can be reached from any state."""

_BARRED = "n"
"""Before an action's number, the predicate of the arguments that it must not have."""


class PddlText:
    """A task's PDDL, and what is called how in it."""

    def __init__(self, schema: Schema) -> None:
        self._schema = schema
        self._objects = {name: f"o{number}" for number, name in enumerate(schema.typing.objects)}
        self._types = {name: f"t{number}" for number, name in enumerate(schema.typing.supertypes)}
        self._predicates = {name: f"p{number}" for number, name in enumerate(schema.predicates)}
        self._actions = list(schema.actions)
        self._number = {name: number for number, name in enumerate(self._actions)}
        self._object_of = {new: name for name, new in self._objects.items()}
        self._predicate_of = {new: name for name, new in self._predicates.items()}

    def atoms(self, name: str) -> Iterator[Atom]:
        """The fluent atoms of the predicate that is called `p1`; none of the flag."""
        return (atom for atom in self._schema.task.atoms if self._predicates[atom.predicate] == name)

    def atom(self, text: str) -> Atom | None:
        """The atom that the translator calls `Atom p1(o2, o3)`; None for what the task does not have."""
        head, _, tail = text.removeprefix("Atom ").removesuffix(")").partition("(")
        if head not in self._predicate_of:
            return None
        return Atom(self._predicate_of[head], tuple(self._object_of[name] for name in tail.split(", ") if name))

    def action(self, text: str) -> tuple[str, tuple[str, ...]] | None:
        """The action and the arguments of the operator that the translator calls `a1 o2 o3`; None for one that the task
        does not have."""
        head, *args = text.split()
        if not head.removeprefix("a").isdecimal():
            return None
        return self._actions[int(head[1:])], tuple(self._object_of[name] for name in args)

    def domain(self, *more: str, avoid: Collection[Step] = ()) -> str:
        """The domain file. `more` are actions beside the task's own; no step in `avoid` can be carried out."""
        schema, kinds, barred = self._schema, self._types, {step.action for step in avoid}
        above = schema.typing.supertypes.items()
        types = [f"{kinds[name]} - {'object' if parent is None else kinds[parent]}" for name, parent in above]
        objects = [f"{self._objects[name]} - {kinds[kind]}" for name, kind in schema.typing.objects.items()]
        predicates = [f"({self._predicates[name]} {self._parameters(own)})" for name, own in schema.predicates.items()]
        for name in sorted(barred):
            own = [kind for _, kind in schema.actions[name].parameters]
            predicates.append(f"({_BARRED}{self._number[name]} {self._parameters(own)})")
        lines = [
            "(define (domain task)",
            "(:requirements :adl :typing :equality)",
            f"(:types {' '.join(types)})",
            f"(:constants {' '.join(objects)})",
            f"(:predicates ({FLAG}) {' '.join(predicates)})",
            *more,
            *(self._action(self._number[name], action, name in barred) for name, action in schema.actions.items()),
            ")",
        ]
        return "\n".join(lines)

    def problem(self, true: Iterable[Atom], goal: Condition | None = None, avoid: Collection[Step] = ()) -> str:
        """The problem file that starts where exactly the static atoms and those in `true` are true. Without a goal, it
        is the flag."""
        facts = [self.fact(atom) for atom in sorted(self._schema.task.static.union(true))]
        facts += [f"({_BARRED}{self.call(step)[1:]})" for step in sorted(avoid, key=str)]
        wanted = f"({FLAG})" if goal is None else self._formula(goal)
        return f"(define (problem task) (:domain task) (:init {' '.join(facts)}) (:goal {wanted}))"

    def _formula(self, condition: Condition) -> str:
        parts = [self.fact(atom) if value else f"(not {self.fact(atom)})" for atom, value in condition.facts.items()]
        parts += [f"(or {' '.join(map(self._formula, choice))})" for choice in condition.choices]
        return f"(and {' '.join(parts)})"

    def fact(self, atom: Atom) -> str:
        """A grounded atom."""
        return f"({' '.join((self._predicates[atom.predicate], *(self._objects[name] for name in atom.args)))})"

    def maker(self, predicate: str) -> str:
        """An action that makes any atom of a predicate true."""
        name, own = self._predicates[predicate], self._schema.predicates[predicate]
        terms = " ".join(f"?v{index}" for index in range(len(own)))
        return f"(:action make-{name} :parameters ({self._parameters(own)}) :precondition () :effect ({name} {terms}))"

    def _parameters(self, kinds: Sequence[str]) -> str:
        return " ".join(f"?v{index} - {self._types[kind]}" for index, kind in enumerate(kinds))

    def asker(self, number: int, atom: Atom) -> str:
        """An action that does nothing but need an atom."""
        return f"(:action ask-{number} :parameters () :precondition {self.fact(atom)} :effect ({FLAG}))"

    def call(self, step: Step) -> str:
        """What the translator calls the operator of a step."""
        return " ".join((f"a{self._number[step.action]}", *(self._objects[arg] for arg in step.args)))

    def _action(self, number: int, action: Action, barred: bool) -> str:
        scope = {variable: f"?v{index}" for index, (variable, _) in enumerate(action.parameters)}
        # What is quantified is written out where it is a condition: the translator would make axioms of it. Where it is
        # an effect, it stays as it is: groups are found by looking at effects before they are grounded.
        conditions = [self._text(each, scope) for each in self._schema.typing.expand(action.preconditions, {})]
        if barred:
            conditions.append(f"(not ({_BARRED}{number} {' '.join(scope.values())}))")
        effects = [self._text(each, scope) for each in action.effects]
        return (
            f"(:action a{number} :parameters ({self._parameters([kind for _, kind in action.parameters])})"
            f" :precondition (and {' '.join(conditions)}) :effect (and {' '.join(effects)}))"
        )

    def _text(self, condition: Lifted, scope: Mapping[str, str]) -> str:
        if isinstance(condition, Forall):
            inner = dict(scope)
            for variable, _ in condition.variables:
                inner[variable] = f"?v{len(scope) + len(inner)}"
            terms = " ".join(f"{inner[variable]} - {self._types[kind]}" for variable, kind in condition.variables)
            return f"(forall ({terms}) (and {' '.join(self._text(each, inner) for each in condition.body)}))"
        if isinstance(condition, Equality):
            words: tuple[str, ...] = ("=", self._term(condition.left, scope), self._term(condition.right, scope))
        else:
            words = (self._predicates[condition.predicate], *(self._term(term, scope) for term in condition.terms))
        text = f"({' '.join(words)})"
        return text if condition.positive else f"(not {text})"

    def _term(self, term: str, scope: Mapping[str, str]) -> str:
        return scope[term] if term.startswith("?") else self._objects[term]
