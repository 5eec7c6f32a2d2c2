"""Inference where more is known of states than mutex groups say: constraints of any form, such as what is above a thing
that is in a column is in that column.

Constraints tie atoms together, directly and through the groups that these are in. Each such part of the atoms has its
own states, listed by going through its groups and atoms one after the other and leaving out what cannot become a legal
state any more; over them inference is exact (`executive.belief.state_space`). All other atoms are left to the groups. A
constraint of which the part has too many states is not used, and is among `unused`.

What actions keep and accidents break is a constraint that costs: a state that breaks it is as improbable as an empty
group, and no more.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from executive.belief.mutex_inference import EMPTY_GROUP, MAX_FRONTIER, Group, MutexNetwork, Solution
from executive.belief.packed_actions import BoolArray
from executive.belief.state_space import StateSpace, truths
from executive.types import Atom, Condition, FloatArray

MOST_LISTED = 100_000
"""States of one part up to which they are listed."""

_ROUNDS, _CLOSE = 60, 1e-4
"""How often weights are corrected at most, and how close to the given marginals is close enough."""


class _Part(NamedTuple):
    """Atoms that constraints tie together: their states, and the logarithm of each one's prior weight, (N,)."""

    space: StateSpace
    log_prior: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedNetwork(MutexNetwork):
    """The atoms of a task, their mutex groups, and constraints that every state keeps besides.

    Attributes:
        constraints: what every state keeps.
        costly: what states keep unless there was an accident. That one of a group's atoms is true costs by the group.
        most: states of one part up to which they are listed.
        unused: the constraints whose parts have more.

    Raises:
        ValueError: as `MutexNetwork`, or no state keeps all constraints.
    """

    constraints: tuple[Condition, ...] = ()
    costly: tuple[Condition, ...] = ()
    most: int = MOST_LISTED
    unused: tuple[Condition, ...] = field(init=False, default=(), repr=False)
    _parts: tuple[_Part, ...] = field(init=False, default=(), repr=False)
    _others: MutexNetwork = field(init=False, repr=False)

    def __post_init__(self) -> None:
        groups = tuple(map(self._made_exact, self.groups))
        object.__setattr__(self, "groups", groups)
        MutexNetwork.__post_init__(self)
        said = {part for group in groups for part in group.at_least_one.conjuncts}
        left = list(dict.fromkeys(part for each in self.constraints for part in each.conjuncts if part not in said))
        told = {*said, *left}
        costly = list(dict.fromkeys(part for each in self.costly for part in each.conjuncts if part not in told))
        parts, unused = [], []
        for atoms, own in _tied(left + costly, groups):
            hard = [each for each in own if each not in costly]
            space = listed(atoms, [group for group in groups if not atoms.isdisjoint(group.atoms)], hard, self.most)
            if space is None:
                unused += own
            else:
                parts.append(_Part(space, _log_prior(space, [each for each in own if each in costly])))
        inside = {atom for part in parts for atom in part.space.atoms}
        rest = tuple(group for group in groups if inside.isdisjoint(group.atoms))
        object.__setattr__(self, "_parts", tuple(parts))
        object.__setattr__(self, "unused", tuple(unused))
        object.__setattr__(self, "_others", MutexNetwork(tuple(a for a in self.atoms if a not in inside), rest))

    def _made_exact(self, group: Group) -> Group:
        """A group of which the constraints say that one of its atoms is true."""
        clauses = (part for each in self.constraints for part in each.conjuncts if part.choices or part.facts.true)
        named = (frozenset(part.atoms) for part in clauses if part == Group(tuple(part.atoms)).at_least_one)
        return Group(group.atoms, group.exact or any(atoms <= set(group.atoms) for atoms in named))

    def solve(self, weights: Mapping[Atom, float], max_frontier: int = MAX_FRONTIER) -> Solution:
        found = self._others.solve(weights, max_frontier)
        for space, log_prior in self._parts:
            own = space.solve(weights, log_prior)
            found = Solution(
                found.log_total + own.log_total,
                {**found.marginal, **own.marginal},
                found.best | own.best,
                found.log_best + own.log_best,
                found.approximate,
            )
        return found

    def log_total(self, weights: Mapping[Atom, float], max_frontier: int = MAX_FRONTIER) -> float:
        return self._others.log_total(weights, max_frontier) + sum(
            space.solve(weights, log_prior).log_total for space, log_prior in self._parts
        )

    def reduced(self) -> MutexNetwork:
        """Return the same without the constraints that are not used: a plain network where none is left."""
        hard, costly = (
            tuple(part for each in some for part in each.conjuncts if part not in self.unused)
            for some in (self.constraints, self.costly)
        )
        if not hard and not costly:
            return MutexNetwork(self.atoms, self.groups)
        return ConstrainedNetwork(self.atoms, self.groups, hard, costly)

    def unused_among(self, constraint: Condition) -> bool:
        """Whether a part of the constraint is not used."""
        return any(part in self.unused for part in constraint.conjuncts)

    def fitted(self, weights: Mapping[Atom, float], marginal: Mapping[Atom, float]) -> dict[Atom, float]:
        """Return weights under which the atoms that constraints tie together have the given marginals, from some that
        would do without constraints (maximum entropy, by damped iterative scaling)."""
        found = dict(weights)
        for space, log_prior in self._parts:
            wanted = {atom: _log_odds(marginal[atom]) for atom in space.atoms}
            for _ in range(_ROUNDS):
                now = space.solve(found, log_prior).marginal
                if max(abs(now[atom] - marginal[atom]) for atom in space.atoms) < _CLOSE:
                    break
                for atom in space.atoms:
                    found[atom] += 0.5 * (wanted[atom] - _log_odds(now[atom]))
        return found


