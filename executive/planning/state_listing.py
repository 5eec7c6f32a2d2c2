"""Lists the states of a task where its actions leave few (`executive.belief.state_space`)."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

from executive.belief.mutex_inference import Group
from executive.belief.state_space import StateSpace
from executive.domain.pddl import Schema
from executive.planning.mutex_groups import Mutexes
from executive.types import Step

MOST_ACTIONS = 2_000
"""Grounded actions up to which states are listed."""


def list_states(schema: Schema, found: Mutexes) -> StateSpace | None:
    """The states that the task's actions lead to from its :init; None where they are too many, where :init leaves open
    what is true, and where the mutex groups say as much: then inference under these is as exact, and they hold after an
    accident, too."""
    if not is_complete(schema, found) or most_actions(schema) > MOST_ACTIONS:
        return None
    space = StateSpace.reachable(schema.task.atoms, tuple(steps(schema)), found.state, schema.task.derived)
    return space if space is not None and space.rules_out_more(found.groups) else None


def is_complete(schema: Schema, found: Mutexes) -> bool:
    """Whether the task's :init says of all that it names where it is."""
    return not schema.unknown and found.state == frozenset(schema.task.declared)


def groups_of(found: Mutexes, space: StateSpace | None) -> tuple[Group, ...]:
    """The mutex groups that the translator found; where it found none, as with effects that depend on conditions, those
    that the listed states keep."""
    return found.groups if found.groups or space is None else space.mutex_groups()


def most_actions(schema: Schema) -> int:
    members = schema.typing.members
    return sum(math.prod(len(members(kind)) for _, kind in each.parameters) for each in schema.actions.values())


def steps(schema: Schema) -> Iterator[Step]:
    """Yield the task's grounded actions."""
    for name, action in schema.actions.items():
        for args in schema.typing.tuples([kind for _, kind in action.parameters]):
            with contextlib.suppress(ValueError):  # this one can never be carried out
                yield schema.ground(name, args)
