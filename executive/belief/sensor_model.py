"""The sensor model: how an estimator's answers become evidence that can be added up.

An answer's evidence is the logarithm of its likelihood ratio: how much more often it is given of true atoms than of
false ones. It is computed from the answer's probability: its log-odds, times a slope and plus a bias, which correct for
overconfidence and for the share of true atoms in the data that the model was fitted on. It is bounded by the likelihood
ratio of a plain yes or no: if those are wrong once in twenty times, no answer counts for more than nineteen to one,
whatever its probability.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from executive.types import Atom

LEAST_EVIDENCE = math.log(2.0)
"""An answer whose likelihood ratio is below two to one counts as no answer: memory alone never decides an atom."""

UNINFORMATIVE = 0.99
"""Error rates whose sum is at least this say nothing of an atom."""

_EDGE = 1e-9
"""Probabilities are clipped to [_EDGE, 1 - _EDGE]."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """The error rates and the calibration of the answers about one predicate's atoms (or about one atom).

    `false_alarms` is the false positive rate: the share of false atoms whose answer is 0.5 or more. `misses` is the
    false negative rate. Evidence is slope * log-odds + bias, clipped to the log-likelihood ratios of a plain no and of
    a plain yes at these rates.

    Raises:
        ValueError: a rate is not in (0, 1), the rates add up to 1 or more, or the slope is negative.
    """

    false_alarms: float = 0.05
    misses: float = 0.05
    slope: float = 1.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.false_alarms < 1.0 and 0.0 < self.misses < 1.0):
            raise ValueError(f"rates between 0 and 1 are expected, got {self.false_alarms} and {self.misses}")
        if self.false_alarms + self.misses >= 1.0:
            raise ValueError(f"rates of {self.false_alarms} and {self.misses} would make a yes speak for no")
        if not (math.isfinite(self.slope) and self.slope >= 0.0 and math.isfinite(self.bias)):
            raise ValueError(f"slope {self.slope!r} and bias {self.bias!r} would reverse the answers' meaning")

    def evidence(self, probability: float) -> float:
        """Return the answer's log-likelihood ratio, true against false."""
        clipped = min(1.0 - _EDGE, max(_EDGE, probability))
        calibrated = self.slope * math.log(clipped / (1.0 - clipped)) + self.bias
        lower = math.log(self.misses / (1.0 - self.false_alarms))
        return min(math.log((1.0 - self.misses) / self.false_alarms), max(lower, calibrated))


PRIOR = 10.0
"""The weight of assumed rates and correlations, in answers."""


@dataclass(frozen=True, slots=True, eq=False)
class AnswerCounts:
    """How many answers of each kind there were: yes or no, about a true or a false atom. They can be added up, and
    taken away again, so that what is learned of all problems but one costs no more than a difference."""

    counts: Counter[tuple[Atom, bool, bool]] = field(default_factory=Counter)
    """By atom, its truth, and whether the answer was yes."""
    predicates: Counter[tuple[str, bool, bool]] = field(default_factory=Counter)
    """The same by predicate."""

    @classmethod
    def of(cls, answers: Iterable[tuple[Atom, bool, bool]]) -> AnswerCounts:
        """Count answers: of each the atom, whether it was yes, and the truth."""
        counts = Counter((atom, truth, yes) for atom, yes, truth in answers)
        predicates: Counter[tuple[str, bool, bool]] = Counter()
        for (atom, truth, yes), number in counts.items():
            predicates[atom.predicate, truth, yes] += number
        return cls(counts, predicates)

    def __add__(self, other: AnswerCounts) -> AnswerCounts:
        return AnswerCounts(self.counts + other.counts, self.predicates + other.predicates)

    def __sub__(self, other: AnswerCounts) -> AnswerCounts:
        return AnswerCounts(self.counts - other.counts, self.predicates - other.predicates)

    def log_odds(self, predicate: str) -> float:
        """Return the log-odds that an atom of the predicate is true, as counted, with one more of either."""
        true = self.predicates[predicate, True, True] + self.predicates[predicate, True, False]
        false = self.predicates[predicate, False, True] + self.predicates[predicate, False, False]
        return math.log((true + 1) / (false + 1))

    def error_model(self, atom: Atom | str, assumed: ErrorModel | None = None) -> ErrorModel:
        """Return the error rates of answers about an atom, or about all of a predicate given by its name: as counted,
        with `PRIOR` more answers at the assumed rates, which are the predicate's for an atom if there are no others."""
        if isinstance(atom, str):
            counts: Mapping[Any, int] = self.predicates
            assumed = ErrorModel() if assumed is None else assumed
        else:
            counts = self.counts
            assumed = self.error_model(atom.predicate) if assumed is None else assumed
        missed, seen = counts[atom, True, False], counts[atom, True, True]
        rejected, alarmed = counts[atom, False, False], counts[atom, False, True]
        misses = (missed + PRIOR * assumed.misses) / (missed + seen + PRIOR)
        false_alarms = (alarmed + PRIOR * assumed.false_alarms) / (rejected + alarmed + PRIOR)
        if misses + false_alarms >= UNINFORMATIVE:  # the answers say nothing, or the opposite
            misses = false_alarms = UNINFORMATIVE / 2
        return ErrorModel(false_alarms, misses, assumed.slope, assumed.bias)


