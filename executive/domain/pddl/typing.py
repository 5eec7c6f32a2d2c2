"""Types and their objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

OBJECT = "object"
"""The type that every other type descends from."""

EITHER = "|"
"""Stands between the types of a union: `(either car truck)` is the type `car|truck`."""


@dataclass(frozen=True)
class Typing:
    """Which objects there are, of which types. `supertypes` maps each type to its parents, `object` to none."""

    supertypes: Mapping[str, tuple[str, ...]]
    objects: Mapping[str, str]

    @cached_property
    def _ancestors(self) -> dict[str, frozenset[str]]:
        """The types that an object of a type is of, too, as far as they have been asked for."""
        return {}

    @cached_property
    def _members(self) -> dict[str, tuple[str, ...]]:
        return {}

    def _above(self, kind: str) -> frozenset[str]:
        if kind not in self._ancestors:
            found, waiting = {kind}, list(kind.split(EITHER))
            while waiting:
                if (each := waiting.pop()) not in found or each == kind:
                    found.add(each)
                    waiting += self.supertypes[each]
            self._ancestors[kind] = frozenset(found)
        return self._ancestors[kind]

    def descends(self, kind: str, ancestor: str) -> bool:
        """Whether `kind` is `ancestor` or one of its subtypes; a union is where one of its types is."""
        above = self._above(kind)
        return any(each in above for each in ancestor.split(EITHER))

    def members(self, kind: str) -> tuple[str, ...]:
        """The objects of a type, subtypes included, in the order of the files."""
        if kind not in self._members:
            self._members[kind] = tuple(name for name, own in self.objects.items() if self.descends(own, kind))
        return self._members[kind]

    def tuples(self, kinds: Sequence[str]) -> Iterator[tuple[str, ...]]:
        """Every tuple of objects that fits a sequence of types; the one empty tuple for no types."""
        return itertools.product(*(self.members(kind) for kind in kinds))
