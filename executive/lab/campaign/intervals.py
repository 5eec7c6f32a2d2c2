"""How far numbers from a sample can be trusted: 95 % intervals, and tests of paired samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

RESAMPLES = 10_000
_Z = 1.959963984540054
"""The normal distribution's 97.5 % quantile."""
_AT_ONCE = 1_000_000
"""Numbers that a bootstrap draws at a time."""


class Interval(NamedTuple):
    """Holds the true value in 95 % of such samples."""

    low: float
    high: float


def wilson(count: int, of: int) -> Interval | None:
    """For a share that is `count / of` in a sample (Wilson 1927); None where there is no sample.

    Raises:
        ValueError: the count is not one from 0 to `of`.
    """
    if not 0 <= count <= of:
        raise ValueError(f"{count} of {of} is no share")
    if of == 0:
        return None
    share, spread = count / of, _Z * _Z / of
    centre = (share + spread / 2) / (1 + spread)
    half = _Z / (1 + spread) * math.sqrt(share * (1 - share) / of + spread / (4 * of))
    # Rounding must not put the share itself outside.
    return Interval(max(0.0, min(share, centre - half)), min(1.0, max(share, centre + half)))


def bootstrap(values: Sequence[float], seed: int = 0) -> Interval | None:
    """For a mean: the 2.5 % and 97.5 % quantiles of the means of resampled samples (Efron's percentile bootstrap). The
    same values in the same order give the same interval. None for fewer than two values."""
    if len(values) < 2:
        return None
    sample, means = np.asarray(values, dtype=float), np.empty(RESAMPLES)
    rng, step = np.random.default_rng(seed), max(1, _AT_ONCE // len(values))
    for begin in range(0, RESAMPLES, step):
        end = min(RESAMPLES, begin + step)
        means[begin:end] = sample[rng.integers(len(sample), size=(end - begin, len(sample)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(float(low), float(high))


def mcnemar(only_first: int, only_second: int) -> float:
    """The exact two-sided p-value (McNemar 1947) of pairs that disagree: how probable at least such an imbalance is if
    either side is as likely to be the one. 1 where no pair disagrees.

    Raises:
        ValueError: a count is negative.
    """
    if min(only_first, only_second) < 0:
        raise ValueError(f"{only_first} and {only_second} are no counts")
    pairs, fewer = only_first + only_second, min(only_first, only_second)
    tail = sum(math.comb(pairs, each) for each in range(fewer + 1))
    return min(1.0, 2 * tail / (1 << pairs))
