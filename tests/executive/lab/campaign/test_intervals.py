"""Intervals hold what they promise, and tests of pairs are those of the textbook."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from executive.lab.campaign.intervals import bootstrap, mcnemar, wilson

shares = st.integers(1, 400).flatmap(lambda of: st.tuples(st.integers(0, of), st.just(of)))


@given(shares)
def test_wilson_is_the_one_of_scipy_and_holds_the_share(share: tuple[int, int]) -> None:
    made, theirs = wilson(*share), stats.binomtest(*share).proportion_ci(method="wilson")
    assert made is not None
    assert (made.low, made.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)
    assert 0.0 <= made.low <= share[0] / share[1] <= made.high <= 1.0
    assert made.low < made.high


@given(shares)
def test_wilson_of_the_opposite_is_mirrored(share: tuple[int, int]) -> None:
    count, of = share
    made, other = wilson(count, of), wilson(of - count, of)
    assert made is not None
    assert other is not None
    assert (made.low, made.high) == pytest.approx((1 - other.high, 1 - other.low))


def test_wilson_covers_the_truth_as_often_as_it_says() -> None:
    for truth, of in product((0.05, 0.3, 0.5, 0.9), (30, 100)):
        binomial = stats.binom(of, truth)
        intervals = [wilson(count, of) for count in range(of + 1)]
        covered = sum(
            binomial.pmf(count) for count, made in enumerate(intervals) if made and made.low <= truth <= made.high
        )
        assert covered == pytest.approx(0.95, abs=0.03)


def test_no_sample_has_no_interval() -> None:
    assert wilson(0, 0) is None
    assert bootstrap([]) is None
    assert bootstrap([3.0]) is None
    with pytest.raises(ValueError, match="5 of 4"):
        wilson(5, 4)


def test_bootstrap_covers_the_mean_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    made = [bootstrap(list(rng.exponential(2.0, 60))) for _ in range(40)]
    covered = sum(each is not None and each.low <= 2.0 <= each.high for each in made)
    assert 33 <= covered <= 40


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=12))
def test_bootstrap_repeats_and_stays_within_the_sample(values: list[float]) -> None:
    made = bootstrap(values)
    assert made is not None
    assert made == bootstrap(values)
    assert min(values) - 1e-9 <= made.low <= made.high <= max(values) + 1e-9


@given(st.integers(0, 40), st.integers(0, 40))
def test_mcnemar_is_the_sign_test_by_counting(first: int, second: int) -> None:
    pairs = first + second
    odd = [k for k in range(pairs + 1) if abs(2 * k - pairs) >= abs(first - second)]
    exact = Fraction(sum(math.comb(pairs, k) for k in odd), 2**pairs)
    assert mcnemar(first, second) == pytest.approx(float(exact))
    assert mcnemar(first, second) == mcnemar(second, first)


def test_mcnemar_of_the_textbook() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(1, 8) == pytest.approx(0.0390625)
    with pytest.raises(ValueError, match="no counts"):
        mcnemar(-1, 2)
