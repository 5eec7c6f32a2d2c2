"""Laws of the values in `executive.types`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.types import (
    Atom,
    Belief,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Facts,
    Observation,
    OutcomeKind,
    Reason,
    SkillResult,
    SkillStatus,
    Step,
    Task,
    Verdict,
)

names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_\-]{0,6}", fullmatch=True)
atoms = st.builds(Atom, names, st.lists(names, max_size=3).map(tuple))
facts = st.dictionaries(atoms, st.booleans(), max_size=8).map(Facts)
probabilities = st.floats(0.0, 1.0)


@given(atoms)
def test_an_atom_is_read_back_as_it_was_printed(atom: Atom) -> None:
    assert Atom.parse(str(atom)) == atom
    spaced = f"  {atom.predicate} ( {' , '.join(atom.args)} ) " if atom.args else f" {atom.predicate} "
    assert Atom.parse(spaced) == atom


@pytest.mark.parametrize("text", ["", "(", "on(", "on)", "on(a", "on(a,)", "on(,a)", "on(a b)", "on(a)(b)", "ön(a)"])
def test_what_is_no_atom_is_refused_with_its_text(text: str) -> None:
    with pytest.raises(ValueError, match="is not an atom such as"):
        Atom.parse(text)


@pytest.mark.parametrize("name", ["", "-a", "a b", "a,b", "a(b"])
def test_an_atom_refuses_names_that_could_not_be_read_back(name: str) -> None:
    with pytest.raises(ValueError, match="PDDL name"):
        Atom(name)
    with pytest.raises(ValueError, match="PDDL name"):
        Atom("on", (name,))


@given(facts)
def test_facts_are_read_back_from_their_literals(some: Facts) -> None:
    assert Facts.parse(*some.literals()) == some


@given(facts)
def test_facts_are_the_same_in_any_order_and_iterate_in_one(some: Facts) -> None:
    backwards = Facts(reversed(list(some.items())))
    assert backwards == some
    assert hash(backwards) == hash(some)
    assert list(backwards) == sorted(some)
    assert len({some, backwards}) == 1


@given(facts)
def test_true_and_false_share_out_what_is_mentioned(some: Facts) -> None:
    assert some.true | some.false == set(some)
    assert not some.true & some.false


@given(facts, facts)
def test_an_override_has_the_last_word_and_nothing_else(one: Facts, other: Facts) -> None:
    both = one | other
    assert both.entails(other)
    assert both.only(other) == other
    assert both.without(other) == one.without(other)


@given(facts, st.sets(atoms))
def test_only_and_without_share_out_facts(some: Facts, chosen: set[Atom]) -> None:
    assert some.only(chosen) | some.without(chosen) == some
    assert not some.only(chosen).keys() & some.without(chosen).keys()


@given(facts, facts, facts)
def test_entailment_is_an_order(one: Facts, two: Facts, three: Facts) -> None:
    assert one.entails(one)
    assert one.entails(Facts())
    assert not (one.entails(two) and two.entails(one)) or one == two
    assert not (one.entails(two) and two.entails(three)) or one.entails(three)


@given(st.sets(atoms), st.sets(atoms))
def test_a_closed_world_mentions_everything(true: set[Atom], universe: set[Atom]) -> None:
    closed = Facts.closed(true, universe)
    assert closed.true == true
    assert set(closed) == true | universe


@pytest.mark.parametrize("pair", [("on(a)", True), (Atom("on"), 1), (Atom("on"), None)])
def test_facts_refuse_what_is_no_signed_atom(pair: tuple[object, object]) -> None:
    with pytest.raises(TypeError, match="Atom to bool"):
        Facts([pair])  # type: ignore[list-item]


@given(st.dictionaries(atoms, probabilities, max_size=6), st.sets(atoms, max_size=3), probabilities, probabilities)
def test_a_belief_is_true_false_or_unknown_and_unknown_is_never_true(
    probability: dict[Atom, float], unanswered: set[Atom], one: float, other: float
) -> None:
    low, high = sorted((one, other))
    belief = Belief(1, probability, frozenset(unanswered - probability.keys()))
    known = belief.facts(low, high)
    for atom in probability.keys() | unanswered:
        truth = belief.truth(atom, low, high)
        assert known.get(atom) is truth
        if atom not in probability:
            assert truth is None
        elif truth is None:
            assert low <= probability[atom] < high
        else:
            assert truth is (probability[atom] >= high)


@given(facts)
def test_certainty_is_believed_at_any_threshold(some: Facts) -> None:
    assert Belief.certain(some).facts() == some
    assert Belief.certain(some).facts(0.01, 1.0) == some


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.001, 1.001, None, "0.5"])
def test_a_belief_refuses_what_is_no_probability(value: object) -> None:
    with pytest.raises(ValueError, match="is not a probability"):
        Belief(1, {Atom("on"): value})  # type: ignore[dict-item]


def test_a_belief_refuses_an_atom_both_answered_and_not() -> None:
    with pytest.raises(ValueError, match="both answered and unanswered"):
        Belief(1, {Atom("on"): 0.5}, frozenset({Atom("on")}))


def test_a_verdict_refuses_sets_that_overlap() -> None:
    one, none = frozenset({Atom("on")}), frozenset[Atom]()
    for holds, violated, unknown in ((one, one, none), (one, none, one), (none, one, one)):
        with pytest.raises(ValueError, match="disjoint"):
            Verdict(holds, violated, unknown)
    assert Verdict(holds=one).satisfied
    assert not Verdict(violated=one).satisfied
    assert not Verdict(unknown=one).satisfied


def test_a_decision_has_an_outcome_exactly_when_it_stops() -> None:
    for kind in DecisionKind:
        stops = kind is DecisionKind.STOP
        causes = (Cause(Reason.AS_EXPECTED), Cause(Reason.RETRY, count=1))
        decision = Decision(kind, causes, outcome=OutcomeKind.GAVE_UP if stops else None)
        assert (decision.code, decision.codes) == (Reason.AS_EXPECTED, (Reason.AS_EXPECTED, Reason.RETRY))
        with pytest.raises(ValueError, match="if and only if"):
            Decision(kind, causes, outcome=None if stops else OutcomeKind.GAVE_UP)
        with pytest.raises(ValueError, match="cause"):
            Decision(kind, (), outcome=OutcomeKind.GAVE_UP if stops else None)


def test_only_done_is_done() -> None:
    step = Step.strips("pick", ("a", "p"))
    assert [status for status in SkillStatus if SkillResult(step, status).done] == [SkillStatus.DONE]
    assert str(step) == "pick(a,p)"


def test_a_task_refuses_a_goal_that_it_does_not_know() -> None:
    with pytest.raises(ValueError, match=r"at\(b\)"):
        Task("d", "p", {}, (Atom("at", ("a",)),), Condition.parse("at(b)"))


@pytest.mark.parametrize("image", [np.zeros((2, 2), np.uint8), np.zeros((2, 2, 4), np.uint8), np.zeros((2, 2, 3))])
def test_an_observation_refuses_what_is_no_picture(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="camera 'front'"):
        Observation(1, 0.0, {"front": image}, np.zeros(6))


def test_a_belief_without_atoms_has_them_unanswered_and_only_those_that_were_asked() -> None:
    asked, other, never = Atom("held", ("a",)), Atom("held", ("b",)), Atom("held", ("c",))
    belief = Belief(3, {asked: 0.9, other: 0.2}, source="model").without({asked, never})
    assert dict(belief.probability) == {other: 0.2}
    assert belief.unanswered == {asked}
    assert (belief.observation_id, belief.source) == (3, "model")
