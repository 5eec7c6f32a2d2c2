"""How sure is sure enough: thresholds by split conformal prediction (Vovk, Gammerman and Shafer 2005).

An answer's nonconformity is the probability that it left for what is not so: 1 - P for a true atom, P for a false one.
A look's, as to one predicate, is the largest of its atoms. Of the scores of n calibration looks, the
ceil((n + 1) (1 - alpha))-th smallest is q. In a new look each atom's set holds every truth value whose nonconformity
would be at most q; where that is one value it is told, else the atom is unknown.

The guarantee is per look and per predicate: if the new look is exchangeable with the calibration looks, then with a
probability of at least 1 - alpha (over all of them) every atom of the predicate has its truth in its set, so that
nothing is told wrongly; and, where no two looks score the same, of at most 1 - alpha + 1 / (n + 1). Answers of one look
err together, which is why the look is the unit and not the atom; looks of one run are like each other, too, and so are
the looks that are calibrated with to be as the new ones are. It says nothing about one atom given the others, and for k
predicates at once no more than 1 - k alpha.
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
    """For each predicate the scores of the calibration looks that answered about it, sorted."""

    scores: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for predicate, scores in self.scores.items():
            if not all(0.0 <= score <= 1.0 for score in scores):
                raise ValueError(f"{predicate}: scores are from 0 to 1")
        ordered = {predicate: tuple(sorted(self.scores[predicate])) for predicate in sorted(self.scores)}
        object.__setattr__(self, "scores", MappingProxyType(ordered))

    @classmethod
    def of(cls, looks: Iterable[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]) -> Conformal:
        """From calibration looks: the probability of each answered atom, and the truth."""
        scores: dict[str, list[float]] = {}
        for probability, truth in looks:
            for predicate, score in look_scores(probability, truth).items():
                scores.setdefault(predicate, []).append(score)
        return cls({predicate: tuple(values) for predicate, values in scores.items()})

    def quantile(self, predicate: str, alpha: float) -> float:
        """q: what a new look's score exceeds with a probability of at most `alpha`.

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
                f"an error rate of {alpha:g} takes at least {needed} calibration looks, and there are {len(scores)} "
                f"about {predicate}; the least rate with these is {1.0 / (len(scores) + 1):.2g}"
            )
        return scores[rank - 1]

    def thresholds(self, alpha: float) -> Mapping[str, Thresholds]:
        """What is told of each predicate's atoms at error rate `alpha`, as thresholds.

        Where q is below 0.5, no answer can be wrong by more than it: the nearer truth value is told of every atom (sets
        that would be empty, which the guarantee counts as errors, are given that value).

        Raises:
            ValueError: as `quantile`.
        """
        made = {}
        for predicate in self.scores:
            q = self.quantile(predicate, alpha)
            made[predicate] = Thresholds() if q < 0.5 else Thresholds(1.0 - q, math.nextafter(q, math.inf))
        return MappingProxyType(made)


def look_scores(probability: Mapping[Atom, float], truth: Mapping[Atom, bool]) -> dict[str, float]:
    """A look's nonconformity by predicate; predicates of which nothing was answered have none."""
    scores: dict[str, float] = {}
    for atom, value in probability.items():
        if atom in truth:
            score = 1.0 - value if truth[atom] else value
            scores[atom.predicate] = max(score, scores.get(atom.predicate, 0.0))
    return scores


def covered(
    conformal: Conformal, alpha: float, looks: Sequence[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]
) -> Mapping[str, float]:
    """The share of looks in which every atom's truth is in its set, by predicate: what is to be 1 - alpha."""
    scores: dict[str, list[bool]] = {}
    for probability, truth in looks:
        for predicate, score in look_scores(probability, truth).items():
            scores.setdefault(predicate, []).append(score <= conformal.quantile(predicate, alpha))
    return {predicate: sum(held) / len(held) for predicate, held in sorted(scores.items())}
