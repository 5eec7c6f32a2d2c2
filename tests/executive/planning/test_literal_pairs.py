"""What is proved of pairs of literals holds in every state that actions lead to."""

from __future__ import annotations

import itertools
import random

from hypothesis import given
from hypothesis import strategies as st

from executive.belief import StateSpace
from executive.planning.literal_pairs import LiteralPairs
from executive.types import ALWAYS, Atom, Condition, Effect, Facts, Step
from tests.executive.belief import piles

ATOMS = tuple(Atom("p", (name,)) for name in "abcdef")
literals = st.builds(Condition.literal, st.sampled_from(ATOMS), st.booleans())
conjunctions = (
    st.lists(literals, max_size=2).map(Condition.all_of).filter(lambda each: bool(each.atoms) or each == ALWAYS)
)
clauses = st.lists(literals, min_size=1, max_size=2).map(Condition.any_of)
conditions = st.one_of(conjunctions, conjunctions, clauses)
facts = st.dictionaries(st.sampled_from(ATOMS), st.booleans(), min_size=1, max_size=2).map(Facts)
effects = st.lists(st.builds(Effect, conditions, facts), min_size=1, max_size=3)
moves = st.lists(
    st.builds(lambda needs, made: Step("act", (), needs, tuple(made)), conditions, effects), min_size=1, max_size=4
)
starts = st.sets(st.sampled_from(ATOMS))


@given(moves, starts, st.sets(st.sampled_from(ATOMS), min_size=1))
def test_every_state_that_actions_lead_to_keeps_what_is_proved(
    steps: list[Step], start: set[Atom], some: set[Atom]
) -> None:
    found = LiteralPairs.reachable(ATOMS, steps, start)
    space = StateSpace.reachable(ATOMS, steps, start)
    assert found is not None
    assert space is not None
    groups = found.groups()
    implications = list(found.implications(groups))
    always = found.always_one(some)
    for number in range(len(space)):
        true = space.true(number)
        assert not any(group.violated(true) for group in groups)
        assert all(each.truth({atom: atom in true for atom in ATOMS}) for each in implications)
        assert not always or not true.isdisjoint(some)
        assert found.never.isdisjoint(true)
        for (one, other), values in itertools.product(
            itertools.combinations(ATOMS, 2), itertools.product([False, True], repeat=2)
        ):
            if ((one in true), (other in true)) == values:
                assert not found.impossible(one, values[0], other, values[1])


def test_of_piles_nearly_every_pair_is_found_and_that_each_cup_is_in_one_place() -> None:
    found = LiteralPairs.reachable(piles.ATOMS, piles.STEPS, piles.START)
    assert found is not None
    states = piles.piles()
    missed = set()
    for one, other in itertools.combinations(piles.ATOMS, 2):
        for values in itertools.product([False, True], repeat=2):
            never = not any(((one in state), (other in state)) == values for state in states)
            if found.impossible(one, values[0], other, values[1]) is not never:
                missed.add((one.predicate, other.predicate, one.args[0] == other.args[0], values))
    assert missed <= {("on", "on", True, (True, True))}, "that a cup is not on two others hangs on three atoms"
    places = {frozenset(piles.at(cup, tray) for tray in piles.TRAYS) for cup in piles.CUPS}
    assert places <= {frozenset(group.atoms) for group in found.groups() if group.exact}


def test_long_walks_of_a_task_too_large_to_be_listed_keep_what_is_proved() -> None:
    cups, trays = [f"c{number}" for number in range(7)], ["s", "t", "u", "v"]
    every, steps = piles.task(cups, trays)
    start = {*(piles.at(cup, "s") for cup in cups), piles.top(cups[-1])}
    start |= {piles.on(upper, lower) for lower, upper in itertools.pairwise(cups)}
    found = LiteralPairs.reachable(every, steps, start)
    assert StateSpace.reachable(every, steps, start, most_states=10_000) is None
    assert found is not None
    groups = found.groups()
    implications = list(found.implications(groups))
    assert sum(group.exact for group in groups) == 2 * len(cups), "each is in one place, and on top or under one other"
    assert (
        Condition.literal(piles.on("c0", "c1"), False) | Condition.literal(piles.on("c1", "c0"), False) in implications
    )
    rng = random.Random(4)
    state = Facts.closed(start, every)
    for _ in range(300):
        able = [step for step in steps if step.precondition.truth(state)]
        state = state | {atom: bool(value) for atom, value in rng.choice(able).changes(state).items()}
        assert not any(group.violated(state.true) for group in groups)
        assert all(each.truth(state) for each in implications)


def test_too_many_literals_are_not_looked_at() -> None:
    many = [Atom("p", (f"x{number}",)) for number in range(501)]
    assert LiteralPairs.reachable(many, [], many[:1]) is None
