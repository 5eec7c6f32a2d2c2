"""The best order in which to open drawers for things whose places are independent of each other and known in
distribution, worked out exactly. It knows nothing of the executive, and is what the executive is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import NamedTuple


class Opened(NamedTuple):
    """What opening the drawers cost, and how many were opened."""

    drawers: int
    cost: float


class BestOrder:
    """The policy of least expected cost.

    Args:
        shares: for each thing that is wanted, how probable each place is; places that are no drawers are in view.
        costs: what it costs to open each drawer, and to close it again.
    """

    def __init__(self, shares: Mapping[str, Mapping[str, float]], costs: Mapping[str, float]) -> None:
        self._shares, self._costs = shares, costs
        self._value = cache(self._valued)

    def played(self, where: Mapping[str, str]) -> Opened:
        """Return what it comes to where each thing is at a place."""
        opened: frozenset[str] = frozenset()
        sought = frozenset(item for item in self._shares if where[item] in self._costs)
        count, cost = 0, 0.0
        while sought:
            drawer = self._choice(opened, sought)
            count, cost, opened = count + 1, cost + self._costs[drawer], opened | {drawer}
            sought = frozenset(item for item in sought if where[item] != drawer)
        return Opened(count, cost)

    def _choice(self, opened: frozenset[str], sought: frozenset[str]) -> str:
        closed = sorted(self._costs.keys() - opened)
        return min(closed, key=lambda drawer: (round(self._if_opened(drawer, opened, sought), 9), drawer))

    def _valued(self, opened: frozenset[str], sought: frozenset[str]) -> float:
        if not sought:
            return 0.0
        return self._if_opened(self._choice(opened, sought), opened, sought)

    def _if_opened(self, drawer: str, opened: frozenset[str], sought: frozenset[str]) -> float:
        total = self._costs[drawer]
        chances = {item: self._chance(item, drawer, opened) for item in sorted(sought)}
        for found in product((False, True), repeat=len(chances)):
            share, left = 1.0, set[str]()
            for (item, chance), is_there in zip(chances.items(), found, strict=True):
                share *= chance if is_there else 1.0 - chance
                left |= set() if is_there else {item}
            if share > 0.0:
                total += share * self._value(opened | {drawer}, frozenset(left))
        return total

    def _chance(self, item: str, drawer: str, opened: frozenset[str]) -> float:
        """How probable it is that a thing is in a drawer, as it is neither in view nor in one that was opened."""
        closed = {each: self._shares[item][each] for each in self._costs.keys() - opened}
        total = sum(closed.values())
        return closed[drawer] / total if total > 0.0 else 0.0
