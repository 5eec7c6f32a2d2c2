"""A second witness: what it adds where it agrees, where it errs less, and where nobody else can tell."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief import BayesMonitor, ErrorModel, SensorModel, WitnessModel
from executive.belief.witnesses import together
from executive.trace.record import monitor_file
from executive.types import Atom, Belief
from tests.executive.belief.hands import ATOMS, NETWORK, PLACES, THINGS, answers, truth
from tests.fakes import at

strengths = st.floats(-10.0, 10.0)
shares = st.floats(0.0, 1.0)

EYE = SensorModel(other=ErrorModel(0.05, 0.05), correlation_within=0.5)
DEPTH = WitnessModel(SensorModel(other=ErrorModel(0.002, 0.002), correlation_within=0.9), shared=0.3)
ALONE = BayesMonitor(NETWORK, EYE)
BOTH = BayesMonitor(NETWORK, EYE, witnesses={"depth": DEPTH})


@given(strengths, strengths, shares)
def test_who_agrees_adds_something_and_at_most_all(one: float, other: float, shared: float) -> None:
    found = together(one, [(other, shared)])
    if one * other <= 0.0:
        assert found == pytest.approx(one + other)
    else:
        assert max(abs(one), abs(other)) <= abs(found) * (1 + 1e-12) <= abs(one + other) * (1 + 1e-9) + 1e-12
        assert math.copysign(1.0, found) == math.copysign(1.0, one)


@given(strengths, st.floats(0.0, 0.9))
def test_the_more_is_shared_the_less_agreement_counts(evidence: float, shared: float) -> None:
    assert abs(together(evidence, [(evidence, shared)])) >= abs(together(evidence, [(evidence, shared + 0.1)]))
    assert together(None, [(evidence, shared)]) == evidence


def seen(monitor: BayesMonitor, *looks: Belief) -> dict[Atom, float]:
    memory = monitor.begin()
    for look in looks:
        memory, judgement = monitor.looked(memory, look, 0)
    return dict(judgement.probability)


WHERE = dict.fromkeys(THINGS, PLACES[0])
HERE, THERE = at(THINGS[0], PLACES[0]), at(THINGS[0], PLACES[1])


def told(where: dict[str, str]) -> dict[Atom, float]:
    return {atom: float(value) for atom, value in truth(where).items()}


def test_the_witness_that_errs_less_decides() -> None:
    """An item that the model sees on one table and depth on another is where depth says."""
    raw = answers(truth(WHERE))
    moved = {**WHERE, THINGS[0]: PLACES[1]}
    wrong = Belief(0, raw.probability, witnesses={"depth": told(moved)})
    assert seen(ALONE, wrong)[HERE] > 0.9
    assert seen(BOTH, wrong)[HERE] < 0.1
    assert seen(BOTH, wrong)[THERE] > 0.9


def test_what_only_the_witness_tells_is_seen() -> None:
    memory, judgement = BOTH.looked(BOTH.begin(), Belief(0, {}, frozenset(ATOMS), witnesses={"depth": told(WHERE)}), 0)
    assert judgement.truth(HERE) is True
    assert judgement.belief.unanswered.isdisjoint({HERE})
    assert memory.marginal is not None


def test_a_witness_that_is_asked_twice_at_one_moment_repeats_itself() -> None:
    once = Belief(0, {}, frozenset(ATOMS), witnesses={"depth": {HERE: 0.9}})
    independent = BayesMonitor(NETWORK, EYE, witnesses={"depth": WitnessModel(SensorModel(correlation_within=0.0))})
    assert seen(BOTH, once, once)[HERE] < seen(independent, once, once)[HERE]


def test_who_is_not_known_is_not_listened_to() -> None:
    raw = answers(truth(WHERE))
    lied = Belief(0, raw.probability, witnesses={"rumour": {HERE: 0.0}})
    assert seen(BOTH, lied) == seen(BOTH, raw) == seen(ALONE, raw)


def test_how_a_witness_errs_is_kept_with_the_record(tmp_path: Path) -> None:
    monitor_file.save(tmp_path, BOTH)
    back = monitor_file.load(tmp_path, ATOMS)
    assert isinstance(back, BayesMonitor)
    assert back.witnesses == BOTH.witnesses


def test_a_share_above_one_is_refused() -> None:
    with pytest.raises(ValueError, match="from 0 to 1"):
        WitnessModel(shared=1.5)
