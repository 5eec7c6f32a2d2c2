"""Mutex groups, and exact inference under them: each atom's marginal probability, and the most probable state.

A mutex group is a set of atoms of which at most one is true, or exactly one. Groups may overlap: the atom that an item
is gripped is in the group of the item's places and in the gripper's. Both results come from one pass over the groups
(dynamic programming along a frontier, a form of bucket elimination, Dechter 1999): each group picks one of its atoms or
none, and the frontier has the later groups that earlier picks have already taken. The time is linear in the number of
groups if they are independent, or overlap as those of the gripper and the items do. If they overlap so much that the
frontier would have more than `MAX_FRONTIER` combinations, the most probable state is found by integer programming
(HiGHS, which proves it optimal), and marginals are computed from the heaviest combinations.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from executive.belief.wide_frontier import WideFrontier
from executive.types import Atom, Condition

MAX_FRONTIER = 2048
"""The most combinations of taken groups that are kept at a time. Up to this many, inference is exact."""

WIDE = 16
"""Combinations from which on arrays are quicker than going from one to the next."""

EMPTY_GROUP = 0.05
"""The prior probability that all atoms of a group are false, in a group that allows that; and that a state breaks what
actions keep and accidents break."""

_NONE = -1


@dataclass(frozen=True, slots=True)
class Group:
    """Atoms of which at most one is true; with `exact`, exactly one.

    Raises:
        ValueError: there is no atom, or one of them twice.
    """

    atoms: tuple[Atom, ...]
    exact: bool = False

    def __post_init__(self) -> None:
        if len(set(self.atoms)) != len(self.atoms) or not self.atoms:
            raise ValueError(
                f"a mutex group needs one or more different atoms, got {', '.join(map(str, self.atoms)) or 'none'}"
            )
        object.__setattr__(self, "atoms", tuple(sorted(self.atoms)))

    @property
    def at_least_one(self) -> Condition:
        """The condition that one or more of the atoms are true."""
        return Condition.any_of(map(Condition.literal, self.atoms))

    def violated(self, true: Collection[Atom]) -> bool:
        """Whether the group forbids that, of its atoms, exactly those in `true` are true."""
        held = sum(atom in true for atom in self.atoms)
        return held > 1 or (self.exact and held == 0)


class Solution(NamedTuple):
    """The result of inference: the logarithm of the sum of all consistent states' weights, each atom's marginal, the
    true atoms of the heaviest state, and the logarithm of that state's weight.

    With `approximate`, the sum and the marginals leave out light states, because groups overlap too much. The heaviest
    state is exact even then.
    """

    log_total: float
    marginal: Mapping[Atom, float]
    best: frozenset[Atom]
    log_best: float
    approximate: bool = False


class _Pick(NamedTuple):
    """A group's choice of an atom (or of none), and the later groups that this takes, as a bit mask."""

    atom: int
    takes: int


class _Edge(NamedTuple):
    """A transition of the frontier by one group's pick: from one combination of taken groups to the next."""

    before: int
    atom: int
    after: int


