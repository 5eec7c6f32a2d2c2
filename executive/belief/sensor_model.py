"""What an eye's answers are worth: from a probability that an eye gives to evidence that can be added up.

An answer is worth the logarithm of how much more often it is given of true atoms than of false ones. That is read off
the probability: its log-odds, times a slope and plus a bias that take out how the eye exaggerates and how often atoms
of the predicate were true where it was measured. And it is never worth more than a plain yes or no has been: one that
is wrong once in twenty times counts for nineteen to one, however sure the eye says it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from executive.types import Atom

HARDLY = math.log(2.0)
"""An answer that is worth less than two to one is none: memory alone never tells an atom."""

_EDGE = 1e-9
"""Probabilities nearer to 0 or 1 are taken to be this near."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """How the answers about one predicate's atoms are to be read.

    `false_alarms` is the share of false atoms that are answered with yes (a probability of 0.5 and more), `misses` that
    of true atoms that are answered with no. Evidence is slope * log-odds + bias, held between what a no and what a yes
    is worth by these rates.
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
            raise ValueError(f"slope {self.slope!r} and bias {self.bias!r} turn answers around")

    def evidence(self, probability: float) -> float:
        """The logarithm of the answer's likelihood ratio, true against false."""
        kept = min(1.0 - _EDGE, max(_EDGE, probability))
        worth = self.slope * math.log(kept / (1.0 - kept)) + self.bias
        least = math.log(self.misses / (1.0 - self.false_alarms))
        return min(math.log((1.0 - self.misses) / self.false_alarms), max(least, worth))


class PastEvidence(NamedTuple):
    """What looks at earlier moments said of an atom that nothing has touched since (log-odds, the first with all that
    was believed then), and what is believed of it now."""

    said: tuple[float, ...]
    believed: float

    def heeds(self, evidence: float) -> bool:
        """Whether a look says the same again, more or less surely."""
        return evidence * self.believed > 0.0 and abs(evidence) >= HARDLY

    def with_look(self, evidence: float, believed: float) -> PastEvidence:
        """With one look more, after which it was `believed`. One that says otherwise is where it all begins anew."""
        if self.heeds(evidence):
            return PastEvidence((*self.said, evidence), believed)
        return PastEvidence((believed,) if abs(evidence) >= HARDLY else self.said, believed)


@dataclass(frozen=True, slots=True)
class SensorModel:
    """The readings of one eye, by predicate, and `other` for those that were not measured. `atoms` are those of single
    atoms, which go before: an eye may see all items on a table but one, and its no to that one is worth nothing.

    `alike` says how much two looks at the same moment err together: 0 where every look errs on its own, 1 where looking
    again shows the same mistakes again. `lasting` says it of looks at different moments, at what no action has touched
    in between: to a model that takes a can on the edge for one on the table, it looks like that all day.
    """

    error_models: Mapping[str, ErrorModel] = field(default_factory=lambda: MappingProxyType({}))
    other: ErrorModel = field(default_factory=ErrorModel)
    alike: float = 0.2
    lasting: float = 0.0
    atoms: Mapping[Atom, ErrorModel] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name in ("alike", "lasting"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: a share from 0 to 1 is expected, got {getattr(self, name)}")

    def evidence(self, atom: Atom, probability: float) -> float:
        reading = self.atoms.get(atom) or self.error_models.get(atom.predicate, self.other)
        return reading.evidence(probability)

    def together(self, evidence: Sequence[float]) -> float:
        """What several looks at one moment say of an atom. n of them that err together count for n / (1 + (n - 1) a)
        that err on their own, where a is `alike` (the design effect of cluster samples, Kish 1965)."""
        count = len(evidence)
        return math.fsum(evidence) / (1.0 + (count - 1) * self.alike)

    def anew(self, evidence: float, earlier: PastEvidence) -> float:
        """What a look adds to what is believed of an atom that nothing has touched since earlier looks told of it.

        What speaks against them counts in full, and so does what says next to nothing. What agrees is one more of them:
        what is believed then is what all of them together are worth, as in `together` with `lasting` for a, so that
        neither many that lean the same way nor a single one that is sure make it certain.
        """
        if not self.lasting or not earlier.heeds(evidence):
            return evidence
        said = (*earlier.said, evidence)
        return math.fsum(said) / (1.0 + (len(said) - 1) * self.lasting) - earlier.believed


EXACT = SensorModel(other=ErrorModel(1e-6, 1e-6), alike=0.0)
"""An eye that is taken to be always right."""
