"""Inference where more is known of states than mutex groups say: constraints of any form, such as what is above a thing
that is in a column is in that column.

Constraints tie atoms together, directly and through the groups that these are in. Each such part of the atoms has its
own states, listed by going through its groups and atoms one after the other and leaving out what cannot become a legal
state any more; over them inference is exact (`executive.belief.state_space`). All other atoms are left to the groups. A
constraint of which the part has too many states is not used, and is among `unused`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from executive.belief.mutex_inference import MAX_FRONTIER, Group, MutexNetwork, Solution
from executive.belief.packed_actions import BoolArray
from executive.belief.state_space import StateSpace, truths
from executive.types import Atom, Condition

MOST_LISTED = 100_000
"""States of one part up to which they are listed."""

_ROUNDS, _CLOSE = 60, 1e-4
"""How often weights are corrected at most, and how close to the given marginals is close enough."""


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedNetwork(MutexNetwork):
    """The atoms of a task, their mutex groups, and constraints that every state keeps besides.

    Raises:
        ValueError: as `MutexNetwork`, or no state keeps all constraints.
    """

    constraints: tuple[Condition, ...] = ()
    unused: tuple[Condition, ...] = field(init=False, default=(), repr=False)
    _parts: tuple[StateSpace, ...] = field(init=False, default=(), repr=False)
    _others: MutexNetwork = field(init=False, repr=False)

    def __post_init__(self) -> None:
        groups = tuple(map(self._made_exact, self.groups))
        object.__setattr__(self, "groups", groups)
        MutexNetwork.__post_init__(self)
        said = {part for group in groups if group.exact for part in _at_least_one(group)}
        left = [part for each in self.constraints for part in each.conjuncts if part not in said]
        parts, unused = [], []
        for atoms, own in _tied(left, groups):
            space = listed(atoms, [group for group in groups if not atoms.isdisjoint(group.atoms)], own)
            if space is None:
                unused += own
            else:
                parts.append(space)
        inside = {atom for space in parts for atom in space.atoms}
        rest = tuple(group for group in groups if inside.isdisjoint(group.atoms))
        object.__setattr__(self, "_parts", tuple(parts))
        object.__setattr__(self, "unused", tuple(unused))
        object.__setattr__(self, "_others", MutexNetwork(tuple(a for a in self.atoms if a not in inside), rest))

    def _made_exact(self, group: Group) -> Group:
        """A group of which the constraints say that one of its atoms is true."""
        clauses = (part for each in self.constraints for part in each.conjuncts if part.choices or part.facts.true)
        named = (frozenset(part.atoms) for part in clauses if part in set(_at_least_one(Group(tuple(part.atoms)))))
        return Group(group.atoms, group.exact or any(atoms <= set(group.atoms) for atoms in named))

    def solve(self, weights: Mapping[Atom, float], max_frontier: int = MAX_FRONTIER) -> Solution:
        found = self._others.solve(weights, max_frontier)
        for space in self._parts:
            own = space.solve(weights)
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
            space.solve(weights).log_total for space in self._parts
        )

    def unused_among(self, constraint: Condition) -> bool:
        """Whether a part of the constraint is not used."""
        return any(part in self.unused for part in constraint.conjuncts)

    def fitted(self, weights: Mapping[Atom, float], marginal: Mapping[Atom, float]) -> dict[Atom, float]:
        """Return weights under which the atoms that constraints tie together have the given marginals, from some that
        would do without constraints (maximum entropy, by damped iterative scaling)."""
        found = dict(weights)
        for space in self._parts:
            wanted = {atom: _log_odds(marginal[atom]) for atom in space.atoms}
            for _ in range(_ROUNDS):
                now = space.solve(found).marginal
                if max(abs(now[atom] - marginal[atom]) for atom in space.atoms) < _CLOSE:
                    break
                for atom in space.atoms:
                    found[atom] += 0.5 * (wanted[atom] - _log_odds(now[atom]))
        return found


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


def _at_least_one(group: Group) -> Iterable[Condition]:
    """Yield the parts of the condition that one of the group's atoms is true."""
    return Condition.any_of(map(Condition.literal, group.atoms)).conjuncts


def _log_odds(probability: float) -> float:
    clipped = min(1.0 - 1e-6, max(1e-6, probability))
    return math.log(clipped / (1.0 - clipped))
