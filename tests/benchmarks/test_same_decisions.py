"""Two records are the same but for clocks and rounding, or their first difference is named."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import same_decisions

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text() | st.floats(-1e6, 1e6),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=12,
)


def event(**data: Any) -> dict[str, Any]:
    return {"v": 1, "type": "Decision", "cycle": 3, "time": 1.0, "wall": 2.0, "data": data}


@given(VALUES)
def test_whatever_is_recorded_is_the_same_as_itself(value: Any) -> None:
    record = [event(value=value)]
    assert same_decisions.first_difference(record, copy.deepcopy(record)) is None


def test_clocks_and_rounding_do_not_count() -> None:
    one, other = event(probability=0.5, seconds=1.0), event(probability=0.5 + 1e-7, seconds=9.0)
    assert same_decisions.first_difference([one], [other | {"wall": 3.0}]) is None


@pytest.mark.parametrize(
    ("other", "where"),
    [
        (event(kind="stop", atoms=["a()"], p=0.5), "data.kind"),
        (event(kind="continue", atoms=["b()"], p=0.5), "data.atoms[0]"),
        (event(kind="continue", atoms=["a()", "b()"], p=0.5), "data.atoms[1]"),
        (event(kind="continue", atoms=["a()"], p=0.501), "data.p"),
        (event(kind="continue", atoms=["a()"]), "data.p"),
        (event(kind="continue", atoms=["a()"], p=0.5, new=0), "data.new"),
    ],
)
def test_the_place_of_a_difference_is_named(other: dict[str, Any], where: str) -> None:
    one = event(kind="continue", atoms=["a()"], p=0.5)
    assert [place for place, _, _ in same_decisions.differences(one, other)] == [where]
    assert same_decisions.first_difference([one], [other]) is not None


@pytest.mark.parametrize("lengths", [(1, 0), (0, 1), (2, 1)])
def test_a_record_that_goes_on_differs_from_one_that_has_ended(lengths: tuple[int, int]) -> None:
    base, here = ([event()] * length for length in lengths)
    assert same_decisions.first_difference(base, here) is not None
