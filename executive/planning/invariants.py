"""What a domain states that every state keeps: held against its actions.

A stated invariant is inductive if no action breaks it: from no state in which all stated invariants and the mutex
groups hold, and the action's precondition, does the action lead to one in which it does not. That is a question of
satisfiability for each grounded action and each part of the invariant that the action touches (regression, Rintanen
2008), answered by search with unit propagation. Where there are too many actions, or the search takes too long, the
invariant is not proved; it holds because the domain says so.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from executive.belief.mutex_inference import Group
from executive.domain.pddl import Schema
from executive.planning.state_listing import MOST_ACTIONS, most_actions, steps
from executive.types import ALWAYS, NEVER, Atom, Condition, Facts, Step

MOST_BRANCHES = 2_000
"""Branches of one search up to which it goes on."""


@dataclass(frozen=True, slots=True)
class Broken:
    """An invariant that an action breaks: its name, the action, and what holds before it."""

    name: str
    step: Step
    before: Facts


def broken(schema: Schema, groups: Sequence[Group]) -> Broken | None:
    """Return the first stated invariant that an action breaks, and how; None if none was found."""
    if not schema.invariants or most_actions(schema) > MOST_ACTIONS:
        return None
    every = Condition.all_of(schema.invariants.values())
    for step in steps(schema):
        for name, invariant in schema.invariants.items():
            for part in invariant.conjuncts:
                if part.atoms.isdisjoint(step.affects):
                    continue
                wrong = ~after(part, step)
                if wrong == NEVER:
                    continue
                wanted = Condition.all_of((step.precondition, wrong, every))
                found = model(Condition.all_of((wanted, *_at_most_one(groups, wanted))))
                if found is not None:
                    return Broken(name, step, found.only(part.atoms | step.precondition.atoms))
    return None


def survives_accidents(part: Condition, steps: Sequence[Step]) -> bool:
    """Whether what `steps` keep holds after an accident, too.

    Anything can fall to where no atom speaks of it: then all atoms about it are false. So an item can be in no place at
    all, while what is on top of another in a pile is in that one's pile, or not on top of it. What holds something is
    left as an action leaves it: a gripper that has lost what it held is empty.
    """
    for thing in sorted({arg for atom in part.atoms for arg in atom.args}):
        about = {atom for atom in part.atoms if thing in atom.args}
        left = part.given(dict.fromkeys(about, False))
        if left == ALWAYS or model(part & ~left) is None:
            continue
        leaving = [step.unconditional for step in steps if not about.isdisjoint(step.unconditional.false)]
        leaving = [effects for effects in leaving if left.given(effects) == ALWAYS]
        if not about <= {atom for effects in leaving for atom in effects.false}:
            return False
    return True


def contradicted(schema: Schema) -> str | None:
    """Return the name of a stated invariant that :init contradicts: what it says, whatever it leaves open."""
    said = {atom: each.value for atom, each in schema.init.items()}
    return next((name for name, each in schema.invariants.items() if each.truth(said) is False), None)


def after(condition: Condition, step: Step) -> Condition:
    """Return what has to hold before a step for a condition to hold after it."""
    parts = [_literal_after(atom, value, step) for atom, value in condition.facts.items()]
    parts += [Condition.any_of(after(part, step) for part in choice) for choice in condition.choices]
    return Condition.all_of(parts)


def _literal_after(atom: Atom, value: bool, step: Step) -> Condition:
    added, deleted = (
        Condition.any_of(each.condition for each in step.effects if each.facts.get(atom) is wanted)
        for wanted in (True, False)
    )
    true = Condition.any_of((added, Condition.all_of((Condition.literal(atom), ~deleted))))
    return true if value else ~true


def _at_most_one(groups: Sequence[Group], about: Condition) -> Iterator[Condition]:
    """Yield what the mutex groups say of the atoms of a condition."""
    for group in groups:
        named = [atom for atom in group.atoms if atom in about.atoms]
        for pair in itertools.combinations(named, 2):
            yield Condition.any_of(Condition.literal(atom, False) for atom in pair)


def model(condition: Condition) -> Facts | None:
    """Return literals that make a condition true, whatever the others are; None where there are none, or none were
    found in `MOST_BRANCHES`."""
    waiting: list[tuple[Mapping[Atom, bool], Condition]] = [({}, condition)]
    for _ in range(MOST_BRANCHES):
        if not waiting:
            return None
        known, left = waiting.pop()
        while left.facts and left != NEVER:
            known, left = {**known, **left.facts}, Condition.all_of(left.conjuncts[len(left.facts) :]).given(left.facts)
        if left == NEVER:
            continue
        if left == ALWAYS:
            return Facts(known)
        shortest = min(left.choices, key=len)
        atom = min(shortest[0].atoms)
        waiting += [({**known, atom: value}, left.given({atom: value})) for value in (False, True)]
    return None
