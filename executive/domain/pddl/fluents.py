"""Which atoms there are to know about: those that some action can change, and those that axioms derive from them.

Nothing is grounded for that. An action can change an atom if there may be arguments for which its static literals hold
and one of its effects is that atom; all other atoms are what :init says of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from executive.domain.pddl.formulas import Axiom, conjuncts
from executive.domain.pddl.grounding import Grounding, Row
from executive.domain.pddl.schema import Action
from executive.domain.pddl.typing import Typing
from executive.types import ALWAYS, NEVER, Atom, Condition


def changed(actions: Iterable[Action], grounding: Grounding, typing: Typing) -> Iterator[tuple[str, Row]]:
    """The predicate and the arguments of each atom that an action may change, some of them twice."""
    for action in actions:
        if not all(typing.members(kind) for _, kind in action.parameters):
            continue
        for effect in action.effects:
            parameters, own = dict(action.parameters), dict(effect.variables)
            kept = list(dict.fromkeys(term for term in effect.literal.terms if term in parameters or term in own))
            formulas = [*conjuncts(effect.condition)]
            if own.keys().isdisjoint(parameters):  # otherwise a name means two things
                formulas += conjuncts(action.precondition)
            for binding in grounding.projections({**parameters, **own}, formulas, kept):
                yield effect.literal.predicate, tuple(binding.get(term, term) for term in effect.literal.terms)


def heads(axioms: Iterable[Axiom], grounding: Grounding) -> Iterator[tuple[int, Mapping[str, str], tuple[str, Row]]]:
    """The axioms' numbers with every binding of their parameters for which they may say something, and the predicate
    and the arguments of the atom that it is about."""
    for number, axiom in enumerate(axioms):
        for binding in grounding.bindings(axiom.parameters, axiom.condition, {}):
            yield number, binding, (axiom.predicate, tuple(binding[name] for name, _ in axiom.parameters))


def rules(
    axioms: Sequence[Axiom],
    found: Iterable[tuple[int, Mapping[str, str], tuple[str, Row]]],
    grounding: Grounding,
    atoms: Mapping[tuple[str, Row], Atom],
) -> tuple[dict[Atom, Condition], frozenset[Atom]]:
    """The condition of each derived atom, and the derived atoms that are true whatever else is.

    Args:
        found: what `heads` gives.
        atoms: the derived atoms among these.
    """
    parts: dict[Atom, list[Condition]] = {}
    for number, binding, key in found:
        parts.setdefault(atoms[key], []).append(grounding.condition(axioms[number].condition, binding))
    written = {atom: Condition.any_of(conditions) for atom, conditions in parts.items()}
    always: set[Atom] = set()
    while settled := {a: c == ALWAYS for a, c in written.items() if c in (ALWAYS, NEVER)}:
        always.update(atom for atom, value in settled.items() if value)
        written = {atom: rule.given(settled) for atom, rule in written.items() if atom not in settled}
    return written, frozenset(always)
