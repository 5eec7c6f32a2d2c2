"""Where to look first for what a goal needs and nobody can see.

A *place* is a condition under which atoms can be seen that cannot be seen now, such as that a drawer is open. What is
believed is split into hypotheses, along the atoms that a plan would start from and that are in doubt: for each, a
relaxed plan tells which places have to be looked at anyway. Looking anywhere else is in vain, at the cost of getting
there and of undoing what the goal does not want. The order of least expected cost is found exactly over the hypotheses,
by dynamic programming over what has been looked at and what that told; where there is too much of it, the next place
is the one with the most probability for its cost, which is the best order of search for a single thing (Blackwell).

Costs are those of relaxed plans: what is in the way counts, whether it is in the way twice does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from executive.domain.pddl import Schema
from executive.planning.relaxed import RelaxedPlan, RelaxedTask
from executive.planning.state_listing import MOST_ACTIONS, most_actions, steps
from executive.protocols import Supposing
from executive.types import Atom, Condition, Facts, PlaceToLook, SearchOrder, Task

DOUBT = 0.02
"""What is less probable than this is not weighed."""

MOST_HYPOTHESES = 64
"""The most probable ones are weighed."""

MOST_CASES = 20_000
"""Cases of what was looked at and seen, up to which the order is the best one."""


class _Hypothesis(NamedTuple):
    """A way how things may be: how probable, the most probable state of this kind, the places that have to be looked at
    anyway, and what is seen at each place, by their numbers."""

    probability: float
    state: Facts
    needed: frozenset[int]
    seen: tuple[tuple[bool, ...], ...]


class ExpectedCostSearch:
    """Orders places by the expected cost of what is done in vain (see `executive.protocols.PlaceSearch`)."""

    def __init__(self, schema: Schema) -> None:
        self._schema, self._task = schema, schema.task

    @cached_property
    def _relaxed(self) -> RelaxedTask | None:
        if most_actions(self._schema) > MOST_ACTIONS:
            return None
        return RelaxedTask(steps(self._schema), self._task.derived)

    def order(self, supposing: Supposing, goal: Condition, hidden: frozenset[Atom]) -> SearchOrder:
        """See `executive.protocols.PlaceSearch`."""
        if not hidden or self._relaxed is None:
            return SearchOrder()
        return _Question(self._task, self._relaxed, goal, hidden).answer(supposing)


@dataclass(frozen=True, slots=True)
class _Question:
    """Where to look first for a goal, when these atoms cannot be seen."""

    task: Task
    relaxed: RelaxedTask
    goal: Condition
    hidden: frozenset[Atom]

    def answer(self, supposing: Supposing) -> SearchOrder:
        places, hypotheses = self._hypotheses(supposing)
        wanted = frozenset[int]().union(*(each.needed for each in hypotheses))
        if all(each.needed == wanted for each in hypotheses):
            return SearchOrder(hypotheses=len(hypotheses))
        costs = {}
        for place in sorted(wanted):
            vain = [each for each in hypotheses if place not in each.needed]
            state = max(vain, key=lambda each: each.probability).state if vain else Facts()
            costs[place] = self._in_vain(state, places[place]) if vain else 0.0
        expected = _Expectation(hypotheses, costs).first()
        # Beliefs that should be even differ by rounding, which is to decide nothing.
        order = sorted(expected, key=lambda place: (round(expected[place], 3), round(costs[place], 3), place))
        best = order[0]
        assumed = max((each for each in hypotheses if best in each.needed), key=lambda each: each.probability)
        total = sum(each.probability for each in hypotheses)
        return SearchOrder(
            tuple(
                PlaceToLook(
                    places[place],
                    sum(each.probability for each in hypotheses if place in each.needed) / total,
                    costs[place],
                    expected[place] / total,
                )
                for place in order
            ),
            assumed.state.only(self.hidden),
            len(hypotheses),
        )

    def _hypotheses(self, supposing: Supposing) -> tuple[list[Condition], list[_Hypothesis]]:
        """Split what is believed along what a plan starts from and is in doubt, the most probable first; and the places
        where that can be seen."""
        waiting: list[tuple[float, Facts]] = [(1.0, Facts())]
        leaves: list[tuple[float, Facts, RelaxedPlan]] = []
        sought: set[Atom] = set()
        while waiting:
            waiting.sort(key=lambda each: each[0])
            chance, literals = waiting.pop()
            probability, state = supposing(literals)
            if (plan := self.relaxed.plan(state, self.goal)) is None:
                continue
            starts = {atom for atom, _ in plan.starts_from} & self.hidden
            sought |= starts
            open_ = [atom for atom in starts - literals.keys() if DOUBT < probability[atom] < 1.0 - DOUBT]
            if not open_ or len(leaves) + len(waiting) + 2 > MOST_HYPOTHESES:
                leaves.append((chance, state, plan))
                continue
            atom = min(open_, key=lambda each: (-probability[each], each))
            for value, share in ((False, 1.0 - probability[atom]), (True, probability[atom])):
                waiting.append((chance * share, literals | {atom: value}))
        # What is the same in all of them is no news, and where it is no place to look.
        doubted = sorted(atom for atom in sought if len({state[atom] for _, state, _ in leaves}) > 1)
        places = sorted({self.task.visible[atom] for atom in doubted}, key=str)
        found = []
        for chance, state, plan in leaves:
            starting = {self.task.visible[atom] for atom, _ in plan.starts_from if atom in doubted}
            needed = [n for n, place in enumerate(places) if place in starting or plan.reaches(place)]
            at = ([atom for atom in doubted if self.task.visible[atom] == place] for place in places)
            found.append(_Hypothesis(chance, state, frozenset(needed), tuple(tuple(state[a] for a in x) for x in at)))
        return places, found

    def _complete(self, state: Mapping[Atom, bool]) -> Mapping[Atom, bool]:
        return self.task.derived.complete(state)

    def _in_vain(self, state: Facts, place: Condition) -> float:
        """What it costs to look at a place, and to undo what the goal does not want."""
        there = self.relaxed.plan(state, place)
        before = self.relaxed.plan(state, self.goal)
        if there is None or before is None:
            return 0.0
        after: Mapping[Atom, bool] = state
        for step in there.steps:
            changes = step.changes(self._complete(after))
            after = {**after, **{atom: value for atom, value in changes.items() if value is not None}}
        back = self.relaxed.plan(after, self.goal)
        return there.cost + (0.0 if back is None else max(0.0, back.cost - before.cost))


class _Expectation:
    """What is spent in vain in expectation, over hypotheses (numbers) and places that were looked at."""

    def __init__(self, hypotheses: Sequence[_Hypothesis], costs: Mapping[int, float]) -> None:
        self._hypotheses, self._costs = hypotheses, costs
        self._known: dict[tuple[frozenset[int], frozenset[int]], float] = {}

    def first(self) -> dict[int, float]:
        """For each place, what is spent if it is looked at first and the best order follows, not normalised."""
        every = frozenset(range(len(self._hypotheses)))
        return {place: self._if_looked_at(every, frozenset(), place) for place in self._costs}

    def _best(self, left: frozenset[int], looked: frozenset[int]) -> float:
        places = sorted(frozenset[int]().union(*(self._hypotheses[each].needed for each in left)) - looked)
        if not places:
            return 0.0
        key = left, looked
        if key not in self._known:
            if len(self._known) > MOST_CASES:
                places = [max(places, key=lambda place: (self._ratio(left, place), -place))]
            self._known[key] = min(self._if_looked_at(left, looked, place) for place in places)
        return self._known[key]

    def _ratio(self, left: frozenset[int], place: int) -> float:
        share = sum(self._hypotheses[n].probability for n in left if place in self._hypotheses[n].needed)
        return share / max(self._costs[place], 1e-9)

    def _if_looked_at(self, left: frozenset[int], looked: frozenset[int], place: int) -> float:
        total, parts = 0.0, dict[tuple[bool, ...], set[int]]()
        for number in left:
            hypothesis = self._hypotheses[number]
            if place not in hypothesis.needed:
                total += hypothesis.probability * self._costs[place]
            parts.setdefault(hypothesis.seen[place], set()).add(number)
        return total + sum(self._best(frozenset(part), looked | {place}) for part in parts.values())
