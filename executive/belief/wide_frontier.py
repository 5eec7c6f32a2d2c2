"""Inference along a frontier with many combinations, in arrays: what leads where is worked out once, and each question
is a few sums over it (see `executive.belief.mutex_inference`, which does the same step by step where it is narrow)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from executive.types import FloatArray

IndexArray: TypeAlias = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """A group's transitions, sorted by where they lead: the combination before, the atom that is picked (-1: none) and
    the combination after; where each combination's transitions start, and the same sorted by where they come from."""

    before: IndexArray
    atom: IndexArray
    after: IndexArray
    starts: IndexArray
    by_before: IndexArray
    starts_before: IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class WideFrontier:
    """The transitions of all groups in turn. Every one of them is part of a consistent state."""

    turns: tuple[_Turn, ...]

    @classmethod
    def of(cls, picks: Callable[[int, int], Iterable[tuple[int, int]]], turns: int, most: int) -> WideFrontier | None:
        """Work out the transitions; None where there are more than `most` combinations at a time.

        Args:
            picks: a group's choices where some groups are taken (bits): the atom, and the groups that it takes.
            turns: how many groups there are.
        """
        every: list[list[tuple[int, int, int]]] = []
        there = {0: None}
        for turn in range(turns):
            here = [
                (taken, atom, taken & ~(1 << turn) | takes) for taken in there for atom, takes in picks(turn, taken)
            ]
            there = dict.fromkeys(after for _, _, after in here)
            if len(there) > most:
                return None
            every.append(here)
        leads = {0}
        found = []
        for here in reversed(every):
            alive = [edge for edge in here if edge[2] in leads]
            leads = {before for before, _, _ in alive}
            found.append(_turn(alive))
        return cls(tuple(reversed(found)))

    @property
    def width(self) -> int:
        """The most combinations at a time."""
        return max((len(turn.starts) for turn in self.turns), default=0)

    def log_total(self, weight: Sequence[float]) -> float:
        """Return the logarithm of the summed weight of all states; `weight` is each atom's."""
        return float(self._sums(np.append(weight, 0.0))[-1][0])

    def solve(self, weight: Sequence[float]) -> tuple[float, list[float], list[int]]:
        """Return the logarithm of the summed weight, each atom's marginal, and the heaviest state's atoms."""
        weights = np.append(weight, 0.0)
        sums = self._sums(weights)
        total = float(sums[-1][0])
        share = np.zeros(len(weights))
        rest = np.zeros(1)
        best = [np.zeros(1)]
        for turn in self.turns:
            best.append(np.maximum.reduceat(best[-1][turn.before] + weights[turn.atom], turn.starts))
        for turn, before in zip(reversed(self.turns), reversed(sums[:-1]), strict=True):
            onward = rest[turn.after] + weights[turn.atom]
            chance = np.exp(before[turn.before] + onward - total)
            share += np.bincount(turn.atom % len(weights), weights=chance, minlength=len(weights))
            rest = _log_sums(onward[turn.by_before], turn.starts_before, turn.before[turn.by_before])
        return total, np.minimum(1.0, share[:-1]).tolist(), self._traced(weights, best)

    def _sums(self, weights: FloatArray) -> list[FloatArray]:
        sums = [np.zeros(1)]
        for turn in self.turns:
            sums.append(_log_sums(sums[-1][turn.before] + weights[turn.atom], turn.starts, turn.after))
        return sums

    def _traced(self, weights: FloatArray, best: Sequence[FloatArray]) -> list[int]:
        """Return the picks of the heaviest state; of several, the transition that comes first."""
        found, state = [], 0
        for turn, before in zip(reversed(self.turns), reversed(best[:-1]), strict=True):
            first = int(turn.starts[state])
            last = int(turn.starts[state + 1]) if state + 1 < len(turn.starts) else len(turn.atom)
            edge = first + int((before[turn.before[first:last]] + weights[turn.atom[first:last]]).argmax())
            state = int(turn.before[edge])
            if turn.atom[edge] >= 0:
                found.append(int(turn.atom[edge]))
        return found


def _turn(edges: Sequence[tuple[int, int, int]]) -> _Turn:
    kept = np.array([atom for _, atom, _ in edges], dtype=np.int64)
    before, after = (_numbered([edge[place] for edge in edges]) for place in (0, 2))
    order = np.argsort(after, kind="stable")
    before, kept, after = before[order], kept[order], after[order]
    back = np.argsort(before, kind="stable")
    return _Turn(before, kept, after, _starts(after), back.astype(np.int64), _starts(before[back]))


def _numbered(combinations: Sequence[int]) -> IndexArray:
    """Return the place of each combination among all of these, in order. They may have more bits than an array's."""
    place = {each: number for number, each in enumerate(sorted(set(combinations)))}
    return np.array([place[each] for each in combinations], dtype=np.int64)


def _starts(sorted_: IndexArray) -> IndexArray:
    return np.flatnonzero(np.diff(sorted_, prepend=-1)).astype(np.int64)


def _log_sums(values: FloatArray, starts: IndexArray, run: IndexArray) -> FloatArray:
    """Return the logarithm of the sum of exp of each run of values; `run` is the number of each value's."""
    most = np.maximum.reduceat(values, starts)
    result: FloatArray = most + np.log(np.add.reduceat(np.exp(values - most[run]), starts))
    return result
