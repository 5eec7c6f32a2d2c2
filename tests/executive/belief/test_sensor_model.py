"""What is learned of a sensor from its answers: how often it errs, and how much a repeated question repeats that."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief import ErrorModel, SensorModel
from executive.belief.sensor_model import PRIOR, AnswerCounts, PastEvidence, error_correlation
from executive.types import Atom

CUP, JUG = Atom("on", ("cup",)), Atom("on", ("jug",))
answers = st.lists(st.tuples(st.sampled_from([CUP, JUG, Atom("free")]), st.booleans(), st.booleans()), max_size=40)


def counted(atom: Atom, truth: bool, yes: int, no: int) -> list[tuple[Atom, bool, bool]]:
    return [(atom, True, truth)] * yes + [(atom, False, truth)] * no


def test_rates_are_those_counted_and_lean_on_what_is_assumed() -> None:
    counts = AnswerCounts.of([*counted(CUP, True, 180, 20), *counted(CUP, False, 10, 390), *counted(JUG, True, 0, 10)])
    on = counts.error_model("on")
    assert on.misses == pytest.approx((30 + PRIOR * 0.05) / (210 + PRIOR))
    assert on.false_alarms == pytest.approx((10 + PRIOR * 0.05) / (400 + PRIOR))
    assert counts.error_model(JUG).misses == pytest.approx((10 + PRIOR * on.misses) / (10 + PRIOR))
    assert counts.error_model(JUG).false_alarms == pytest.approx(on.false_alarms), "nothing but what is assumed"
    assert counts.error_model(Atom("new")) == ErrorModel()


def test_answers_that_say_the_opposite_say_nothing() -> None:
    counts = AnswerCounts.of([*counted(CUP, True, 0, 500), *counted(CUP, False, 500, 0)])
    model = counts.error_model(CUP)
    assert abs(model.evidence(1.0)) < 0.05
    assert abs(model.evidence(0.0)) < 0.05


@given(answers, answers)
def test_what_is_added_can_be_taken_away(
    one: list[tuple[Atom, bool, bool]], two: list[tuple[Atom, bool, bool]]
) -> None:
    both = AnswerCounts.of([*one, *two])
    assert (AnswerCounts.of(one) + AnswerCounts.of(two)).counts == both.counts
    assert (both - AnswerCounts.of(two)).predicates == AnswerCounts.of(one).predicates


def test_the_correlation_of_errors_is_that_of_the_table() -> None:
    always = {(True, True): 1000, (False, False): 5000}
    assert error_correlation(always, 0.0) == pytest.approx(1000 / (1000 + PRIOR))
    independent = {(True, True): 100, (True, False): 900, (False, True): 900, (False, False): 8100}
    assert error_correlation(independent, 0.0) == pytest.approx(0.0)
    assert error_correlation({(False, False): 900}, 0.8) == 0.8, "no mistake says nothing of repeated ones"
    assert error_correlation({(True, False): 500, (False, True): 500, (False, False): 500}, 0.0) == 0.0


def test_a_predicate_whose_mistakes_repeat_gains_little_from_asking_again() -> None:
    model = SensorModel(correlations={"on": 1.0, "free": 0.0}, correlation_within=0.5, correlation_across=0.5)
    assert model.pooled([2.0, 2.0, 2.0], "on") == pytest.approx(2.0)
    assert model.pooled([2.0, 2.0, 2.0], "free") == pytest.approx(6.0)
    assert model.pooled([2.0, 2.0, 2.0], "at") == pytest.approx(3.0)
    earlier = PastEvidence((2.0,), 2.0)
    assert model.increment(2.0, earlier, "on") == pytest.approx(0.0)
    assert model.increment(2.0, earlier, "free") == pytest.approx(2.0)
    assert model.increment(-2.0, earlier, "on") == pytest.approx(-2.0), "what says otherwise counts in full"
    with pytest.raises(ValueError, match="correlation"):
        SensorModel(correlations={"on": 1.1})
