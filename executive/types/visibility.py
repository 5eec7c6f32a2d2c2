"""What can be seen: the conditions under which atoms are visible, and what follows from what is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from executive.types.conditions import Condition
from executive.types.derived import DerivedRules
from executive.types.facts import Atom


@dataclass(frozen=True, slots=True)
class Visibility:
    """The conditions under which atoms can be seen, of those that cannot always be; `rules` say how derived atoms in
    them follow from others."""

    conditions: Mapping[Atom, Condition] = field(default_factory=lambda: MappingProxyType({}))
    rules: DerivedRules = field(default_factory=DerivedRules)

    def __bool__(self) -> bool:
        return bool(self.conditions)

    def truth(self, atom: Atom, known: Mapping[Atom, bool]) -> bool | None:
        """Return whether an atom can be seen where this much is known; None where that depends on what is not."""
        condition = self.conditions.get(atom)
        return True if condition is None else condition.truth(self.rules.complete(known, condition.atoms))

    def hidden(self, known: Mapping[Atom, bool]) -> frozenset[Atom]:
        """Return the atoms of which it is not known that they can be seen."""
        return frozenset(atom for atom in self.conditions if self.truth(atom, known) is not True)

    def covered(self, known: Mapping[Atom, bool]) -> frozenset[Atom]:
        """Return the atoms of which it is known that they cannot be seen."""
        return frozenset(atom for atom in self.conditions if self.truth(atom, known) is False)
