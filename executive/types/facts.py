"""Atoms and signed facts: what everything else is about."""

from __future__ import annotations

import re
from collections.abc import ItemsView, Iterable, Iterator, KeysView, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias, TypeVar, overload

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
Image: TypeAlias = npt.NDArray[np.uint8]
DepthImage: TypeAlias = npt.NDArray[np.uint16]
_T = TypeVar("_T")
_NAME = r"[A-Za-z0-9_][A-Za-z0-9_\-]*"
_ATOM = re.compile(rf"\s*({_NAME})\s*(?:\(\s*((?:{_NAME}(?:\s*,\s*{_NAME})*)?)\s*\))?\s*")


@dataclass(frozen=True, slots=True, order=True)
class Atom:
    """A grounded predicate, printed and parsed as `on-table(milk-carton,wood-table)`; without arguments, `name()`."""

    predicate: str
    args: tuple[str, ...] = ()
    _hash: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_hash", hash((self.predicate, self.args)))  # asked for millions of times in a run
        for name in (self.predicate, *self.args):
            if not re.fullmatch(_NAME, name):
                raise ValueError(f"{name!r} is not a PDDL name (a letter or digit, then letters, digits, '-' or '_')")

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[object, ...]:  # another process has other hashes
        return Atom, (self.predicate, self.args)

    @classmethod
    def parse(cls, text: str) -> Atom:
        """Read an atom as `str` prints it; `name` alone means `name()`.

        Raises:
            ValueError: when the text is no atom.
        """
        match = _ATOM.fullmatch(text)
        if match is None:
            raise ValueError(f"{text!r} is not an atom such as on-table(lemon,wood-table)")
        args = match.group(2)
        return cls(match.group(1), tuple(part.strip() for part in args.split(",")) if args else ())

    def __str__(self) -> str:
        return f"{self.predicate}({','.join(self.args)})"


class Facts(Mapping[Atom, bool]):
    """An immutable, partial, signed assignment: an atom is true, false, or simply not mentioned.

    Preconditions, effects, goals, expectations and revised states are all facts, so that "must be false" is never
    confused with "is not mentioned". Iteration is in sorted order, so that everything derived from it repeats.
    """

    __slots__ = ("_hash", "_truth")

    def __init__(self, truth: Mapping[Atom, bool] | Iterable[tuple[Atom, bool]] = ()) -> None:
        pairs = dict(truth)
        for atom, value in pairs.items():
            if not isinstance(atom, Atom) or not isinstance(value, bool):
                raise TypeError(f"facts map Atom to bool, got {atom!r}: {value!r}")
        self._truth: Mapping[Atom, bool] = MappingProxyType({atom: pairs[atom] for atom in sorted(pairs)})
        self._hash: int | None = None

    @classmethod
    def _in_order(cls, truth: dict[Atom, bool]) -> Facts:
        """Facts of pairs that are in order already, and of the right types."""
        facts = cls.__new__(cls)
        facts._truth, facts._hash = MappingProxyType(truth), None
        return facts

    @classmethod
    def closed(cls, true: Iterable[Atom], universe: Iterable[Atom]) -> Facts:
        """Return every atom of `universe`: true when in `true`, else false (the closed world of a PDDL :init)."""
        holding = frozenset(true)
        return cls({atom: atom in holding for atom in (*universe, *holding)})

    @classmethod
    def parse(cls, *literals: str) -> Facts:
        """Facts from literals such as `on-table(lemon,wood-table)` and `not robot-gripper-empty()`."""
        truth: dict[Atom, bool] = {}
        for literal in literals:
            text = literal.strip()
            negated = text.startswith("not ")
            truth[Atom.parse(text[4:] if negated else text)] = not negated
        return cls(truth)

    def __getitem__(self, atom: Atom) -> bool:
        return self._truth[atom]

    def __contains__(self, atom: object) -> bool:
        return atom in self._truth

    def __iter__(self) -> Iterator[Atom]:
        return iter(self._truth)

    def __len__(self) -> int:
        return len(self._truth)

    # What `Mapping` has of these is many times slower.

    def keys(self) -> KeysView[Atom]:
        return self._truth.keys()

    def items(self) -> ItemsView[Atom, bool]:
        return self._truth.items()

    @overload
    def get(self, atom: Atom, default: None = None, /) -> bool | None: ...
    @overload
    def get(self, atom: Atom, default: bool | _T, /) -> bool | _T: ...
    def get(self, atom: Atom, default: bool | _T | None = None, /) -> bool | _T | None:
        return self._truth.get(atom, default)

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = hash(frozenset(self._truth.items()))
        return self._hash

    def __eq__(self, other: object) -> bool:
        return dict(self._truth) == dict(other._truth) if isinstance(other, Facts) else NotImplemented

    def __or__(self, other: Mapping[Atom, bool]) -> Facts:
        """These facts, overridden by `other`."""
        merged = {**self._truth, **other}
        return Facts._in_order(merged) if len(merged) == len(self._truth) else Facts(merged)

    def __reduce__(self) -> tuple[object, ...]:
        return Facts, (dict(self._truth),)

    def __repr__(self) -> str:
        return f"Facts({', '.join(self.literals())})"

    def literals(self) -> tuple[str, ...]:
        """Return the facts as text: `atom` or `not atom`, in sorted order. `Facts.parse` reads them back."""
        return tuple(str(atom) if value else f"not {atom}" for atom, value in self._truth.items())

    @property
    def true(self) -> frozenset[Atom]:
        return frozenset(atom for atom, value in self._truth.items() if value)

    @property
    def false(self) -> frozenset[Atom]:
        return frozenset(atom for atom, value in self._truth.items() if not value)

    def without(self, atoms: Iterable[Atom]) -> Facts:
        dropped = frozenset(atoms)
        return Facts._in_order({atom: value for atom, value in self._truth.items() if atom not in dropped})

    def only(self, atoms: Iterable[Atom]) -> Facts:
        kept = frozenset(atoms)
        return Facts._in_order({atom: value for atom, value in self._truth.items() if atom in kept})

    def entails(self, required: Mapping[Atom, bool]) -> bool:
        """Return whether every literal of `required` is mentioned here with the same sign."""
        return all(self._truth.get(atom) is value for atom, value in required.items())
