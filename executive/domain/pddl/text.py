"""A task's parts written as PDDL, under names that hit no word of PDDL's own, whatever the task calls things.

Where the types are a tree, they are written as types. Where a type has several supertypes or stands for a union, which
few programs read, every type that is used becomes a static predicate, and parameters have none.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from executive.domain.pddl.formulas import And, Equality, Exists, Forall, Formula, LiftedEffect, Literal, Or
from executive.domain.pddl.schema import Action, Schema
from executive.domain.pddl.typing import EITHER
from executive.types import Atom, Condition

Variables = Sequence[tuple[str, str]]
Scope = Mapping[str, str]


class Writer:
    """Writes formulas, effects, actions and axioms of one task.

    Attributes:
        objects, predicates, functions: what each is called.
    """

    def __init__(self, schema: Schema) -> None:
        self._schema, typing = schema, schema.typing
        self.objects = {name: f"o{number}" for number, name in enumerate(typing.objects)}
        self.predicates = {name: f"p{number}" for number, name in enumerate(schema.predicates)}
        functions = dict.fromkeys(name for name, _ in schema.values)
        self.functions = {name: f"f{number}" for number, name in enumerate(functions)}
        self._kinds = {name: f"t{number}" for number, name in enumerate(self._all_kinds())}
        self._has_types = all(len(above) <= 1 for above in typing.supertypes.values()) and not any(
            EITHER in kind for kind in self._kinds
        )

    def _all_kinds(self) -> Iterator[str]:
        """Every type that there is or that something is declared to be of; some of them more than once, which a
        dictionary's keys do not mind."""
        schema = self._schema
        found = dict.fromkeys([*schema.typing.supertypes, *schema.typing.objects.values()])
        found.update(dict.fromkeys(kind for kinds in schema.predicates.values() for kind in kinds))
        waiting: list[Formula] = [schema.goal]
        for action in schema.actions.values():
            found.update(dict.fromkeys(kind for _, kind in action.parameters))
            waiting.append(action.precondition)
            for effect in action.effects:
                found.update(dict.fromkeys(kind for _, kind in effect.variables))
                waiting.append(effect.condition)
        for axiom in schema.axioms:
            found.update(dict.fromkeys(kind for _, kind in axiom.parameters))
            waiting.append(axiom.condition)
        while waiting:
            match waiting.pop():
                case And(parts) | Or(parts):
                    waiting += parts
                case Forall(variables, body) | Exists(variables, body):
                    found.update(dict.fromkeys(kind for _, kind in variables))
                    waiting.append(body)
                case _:
                    pass
        yield from found

    # What is declared.

    def types(self) -> str:
        """The section of types; empty where there are predicates in their place."""
        if not self._has_types:
            return ""
        above = self._schema.typing.supertypes.items()
        lines = [f"{self._kinds[name]} - {self._kinds[parents[0]] if parents else 'object'}" for name, parents in above]
        return f"(:types {' '.join(lines)})"

    def constants(self) -> str:
        """All objects, as constants of the domain."""
        objects = self._schema.typing.objects.items()
        if not self._has_types:
            return f"(:constants {' '.join(self.objects.values())})"
        return f"(:constants {' '.join(f'{self.objects[name]} - {self._kinds[kind]}' for name, kind in objects)})"

    def declarations(self) -> Iterator[str]:
        """The declarations of predicates."""
        for name, kinds in self._schema.predicates.items():
            variables = [(f"?v{index}", kind) for index, kind in enumerate(kinds)]
            yield f"({self.predicates[name]} {self.parameters(variables)})"
        if not self._has_types:
            yield from (f"({name} ?v0)" for name in self._kinds.values())

    def facts(self) -> Iterator[str]:
        """What holds at first besides atoms: types that are predicates."""
        typing = self._schema.typing
        for kind, name in self._kinds.items() if not self._has_types else ():
            yield from (f"({name} {self.objects[member]})" for member in typing.members(kind))

    # Formulas and actions.

    def scope(self, variables: Variables, outer: Scope | None = None) -> dict[str, str]:
        """Names for variables, none of them one of an outer variable's."""
        names = dict(outer or {})
        first = len(set(names.values()))
        return names | {variable: f"?v{first + index}" for index, (variable, _) in enumerate(variables)}

    def parameters(self, variables: Variables, scope: Scope | None = None) -> str:
        """The variables as they are declared."""
        names = [(scope or {}).get(variable, variable) for variable, _ in variables]
        if not self._has_types:
            return " ".join(names)
        return " ".join(f"{name} - {self._kinds[kind]}" for name, (_, kind) in zip(names, variables, strict=True))

    def guards(self, variables: Variables, scope: Scope) -> list[str]:
        """What has to hold of the variables for them to be of their types, where that is not declared."""
        return [] if self._has_types else [f"({self._kinds[kind]} {scope[name]})" for name, kind in variables]

    def term(self, term: str, scope: Scope) -> str:
        return scope[term] if term.startswith("?") else self.objects[term]

    def formula(self, formula: Formula, scope: Scope) -> str:
        """A condition."""
        match formula:
            case Literal(predicate, terms, positive):
                text = f"({' '.join((self.predicates[predicate], *(self.term(term, scope) for term in terms)))})"
                return text if positive else f"(not {text})"
            case Equality(left, right, positive):
                text = f"(= {self.term(left, scope)} {self.term(right, scope)})"
                return text if positive else f"(not {text})"
            case And(parts):
                return f"(and {' '.join(self.formula(part, scope) for part in parts)})"
            case Or(parts):
                return f"(or {' '.join(self.formula(part, scope) for part in parts)})"
            case Forall(variables, body) | Exists(variables, body):
                inner = self.scope(variables, scope)
                guards, text = self.guards(variables, inner), self.formula(body, inner)
                if isinstance(formula, Exists):
                    return f"(exists ({self.parameters(variables, inner)}) (and {' '.join((*guards, text))}))"
                open_ = " ".join((*(f"(not {guard})" for guard in guards), text))
                return f"(forall ({self.parameters(variables, inner)}) (or {open_}))"

    def condition(self, condition: Condition) -> str:
        """A condition that is grounded."""
        parts = [self.atom(atom) if value else f"(not {self.atom(atom)})" for atom, value in condition.facts.items()]
        parts += [f"(or {' '.join(map(self.condition, choice))})" for choice in condition.choices]
        return f"(and {' '.join(parts)})"

    def atom(self, atom: Atom) -> str:
        """A grounded atom."""
        return f"({' '.join((self.predicates[atom.predicate], *(self.objects[name] for name in atom.args)))})"

    def effect(self, effect: LiftedEffect, scope: Scope) -> str:
        """An effect."""
        inner = self.scope(effect.variables, scope)
        text, needed = self.formula(effect.literal, inner), self.guards(effect.variables, inner)
        if effect.condition != And():
            needed.append(self.formula(effect.condition, inner))
        if needed:
            text = f"(when (and {' '.join(needed)}) {text})"
        return f"(forall ({self.parameters(effect.variables, inner)}) {text})" if effect.variables else text

    def action(self, name: str, action: Action, precondition: Formula, *needed: str) -> str:
        """An action under another name and with a precondition that may be written otherwise; `needed` are conditions
        that it has besides."""
        scope = self.scope(action.parameters)
        conditions = [*self.guards(action.parameters, scope), self.formula(precondition, scope), *needed]
        effects = " ".join(self.effect(effect, scope) for effect in action.effects)
        return (
            f"(:action {name} :parameters ({self.parameters(action.parameters, scope)})"
            f" :precondition (and {' '.join(conditions)}) :effect (and {effects}))"
        )

    def axioms(self) -> Iterator[str]:
        """The axioms."""
        for axiom in self._schema.axioms:
            scope = self.scope(axiom.parameters)
            terms = " ".join(scope[name] for name, _ in axiom.parameters)
            conditions = [*self.guards(axiom.parameters, scope), self.formula(axiom.condition, scope)]
            yield f"(:derived ({self.predicates[axiom.predicate]} {terms}) (and {' '.join(conditions)}))"
