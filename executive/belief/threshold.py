"""The paper's monitor: every answer is thresholded on its own, without consistency or memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

from executive.belief.interface import Judgement, Supposition, Thresholds
from executive.belief.last_known import LastKnown
from executive.types import Atom, Belief, Facts, SkillResult, Step


@dataclass(frozen=True, slots=True)
class Thresholded:
    """The memory: last known values before and with the looks at this moment, and the newest answer about each atom."""

    before: LastKnown = field(default_factory=LastKnown)
    now: LastKnown = field(default_factory=LastKnown)
    answers: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class ThresholdMonitor:
    """Thresholds every answer; of several looks at one moment, the newest answer about an atom counts.

    Args:
        atoms: the task's.
        thresholds: one pair for all predicates (the paper: both 0.5).
    """

    kind: ClassVar[str] = "plain"
    atoms: Sequence[Atom]
    thresholds: Thresholds = field(default_factory=Thresholds)

    def begin(self) -> Thresholded:
        return Thresholded()

    def acted(self, memory: Thresholded, step: Step | None, result: SkillResult | None = None) -> Thresholded:
        return Thresholded(memory.now, memory.now)

    def state_without(self, memory: Thresholded, atom: Atom) -> Facts | None:
        return None

    def state_with(self, memory: Thresholded, atom: Atom) -> Facts | None:
        return None

    def supposing(self, memory: Thresholded, literals: Mapping[Atom, bool]) -> Supposition | None:
        return None

    def looked(self, memory: Thresholded, raw: Belief, cycle: int) -> tuple[Thresholded, Judgement]:
        atoms = frozenset(self.atoms)
        answers = {**memory.answers, **{atom: value for atom, value in raw.probability.items() if atom in atoms}}
        truth = {atom: self.thresholds.truth(value) for atom, value in answers.items()}
        seen = Facts({atom: value for atom, value in truth.items() if value is not None})
        now = memory.before.updated(seen, cycle)
        probability = {atom: answers.get(atom, float(now.facts.get(atom, 0.5))) for atom in self.atoms}
        judgement = Judgement(
            belief=replace(raw, probability=answers, unanswered=atoms - answers.keys()),
            seen=seen,
            probability=MappingProxyType(probability),
            state=Facts.closed(now.facts.true, self.atoms),
            remembered=now.remembered(seen, cycle, probability),
            thresholded=True,
        )
        return Thresholded(memory.before, now, MappingProxyType(answers)), judgement
