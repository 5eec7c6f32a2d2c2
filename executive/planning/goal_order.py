"""Reordering of a plan's steps where their order is free.

A planner that minimises cost is free to sort the groceries in any order, and which one it picks depends on its hash
tables. People wrote the goal in an order, though, and a run is easier to follow, to compare and to reproduce when
the steps keep it. So commuting segments of a plan are put into the order of the goals that they achieve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet

from executive.types import Atom, Facts, Step


def holds(true: AbstractSet[Atom], required: Mapping[Atom, bool]) -> bool:
    """Whether every literal of `required` holds where exactly the atoms in `true` are true."""
    return all((atom in true) is value for atom, value in required.items())


def replay(true: AbstractSet[Atom], steps: Sequence[Step]) -> frozenset[Atom] | None:
    """The atoms that are true after the steps, or None when a precondition fails on the way."""
    current = set(true)
    for step in steps:
        if not holds(current, step.precondition.facts):
            return None
        current = (current - step.unconditional.false) | step.unconditional.true
    return frozenset(current)


def by_goals(
    state: Facts, steps: Sequence[Step], goal: Facts, order: Sequence[Atom], stop: Callable[[], bool] = bool
) -> tuple[Step, ...]:
    """Reorders the steps so that the goals are achieved in `order` as far as the steps allow.

    Again and again, the first goal in `order` that does not hold yet is looked at: the few remaining steps that lead
    to it from here are moved to the front, if they can be carried out at once and the rest still reaches the goal
    after them. A segment that is needed by others stays before them. Valid plans stay valid, and a plan whose steps
    do not commute is returned as it came. Atoms not mentioned in `state` are false. Where it is to `stop`, which is
    asked before each segment, the rest stays in the order that it had.
    """
    true: frozenset[Atom] = state.true
    done: list[Step] = []
    remaining = list(steps)
    while remaining:
        for atom in order:
            if (atom in true) is goal[atom]:
                continue
            if stop():
                return (*done, *remaining)
            chosen = _towards(true, remaining, atom, goal[atom])
            segment = [remaining[index] for index in sorted(chosen)]
            rest = [step for index, step in enumerate(remaining) if index not in chosen]
            after = replay(true, segment)
            if after is None or (atom in after) is not goal[atom]:
                continue
            end = replay(after, rest)
            if end is not None and holds(end, goal):
                done, remaining, true = [*done, *segment], rest, after
                break
        else:
            break  # no goal can be brought forward any more
    return (*done, *remaining)


def _towards(true: AbstractSet[Atom], steps: Sequence[Step], atom: Atom, value: bool) -> frozenset[int]:
    """Indices of the steps that lead to `atom` being `value`, found backwards from the goal: a step is chosen when it
    provides something that is needed and does not hold already."""
    needed: set[tuple[Atom, bool]] = {(atom, value)}
    chosen: set[int] = set()
    for index in reversed(range(len(steps))):
        step = steps[index]
        provided = {(a, v) for a, v in needed if step.unconditional.get(a) is v}
        if provided:
            chosen.add(index)
            needed -= provided
            needed |= {(a, v) for a, v in step.precondition.facts.items() if (a in true) is not v}
    return frozenset(chosen)
