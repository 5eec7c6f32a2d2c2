"""The last known value of each atom, and the cycle in which it was observed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from executive.types import Atom, Facts, Remembered


@dataclass(frozen=True, slots=True)
class LastKnown:
    """The last known value of each atom, and the cycle in which it was last observed."""

    facts: Facts = field(default_factory=Facts)
    cycle: Mapping[Atom, int] = field(default_factory=lambda: MappingProxyType({}))

    def updated(self, seen: Facts, cycle: int) -> LastKnown:
        """Return the values with those that were seen in `cycle`."""
        return LastKnown(self.facts | seen, MappingProxyType({**self.cycle, **dict.fromkeys(seen, cycle)}))

    def remembered(self, seen: Facts, cycle: int, probability: Mapping[Atom, float]) -> Mapping[Atom, Remembered]:
        """Return the last known values of the atoms that `seen` lacks, with their ages in `cycle`."""
        return MappingProxyType(
            {
                atom: Remembered(value, cycle - self.cycle[atom], probability[atom])
                for atom, value in self.facts.items()
                if atom not in seen
            }
        )
