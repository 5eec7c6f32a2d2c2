"""Inference under constraints of any form, held against counting every state."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from executive.belief import BayesMonitor, ConstrainedNetwork, Group, SensorModel
from executive.belief.mutex_inference import EMPTY_GROUP
from executive.types import Atom, Belief, Condition
from tests.executive.belief.test_mutex_inference import ATOMS, groups, states, weights

literals = st.builds(Condition.literal, st.sampled_from(ATOMS), st.booleans())
clauses = st.lists(literals, min_size=1, max_size=3).map(Condition.any_of)
constraints = st.lists(clauses, min_size=1, max_size=3).map(tuple)


def allowed(some: tuple[Group, ...], kept: tuple[Condition, ...]) -> list[frozenset[Atom]]:
    def keeps(true: frozenset[Atom]) -> bool:
        return all(each.truth({atom: atom in true for atom in ATOMS}) for each in kept)

    return [true for true in states(some) if keeps(true)]


@given(groups, constraints, weights)
def test_answers_are_those_of_counting_every_state(
    some: tuple[Group, ...], kept: tuple[Condition, ...], weight: Mapping[Atom, float]
) -> None:
    assume(there := allowed(some, kept))
    network = ConstrainedNetwork(ATOMS, some, kept)
    answer = network.solve(weight)
    logs = {true: math.fsum(weight[atom] for atom in true) for true in there}
    total = math.fsum(map(math.exp, logs.values()))
    share = {atom: math.fsum(math.exp(log) for true, log in logs.items() if atom in true) / total for atom in ATOMS}
    assert not network.unused
    assert answer.log_total == pytest.approx(math.log(total), abs=1e-9)
    assert network.log_total(weight) == pytest.approx(math.log(total), abs=1e-9)
    assert answer.marginal == pytest.approx(share, abs=1e-9)
    assert answer.log_best == pytest.approx(max(logs.values()), abs=1e-9)
    assert answer.best in there


@given(groups, constraints, constraints, weights)
def test_what_accidents_break_costs_and_is_not_ruled_out(
    some: tuple[Group, ...], kept: tuple[Condition, ...], costly: tuple[Condition, ...], weight: Mapping[Atom, float]
) -> None:
    assume(there := allowed(some, kept))
    hard = {part for each in kept for part in each.conjuncts}
    exact = {Condition.any_of(map(Condition.literal, group.atoms)) for group in some}
    costly = tuple(each for each in costly if each not in hard | exact)
    network = ConstrainedNetwork(ATOMS, some, kept, costly)
    price = math.log((1.0 - EMPTY_GROUP) / EMPTY_GROUP)

    def broken(true: frozenset[Atom]) -> int:
        state = {atom: atom in true for atom in ATOMS}
        return sum(not part.truth(state) for part in {part for each in costly for part in each.conjuncts})

    logs = {true: math.fsum(weight[atom] for atom in true) - price * broken(true) for true in there}
    total = math.fsum(map(math.exp, logs.values()))
    answer = network.solve(weight)
    assert answer.log_total == pytest.approx(math.log(total), abs=1e-9)
    for atom in ATOMS:
        share = math.fsum(math.exp(log) for true, log in logs.items() if atom in true) / total
        assert answer.marginal[atom] == pytest.approx(share, abs=1e-9)
    assert answer.log_best == pytest.approx(max(logs.values()), abs=1e-9)


def test_a_group_of_which_one_is_true_is_exact_and_nothing_has_to_be_listed() -> None:
    some = (Group(ATOMS[:3]), Group(ATOMS[3:5]))
    network = ConstrainedNetwork(ATOMS, some, (Condition.any_of(map(Condition.literal, ATOMS[:3])),))
    assert [group.exact for group in network.groups] == [True, False]
    assert network._parts == ()


def test_what_no_state_keeps_is_refused_and_what_ties_too_much_together_is_not_used() -> None:
    contradiction = Condition.all_of([Condition.literal(ATOMS[0]), Condition.literal(ATOMS[1])])
    with pytest.raises(ValueError, match="no state"):
        ConstrainedNetwork(ATOMS, (Group(ATOMS[:2]),), (contradiction,))
    many = tuple(Atom("p", (f"x{number}",)) for number in range(40))
    network = ConstrainedNetwork(many, (), (Condition.any_of(map(Condition.literal, many)),))
    assert network.unused
    assert network.solve({}).marginal[many[0]] == pytest.approx(0.5)


def test_marginals_stay_what_they_were_from_one_moment_to_the_next() -> None:
    """Weights that reproduce the marginals are found, so that a constraint does not count anew at each moment."""
    a, b, c = ATOMS[:3]
    kept = (Condition.any_of([Condition.literal(a, False), Condition.literal(b)]),)  # what is in a is in b
    monitor = BayesMonitor(ConstrainedNetwork((a, b, c), (), kept), SensorModel())
    memory, judged = monitor.looked(monitor.begin(), Belief(0, {a: 0.7, c: 0.9}), 0)
    before = judged.probability
    assert before[a] < before[b]
    for cycle in range(1, 8):
        memory, judged = monitor.looked(monitor.acted(memory, None), Belief(cycle, {}), cycle)
    for atom in (a, b, c):
        uniform = monitor._uniform[atom]
        left = 0.96**7
        assert judged.probability[atom] == pytest.approx(left * before[atom] + (1 - left) * uniform, abs=2e-3)
