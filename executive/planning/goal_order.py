"""Carrying out a plan on paper, and reordering its steps where their order is free.

A planner that minimises cost is free to sort the groceries in any order, and which one it picks depends on its hash
tables. People wrote the goal in an order, though, and a run is easier to follow, to compare and to reproduce when
the steps keep it. So commuting segments of a plan are put into the order of the goals that they achieve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet

from executive.types import Atom, Condition, DerivedRules, Step

NO_RULES = DerivedRules()

MOST_WORK = 1_000_000
"""Steps times goals times goals up to which a plan is put in order: so the time that it takes grows."""


class State(Mapping[Atom, bool]):
    """A complete state: exactly the atoms in `true` are true, and those derived atoms that follow from them."""

    def __init__(self, true: AbstractSet[Atom], rules: DerivedRules = NO_RULES) -> None:
        self.true = frozenset(true)
        self._derived: Mapping[Atom, bool] = {}
        if rules:
            known = rules.complete({atom: atom in self.true for atom in rules.fluents})
            self._derived = {atom: known[atom] for atom in rules.rules}

    def __getitem__(self, atom: Atom) -> bool:
        return atom in self.true or self._derived.get(atom, False)

    def __iter__(self) -> Iterator[Atom]:
        """The true atoms."""
        yield from self.true
        yield from (atom for atom, value in self._derived.items() if value)

    def __len__(self) -> int:
        return len(self.true) + sum(self._derived.values())


def replay(true: AbstractSet[Atom], steps: Sequence[Step], rules: DerivedRules = NO_RULES) -> frozenset[Atom] | None:
    """The atoms that are true after the steps, but for derived ones, or None when a precondition fails on the way."""
    state = State(true, rules)
    for step in steps:
        if not step.precondition.truth(state):
            return None
        changes = step.changes(state)
        state = State((state.true - changes.keys()).union(atom for atom, value in changes.items() if value), rules)
    return state.true


def by_goals(
    true: AbstractSet[Atom],
    steps: Sequence[Step],
    goal: Condition,
    order: Sequence[Atom],
    stop: Callable[[], bool] = bool,
    rules: DerivedRules = NO_RULES,
) -> tuple[Step, ...]:
    """Reorders the steps so that the goal's literals are achieved in `order` as far as the steps allow.

    Again and again, the first literal in `order` that does not hold yet is looked at: the few remaining steps that lead
    to it from here are moved to the front, if they can be carried out at once and the rest still reaches the goal
    after them. A segment that is needed by others stays before them. Valid plans stay valid, and a plan whose steps
    do not commute is returned as it came. Where it is to `stop`, which is asked before each segment, the rest stays in
    the order that it had; a plan that is too long for its many goals stays as it is.

    Args:
        true: the atoms that are true before the plan.
        order: the atoms of the goal's literals.
    """
    if len(steps) * len(order) ** 2 > MOST_WORK:
        return tuple(steps)
    state = State(true, rules)
    done: list[Step] = []
    remaining = list(steps)
    while remaining:
        for atom in order:
            if state[atom] is goal.facts[atom]:
                continue
            if stop():
                return (*done, *remaining)
            chosen = _towards(state, remaining, atom, goal.facts[atom])
            segment = [remaining[index] for index in sorted(chosen)]
            rest = [step for index, step in enumerate(remaining) if index not in chosen]
            after = replay(state.true, segment, rules)
            if after is None or State(after, rules)[atom] is not goal.facts[atom]:
                continue
            end = replay(after, rest, rules)
            if end is not None and goal.truth(State(end, rules)):
                done, remaining, state = [*done, *segment], rest, State(after, rules)
                break
        else:
            break  # no goal can be brought forward any more
    return (*done, *remaining)


def _towards(state: Mapping[Atom, bool], steps: Sequence[Step], atom: Atom, value: bool) -> frozenset[int]:
    """Indices of the steps that lead to `atom` being `value`, found backwards from the goal: a step is chosen when it
    provides something that is needed and does not hold already."""
    needed: set[tuple[Atom, bool]] = {(atom, value)}
    chosen: set[int] = set()
    for index in reversed(range(len(steps))):
        step = steps[index]
        gives = [effect.facts for effect in step.effects]
        provided = {(a, v) for a, v in needed if any(facts.get(a) is v for facts in gives)}
        if provided:
            chosen.add(index)
            needed -= provided
            needed |= {(a, v) for a, v in step.precondition.facts.items() if state[a] is not v}
    return frozenset(chosen)