@dataclass(frozen=True, slots=True, eq=False)
class MutexNetwork:
    """The atoms of a task and their mutex groups. An atom that is in no group is independent of all others.

    Raises:
        ValueError: a group has an atom that is not among `atoms`, or no state is consistent with all groups.
    """

    atoms: tuple[Atom, ...]
    groups: tuple[Group, ...] = ()
    groups_of: Mapping[Atom, tuple[Group, ...]] = field(init=False, repr=False)
    """The groups that each atom is in."""
    _picks_of: tuple[tuple[_Pick, ...], ...] = field(init=False, repr=False)
    _ungrouped: tuple[int, ...] = field(init=False, repr=False)
    _wide: WideFrontier | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "atoms", tuple(sorted(set(self.atoms))))
        position = {atom: index for index, atom in enumerate(self.atoms)}
        groups_of: dict[Atom, tuple[Group, ...]] = dict.fromkeys(self.atoms, ())
        for group in self.groups:
            for atom in group.atoms:
                if atom not in position:
                    raise ValueError(f"a mutex group names {atom}, which is not among the atoms")
                groups_of[atom] += (group,)
        object.__setattr__(self, "groups_of", groups_of)
        members = [frozenset(position[atom] for atom in group.atoms) for group in self.groups]
        turns, seen = [], set[int]()
        order = _order(members)
        turns_of: dict[int, list[int]] = {}
        for turn, number in enumerate(order):
            for index in members[number]:
                turns_of.setdefault(index, []).append(turn)
        for turn, number in enumerate(order):
            picks = [] if self.groups[number].exact else [_Pick(_NONE, 0)]
            for index in sorted(members[number] - seen):
                picks.append(_Pick(index, sum(1 << bit for bit in turns_of[index] if bit > turn)))
            seen |= members[number]
            turns.append(tuple(picks))
        object.__setattr__(self, "_picks_of", tuple(turns))
        object.__setattr__(self, "_ungrouped", tuple(index for index in range(len(self.atoms)) if index not in seen))
        MutexNetwork.solve(self, {})
        if len(self.groups) > 1:
            wide = WideFrontier.of(self._picks, len(self._picks_of), MAX_FRONTIER)
            object.__setattr__(self, "_wide", wide if wide is not None and wide.width >= WIDE else None)

    def violated(self, true: Collection[Atom]) -> tuple[Group, ...]:
        """Return the groups that forbid that exactly these atoms are true."""
        return tuple(group for group in self.groups if group.violated(true))

    def solve(self, weights: Mapping[Atom, float], max_frontier: int = MAX_FRONTIER) -> Solution:
        """Infer marginals and the most probable state of the distribution over consistent states in which a state's
        probability is proportional to the product of exp(weight) over its true atoms: without groups, `weights` are
        log-odds. An atom without a weight has 0. Ties between states are broken by a fixed order.

        Raises:
            ValueError: a weight is not finite, or no state is consistent with all groups.
        """
        weight = [float(weights.get(atom, 0.0)) for atom in self.atoms]
        if not all(map(math.isfinite, weight)):
            raise ValueError("weights have to be finite")
        best: frozenset[int] | None = None
        if self._wide is not None and self._wide.width <= max_frontier:
            log_total, marginal, picked = self._wide.solve(weight)
            true = set(picked)
        else:
            if (swept := self._sweep(weight, max_frontier)) is None:
                best = self._heaviest(weight)
                swept = self._sweep(weight, max_frontier, self._path(best))
                assert swept is not None
            sums, edges = swept
            log_total, marginal = sums[-1][0], self._marginals(weight, sums, edges)
            true = set(self._traced(weight, edges) if best is None else best)
        for atom in self._ungrouped:
            marginal[atom] = _sigmoid(weight[atom])
            log_total += _softplus(weight[atom])
            if weight[atom] > 0:
                true.add(atom)
        return Solution(
            log_total,
            dict(zip(self.atoms, marginal, strict=True)),
            frozenset(self.atoms[atom] for atom in true),
            math.fsum(weight[atom] for atom in true),
            approximate=best is not None,
        )

    def log_total(self, weights: Mapping[Atom, float], max_frontier: int = MAX_FRONTIER) -> float:
        """Return `solve(weights).log_total` alone, which is less work.

        Raises:
            ValueError: as `solve`.
        """
        weight = [float(weights.get(atom, 0.0)) for atom in self.atoms]
        if not all(map(math.isfinite, weight)):
            raise ValueError("weights have to be finite")
        if self._wide is not None and self._wide.width <= max_frontier:
            grouped = self._wide.log_total(weight)
        elif (swept := self._sweep(weight, max_frontier)) is not None:
            grouped = swept[0][-1][0]
        else:
            return self.solve(weights, max_frontier).log_total
        return math.fsum((grouped, *(_softplus(weight[atom]) for atom in self._ungrouped)))

    def _picks(self, turn: int, taken: int) -> Iterator[_Pick]:
        """Yield the picks that a group has when the groups in `taken` are taken."""
        if taken >> turn & 1:
            yield _Pick(_NONE, 0)
        else:
            yield from (pick for pick in self._picks_of[turn] if not pick.takes & taken)

    def _sweep(self, weight: Sequence[float], max_frontier: int, path: Sequence[int] = ()) -> _Swept | None:
        """Return, for each turn, the logarithm of the summed weight of each combination of taken groups, and the
        transitions that lead there. Of more than `max_frontier` combinations only the heaviest and the one on the
        `path` are kept; without a path, the result is None."""
        sums: list[dict[int, float]] = [{0: 0.0}]
        edges: list[list[_Edge]] = []
        for turn in range(len(self._picks_of)):
            arriving: dict[int, list[float]] = {}
            here = []
            for taken, total in sums[-1].items():
                for atom, takes in self._picks(turn, taken):
                    after = taken & ~(1 << turn) | takes
                    arriving.setdefault(after, []).append(total + (0.0 if atom == _NONE else weight[atom]))
                    here.append(_Edge(taken, atom, after))
            there = {after: _log_sum(totals) for after, totals in arriving.items()}
            if not there:
                raise ValueError("no state is consistent with all mutex groups")
            if len(there) > max_frontier:
                if not path:
                    return None
                heaviest = {path[turn], *sorted(there, key=lambda after: -there[after])[:max_frontier]}
                there = {after: total for after, total in there.items() if after in heaviest}
                here = [edge for edge in here if edge.after in heaviest]
            sums.append(there)
            edges.append(here)
        return sums, edges

    def _marginals(
        self, weight: Sequence[float], sums: Sequence[Mapping[int, float]], edges: Sequence[Sequence[_Edge]]
    ) -> list[float]:
        """Return each atom's marginal, by the backward pass over the transitions."""
        share = [0.0] * len(weight)
        total = sums[-1][0]
        rest = {0: 0.0}
        for turn in range(len(edges) - 1, -1, -1):
            leaving: dict[int, list[float]] = {}
            for taken, atom, after in edges[turn]:
                if after in rest:
                    onward = rest[after] + (0.0 if atom == _NONE else weight[atom])
                    leaving.setdefault(taken, []).append(onward)
                    if atom != _NONE:
                        share[atom] += math.exp(sums[turn][taken] + onward - total)
            rest = {taken: _log_sum(onwards) for taken, onwards in leaving.items()}
        return [min(1.0, value) for value in share]

    def _traced(self, weight: Sequence[float], edges: Sequence[Sequence[_Edge]]) -> Iterator[int]:
        """Yield the picks of the heaviest state."""
        best: dict[int, float] = {0: 0.0}
        came: list[dict[int, _Edge]] = []
        for here in edges:
            there: dict[int, float] = {}
            by: dict[int, _Edge] = {}
            for edge in here:
                total = best[edge.before] + (0.0 if edge.atom == _NONE else weight[edge.atom])
                if edge.after not in there or total > there[edge.after]:
                    there[edge.after], by[edge.after] = total, edge
            best = there
            came.append(by)
        taken = 0
        for by in reversed(came):
            edge = by[taken]
            taken = edge.before
            if edge.atom != _NONE:
                yield edge.atom

    def _path(self, true: Collection[int]) -> list[int]:
        """Return the combinations of taken groups along the picks of a state."""
        path, taken = [], 0
        for turn in range(len(self._picks_of)):
            picks = {pick.atom: pick for pick in self._picks(turn, taken)}
            pick = next((picks[atom] for atom in picks if atom in true), picks.get(_NONE))
            assert pick is not None  # the state is consistent
            taken = taken & ~(1 << turn) | pick.takes
            path.append(taken)
        return path

    def _heaviest(self, weight: Sequence[float]) -> frozenset[int]:
        """Find the heaviest state's atoms by integer programming, those in no group left out.

        Raises:
            ValueError: no state is consistent with all groups.
        """
        import numpy as np
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import lil_array

        position = {atom: index for index, atom in enumerate(self.atoms)}
        rows = lil_array((len(self.groups), len(weight)))
        for row, group in enumerate(self.groups):
            for atom in group.atoms:
                rows[row, position[atom]] = 1.0
        least = np.array([float(group.exact) for group in self.groups])
        grouped = np.ones(len(weight))
        grouped[list(self._ungrouped)] = 0.0
        result = milp(
            -np.array(weight) * grouped,
            integrality=np.ones(len(weight)),
            bounds=Bounds(0.0, grouped),
            constraints=LinearConstraint(rows.tocsr(), least, np.ones(len(self.groups))),
            options={"mip_rel_gap": 0.0},
        )
        if result.x is None:
            raise ValueError("no state is consistent with all mutex groups")
        return frozenset(int(atom) for atom in np.flatnonzero(np.round(result.x)))


