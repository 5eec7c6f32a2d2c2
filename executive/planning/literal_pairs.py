"""What every reachable state keeps, proved from the actions alone: which two literals never hold together.

From a complete initial state on, pairs of literals are added that an action may bring about from pairs there are, until
nothing more follows (the h2 heuristic's fixpoint, Haslum and Geffner 2000, over literals of both signs, as in Alcazar
and Torralba 2015). What is left out is impossible: that two atoms are true is a mutex, that one is true and another one
false an implication. It errs to one side alone: disjunctions in preconditions and derived atoms are taken as satisfied,
and of effects under conditions all that go together may come about.

Of a set of atoms at least one is true if one is so initially, and each action that may delete one surely adds another.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from executive.belief.mutex_inference import Group
from executive.belief.packed_actions import BoolArray
from executive.belief.state_space import largest_groups
from executive.types import Atom, Condition, Step

MOST_LITERALS = 1_000
"""Literals up to which pairs are looked at."""

MOST_EFFECTS = 20_000
"""Pairs of effects of the same action, over all actions, up to which it is done: a second or two."""

Literals: TypeAlias = npt.NDArray[np.intp]


class _Effect(NamedTuple):
    """What an action makes so, and the literals that have to hold before: the precondition's and its own."""

    needs: Literals
    own: Literals
    makes: Literals
    is_literal: bool
    """Whether its condition is these literals alone, so that it comes about where they hold."""


