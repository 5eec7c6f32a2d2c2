"""The last known value of each atom, and when it was told: what is left of what cannot be seen any more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from executive.types import Atom, Facts, Remembered


@dataclass(frozen=True, slots=True)
class LastKnown:
    """Values, and the cycle in which each was told last."""

    facts: Facts = field(default_factory=Facts)
    cycle: Mapping[Atom, int] = field(default_factory=lambda: MappingProxyType({}))

    def updated(self, seen: Facts, cycle: int) -> LastKnown:
        return LastKnown(self.facts | seen, MappingProxyType({**self.cycle, **dict.fromkeys(seen, cycle)}))

    def remembered(self, seen: Facts, cycle: int, probability: Mapping[Atom, float]) -> Mapping[Atom, Remembered]:
        """What is known of the atoms that `seen` does not tell, and how old that is in `cycle`."""
        return MappingProxyType(
            {
                atom: Remembered(value, cycle - self.cycle[atom], probability[atom])
                for atom, value in self.facts.items()
                if atom not in seen
            }
        )