_Swept: TypeAlias = tuple[list[dict[int, float]], list[list[_Edge]]]


def _order(members: Sequence[frozenset[int]]) -> list[int]:
    """Return an elimination order of the groups that keeps the frontier small: greedily, of the groups before it and
    next to it comes the one after which the fewest remaining groups share an atom with those before. A group that
    overlaps with many, such as a gripper's, so comes after those."""
    groups_of: dict[int, list[int]] = {}
    for number, atoms in enumerate(members):
        for atom in atoms:
            groups_of.setdefault(atom, []).append(number)
    neighbours = [
        {other for atom in atoms for other in groups_of[atom]} - {number} for number, atoms in enumerate(members)
    ]
    order: list[int] = []
    left, frontier, near = set(range(len(members))), set[int](), set[int]()
    while left:
        candidates = near or left
        chosen = min(sorted(candidates), key=lambda number: len(neighbours[number] - frontier) - (number in frontier))
        order.append(chosen)
        left.discard(chosen)
        for other in neighbours[chosen]:
            neighbours[other].discard(chosen)
        frontier = (frontier | neighbours[chosen]) - {chosen}
        near = (near | neighbours[chosen]).union(*(neighbours[other] for other in neighbours[chosen])) - {chosen}
    return order


def _log_sum(values: Sequence[float]) -> float:
    most = max(values)
    return most + math.log(math.fsum(math.exp(value - most) for value in values))


def _softplus(value: float) -> float:
    return max(value, 0.0) + math.log1p(math.exp(-abs(value)))


def _sigmoid(value: float) -> float:
    return 1.0 / (1.0 + math.exp(-value)) if value >= 0 else math.exp(value) / (1.0 + math.exp(value))
