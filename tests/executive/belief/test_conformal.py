"""The promise of conformal thresholds, kept per look, and what they do at the edges."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief.conformal import Conformal, covered, look_scores
from executive.belief.interface import Thresholds
from executive.types import Atom

ATOMS = tuple(Atom("on", (name,)) for name in "abcde") + (Atom("free"),)


def eye(rng: np.random.Generator, looks: int) -> list[tuple[dict[Atom, float], dict[Atom, bool]]]:
    """An eye whose answers within a look err together: some looks are bad as a whole."""
    made = []
    for _ in range(looks):
        truth = {atom: bool(rng.random() < 0.4) for atom in ATOMS}
        clarity = rng.normal(2.0, 1.5)
        odds = {atom: (1 if truth[atom] else -1) * rng.normal(clarity, 1.0) for atom in ATOMS}
        made.append(({atom: 1 / (1 + math.exp(-value)) for atom, value in odds.items()}, truth))
    return made


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.2])
def test_truths_are_in_their_sets_as_often_as_was_asked_and_hardly_more(alpha: float) -> None:
    rng, n, trials = np.random.default_rng(7), 99, 150
    shares = []
    for _ in range(trials):
        conformal = Conformal.of(eye(rng, n))
        shares.append(covered(conformal, alpha, eye(rng, 50))["on"])
    deviation = 4 * math.sqrt(alpha * (1 - alpha) / n / trials + alpha * (1 - alpha) / 50 / trials)
    assert 1 - alpha - deviation <= float(np.mean(shares)) <= 1 - alpha + 1 / (n + 1) + deviation


@given(st.integers(0, 1000), st.sampled_from([0.05, 0.1, 0.3]))
def test_where_all_truths_are_in_their_sets_nothing_is_told_wrongly(seed: int, alpha: float) -> None:
    rng = np.random.default_rng(seed)
    conformal = Conformal.of(eye(rng, 40))
    thresholds = conformal.thresholds(alpha)
    for probability, truth in eye(rng, 10):
        scores = look_scores(probability, truth)
        for atom, value in probability.items():
            told = thresholds[atom.predicate].truth(value)
            if scores[atom.predicate] <= conformal.quantile(atom.predicate, alpha):
                assert told in (None, truth[atom])


def test_a_look_scores_as_badly_as_its_worst_atom_of_each_predicate() -> None:
    truth = dict.fromkeys(ATOMS, True)
    assert look_scores({ATOMS[0]: 0.9, ATOMS[1]: 0.7, ATOMS[5]: 1.0}, truth) == {
        "on": pytest.approx(0.3),
        "free": pytest.approx(0.0),
    }
    assert look_scores({}, truth) == {}
    assert look_scores({ATOMS[0]: 0.9}, {}) == {}


def test_a_stricter_rate_tells_less() -> None:
    conformal = Conformal({"on": tuple(np.linspace(0.0, 1.0, 101)[:-1])})
    bands = [conformal.thresholds(alpha)["on"] for alpha in (0.4, 0.2, 0.1, 0.05)]
    assert all(one.low >= other.low and one.high <= other.high for one, other in pairwise(bands))
    assert bands[2].truth(0.95) is True
    assert bands[2].truth(0.85) is None
    assert bands[2].truth(0.05) is False


def test_an_eye_that_is_good_enough_needs_no_unknowns() -> None:
    conformal = Conformal({"on": (0.0, 0.01, 0.02, 0.1, 0.3, 0.3, 0.3, 0.3, 0.3)})
    assert conformal.thresholds(0.1)["on"] == Thresholds(0.5, 0.5)


def test_an_eye_that_may_be_wrong_beyond_doubt_is_never_believed() -> None:
    never = Conformal({"on": (0.0,) * 50 + (1.0,) * 50}).thresholds(0.1)["on"]
    assert never.truth(1.0) is None
    assert never.truth(0.0) is None


def test_too_few_looks_are_named_with_how_many_it_takes() -> None:
    conformal = Conformal({"on": (0.1,) * 19})
    assert conformal.quantile("on", 0.05) == 0.1
    with pytest.raises(ValueError, match="needs at least 99 calibration looks, and there are 19 about on"):
        conformal.quantile("on", 0.01)
    for alpha in (0.0, 1.0, -1.0):
        with pytest.raises(ValueError, match="between 0 and 1"):
            conformal.quantile("on", alpha)
    with pytest.raises(ValueError, match="from 0 to 1"):
        Conformal({"on": (1.5,)})
