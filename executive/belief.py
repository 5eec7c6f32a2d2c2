"""What the looks amount to, and what is kept of them over time. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from executive.types import Atom, Facts


@dataclass(frozen=True, slots=True)
class Known:
    """The last known value of each atom, and the cycle in which it was last seen.

    What a look cannot tell keeps its value and grows older. It is never replaced by what an action was meant to do.
    """

    facts: Facts = field(default_factory=Facts)
    seen: Mapping[Atom, int] = field(default_factory=lambda: MappingProxyType({}))

    def updated(self, seen: Facts, cycle: int) -> Known:
        """With what was seen in `cycle`."""
        return Known(self.facts | seen, MappingProxyType({**self.seen, **dict.fromkeys(seen, cycle)}))

    def age(self, atom: Atom, cycle: int) -> int | None:
        """For how many cycles the atom has not been seen; None if it never was."""
        return cycle - self.seen[atom] if atom in self.seen else None

    def state(self, atoms: Collection[Atom]) -> Facts:
        """A complete state to plan from: what is known, and false for what is not (the closed world assumption)."""
        return Facts.closed(self.facts.true, atoms)


@dataclass(frozen=True, slots=True)
class Moment:
    """The looks at one state of the world, between two actions: what was known before them, what they were expected
    to show, and what each of them showed."""

    before: Known
    expected: Facts
    looks: tuple[Facts, ...] = ()
    observation_id: int = -1
    """Of the last look."""

    @property
    def last(self) -> Facts:
        """What the last look alone showed; nothing before the first one."""
        return self.looks[-1] if self.looks else Facts()

    @property
    def settled(self) -> Facts:
        """What the looks say together; see `settle`."""
        return settle(self.expected, self.looks)

    def looked(self, seen: Facts, observation_id: int) -> Moment:
        """With one more look."""
        return replace(self, looks=(*self.looks, seen), observation_id=observation_id)


def settle(expected: Facts, looks: Sequence[Facts]) -> Facts:
    """What several looks at one moment say together.

    What any of them saw as expected is taken to be so: a surprise that one look shows and another does not is no
    surprise. Otherwise the last look that could tell decides. What none could tell is not mentioned.
    """
    settled: dict[Atom, bool] = {}
    for look in reversed(looks):
        for atom, value in look.items():
            if atom not in settled or expected.get(atom) is value:
                settled[atom] = value
    return Facts(settled)
