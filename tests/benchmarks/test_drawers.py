"""The law that an item anywhere in an open drawer can be taken out, on some of the benchmark's places."""

from __future__ import annotations

import pytest

from benchmarks.drawers import ITEMS, draw, taken


def test_places_are_of_all_kinds() -> None:
    places = [draw(number) for number in range(200)]
    assert {place.item for place in places} == set(ITEMS)
    assert {place.side for place in places} == {0, 1, 2}
    at_a_wall = sum(bool((abs(place.share) == 1.0).any()) for place in places)
    assert 0.5 < at_a_wall / len(places) < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("number", range(12))
def test_an_item_anywhere_in_an_open_drawer_can_be_taken_out(number: int) -> None:
    found = taken(draw(number))
    assert found.tries, found.result.reason
