"""Draws an action that can be carried out in a state, without grounding all that there are: the positive literals of
its precondition are matched with what is true, the rarest predicate first, and what they leave open is tried in random
order."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np

from executive.domain.pddl.formulas import Literal, conjuncts
from executive.domain.pddl.schema import Action, Schema
from executive.types import Atom, Step

MOST_TRIES = 2_000
"""Bindings that are tried for one draw."""


def draw_action(
    schema: Schema, state: Mapping[Atom, bool], rng: np.random.Generator, about: Collection[str] = ()
) -> Step | None:
    """Draw an action that can be carried out in the complete `state`, changes it, and has all objects in `about` among
    its arguments: an action schema first, each as probable as the others, then its arguments. None where none is found.
    """
    tries, known = iter(range(MOST_TRIES)), schema.task.derived.complete(state)
    facts: dict[str, list[tuple[str, ...]]] = {}
    for atom in sorted({*schema.task.static, *(atom for atom, value in known.items() if value)}):
        facts.setdefault(atom.predicate, []).append(atom.args)
    for number in rng.permutation(len(schema.actions)):
        action = schema.actions[sorted(schema.actions)[number]]
        needs = [each for each in conjuncts(action.precondition) if isinstance(each, Literal) and each.positive]
        needs.sort(key=lambda literal: len(facts.get(literal.predicate, ())))
        for binding in _bindings(schema, action, needs, facts, {}, rng):
            if next(tries, None) is None:
                return None
            args = tuple(binding[variable] for variable, _ in action.parameters)
            with suppress(ValueError):  # an instance that can never be carried out
                step = schema.ground(action.name, args)
                possible = step.precondition.truth(known)
                changes = any(state[atom] is not value for atom, value in step.changes(known).items())
                if possible and changes and set(about) <= set(args):
                    return step
    return None


def _bindings(
    schema: Schema,
    action: Action,
    needs: Sequence[Literal],
    facts: Mapping[str, Sequence[tuple[str, ...]]],
    bound: Mapping[str, str],
    rng: np.random.Generator,
) -> Iterator[Mapping[str, str]]:
    """Yield bindings of the action's parameters in random order, under which all of `needs` are among the facts."""
    if needs:
        there = facts.get(needs[0].predicate, ())
        for number in rng.permutation(len(there)):
            further = dict(bound)
            for term, name in zip(needs[0].terms, there[number], strict=True):
                if (further.setdefault(term, name) if term.startswith("?") else term) != name:
                    break
            else:
                yield from _bindings(schema, action, needs[1:], facts, further, rng)
        return
    variable, kind = next(((name, kind) for name, kind in action.parameters if name not in bound), ("", ""))
    if not variable:
        yield bound
        return
    members = schema.typing.members(kind)
    for number in rng.permutation(len(members)):
        yield from _bindings(schema, action, (), facts, {**bound, variable: members[number]}, rng)