@dataclass(frozen=True, slots=True, eq=False)
class LiteralPairs:
    """Which pairs of literals some reachable state may have: atom i is true (i), or false (number of atoms + i)."""

    atoms: tuple[Atom, ...]
    possible: BoolArray
    _moves: tuple[tuple[_Effect, ...], ...]
    _start: frozenset[Atom]

    @classmethod
    def reachable(cls, atoms: Iterable[Atom], steps: Sequence[Step], start: Collection[Atom]) -> LiteralPairs | None:
        """Work the pairs out from the state in which exactly `start` is true; None where they are too many."""
        known = tuple(sorted(set(atoms)))
        moves = tuple(_effects(step, known) for step in steps)
        if 2 * len(known) > MOST_LITERALS or sum(len(effects) ** 2 for effects in moves) > MOST_EFFECTS:
            return None
        true = np.array([atom in start for atom in known], dtype=np.bool_)
        first = np.concatenate([true, ~true])
        found = cls(known, np.outer(first, first), moves, frozenset(start))
        depends = [found._depends(effects) for effects in moves]
        changed = np.ones(len(first), dtype=np.bool_)
        while changed.any():
            before = found.possible.copy()
            for effects, rows in zip(moves, depends, strict=True):
                if changed[rows].any() or not len(rows):
                    found._apply(effects)
            changed = (before != found.possible).any(axis=0)
        return found

    def impossible(self, one: Atom, value: bool, other: Atom, other_value: bool) -> bool:
        """Whether no reachable state has both literals."""
        place = {atom: index for index, atom in enumerate(self.atoms)}
        size = len(self.atoms)
        return not self.possible[place[one] + size * (not value), place[other] + size * (not other_value)]

    @property
    def never(self) -> frozenset[Atom]:
        """The atoms that are true in no reachable state."""
        ever = self.possible.diagonal()[: len(self.atoms)]
        return frozenset(atom for atom, may_be in zip(self.atoms, ever, strict=True) if not may_be)

    def groups(self) -> tuple[Group, ...]:
        """Return sets of atoms of which at most one is ever true, each about one object; exact where one always is."""
        size = len(self.atoms)
        together = self.possible[:size, :size].copy()
        return tuple(Group(group.atoms, self.always_one(group.atoms)) for group in largest_groups(self.atoms, together))

    def always_one(self, atoms: Collection[Atom]) -> bool:
        """Whether it is proved that in every reachable state one or more of the atoms are true."""
        if self._start.isdisjoint(atoms):
            return False
        place = {atom: index for index, atom in enumerate(self.atoms)}
        true = np.array([place[atom] for atom in atoms], dtype=np.intp)
        false = true + len(self.atoms)
        for effects in self._moves:
            for effect in effects:
                deleted = np.intersect1d(effect.makes, false)
                if not len(deleted) or not self._compatible(effect.needs):
                    continue
                # Whichever atom it is: the action finds it true, and surely makes another one true.
                for literal in deleted.tolist():
                    needs = np.union1d(effect.needs, [literal - len(self.atoms)])
                    if self._compatible(needs) and not any(
                        other.is_literal and np.isin(other.makes, true).any() and self._sure(other.own, needs)
                        for other in effects
                    ):
                        return False
        return True

    def implications(self, groups: Iterable[Group]) -> Iterator[Condition]:
        """Yield clauses of two literals that every reachable state keeps and that the groups do not say: an atom is
        only true where another one is, or one of the two is true."""
        size = len(self.atoms)
        ever = self.possible.diagonal()
        said = {frozenset(pair) for group in groups for pair in itertools.combinations(group.atoms, 2)}
        for one, other in zip(*np.nonzero(np.triu(~self.possible, 1)), strict=True):
            atoms = self.atoms[one % size], self.atoms[other % size]
            if atoms[0] == atoms[1] or not (ever[one] and ever[other]):
                continue
            values = bool(one < size), bool(other < size)
            always = [ever[literal] and not ever[(literal + size) % (2 * size)] for literal in (one, other)]
            if any(always) or (all(values) and frozenset(atoms) in said):
                continue
            yield Condition.any_of(Condition.literal(a, not v) for a, v in zip(atoms, values, strict=True))

    def _depends(self, effects: Sequence[_Effect]) -> Literals:
        """Return the literals on whose pairs it depends what the action may lead to."""
        size, literals = len(self.atoms), [effect.needs for effect in effects]
        literals += [(effect.own + size) % (2 * size) for effect in effects]
        return np.unique(np.concatenate(literals)).astype(np.intp) if literals else np.zeros(0, dtype=np.intp)

    def _compatible(self, literals: Literals, others: Literals | None = None) -> bool:
        return bool(self.possible[np.ix_(literals, literals if others is None else others)].all())

    def _sure(self, wanted: Literals, given: Literals) -> bool:
        """Whether literals hold in every reachable state that has the given ones."""
        opposite = (wanted + len(self.atoms)) % (2 * len(self.atoms))
        return bool((np.isin(wanted, given) | ~self.possible[np.ix_(given, opposite)].all(axis=0)).all())

    def _apply(self, effects: Sequence[_Effect]) -> None:
        """Add the pairs that an action may bring about."""
        possible, size = self.possible, len(self.atoms)
        able = [effect for effect in effects if self._compatible(effect.needs)]
        for number, effect in enumerate(able):
            for other in able[number:]:
                if other is effect or self._compatible(effect.needs, other.needs):
                    possible[np.ix_(effect.makes, other.makes)] = True
                    possible[np.ix_(other.makes, effect.makes)] = True
            # What stays as it is: what may hold with the effect's needs, and is not surely changed then.
            stays = np.asarray(np.logical_and.reduce(possible[effect.needs], axis=0) & possible.diagonal())
            with_needs = np.array(stays)
            for other in (other for other in able if other.is_literal):
                opposite = (other.own + size) % (2 * size)
                given = np.isin(other.own, effect.needs) | ~with_needs[opposite]
                sure = (given[None, :] | ~possible[:, opposite]).all(axis=1)
                changes = (other.makes + size) % (2 * size)
                stays[changes] &= ~sure[changes]
            possible[np.ix_(effect.makes, stays)] = True
            possible[np.ix_(stays, effect.makes)] = True
        possible[np.arange(2 * size), (np.arange(2 * size) + size) % (2 * size)] = False


def _effects(step: Step, atoms: Sequence[Atom]) -> tuple[_Effect, ...]:
    """Return an action's effects; where it makes an atom true in any case, none deletes it."""
    place = {atom: index for index, atom in enumerate(atoms)}

    def literals(facts: Mapping[Atom, bool]) -> Literals:
        found = [place[atom] + len(atoms) * (not value) for atom, value in facts.items() if atom in place]
        return np.array(sorted(found), dtype=np.intp)

    needs = literals(step.precondition.facts)
    added = step.unconditional.true
    found = []
    for effect in step.effects:
        own = literals(effect.condition.facts)
        told = {atom: value for atom, value in effect.facts.items() if value or atom not in added}
        is_literal = not effect.condition.choices and effect.condition.facts.keys() <= place.keys()
        found.append(_Effect(np.union1d(needs, own).astype(np.intp), own, literals(told), is_literal))
    return tuple(found)
