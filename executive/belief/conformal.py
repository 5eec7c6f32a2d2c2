"""Thresholds for a requested error rate, by split conformal prediction (Vovk, Gammerman and Shafer 2005).

An answer's nonconformity score is the probability that it gave to the wrong value: 1 - P for a true atom, P for a false
one. A look's score for a predicate is the largest among its atoms. Of the scores of n calibration looks, the
ceil((n + 1) (1 - alpha))-th smallest is q. In a new look, an atom's prediction set has every truth value whose score
would be at most q; if that is one value, the atom has it, else the atom is unknown.

The guarantee is per look and per predicate: if the new look is exchangeable with the calibration looks, then with a
probability of at least 1 - alpha (over all of them) every atom of the predicate has its truth in its set, so that
none is wrong; and, where no two looks have the same score, of at most 1 - alpha + 1 / (n + 1). The errors of one look's
answers are correlated, which is why the unit is the look and not the atom; looks of one run resemble each other, too:
the calibration looks have to come from runs like the new ones. Nothing is guaranteed about one atom given the others,
and for k predicates at once no more than 1 - k alpha.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from executive.belief.interface import Thresholds
from executive.types import Atom


@dataclass(frozen=True, slots=True)
class Conformal:
    """The sorted scores of the calibration looks, by predicate; of each, those looks that answered about it.

    Raises:
        ValueError: a score is not in [0, 1].
    """

    scores: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for predicate, scores in self.scores.items():
            if not all(0.0 <= score <= 1.0 for score in scores):
                raise ValueError(f"{predicate}: scores are from 0 to 1")
        ordered = {predicate: tuple(sorted(self.scores[predicate])) for predicate in sorted(self.scores)}
        object.__setattr__(self, "scores", MappingProxyType(ordered))

    @classmethod
    def of(cls, looks: Iterable[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]) -> Conformal:
        """Compute the scores of calibration looks: of each, the probability of every answered atom, and the truth."""
        scores: dict[str, list[float]] = {}
        for probability, truth in looks:
            for predicate, score in look_scores(probability, truth).items():
                scores.setdefault(predicate, []).append(score)
        return cls({predicate: tuple(values) for predicate, values in scores.items()})

    def quantile(self, predicate: str, alpha: float) -> float:
        """Return q, which a new look's score exceeds with a probability of at most `alpha`.

        Raises:
            ValueError: `alpha` is not between 0 and 1, or there are too few looks for it.
        """
        scores = self.scores[predicate]
        if not 0.0 < alpha < 1.0:
            raise ValueError(f"an error rate between 0 and 1 is expected, got {alpha}")
        # The tiny term keeps 0.9 * 10 from being rounded up to more than 9.
        rank = math.ceil((len(scores) + 1) * (1.0 - alpha) - 1e-9)
        if rank > len(scores):
            needed = math.ceil(1.0 / alpha - 1e-9) - 1
            raise ValueError(
                f"an error rate of {alpha:g} needs at least {needed} calibration looks, and there are {len(scores)} "
                f"about {predicate}; the least rate with these is {1.0 / (len(scores) + 1):.2g}"
            )
        return scores[rank - 1]

    def thresholds(self, alpha: float) -> Mapping[str, Thresholds]:
        """Return each predicate's thresholds for the error rate `alpha`.

        If q is below 0.5, every atom gets the nearer truth value (prediction sets that would be empty, which the
        guarantee counts as errors, get that value).

        Raises:
            ValueError: as `quantile`.
        """
        made = {}
        for predicate in self.scores:
            q = self.quantile(predicate, alpha)
            made[predicate] = Thresholds() if q < 0.5 else Thresholds(1.0 - q, math.nextafter(q, math.inf))
        return MappingProxyType(made)


def look_scores(probability: Mapping[Atom, float], truth: Mapping[Atom, bool]) -> dict[str, float]:
    """Return a look's nonconformity score by predicate; predicates without an answer have none."""
    scores: dict[str, float] = {}
    for atom, value in probability.items():
        if atom in truth:
            score = 1.0 - value if truth[atom] else value
            scores[atom.predicate] = max(score, scores.get(atom.predicate, 0.0))
    return scores


def covered(
    conformal: Conformal, alpha: float, looks: Sequence[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]
) -> Mapping[str, float]:
    """Return the empirical coverage by predicate, which should be 1 - alpha: the share of looks in which every atom's
    truth is in its set."""
    scores: dict[str, list[bool]] = {}
    for probability, truth in looks:
        for predicate, score in look_scores(probability, truth).items():
            scores.setdefault(predicate, []).append(score <= conformal.quantile(predicate, alpha))
    return {predicate: sum(held) / len(held) for predicate, held in sorted(scores.items())}
