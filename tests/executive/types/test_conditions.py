"""Laws of conditions, of conditional effects and of derived atoms, held against all states of a few atoms."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.types import ALWAYS, NEVER, Atom, Condition, DerivedRules, Effect, Facts, Step

P, Q, R, S = ATOMS = [Atom(name) for name in "pqrs"]
literals = st.builds(Condition.literal, st.sampled_from(ATOMS), st.booleans())
conditions = st.recursive(
    st.sampled_from([ALWAYS, NEVER]) | literals,
    lambda inner: st.lists(inner, max_size=3).flatmap(
        lambda parts: st.sampled_from([Condition.all_of(parts), Condition.any_of(parts)])
    ),
    max_leaves=8,
)
partial = st.dictionaries(st.sampled_from(ATOMS), st.booleans()).map(Facts)
effects = st.lists(st.builds(Effect, conditions, partial), max_size=3).map(tuple)


def completions(state: Mapping[Atom, bool]) -> Iterator[dict[Atom, bool]]:
    """Every complete state that a partial one may be."""
    for values in product((False, True), repeat=len(ATOMS)):
        whole = dict(zip(ATOMS, values, strict=True))
        if all(whole[atom] is value for atom, value in state.items()):
            yield whole


@given(st.lists(conditions, max_size=3))
def test_a_conjunction_and_a_disjunction_mean_what_their_parts_do(parts: list[Condition]) -> None:
    for state in completions({}):
        assert Condition.all_of(parts).truth(state) is all(part.truth(state) for part in parts)
        assert Condition.any_of(parts).truth(state) is any(part.truth(state) for part in parts)


@given(conditions)
def test_a_negation_is_true_where_its_condition_is_not(condition: Condition) -> None:
    assert all((~condition).truth(state) is not condition.truth(state) for state in completions({}))


@given(conditions, partial)
def test_what_is_told_of_a_partial_state_holds_of_all_that_it_may_be(condition: Condition, state: Facts) -> None:
    told = condition.truth(state)
    assert told is None or all(condition.truth(whole) is told for whole in completions(state))
    rest = condition.given(state)
    assert rest.atoms.isdisjoint(state)
    assert all(rest.truth(whole) is condition.truth(whole) for whole in completions(state))


@given(conditions)
def test_a_condition_is_read_as_it_prints(condition: Condition) -> None:
    assert Condition.parse(str(condition)) == condition
    assert Condition.parse(*condition.texts()) == condition
    assert Condition.all_of(condition.conjuncts) == condition


@given(conditions, partial)
def test_the_literals_that_decide_tell_the_truth_of_a_condition(condition: Condition, state: Facts) -> None:
    decisive = condition.decisive(state)
    told = Condition.of(decisive).truth(state)
    assert told is condition.truth(state) or condition == NEVER


@given(conditions, partial)
def test_values_come_back_from_another_process_as_they_were(condition: Condition, facts: Facts) -> None:
    for value in (condition, facts, P, Step("do", (), condition, (Effect(condition, facts),))):
        back = pickle.loads(pickle.dumps(value))
        assert (back, hash(back)) == (value, hash(value))


def test_it_prints_as_one_would_write_it() -> None:
    condition = Condition.parse("p and (q() or not r and s())")
    assert str(condition) == "p() and ((not r() and s()) or q())"
    assert [str(part) for part in condition.conjuncts] == ["p()", "(not r() and s()) or q()"]
    assert Condition.parse("p", "not p") == NEVER
    assert str(ALWAYS) == "true"


@pytest.mark.parametrize("text", ["", "and p", "p q", "p or", "(p", "p)", "not", "p and (q or", "p & q", "(" * 200])
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="condition"):
        Condition.parse(text)


@given(effects, partial)
def test_what_is_told_of_a_change_comes_about_in_every_state_that_it_may_be(
    some: tuple[Effect, ...], state: Facts
) -> None:
    step = Step("do", (), effects=some)
    changes = step.changes(state)
    assert changes.keys() <= set(step.affects)
    for whole in completions(state):
        happening = [effect.facts for effect in some if effect.condition.truth(whole)]
        added = {atom for facts in happening for atom in facts.true}
        after = {**whole, **{a: False for facts in happening for a in facts.false}, **dict.fromkeys(added, True)}
        for atom in ATOMS:
            value = changes.get(atom, state.get(atom))
            assert value is None or after[atom] is value


def test_an_unknown_condition_makes_its_effect_unknown_and_never_false() -> None:
    lit = Step("press", (), effects=(Effect(Condition.literal(P), Facts({Q: True})),))
    assert lit.changes(Facts({P: True, Q: False})) == {Q: True}
    assert lit.changes(Facts({P: False, Q: False})) == {}
    assert lit.changes(Facts({Q: False})) == {Q: None}
    assert lit.changes(Facts({Q: True})) == {Q: True}, "what may be made true and is so stays so"


def test_an_atom_both_added_and_deleted_is_true() -> None:
    both = Step("do", (), effects=(Effect(ALWAYS, Facts({P: False})), Effect(Condition.literal(Q), Facts({P: True}))))
    assert both.changes(Facts({P: True, Q: True})) == {P: True}
    assert both.changes(Facts({P: True, Q: False})) == {P: False}
    assert both.changes(Facts({P: True})) == {P: None}


def above(one: str, other: str) -> Atom:
    return Atom("above", (one, other))


def on(one: str, other: str) -> Atom:
    return Atom("on", (one, other))


BLOCKS = "abc"
CLOSURE = DerivedRules(
    {
        above(x, y): Condition.any_of(
            [
                Condition.literal(on(x, y)),
                *(Condition.of({on(x, z): True, above(z, y): True}) for z in BLOCKS if z not in (x, y)),
            ]
        )
        for x, y in product(BLOCKS, BLOCKS)
        if x != y
    }
    | {Atom("free", (x,)): Condition.of({above(y, x): False for y in BLOCKS if y != x}) for x in BLOCKS}
)
places = [on(x, y) for x, y in product(BLOCKS, BLOCKS) if x != y]


@given(st.dictionaries(st.sampled_from(places), st.booleans()).map(Facts))
def test_derived_atoms_follow_from_the_others(state: Facts) -> None:
    known = CLOSURE.complete(state)
    for values in product((False, True), repeat=len(places)):
        whole = {**dict(zip(places, values, strict=True)), **state}
        reached = {(x, x) for x in BLOCKS}
        for _ in BLOCKS:
            reached |= {(x, z) for x, y in reached for z in BLOCKS if y != z and whole[on(y, z)]}
        for x, y in product(BLOCKS, BLOCKS):
            assert x == y or known.get(above(x, y)) in (None, (x, y) in reached)
        for x in BLOCKS:
            is_free = not any((y, x) in reached for y in BLOCKS if y != x)
            assert known.get(Atom("free", (x,))) in (None, is_free)
    if len(state) == len(places):
        assert known.keys() == {*places, *CLOSURE.rules}


def test_a_derived_atom_hangs_on_those_that_it_is_computed_from() -> None:
    assert CLOSURE.support([P, above("a", "b")]) == (P, *sorted(place for place in places if place.args[0] != "b"))
    assert DerivedRules().complete(Facts({P: True})) == Facts({P: True})


def test_what_is_derived_from_its_own_negation_is_refused() -> None:
    with pytest.raises(ValueError, match="own negation"):
        DerivedRules({P: Condition.literal(Q, False), Q: Condition.literal(P)})
