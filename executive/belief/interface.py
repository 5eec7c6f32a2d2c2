"""The interface between the loop and a monitor: the values they exchange, and the protocol.

    memory = monitor.begin()
    memory, judgement = monitor.looked(memory, raw, cycle)          # once a look
    memory = monitor.acted(memory, step, result)                    # once an action, before the looks after it

A monitor is frozen and holds what a run does not change (mutex groups, error rates, thresholds). What does change is
its `Memory`, a frozen value too, so that the same calls always return the same values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeAlias

from executive.types import Atom, Belief, Contradiction, Facts, Overruled, Remembered, SkillResult, Step

Memory: TypeAlias = Any
"""A monitor's belief state; each monitor has its own type. The loop hands it back unread."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """A pair of thresholds: an atom is true at or above `high`, false below `low`, and unknown in between.

    With `high` above 1 nothing is ever true, with `low` 0 nothing is ever false.

    Raises:
        ValueError: not 0 <= low <= high.
    """

    low: float = 0.5
    high: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.high:
            raise ValueError(f"thresholds must satisfy 0 <= low <= high, got low {self.low}, high {self.high}")

    def truth(self, probability: float) -> bool | None:
        """Return True, False, or None for unknown."""
        if probability >= self.high:
            return True
        return False if probability < self.low else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """The state estimate after the looks since the last action.

    Attributes:
        belief: the posterior probability of every atom that these looks decide, by an answer or because the rest of its
            mutex group is decided; the task's other atoms are `unanswered`. Has the newest look's observation id.
        seen: the truth of the atoms in `belief` at their predicates' thresholds. Neither an action's expected effects
            nor an older look ever replace an answer here.
        probability: the posterior probability of every atom of the task; of unseen ones, from the action model and
            earlier looks.
        state: every atom's truth in the most probable consistent state, which is planned from. An unseen atom has its
            last known value; it is false if that contradicts what is seen, or if it was never seen. One that cannot
            always be seen is then as it most probably is.
        contradictions: answers of the newest look that cannot all be right, which consistency resolved.
        overruled: answers of the newest look that the posterior does not follow.
        remembered: atoms that these looks do not decide and earlier ones did.
        came_about: the probability that the last action had all its effects; None without an action or without memory.
        thresholded: whether every answer is thresholded on its own, as in the paper, so that none is too uncertain to
            act upon.
    """

    belief: Belief
    seen: Facts
    probability: Mapping[Atom, float]
    state: Facts
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    remembered: Mapping[Atom, Remembered] = field(default_factory=lambda: MappingProxyType({}))
    came_about: float | None = None
    thresholded: bool = False

    def truth(self, atom: Atom) -> bool | None:
        """Return True, False, or None for an atom that the looks do not decide."""
        return self.seen.get(atom)

    def age(self, atom: Atom) -> int | None:
        """Return the cycles since the atom was last seen: 0 if it is seen now, None if it never was."""
        if atom in self.seen:
            return 0
        return self.remembered[atom].age if atom in self.remembered else None

    def least_certain(self, atoms: Collection[Atom]) -> tuple[Atom, ...]:
        """Return the atoms in the order of their probability's distance to 0.5 (ties in sorted order)."""
        return tuple(sorted(atoms, key=lambda atom: (abs(self.probability.get(atom, 0.5) - 0.5), atom)))


class Supposition(NamedTuple):
    """What would be believed if something more were known: each atom's probability, and the most probable state."""

    probability: Mapping[Atom, float]
    state: Facts


class Monitor(Protocol):
    """Turns an estimator's raw answers into state estimates. Deterministic; it never looks by itself.

    One of Executive's own has a `kind`, too: the word for it in a run's configuration and record.
    """

    def begin(self) -> Memory:
        """Return the memory of a run in which nothing was seen yet."""
        ...

    def acted(self, memory: Memory, step: Step | None, result: SkillResult | None = None) -> Memory:
        """Return the memory after the robot did `step` and its skill reported `result` (the prediction of a Bayes
        filter); without a step, after time in which the world may have changed. Later looks are at another moment."""
        ...

    def state_without(self, memory: Memory, atom: Atom) -> Facts | None:
        """Return the most probable state in which `atom` is false and one of its mutex partners is true instead, given
        all that was seen so far; None if it has no mutex partners that are known."""
        ...

    def state_with(self, memory: Memory, atom: Atom) -> Facts | None:
        """Return the most probable state in which `atom` is true, given all that was seen so far; None if the monitor
        does not know which other atoms would change with it."""
        ...

    def supposing(self, memory: Memory, literals: Mapping[Atom, bool]) -> Supposition | None:
        """Return what would be believed if these literals held, too, given all that was seen so far; None if the
        monitor does not know what goes with them."""
        ...

    def looked(self, memory: Memory, raw: Belief, cycle: int) -> tuple[Memory, Judgement]:
        """Return the memory and the state estimate after one more look at the present moment (the update of a Bayes
        filter). `raw` has the estimator's answers about all or some atoms; about the others this look says nothing."""
        ...
