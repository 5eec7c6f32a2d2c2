"""Laws of listed states: they are what actions lead to, and inference over them is that of enumeration by hand."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief import Group, StateSpace
from executive.belief.packed_actions import Actions
from executive.types import ALWAYS, Atom, Condition, DerivedRules, Effect, Facts, Step
from tests.executive.belief.piles import ATOMS, CUPS, START, STEPS, TRAYS, at, listed, on, piles, top


@pytest.fixture(scope="module")
def space() -> StateSpace:
    return listed()


def test_listed_are_the_states_that_actions_lead_to_from_wherever_one_begins(space: StateSpace) -> None:
    assert {space.true(number) for number in range(len(space))} == set(piles())
    assert len(space) == len(piles()) == 60
    for start in piles()[::13]:
        again = StateSpace.reachable(ATOMS, STEPS, start)
        assert again is not None
        assert np.array_equal(again.packed, space.packed), "the order says nothing of the start"


def test_random_walks_stay_within_the_listed_states(space: StateSpace) -> None:
    rng = random.Random(1)
    for _ in range(20):
        state = Facts.closed(START, ATOMS)
        for _ in range(10):
            able = [step for step in STEPS if step.precondition.truth(state)]
            state = state | {atom: bool(value) for atom, value in rng.choice(able).changes(state).items()}
            assert space.number(state.true) is not None


def test_too_many_states_or_too_much_work_is_no_listing() -> None:
    assert StateSpace.reachable(ATOMS, STEPS, START, most_states=59) is None
    assert StateSpace.reachable(ATOMS, STEPS, START, most_states=60) is not None
    assert StateSpace.reachable(ATOMS, STEPS, START, most_work=100) is None


weights = st.dictionaries(st.sampled_from(ATOMS), st.floats(-6.0, 6.0))


@given(weights=weights)
def test_inference_is_that_of_enumeration(space: StateSpace, weights: dict[Atom, float]) -> None:
    mass = {state: math.exp(math.fsum(weights.get(atom, 0.0) for atom in state)) for state in piles()}
    whole = math.fsum(mass.values())
    solution = space.solve(weights)
    assert solution.log_total == pytest.approx(math.log(whole))
    assert mass[solution.best] == pytest.approx(max(mass.values()))
    assert math.exp(solution.log_best) == pytest.approx(max(mass.values()))
    for atom in ATOMS:
        expected = math.fsum(value for state, value in mass.items() if atom in state) / whole
        assert solution.marginal[atom] == pytest.approx(expected, abs=1e-9)
        assert 0.0 <= solution.marginal[atom] <= 1.0


@given(weights=weights, seed=st.integers(0, 1000))
def test_the_order_of_answers_and_of_atoms_changes_nothing(
    space: StateSpace, weights: dict[Atom, float], seed: int
) -> None:
    rng = random.Random(seed)
    shuffled = dict(rng.sample(sorted(weights.items()), len(weights)))
    assert space.solve(shuffled) == space.solve(weights)
    other = StateSpace.of(rng.sample(ATOMS, len(ATOMS)), rng.sample(piles(), 60))
    assert other.solve(weights) == space.solve(weights)


def test_a_prior_counts_and_what_it_rules_out_is_impossible(space: StateSpace) -> None:
    prior = np.full(len(space), -np.inf)
    prior[[3, 5]] = np.log([0.25, 0.75])
    solution = space.solve({}, prior)
    assert solution.best == space.true(5)
    for atom in ATOMS:
        assert solution.marginal[atom] == pytest.approx(0.25 * (atom in space.true(3)) + 0.75 * (atom in space.true(5)))


def test_successors_are_those_of_progression(space: StateSpace) -> None:
    for step in STEPS:
        for number, after in enumerate(space.successors(step).tolist()):
            state = Facts.closed(space.true(number), ATOMS)
            if not step.precondition.truth(state):
                assert after == -1
            else:
                expected = state | {atom: bool(value) for atom, value in step.changes(state).items()}
                assert space.true(after) == expected.true


def test_states_of_one_class_differ_in_nothing_else(space: StateSpace) -> None:
    loose = {atom for atom in ATOMS if "c" in atom.args} | {top("a"), top("b")}
    number = space.classes(loose).tolist()
    for one, other in itertools.combinations(range(len(space)), 2):
        alike = space.true(one) - loose == space.true(other) - loose
        assert (number[one] == number[other]) is alike


def test_derived_atoms_are_computed_where_a_condition_names_them() -> None:
    lit, powered, switch = Atom("lit"), Atom("powered"), Atom("switch")
    rules = DerivedRules({lit: Condition.literal(powered), powered: Condition.literal(switch)})
    flip = Step("flip", (), ALWAYS, (Effect(ALWAYS, Facts({switch: True})),))
    door = Atom("door")
    leave = Step("leave", (), Condition.literal(lit), (Effect(ALWAYS, Facts({door: True})),))
    found = StateSpace.reachable([switch, door], [flip, leave], (), rules)
    assert found is not None
    assert {found.true(number) for number in range(len(found))} == {
        frozenset(),
        frozenset({switch}),
        frozenset({switch, door}),
    }


def test_more_than_sixty_four_atoms() -> None:
    lamps = [Atom("lit", (f"l{number:02}",)) for number in range(70)]
    steps = [
        Step("on", lamp.args, ALWAYS, (Effect(ALWAYS, Facts(dict.fromkeys(lamps, False) | {lamp: True})),))
        for lamp in lamps
    ]
    found = StateSpace.reachable(lamps, steps, ())
    assert found is not None
    assert len(found) == 71
    assert found.solve({lamps[66]: 2.0}).best == {lamps[66]}
    assert found.number({lamps[3]}) is not None
    assert found.number({lamps[3], lamps[4]}) is None
    assert found.successors(steps[5]).tolist() == [found.number({lamps[5]})] * 71


def test_whether_groups_say_it_all(space: StateSpace) -> None:
    places = [Group(tuple(at(cup, tray) for tray in TRAYS)) for cup in CUPS]
    assert space.rules_out_more(places)
    free = StateSpace.of(
        [at(cup, tray) for cup in CUPS for tray in TRAYS],
        [frozenset(map(at, CUPS, choice)) for choice in itertools.product(TRAYS, repeat=3)],
    )
    assert not free.rules_out_more(places), "each cup is somewhere, and that is all"


def test_groups_are_kept_by_every_state_and_as_large_as_can_be(space: StateSpace) -> None:
    groups = space.mutex_groups()
    assert all(not group.violated(space.true(number)) for group in groups for number in range(len(space)))
    assert not any(group.exact for group in groups)
    for cup in CUPS:
        others = [other for other in CUPS if other != cup]
        assert Group(tuple(at(cup, tray) for tray in TRAYS)) in groups
        assert Group((top(cup), *(on(other, cup) for other in others))) in groups, "something lies on it, or nothing"
        assert Group(tuple(on(cup, other) for other in others)) in groups
    assert space.always_one(Group(tuple(at("a", tray) for tray in TRAYS)))
    assert not space.always_one(Group(tuple(on("a", other) for other in ("b", "c"))))


def test_what_some_truths_leave_no_choice_about(space: StateSpace) -> None:
    told = {on("b", "a"): True, on("c", "b"): True, at("a", "s"): True}
    follows = space.common(told)
    assert {atom for atom, value in follows.items() if value} == {*told, at("b", "s"), at("c", "s"), top("c")}
    assert follows.keys() == set(ATOMS), "the state is known"
    assert space.common({on("b", "a"): True, on("a", "b"): True}) == {}, "no state is like that"
    assert space.common({}) == {}, "nothing is the same in all"


def test_what_is_no_space_is_refused() -> None:
    with pytest.raises(ValueError, match="sorted"):
        StateSpace((on("b", "a"), on("a", "b")), np.zeros((1, 1), dtype=np.uint8))
    with pytest.raises(ValueError, match="bytes"):
        StateSpace((on("a", "b"),), np.zeros((0, 1), dtype=np.uint8))
    with pytest.raises(ValueError, match="different"):
        StateSpace((on("a", "b"),), np.zeros((2, 1), dtype=np.uint8))
    with pytest.raises(ValueError, match="finite"):
        StateSpace((on("a", "b"),), np.zeros((1, 1), dtype=np.uint8)).solve({on("a", "b"): math.inf})


def test_actions_can_be_prepared_once(space: StateSpace) -> None:
    prepared = Actions(space.atoms, STEPS)
    again = StateSpace.reachable(ATOMS, prepared, piles()[7])
    assert again is not None
    assert np.array_equal(again.packed, space.packed)
    for step, after in zip(STEPS, space.transitions(prepared), strict=True):
        assert np.array_equal(after, space.successors(step))
    with pytest.raises(ValueError, match="other atoms"):
        StateSpace.reachable(ATOMS[1:], prepared, ())
