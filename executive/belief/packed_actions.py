"""Grounded actions applied to many states at once. States are kept as bits, eight atoms in a byte, and worked on as
words of 64: whether a conjunction of literals holds is one comparison a word, whatever the number of literals, and what
an action adds and deletes is one more."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from executive.types import Atom, Condition, DerivedRules, Facts, Step

BoolArray: TypeAlias = npt.NDArray[np.bool_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]
WordArray: TypeAlias = npt.NDArray[np.uint64]

NO_RULES = DerivedRules()


def width(atoms: int) -> int:
    """The bytes that a state over so many atoms takes."""
    return (atoms + 7) // 8


def pack(states: BoolArray) -> ByteArray:
    """Return rows of bytes, (N, width), for rows of truth values, (N, atoms)."""
    return np.packbits(states, axis=1)


def unpack(packed: ByteArray, atoms: int) -> BoolArray:
    """Return rows of truth values, (N, atoms), for rows of bytes."""
    return np.unpackbits(packed, axis=1, count=atoms).astype(np.bool_)


class _Bits(NamedTuple):
    """Some bits of a word: which ones, and their values."""

    word: int
    mask: np.uint64
    value: np.uint64


class _Test(NamedTuple):
    """A condition, prepared: literals as bits, literals of derived atoms, and disjunctions."""

    bits: tuple[_Bits, ...]
    derived: tuple[tuple[Atom, bool], ...]
    choices: tuple[tuple[_Test, ...], ...]


_ALWAYS = _Test((), (), ())


class _Effect(NamedTuple):
    """An effect, prepared: when it happens, and the bits that it deletes and adds."""

    when: _Test
    deletes: tuple[_Bits, ...]
    adds: tuple[_Bits, ...]


class _Move(NamedTuple):
    able: _Test
    effects: tuple[_Effect, ...]


class Actions:
    """Grounded actions over `atoms`, which are sorted. Any other atom is false, unless it follows by the `rules`."""

    def __init__(self, atoms: Sequence[Atom], steps: Sequence[Step], rules: DerivedRules = NO_RULES) -> None:
        self.atoms, self.steps, self.rules = tuple(atoms), tuple(steps), rules
        self._position = {atom: index for index, atom in enumerate(self.atoms)}
        self._moves: dict[int, _Move] = {}
        self._derivations: dict[Atom, _Test] = {}

    def successors(self, packed: ByteArray) -> Iterator[ByteArray]:
        """Yield for each action the states that it leads to from those, (N, width), in which it can be done."""
        words = _words(packed)
        derived = self._derived(words)
        for number in range(len(self.steps)):
            _, after = self._applied(words, number, derived)
            if after.shape[1]:
                yield _bytes(after, packed.shape[1])

    def applied(self, packed: ByteArray, number: int = 0) -> tuple[BoolArray, ByteArray]:
        """Return in which of the states, (N, width), the action of that number can be done, (N,), and where it leads
        from these."""
        words = _words(packed)
        able, after = self._applied(words, number, self._derived(words))
        return able, _bytes(after, packed.shape[1])

    def truth(self, condition: Condition, packed: ByteArray) -> BoolArray:
        """Return in which of the states, (N, width), a condition holds, (N,)."""
        words = _words(packed)
        return _holds(self._test(condition), words, self._derived(words))

    def _applied(self, words: WordArray, number: int, derived: Mapping[Atom, BoolArray]) -> tuple[BoolArray, WordArray]:
        if number not in self._moves:
            self._moves[number] = self._move(self.steps[number])
        move = self._moves[number]
        able = _holds(move.able, words, derived)
        before = words[:, able]
        derived = {atom: column[able] for atom, column in derived.items()}
        after = before.copy()
        happening = [(_where(effect.when, before, derived), effect) for effect in move.effects]
        for where, effect in happening:
            for word, mask, _ in effect.deletes:
                after[word, where] &= ~mask
        for where, effect in happening:  # what is both deleted and added is true
            for word, mask, _ in effect.adds:
                after[word, where] |= mask
        return able, after

    def _derived(self, words: WordArray) -> dict[Atom, BoolArray]:
        """Compute the derived atoms, stratum by stratum, until nothing more follows."""
        derived = {atom: np.zeros(words.shape[1], dtype=np.bool_) for atom in self.rules.rules}
        for stratum in self.rules.strata:
            changed = True
            while changed:
                changed = False
                for atom in stratum:
                    if atom not in self._derivations:
                        self._derivations[atom] = self._test(self.rules.rules[atom])
                    column = _holds(self._derivations[atom], words, derived)
                    if np.any(column & ~derived[atom]):
                        derived[atom] = column | derived[atom]
                        changed = True
        return derived

    def _move(self, step: Step) -> _Move:
        effects = (
            _Effect(self._test(each.condition), self._bits(each.facts.false), self._bits(each.facts.true))
            for each in step.effects
        )
        return _Move(self._test(step.precondition), tuple(effects))

    def _test(self, condition: Condition) -> _Test:
        own = {atom: value for atom, value in condition.facts.items() if atom in self._position}
        derived = [(atom, value) for atom, value in condition.facts.items() if atom not in self._position]
        choices = [tuple(self._test(part) for part in choice) for choice in condition.choices]
        if any(value and atom not in self.rules.rules for atom, value in derived):
            choices.append(())  # an atom that never is true has to be
        derived = [(atom, value) for atom, value in derived if atom in self.rules.rules]
        return _Test(self._bits(own, Facts(own).true), tuple(derived), tuple(choices))

    def _bits(self, atoms: Collection[Atom], true: Collection[Atom] = ()) -> tuple[_Bits, ...]:
        rows = np.zeros((2, len(self.atoms)), dtype=np.bool_)
        for row, members in zip(rows, (atoms, true), strict=True):
            row[[self._position[atom] for atom in members if atom in self._position]] = True
        words = _words(pack(rows))
        return tuple(_Bits(number, mask, value) for number, (mask, value) in enumerate(words) if mask)


def _holds(test: _Test, words: WordArray, derived: Mapping[Atom, BoolArray]) -> BoolArray:
    parts = [(words[word] & mask) == value for word, mask, value in test.bits]
    result = parts[0] if parts else np.ones(words.shape[1], dtype=np.bool_)
    for part in parts[1:]:
        result &= part
    for atom, wanted in test.derived:
        result &= derived[atom] == wanted
    for choice in test.choices:
        either = np.zeros(words.shape[1], dtype=np.bool_)
        for part in choice:
            either |= _holds(part, words, derived)
        result &= either
    return result


def _where(test: _Test, words: WordArray, derived: Mapping[Atom, BoolArray]) -> slice | npt.NDArray[np.intp]:
    return slice(None) if test == _ALWAYS else np.flatnonzero(_holds(test, words, derived))


def _words(packed: ByteArray) -> WordArray:
    """Return the states' bits as words, (words, N), for rows of bytes, (N, width)."""
    rows, own = packed.shape
    padded = np.zeros((rows, max(8, (own + 7) // 8 * 8)), dtype=np.uint8)
    padded[:, :own] = packed
    return np.ascontiguousarray(padded.view(np.uint64).T)


def _bytes(words: WordArray, own: int) -> ByteArray:
    return np.ascontiguousarray(np.ascontiguousarray(words.T).view(np.uint8)[:, :own])
