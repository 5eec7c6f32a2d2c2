"""What the loop and a monitor say to each other: the values, and the protocol that every monitor keeps.

    memory = monitor.begin()
    memory, judgement = monitor.looked(memory, raw, cycle)          # once a look
    memory = monitor.acted(memory, step, result)                    # once an action, before the looks after it

A monitor is frozen and holds what a run does not change (groups, error rates, thresholds). What a run does change is
its `Memory`, a frozen value too: the same calls give the same answers, whoever else calls meanwhile.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

from executive.types import Atom, Belief, Contradiction, Facts, Overruled, Remembered, SkillResult, Step

Memory: TypeAlias = Any
"""What a monitor keeps of a run; each monitor has its own kind. To be handed back unread."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What is true at or above `high`, false below `low`, and unknown in between (see `Belief.truth`). Nothing is ever
    true where `high` is above 1, nor false where `low` is 0."""

    low: float = 0.5
    high: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.high:
            raise ValueError(f"thresholds must satisfy 0 <= low <= high, got low {self.low}, high {self.high}")

    def truth(self, probability: float) -> bool | None:
        if probability >= self.high:
            return True
        return False if probability < self.low else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """What is made of the looks since the last action, the last one included.

    Attributes:
        belief: the fused probability of every atom that these looks tell, be it by an answer or because the others of
            its group are told; the rest of the task's atoms are `unanswered`. Carries the last look's observation id.
        seen: the truth of the atoms in `belief` at the thresholds of their predicates. Neither an effect that an action
            should have had nor an older look ever stands in for an answer here.
        probability: of every atom of the task, unseen ones included: what the action model and memory make of them.
        state: every atom's truth in the most probable consistent state, to plan from. What is unseen has its last known
            value, or is false where that is inconsistent with what is seen, or where it was never seen.
        contradictions: clashes between the answers of the last look, which consistency resolved.
        overruled: answers of the last look that are not believed.
        remembered: atoms that these looks do not tell and earlier ones did.
        came_about: the probability that the last action had all of its effects; None where there was no action, or no
            memory.
        at_word: every answer is taken at its word, as the paper does it; none of them can be too unsure to act upon.
    """

    belief: Belief
    seen: Facts
    probability: Mapping[Atom, float]
    state: Facts
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    remembered: Mapping[Atom, Remembered] = field(default_factory=lambda: MappingProxyType({}))
    came_about: float | None = None
    at_word: bool = False

    def truth(self, atom: Atom) -> bool | None:
        """True, False, or None for what the looks cannot tell."""
        return self.seen.get(atom)

    def age(self, atom: Atom) -> int | None:
        """Cycles since the atom was last told: 0 for what is seen now, None for what never was."""
        if atom in self.seen:
            return 0
        return self.remembered[atom].age if atom in self.remembered else None

    def least_certain(self, atoms: Collection[Atom]) -> tuple[Atom, ...]:
        """The atoms, the one that is nearest to even chances first (ties in sorted order)."""
        return tuple(sorted(atoms, key=lambda atom: (abs(self.probability.get(atom, 0.5) - 0.5), atom)))


class Monitor(Protocol):
    """Turns raw looks into judgements. Deterministic; it never looks by itself."""

    def begin(self) -> Memory:
        """The memory of a run in which nothing was seen yet."""
        ...

    def acted(self, memory: Memory, step: Step | None, result: SkillResult | None = None) -> Memory:
        """The robot did `step`, and its skill says `result`; or, without a step, time went by in which the world may
        have changed. From here on looks are about another moment."""
        ...

    def otherwise(self, memory: Memory, atom: Atom) -> Facts | None:
        """If `atom` is not what it is believed to be, what then? The most probable state with something else true in
        its stead, from what was seen so far; None where nothing else is known that could be."""
        ...

    def supposing(self, memory: Memory, atom: Atom) -> Facts | None:
        """The most probable state in which `atom` is true, from what was seen so far; None where it cannot be told
        what else would be otherwise then."""
        ...

    def looked(self, memory: Memory, raw: Belief, cycle: int) -> tuple[Memory, Judgement]:
        """One more look at the moment since the last action. `raw` is what the estimator says, about all atoms or some
        of them; what it leaves out or does not answer, this look does not tell."""
        ...
