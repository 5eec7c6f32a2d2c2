"""The states that a task can be in, all of them listed, and exact inference over them.

Where the actions leave few states, as six blocks in four columns have 60,480, they are listed: from a legal state on,
whatever the grounded actions lead to, breadth first. A listed state keeps every constraint that there is, whether it
has a name (one of these is true, what is above something is in its column) or not, so nothing has to be found, proved
or declared. What is computed over the states are sums of one weight for each true atom. States are kept as bits, eight
atoms in a byte, so that a byte's 256 sums are worked out once and looked up for all states.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from executive.belief.mutex_inference import Group, MutexNetwork, Solution
from executive.belief.packed_actions import NO_RULES, Actions, BoolArray, ByteArray, pack, unpack, width
from executive.types import Atom, Condition, DerivedRules, FloatArray, Step

IndexArray: TypeAlias = npt.NDArray[np.int64]
_Key = TypeVar("_Key")

MOST_STATES = 1_000_000
"""States up to which they are listed."""

MOST_WORK = 5_000_000
"""Actions times states up to which they are listed: it takes a second or so."""

_NEGLIGIBLE = 1e-16
"""A state's probability that changes no marginal: all states of that kind together have less than 1e-10."""

_BITS = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).astype(np.float64)
"""Row b has the eight bits of the byte b."""


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """Some states over `atoms`, which are sorted: row by row their bits, in ascending order and each once.

    The order says nothing about where the listing began, so that a tie between states is broken the same from anywhere.

    Raises:
        ValueError: there is no state, or the rows are none of that kind.
    """

    atoms: tuple[Atom, ...]
    packed: ByteArray
    rules: DerivedRules = NO_RULES
    """How derived atoms, which no state has, follow from the others."""
    _successors: dict[Step, IndexArray] = field(init=False, repr=False, default_factory=dict)
    _classes: dict[frozenset[Atom], IndexArray] = field(init=False, repr=False, default_factory=dict)
    """What was asked for, as a run does the same steps again and again: no more numbers than `MOST_WORK` each."""

    def __post_init__(self) -> None:
        if list(self.atoms) != sorted(set(self.atoms)):
            raise ValueError("the atoms of a state space are sorted, and each there once")
        if self.packed.ndim != 2 or self.packed.shape[1] != width(len(self.atoms)) or not len(self.packed):
            raise ValueError(f"expected rows of {width(len(self.atoms))} bytes, got {self.packed.shape}")
        if not np.array_equal(_unique(self.packed), self.packed):
            raise ValueError("the states have to be sorted and different")

    @classmethod
    def of(cls, atoms: Iterable[Atom], states: Iterable[Collection[Atom]]) -> StateSpace:
        """Return the space of these states, each given by its true atoms."""
        known = tuple(sorted(set(atoms)))
        position = {atom: index for index, atom in enumerate(known)}
        rows = []
        for state in states:
            row = np.zeros(len(known), dtype=np.bool_)
            row[[position[atom] for atom in state]] = True
            rows.append(row)
        return cls.from_rows(known, np.array(rows, dtype=np.bool_).reshape(len(rows), len(known)))

    @classmethod
    def from_rows(cls, atoms: Sequence[Atom], rows: BoolArray) -> StateSpace:
        """Return the space of these states: (N, atoms), whether each of the sorted atoms is true."""
        return cls(tuple(atoms), _unique(pack(rows)))

    @classmethod
    def reachable(
        cls,
        atoms: Iterable[Atom],
        steps: Sequence[Step] | Actions,
        start: Collection[Atom],
        rules: DerivedRules = NO_RULES,
        most_states: int = MOST_STATES,
        most_work: int = MOST_WORK,
    ) -> StateSpace | None:
        """List the states that `steps`, the task's grounded actions, lead to from the state in which exactly `start` is
        true; None if there are too many of them. Actions that were prepared for these atoms bring their rules along."""
        known = tuple(sorted(set(atoms)))
        actions = steps if isinstance(steps, Actions) else Actions(known, steps, rules)
        if actions.atoms != known:
            raise ValueError("the actions were prepared for other atoms")
        first = np.array([[atom in start for atom in known]], dtype=np.bool_)
        frontier = found = pack(first)
        seen = _keys(found)
        while len(frontier):
            if len(found) > most_states or len(found) * len(actions.steps) > most_work:
                return None
            after = _unique(np.concatenate([*actions.successors(frontier)] or [frontier]))
            keys = _keys(after)
            place = np.minimum(np.searchsorted(seen, keys), len(seen) - 1)
            frontier = after[seen[place] != keys]
            found = _unique(np.concatenate([found, frontier]))
            seen = _keys(found)
        return cls(known, found, actions.rules)

    def __len__(self) -> int:
        return len(self.packed)

    def true(self, state: int) -> frozenset[Atom]:
        """Return the true atoms of the state with that number."""
        return frozenset(self.atoms[index] for index in np.flatnonzero(self._bits(self.packed[state : state + 1])[0]))

    def number(self, true: Collection[Atom]) -> int | None:
        """Return the number of the state in which exactly these atoms are true; None if it is not listed."""
        if not set(true) <= set(self.atoms):
            return None
        key = _keys(pack(np.array([[atom in true for atom in self.atoms]], dtype=np.bool_)))
        found = int(self._find(key)[0])
        return None if found < 0 else found

    def sums(self, weights: Mapping[Atom, float]) -> FloatArray:
        """Return for each state the sum of the weights of its true atoms, (N,); an atom without a weight has 0."""
        padded = np.zeros(8 * self.packed.shape[1])
        padded[: len(self.atoms)] = [weights.get(atom, 0.0) for atom in self.atoms]
        total = np.zeros(len(self))
        for column in range(self.packed.shape[1]):
            own = padded[8 * column : 8 * column + 8]
            if own.any():
                total += (_BITS @ own)[self.packed[:, column]]
        return total

    def marginals(self, probability: FloatArray) -> dict[Atom, float]:
        """Return for each atom the probability that it is true, given each state's, (N,)."""
        kept = probability > _NEGLIGIBLE
        packed, probability = self.packed[kept], probability[kept]
        parts = [
            np.bincount(packed[:, column], weights=probability, minlength=256) @ _BITS
            for column in range(packed.shape[1])
        ]
        values = np.clip(np.concatenate(parts), 0.0, 1.0) if parts else np.zeros(0)
        return dict(zip(self.atoms, values[: len(self.atoms)].tolist(), strict=True))

    def solve(self, weights: Mapping[Atom, float], log_prior: FloatArray | None = None) -> Solution:
        """Infer marginals and the most probable state of the distribution in which a state's probability is
        proportional to its prior times the product of exp(weight) over its true atoms. Without a prior all states are
        equally probable. A tie goes to the state that is listed first.

        Raises:
            ValueError: a weight is not finite.
        """
        if not all(map(math.isfinite, weights.values())):
            raise ValueError("weights have to be finite")
        total = self.sums(weights)
        if log_prior is not None:
            total += log_prior
        best = int(total.argmax())
        likelihood = np.exp(total - total[best])
        whole = float(likelihood.sum())
        return Solution(
            float(total[best]) + math.log(whole),
            self.marginals(likelihood / whole),
            self.true(best),
            float(total[best]),
        )

    def successors(self, step: Step) -> IndexArray:
        """Return the number of the state that `step` leads to from each state, (N,): -1 where its precondition does not
        hold, or where it leads to a state that is not listed."""
        if step in self._successors:
            return self._successors[step]
        (found,) = self.transitions(Actions(self.atoms, [step], self.rules))
        return self._keep(self._successors, step, found)

    def transitions(self, actions: Actions) -> list[IndexArray]:
        """Return the same as `successors` for each of these actions, which were prepared for the same atoms."""
        every = []
        for number in range(len(actions.steps)):
            found = np.full(len(self), -1, dtype=np.int64)
            for first in range(0, len(self), _CHUNK):
                able, after = actions.applied(self.packed[first : first + _CHUNK], number)
                found[first : first + _CHUNK][able] = self._find(_keys(after))
            every.append(found)
        return every

    def holds(self, condition: Condition) -> BoolArray:
        """Return in which states a condition holds, (N,)."""
        actions = Actions(self.atoms, (), self.rules)
        parts = [actions.truth(condition, self.packed[first : first + _CHUNK]) for first in range(0, len(self), _CHUNK)]
        return np.concatenate(parts)

    def classes(self, atoms: Collection[Atom]) -> IndexArray:
        """Return a number for each state, (N,), from 0: the same for states that agree on all atoms but these."""
        key = frozenset(atoms)
        if key not in self._classes:
            kept = np.array([[atom not in key for atom in self.atoms]], dtype=np.bool_)
            _, number = np.unique(_keys(self.packed & pack(kept)), return_inverse=True)
            self._keep(self._classes, key, number.astype(np.int64))
        return self._classes[key]

    def mutex_groups(self) -> tuple[Group, ...]:
        """Return sets of atoms of which no listed state has two (`largest_groups`). They are not exact: after an
        accident a thing may be nowhere."""
        size = len(self.atoms)
        together = np.zeros((size, size), dtype=np.bool_)
        for first in range(0, len(self), _CHUNK):
            rows = self._bits(self.packed[first : first + _CHUNK]).astype(np.float32)
            together |= rows.T @ rows > 0
        return largest_groups(self.atoms, together)

    def always_one(self, group: Group) -> bool:
        """Whether every listed state has one or more of the group's atoms."""
        members = np.array([[atom in group.atoms for atom in self.atoms]], dtype=np.bool_)
        return bool(np.all((self.packed & pack(members)).any(axis=1)))

    def rules_out_more(self, groups: Sequence[Group]) -> bool:
        """Whether the listed states are fewer than those that the mutex groups allow, if groups are taken as exact of
        which every listed state has a true atom."""
        kept = [Group(group.atoms, exact=self.always_one(group)) for group in groups]
        allowed = MutexNetwork(self.atoms, tuple(kept)).solve({})
        return allowed.approximate or allowed.log_total > math.log(len(self)) + 1e-6

    def common(self, known: Mapping[Atom, bool]) -> dict[Atom, bool]:
        """Return the atoms that have the same truth in all listed states in which these have theirs, with that truth;
        nothing if there is no such state. Atoms of other tasks are left out."""
        told = np.array([[atom in known for atom in self.atoms]], dtype=np.bool_)
        true = np.array([[bool(known.get(atom)) for atom in self.atoms]], dtype=np.bool_)
        rows = self.packed[((self.packed & pack(told)) == pack(true)).all(axis=1)]
        if not len(rows):
            return {}
        every, some = (
            unpack(part.reduce(rows, axis=0, keepdims=True), len(self.atoms))[0]
            for part in (np.bitwise_and, np.bitwise_or)
        )
        return {atom: bool(all_) for atom, all_, any_ in zip(self.atoms, every, some, strict=True) if all_ == any_}

    def _keep(self, known: dict[_Key, IndexArray], key: _Key, numbers: IndexArray) -> IndexArray:
        """Keep what was worked out, which nobody may write to."""
        numbers.flags.writeable = False
        if (len(known) + 1) * len(self) > MOST_WORK:
            known.clear()
        known[key] = numbers
        return numbers

    def _bits(self, packed: ByteArray) -> BoolArray:
        return unpack(packed, len(self.atoms))

    def _find(self, keys: _Keys) -> IndexArray:
        """Return the numbers of the states with these keys; -1 for those that are not listed."""
        own = _keys(self.packed)
        place = np.minimum(np.searchsorted(own, keys), len(own) - 1).astype(np.int64)
        return np.where(own[place] == keys, place, -1)


