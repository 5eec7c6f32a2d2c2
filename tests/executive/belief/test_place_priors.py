"""What is believed before the first look: what is stated is believed, and the rest shares what is left."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief import BayesMonitor, Group, MutexNetwork
from executive.belief.place_priors import LEFT_OUT, informed, stated_priors
from executive.types import Atom, Belief

PLACES = tuple(Atom("at", ("x", place)) for place in "abcd")
OTHER = tuple(Atom("at", ("y", place)) for place in "abcd")
GROUPS = (Group(PLACES, exact=True), Group(OTHER))
ATOMS = (*PLACES, *OTHER)


def before_any_look(stated: dict[Atom, float]) -> dict[Atom, float]:
    monitor = BayesMonitor(MutexNetwork(ATOMS, GROUPS), prior=stated)
    _, judged = monitor.looked(monitor.begin(), Belief(0, {}), 0)
    return dict(judged.probability)


@given(st.lists(st.floats(0.01, 1.0), min_size=2, max_size=3))
def test_what_is_stated_is_believed_and_the_rest_shares_what_is_left(weights: list[float]) -> None:
    total = math.fsum(weights) + 0.3
    stated = {atom: weight / total for atom, weight in zip(PLACES, weights, strict=False)}
    believed = before_any_look(stated)
    assert all(believed[atom] == pytest.approx(value, abs=1e-3) for atom, value in stated.items())
    left = [believed[atom] for atom in PLACES if atom not in stated]
    assert all(value == pytest.approx(left[0], abs=1e-6) for value in left)
    assert math.fsum(believed[atom] for atom in PLACES) == pytest.approx(1.0)
    even = before_any_look({})
    assert all(believed[atom] == pytest.approx(even[atom]) for atom in OTHER), "nothing is stated of it"


def test_evidence_overrules_where_things_usually_are() -> None:
    monitor = BayesMonitor(MutexNetwork(ATOMS, GROUPS), prior={PLACES[0]: 0.9})
    _, judged = monitor.looked(monitor.begin(), Belief(0, {PLACES[0]: 0.01}), 0)
    assert judged.probability[PLACES[0]] < 0.5 < 1.0 - judged.probability[PLACES[1]]


def test_one_of_several_excludes_the_others_and_shares_evenly_or_as_is_usual() -> None:
    even = stated_priors(GROUPS, {}, oneof=[PLACES[:2]])
    assert even[PLACES[0]] == even[PLACES[1]] == pytest.approx(0.5 - LEFT_OUT)
    assert even[PLACES[2]] == even[PLACES[3]] == LEFT_OUT
    usual = stated_priors(GROUPS, {PLACES[0]: 0.6, PLACES[2]: 0.3}, oneof=[PLACES[:2]])
    assert usual[PLACES[0]] / usual[PLACES[1]] == pytest.approx(0.6 / 0.4)
    assert usual[PLACES[2]] == LEFT_OUT, "the problem says where it is not"
    assert not set(OTHER) & even.keys()


def test_what_may_be_so_excludes_the_others_of_its_group() -> None:
    told = stated_priors(GROUPS, {}, unknown=OTHER[:1])
    assert told == dict.fromkeys(OTHER[1:], LEFT_OUT), "it may be so, and may be not"
    assert stated_priors((), {}, oneof=[PLACES[:2]]) == dict.fromkeys(PLACES[:2], 0.5)


def test_more_than_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"at\(x,a\), at\(x,b\) add up to 1.2"):
        stated_priors(GROUPS, {PLACES[0]: 0.7, PLACES[1]: 0.5})


@given(st.dictionaries(st.sampled_from(PLACES), st.floats(0.0, 0.25), max_size=4))
def test_probabilities_of_a_group_stay_probabilities(stated: dict[Atom, float]) -> None:
    even = {**dict.fromkeys(PLACES, 0.25), **dict.fromkeys(OTHER, 0.2)}
    found = informed(GROUPS, even, stated)
    assert all(0.0 <= value <= 1.0 for value in found.values())
    assert math.fsum(found[atom] for atom in PLACES) <= 1.0 + 1e-9
    if len(stated) < len(PLACES):
        assert math.fsum(found[atom] for atom in PLACES) == pytest.approx(1.0)
