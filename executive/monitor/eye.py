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

from executive.types import Atom

HARDLY = math.log(2.0)
"""An answer that is worth less than two to one is none: memory alone never tells an atom."""

_EDGE = 1e-9
"""Probabilities nearer to 0 or 1 are taken to be this near."""


@dataclass(frozen=True, slots=True)
class Reading:
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


@dataclass(frozen=True, slots=True)
class Eye:
    """The readings of one eye, by predicate, and `other` for those that were not measured. `atoms` are those of single
    atoms, which go before: an eye may see all items on a table but one, and its no to that one is worth nothing.

    `alike` says how much two looks at the same moment err together: 0 where every look errs on its own, 1 where looking
    again shows the same mistakes again. `lasting` says it of looks at different moments, at what no action has touched
    in between: to a model that takes a can on the edge for one on the table, it looks like that all day.
    """

    readings: Mapping[str, Reading] = field(default_factory=lambda: MappingProxyType({}))
    other: Reading = field(default_factory=Reading)
    alike: float = 0.2
    lasting: float = 0.0
    atoms: Mapping[Atom, Reading] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name in ("alike", "lasting"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: a share from 0 to 1 is expected, got {getattr(self, name)}")

    def evidence(self, atom: Atom, probability: float) -> float:
        reading = self.atoms.get(atom) or self.readings.get(atom.predicate, self.other)
        return reading.evidence(probability)

    def together(self, evidence: Sequence[float]) -> float:
        """What several looks at one moment say of an atom. n of them that err together count for n / (1 + (n - 1) a)
        that err on their own, where a is `alike` (the design effect of cluster samples, Kish 1965)."""
        count = len(evidence)
        return math.fsum(evidence) / (1.0 + (count - 1) * self.alike)

    def anew(self, evidence: float, believed: float) -> float:
        """What a look says that earlier ones have not said already, where they had it `believed` (log-odds) and nothing
        has touched it since. What speaks against them counts in full, and so does what says next to nothing; what
        agrees counts as far as it is not the same error once more, and takes something away where it is less sure than
        they were: with `lasting` a, looks that all say e amount to e / a, whatever was believed before."""
        if evidence * believed <= 0.0 or abs(evidence) < HARDLY:
            return evidence
        return evidence - self.lasting * believed


EXACT = Eye(other=Reading(1e-6, 1e-6), alike=0.0)
"""An eye that is taken to be always right."""