_CHUNK = 65_536
"""States that are worked on at a time."""

_Keys: TypeAlias = npt.NDArray[np.generic]


def largest_groups(atoms: Sequence[Atom], together: BoolArray) -> tuple[Group, ...]:
    """Return sets of atoms of which no two are true together, each about one object: all atoms of a predicate with the
    object in one place, and as many others as go with them.

    Args:
        together: which atoms may be true together, (atoms, atoms); on the diagonal, which may be true at all. It is
            written to.
    """
    possible = together.diagonal().copy()
    np.fill_diagonal(together, False)
    families: dict[str, dict[tuple[str, int], list[int]]] = {}
    for index, atom in enumerate(atoms):
        for place, name in enumerate(atom.args if possible[index] else ()):
            families.setdefault(name, {}).setdefault((atom.predicate, place), []).append(index)
    found: set[frozenset[int]] = set()
    for parts in families.values():
        for family in parts.values():
            members = list(family)
            for other in parts.values():
                more = [index for index in other if index not in members]
                if not together[np.ix_(members + more, members + more)].any():
                    members += more
            if not together[np.ix_(members, members)].any() and len(members) > 1:
                found.add(frozenset(members))
    largest = [group for group in found if not any(group < other for other in found)]
    return tuple(sorted((Group(tuple(atoms[index] for index in group)) for group in largest), key=lambda g: g.atoms))


def truths(condition: Condition, atoms: Sequence[Atom], states: BoolArray) -> BoolArray:
    """Return in which of the states, (N, atoms), a condition holds, (N,)."""
    return Actions(atoms, ()).truth(condition, pack(states))


def _keys(packed: ByteArray) -> _Keys:
    """Return one sortable value for each row of bytes, (N,), in the order of the rows."""
    rows, width = packed.shape
    if width <= 8:
        padded = np.zeros((rows, 8), dtype=np.uint8)
        padded[:, :width] = packed
        return padded.view(">u8").ravel().astype(np.uint64)
    return np.ascontiguousarray(packed).view(f"V{width}").ravel()


def _unique(packed: ByteArray) -> ByteArray:
    _, first = np.unique(_keys(packed), return_index=True)
    return packed[first]
