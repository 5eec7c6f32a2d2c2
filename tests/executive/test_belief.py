"""Laws of what looks amount to and what is kept of them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from executive.belief import Known, Moment, settle
from executive.types import Atom, Facts

UNIVERSE = [Atom("p", (str(name),)) for name in "abcd"]
partial = st.dictionaries(st.sampled_from(UNIVERSE), st.booleans()).map(Facts)
looks = st.lists(partial, min_size=1, max_size=4)


@given(partial, looks)
def test_looks_together_tell_what_any_of_them_tells_and_nothing_else(expected: Facts, some: list[Facts]) -> None:
    settled = settle(expected, some)
    assert set(settled) == set().union(*some)
    for atom, value in settled.items():
        assert value in {look[atom] for look in some if atom in look}


@given(partial, looks)
def test_a_surprise_that_one_look_shows_and_another_does_not_is_no_surprise(expected: Facts, some: list[Facts]) -> None:
    settled = settle(expected, some)
    for atom, value in expected.items():
        told = [look[atom] for look in some if atom in look]
        assert settled.get(atom) is (value if value in told else told[-1] if told else None)


@given(looks)
def test_without_an_expectation_the_last_look_that_could_tell_decides(some: list[Facts]) -> None:
    last = Facts()
    for look in some:
        last = last | look
    assert settle(Facts(), some) == last


@given(partial, partial)
def test_one_look_is_taken_at_its_word(expected: Facts, look: Facts) -> None:
    assert settle(expected, [look]) == look
    assert settle(expected, []) == Facts()


@given(st.lists(partial, max_size=5))
def test_what_cannot_be_seen_keeps_its_last_value_and_grows_older(seen: list[Facts]) -> None:
    known = Known()
    for cycle, facts in enumerate(seen):
        known = known.updated(facts, cycle)
    for atom in UNIVERSE:
        cycles = [cycle for cycle, facts in enumerate(seen) if atom in facts]
        if cycles:
            assert known.facts[atom] is seen[cycles[-1]][atom]
            assert known.age(atom, len(seen)) == len(seen) - cycles[-1]
        else:
            assert atom not in known.facts
            assert known.age(atom, len(seen)) is None


@given(partial)
def test_a_state_to_plan_from_is_complete_and_takes_nothing_unknown_for_true(facts: Facts) -> None:
    state = Known(facts).state(UNIVERSE)
    assert set(state) == set(UNIVERSE)
    assert state.true == facts.true


@given(partial, looks)
def test_a_moment_keeps_its_looks_apart(expected: Facts, some: list[Facts]) -> None:
    moment = Moment(Known(), expected)
    assert moment.last == Facts()
    for number, look in enumerate(some):
        moment = moment.looked(look, number)
        assert moment.last == look
        assert moment.observation_id == number
    assert moment.looks == tuple(some)
    assert moment.settled == settle(expected, some)
