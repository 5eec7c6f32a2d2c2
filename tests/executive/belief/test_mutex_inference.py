"""Inference under mutex groups, held against counting every state."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from executive.belief import mutex_inference
from executive.belief.mutex_inference import Group, MutexNetwork
from executive.types import Atom

ATOMS = tuple(Atom("p", (name,)) for name in "abcdefgh")

members = st.lists(st.sampled_from(ATOMS), min_size=1, max_size=5, unique=True).map(tuple)
groups = st.lists(st.builds(Group, members, st.booleans()), max_size=5).map(tuple)
weights = st.fixed_dictionaries({atom: st.floats(-8, 8) for atom in ATOMS})


class Counted(NamedTuple):
    log_total: float
    marginal: dict[Atom, float]
    log_best: float


def states(some: tuple[Group, ...]) -> list[frozenset[Atom]]:
    subsets = (frozenset(itertools.compress(ATOMS, bits)) for bits in itertools.product([0, 1], repeat=len(ATOMS)))
    return [true for true in subsets if not any(group.violated(true) for group in some)]


def count(some: tuple[Group, ...], weight: Mapping[Atom, float]) -> Counted:
    """By definition."""
    logs = {true: math.fsum(weight[atom] for atom in true) for true in states(some)}
    total = math.fsum(map(math.exp, logs.values()))
    share = {atom: math.fsum(math.exp(log) for true, log in logs.items() if atom in true) / total for atom in ATOMS}
    return Counted(math.log(total), share, max(logs.values()))


def network(some: tuple[Group, ...]) -> MutexNetwork:
    assume(states(some))
    return MutexNetwork(ATOMS, some)


@given(groups, weights)
def test_answers_are_those_of_counting_every_state(some: tuple[Group, ...], weight: dict[Atom, float]) -> None:
    answer, counted = network(some).solve(weight), count(some, weight)
    assert not answer.approximate
    assert answer.log_total == pytest.approx(counted.log_total, abs=1e-9)
    assert network(some).log_total(weight) == pytest.approx(counted.log_total, abs=1e-9)
    assert answer.marginal == pytest.approx(counted.marginal, abs=1e-9)
    assert answer.log_best == pytest.approx(counted.log_best, abs=1e-9)
    assert not network(some).violated(answer.best)
    assert answer.log_best == pytest.approx(math.fsum(weight[atom] for atom in answer.best), abs=1e-9)


@given(groups, weights)
def test_in_arrays_answers_are_the_same(some: tuple[Group, ...], weight: dict[Atom, float]) -> None:
    assume(states(some))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mutex_inference, "WIDE", 0)
        wide = MutexNetwork(ATOMS, some)
    answer, counted = wide.solve(weight), count(some, weight)
    assert answer.log_total == pytest.approx(counted.log_total, abs=1e-9)
    assert wide.log_total(weight) == pytest.approx(counted.log_total, abs=1e-9)
    assert answer.marginal == pytest.approx(counted.marginal, abs=1e-9)
    assert answer.log_best == pytest.approx(counted.log_best, abs=1e-9)
    assert answer.best == network(some).solve(weight).best, "a tie is broken the same"


def test_a_group_that_overlaps_with_all_others_comes_after_them() -> None:
    """A hand that may hold any of many things keeps no more than two combinations at a time."""
    held = [Atom("held", (f"t{number}",)) for number in range(300)]
    at = [[Atom("at", (f"t{number}", place)) for place in "ab"] for number in range(300)]
    some = (
        Group((Atom("free"), *held), exact=True),
        *(Group((*own, hand)) for own, hand in zip(at, held, strict=True)),
    )
    many = MutexNetwork(tuple({atom for group in some for atom in group.atoms}), some)
    answer = many.solve({held[7]: 5.0, Atom("free"): 1.0}, max_frontier=2)
    assert not answer.approximate
    assert held[7] in answer.best


@given(groups, weights)
def test_where_groups_overlap_too_much_the_best_state_is_still_the_best(
    some: tuple[Group, ...], weight: dict[Atom, float]
) -> None:
    narrow = network(some).solve(weight, max_frontier=1)
    assert not network(some).violated(narrow.best)
    assert narrow.log_best == pytest.approx(count(some, weight).log_best, abs=1e-6)
    assert narrow.log_total <= count(some, weight).log_total + 1e-9
    assert all(0.0 <= value <= 1.0 for value in narrow.marginal.values())


@given(groups, weights, st.randoms(use_true_random=False))
def test_the_order_of_groups_changes_no_probability(
    some: tuple[Group, ...], weight: dict[Atom, float], random: st.DrawFn
) -> None:
    mixed = list(some)
    random.shuffle(mixed)  # type: ignore[attr-defined]
    assert network(tuple(mixed)).solve(weight).marginal == pytest.approx(network(some).solve(weight).marginal, abs=1e-9)


@given(groups, weights)
def test_probabilities_keep_to_the_groups(some: tuple[Group, ...], weight: dict[Atom, float]) -> None:
    marginal = network(some).solve(weight).marginal
    for group in some:
        total = math.fsum(marginal[atom] for atom in group.atoms)
        assert total == pytest.approx(1.0) if group.exact else total <= 1.0 + 1e-9


def test_tiles_on_a_board_are_more_than_is_kept_and_the_best_board_is_found() -> None:
    tiles, cells = range(7), range(8)
    at = {(tile, cell): Atom("at", (f"t{tile}", f"c{cell}")) for tile in tiles for cell in cells}
    of_tiles = [Group(tuple(at[tile, cell] for cell in cells)) for tile in tiles]
    of_cells = [Group(tuple(at[tile, cell] for tile in tiles)) for cell in cells]
    board = MutexNetwork(tuple(at.values()), (*of_tiles, *of_cells))
    weight = {atom: 3.0 if tile == cell else -3.0 for (tile, cell), atom in at.items()}
    wide, narrow = board.solve(weight), board.solve(weight, max_frontier=30)
    assert narrow.approximate
    assert not wide.approximate
    assert narrow.best == wide.best == frozenset(at[tile, tile] for tile in tiles)
    assert narrow.marginal == pytest.approx(wide.marginal, abs=0.02)


def test_a_network_refuses_nonsense() -> None:
    a, b = ATOMS[:2]
    with pytest.raises(ValueError, match="different atoms"):
        Group((a, a))
    with pytest.raises(ValueError, match="not among the atoms"):
        MutexNetwork((a,), (Group((a, b)),))
    with pytest.raises(ValueError, match="no state is consistent"):
        MutexNetwork((a, b), (Group((a,), exact=True), Group((b,), exact=True), Group((a, b))))
    with pytest.raises(ValueError, match="finite"):
        MutexNetwork((a, b)).solve({a: math.inf})
