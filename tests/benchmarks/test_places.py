"""The order in which places are looked at is the best one, as another program works it out."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.places.__main__ import measured, table
from benchmarks.places.best import BestOrder
from benchmarks.places.playing import DOMAIN
from benchmarks.places.settings import DRAWERS, SETTINGS, WANTED
from executive.domain.loader import Domain, load_domain
from executive.planning.place_search import ExpectedCostSearch
from executive.types import Atom, Facts, SearchOrder

PLAIN, HEAVY = load_domain(DOMAIN), load_domain(DOMAIN, "heavy-drawer")
SEARCH = {domain.task.problem: ExpectedCostSearch(domain.parsed) for domain in (PLAIN, HEAVY)}


def searched(domain: Domain, shares: Mapping[str, Mapping[str, float]]) -> SearchOrder:
    """Where to look first, where things are in drawers as probably as that, each whatever the others are."""
    atoms = domain.task.atoms

    def supposing(literals: Facts) -> tuple[dict[Atom, float], Facts]:
        probability = {atom: float(atom == Atom("hand-empty")) for atom in atoms}
        true = {Atom("hand-empty"), Atom("at", ("salt", "worktop")), Atom("at", ("cup", "worktop"))}
        for item in WANTED:
            left = {
                place: p for place, p in shares[item].items() if literals.get(Atom("at", (item, place))) is not False
            }
            for place in shares[item]:
                if literals.get(Atom("at", (item, place))):
                    left = {place: 1.0}
            total = math.fsum(left.values())
            for place, share in left.items():
                probability[Atom("at", (item, place))] = share / total
            true.add(Atom("at", (item, max(sorted(left), key=lambda place: left[place]))))
        return probability, Facts.closed(true, atoms)

    hidden = frozenset(Atom("at", (item, place)) for item in WANTED for place in DRAWERS)
    return SEARCH[domain.task.problem].order(supposing, domain.task.goal, hidden)


def distributions() -> st.SearchStrategy[Mapping[str, float]]:
    weights = st.lists(st.integers(1, 20), min_size=3, max_size=3)
    return weights.map(lambda each: {place: w / sum(each) for place, w in zip(DRAWERS, each, strict=True)})


@settings(max_examples=40, deadline=None)
@given(st.fixed_dictionaries({item: distributions() for item in WANTED}), st.booleans())
def test_the_first_place_is_that_of_the_best_order(shares: Mapping[str, Mapping[str, float]], heavy: bool) -> None:
    """What is spent at all is what is spent in vain and what has to be spent anyway."""
    domain = HEAVY if heavy else PLAIN
    costs = {drawer: 1.0 + domain.parsed.cost("pull", (drawer,)) for drawer in DRAWERS}
    best = BestOrder(shares, costs)
    found = searched(domain, shares)
    needed = math.fsum(
        costs[drawer] * (1.0 - math.prod(1.0 - shares[item][drawer] for item in WANTED)) for drawer in DRAWERS
    )
    every = frozenset(WANTED)
    for place in found.places:
        (atom,) = place.condition.atoms
        (drawer,) = atom.args
        assert place.cost == pytest.approx(costs[drawer])
        assert place.expected + needed == pytest.approx(best._if_opened(drawer, frozenset(), every), rel=1e-6)
    first = found.places[0]
    assert first.expected == pytest.approx(min(place.expected for place in found.places))
    assumed = [atom for atom in found.assumed.true if first.condition == domain.task.visible[atom]]
    assert assumed, "something that is sought is taken to be there"


def test_where_all_is_known_there_is_nothing_to_choose() -> None:
    known = {item: {"left": 1.0, "middle": 0.0, "right": 0.0} for item in WANTED}
    assert searched(PLAIN, known).places == ()


@pytest.mark.parametrize("search", ["expected", "likeliest"])
def test_every_way_finds_everything_and_opens_no_drawer_twice_for_nothing(search: str) -> None:
    row = measured(SETTINGS[2], search, seeds=4)
    assert (row["success"], row["false claims"], row["twice for nothing"]) == (1.0, 0, 0)
    assert row["opened"] <= len(DRAWERS)
    assert SETTINGS[2].name in table([row])