def phi(repeats: Mapping[tuple[bool, bool], int]) -> float | None:
    """Return how much the errors of repeated questions are correlated (the phi coefficient, not below 0), None where
    one of both answers was always wrong or never.

    Args:
        repeats: how often an answer was wrong or not, and the next answer to the same question, as nothing had changed.
    """
    both, first, second, neither = (
        repeats.get(key, 0) for key in ((True, True), (True, False), (False, True), (False, False))
    )
    spread = math.sqrt((both + first) * (second + neither) * (both + second) * (first + neither))
    return max(0.0, (both * neither - first * second) / spread) if spread else None


def error_correlation(repeats: Mapping[tuple[bool, bool], int], assumed: float) -> float:
    """Return `phi` with `PRIOR` more mistakes at the assumed correlation."""
    mistakes = repeats.get((True, True), 0) + repeats.get((True, False), 0)
    found, weight = phi(repeats), mistakes / (mistakes + PRIOR)
    return weight * (assumed if found is None else found) + (1.0 - weight) * assumed


class PastEvidence(NamedTuple):
    """The evidence of earlier moments about an atom that no action has affected since.

    `evidence` are log-likelihood ratios, one a moment; the first stands for all that was believed then. `believed` is
    the atom's present log-odds.
    """

    evidence: tuple[float, ...]
    believed: float

    def agrees_with(self, evidence: float) -> bool:
        """Whether new evidence points the same way as the belief, and is not too weak to count."""
        return evidence * self.believed > 0.0 and abs(evidence) >= LEAST_EVIDENCE

    def with_look(self, evidence: float, believed: float) -> PastEvidence:
        """Return the evidence with one more moment's, after which the log-odds are `believed`. Evidence that disagrees
        starts a new sequence."""
        if self.agrees_with(evidence):
            return PastEvidence((*self.evidence, evidence), believed)
        return PastEvidence((believed,) if abs(evidence) >= LEAST_EVIDENCE else self.evidence, believed)


@dataclass(frozen=True, slots=True)
class SensorModel:
    """The error models of one estimator, and how much the errors of repeated looks are correlated.

    Attributes:
        error_models: by predicate.
        other: the error model of predicates that were not measured.
        correlation_within: how much the errors of several looks at the same moment are correlated, from 0 (each look
            errs independently) to 1 (a second look repeats the mistakes of the first).
        correlation_across: the same for looks at different moments, about atoms that no action has affected in between.
            A model that takes a can on the edge for one on the table does so in every look.
        correlations: the measured correlation of the errors of repeated questions, by predicate, which takes the place
            of the two above. It is that between a mistake and the next answer to the same question, asked in the same
            way while nothing has changed.
        atoms: error models of single atoms, which precede those of their predicates: an estimator may be right about
            all items on a table but one.

    Raises:
        ValueError: a correlation is not in [0, 1].
    """

    error_models: Mapping[str, ErrorModel] = field(default_factory=lambda: MappingProxyType({}))
    other: ErrorModel = field(default_factory=ErrorModel)
    correlation_within: float = 0.2
    correlation_across: float = 0.0
    atoms: Mapping[Atom, ErrorModel] = field(default_factory=lambda: MappingProxyType({}))
    correlations: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for predicate, value in self.correlations.items():
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{predicate}: a correlation from 0 to 1 is expected, got {value}")
        for name in ("correlation_within", "correlation_across"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: a share from 0 to 1 is expected, got {getattr(self, name)}")

    def evidence(self, atom: Atom, probability: float) -> float:
        """Return the log-likelihood ratio of an answer about `atom`."""
        model = self.atoms.get(atom) or self.error_models.get(atom.predicate, self.other)
        return model.evidence(probability)

    def pooled(self, evidence: Sequence[float], predicate: str = "") -> float:
        """Return the evidence of several looks at one moment together. n looks whose errors have the correlation a
        count for n / (1 + (n - 1) a) independent ones (the design effect of cluster samples, Kish 1965); a is the
        predicate's, or `correlation_within`."""
        count, correlation = len(evidence), self.correlations.get(predicate, self.correlation_within)
        return math.fsum(evidence) / (1.0 + (count - 1) * correlation)

    def increment(self, evidence: float, earlier: PastEvidence, predicate: str = "") -> float:
        """Return what a look adds to the log-odds of an atom that no action has affected since `earlier` looks.

        Evidence that disagrees with the belief counts in full, and so does evidence too weak to count. Evidence that
        agrees is pooled with the earlier ones, as in `pooled` with `correlation_across` for a unless the predicate has
        its own, so that neither many weak looks nor a single confident one make the atom certain.
        """
        correlation = self.correlations.get(predicate, self.correlation_across)
        if not correlation or not earlier.agrees_with(evidence):
            return evidence
        every = (*earlier.evidence, evidence)
        return math.fsum(every) / (1.0 + (len(every) - 1) * correlation) - earlier.believed


EXACT = SensorModel(other=ErrorModel(1e-6, 1e-6), correlation_within=0.0)
"""The sensor model of an estimator that is practically never wrong, such as the oracle."""