def _log_prior(space: StateSpace, costly: Sequence[Condition]) -> FloatArray | None:
    if not costly:
        return None
    price = math.log((1.0 - EMPTY_GROUP) / EMPTY_GROUP)
    broken: FloatArray = np.sum([~space.holds(each) for each in costly], axis=0, dtype=np.float64)
    return -price * broken


def listed(
    atoms: Collection[Atom], groups: Sequence[Group], constraints: Sequence[Condition], most: int = MOST_LISTED
) -> StateSpace | None:
    """List the assignments of the atoms that keep the groups and the constraints; None where they are too many, or
    would be on the way.

    Raises:
        ValueError: there is none.
    """
    order = list(dict.fromkeys([*(atom for group in groups for atom in group.atoms), *sorted(atoms)]))
    position = {atom: index for index, atom in enumerate(order)}
    rows: BoolArray = np.zeros((1, len(order)), dtype=np.bool_)
    told: set[Atom] = set()
    open_groups, open_constraints = list(groups), list(constraints)
    turns: list[tuple[Atom, ...]] = [group.atoms for group in groups]
    turns += [(atom,) for atom in order]
    for turn in turns:
        new = [position[atom] for atom in turn if atom not in told]
        if not new:
            continue
        # Of a group at most one atom is true; an atom alone may be true or not.
        choices = np.zeros((len(new) + 1, len(order)), dtype=np.bool_)
        choices[np.arange(len(new)), new] = True
        if len(rows) * len(choices) > 8 * most:
            return None
        rows = (rows[:, None, :] | choices[None, :, :]).reshape(-1, len(order))
        told.update(turn)
        for group in list(open_groups):
            if told.issuperset(group.atoms):
                open_groups.remove(group)
            true = rows[:, [position[atom] for atom in group.atoms if atom in told]].sum(axis=1)
            rows = rows[(true <= 1) & ((true == 1) | (not group.exact) | (group in open_groups))]
        for constraint in list(open_constraints):
            if told.issuperset(constraint.atoms):
                open_constraints.remove(constraint)
                rows = rows[truths(constraint, order, rows)]
        if len(rows) > most:
            return None
    if not len(rows):
        raise ValueError("no state keeps all constraints")
    known = sorted(order)
    return StateSpace.from_rows(known, rows[:, [position[atom] for atom in known]])


def _tied(constraints: Sequence[Condition], groups: Sequence[Group]) -> list[tuple[set[Atom], list[Condition]]]:
    """Return the parts of the atoms that constraints tie together, with all atoms of their groups."""
    parts: list[tuple[set[Atom], list[Condition]]] = [(set(each.atoms), [each]) for each in constraints]
    for group in groups:
        parts.append((set(group.atoms), []))
    joined: list[tuple[set[Atom], list[Condition]]] = []
    for atoms, own in parts:
        touching = [part for part in joined if not part[0].isdisjoint(atoms)]
        joined = [part for part in joined if part[0].isdisjoint(atoms)]
        more = [each for part in touching for each in part[1]]
        joined.append((atoms.union(*(part[0] for part in touching)), more + own))
    return [part for part in joined if part[1]]


def _log_odds(probability: float) -> float:
    clipped = min(1.0 - 1e-6, max(1e-6, probability))
    return math.log(clipped / (1.0 - clipped))
