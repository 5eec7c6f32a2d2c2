"""The monitor of the paper: each look alone, each atom alone, against a threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from executive.monitor.seam import Judgement, Thresholds
from executive.types import Atom, Belief, Facts, Remembered, SkillResult, Step


@dataclass(frozen=True, slots=True)
class Last:
    """The last known value of each atom and the cycle in which it was told, and which of them since the last action."""

    facts: Facts = field(default_factory=Facts)
    cycle: Mapping[Atom, int] = field(default_factory=lambda: MappingProxyType({}))
    told: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class PlainMonitor:
    """Takes every answer at its word; of several looks at one moment, the last that could tell.

    Args:
        atoms: the task's.
        thresholds: one pair for all (the paper: both 0.5), or one for each predicate.
    """

    atoms: Sequence[Atom]
    thresholds: Thresholds | Mapping[str, Thresholds] = field(default_factory=Thresholds)

    def begin(self) -> Last:
        return Last()

    def acted(self, memory: Last, step: Step | None, result: SkillResult | None = None) -> Last:
        return replace(memory, told=MappingProxyType({}))

    def looked(self, memory: Last, raw: Belief, cycle: int) -> tuple[Last, Judgement]:
        asked = set(self.atoms)
        answers = {atom: value for atom, value in raw.probability.items() if atom in asked}
        told = {**memory.told, **answers}
        truth = {atom: self._of(atom).truth(value) for atom, value in told.items()}
        seen = Facts({atom: value for atom, value in truth.items() if value is not None})
        facts = memory.facts | seen
        cycles = MappingProxyType({**memory.cycle, **dict.fromkeys(seen, cycle)})
        remembered = {
            atom: Remembered(facts[atom], cycle - cycles[atom], float(facts[atom]))
            for atom in facts
            if atom not in seen
        }
        judgement = Judgement(
            belief=replace(raw, probability=told, unanswered=frozenset(asked - told.keys())),
            seen=seen,
            probability=MappingProxyType({atom: told.get(atom, float(facts.get(atom, 0.5))) for atom in self.atoms}),
            state=Facts.closed(facts.true, self.atoms),
            remembered=MappingProxyType(remembered),
        )
        return Last(facts, cycles, MappingProxyType(told)), judgement

    def _of(self, atom: Atom) -> Thresholds:
        pairs = self.thresholds
        return pairs if isinstance(pairs, Thresholds) else pairs[atom.predicate]
