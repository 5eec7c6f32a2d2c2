"""Plans in which nothing that was ever so ceases to be: the relaxation that planners' heuristics use.

A relaxed plan is found in milliseconds, and says well enough what a real one needs: which literals of the present state
it starts from, and what it brings about on its way. Costs are those of the additive heuristic (Bonet and Geffner 2001),
plans those of FF's (Hoffmann and Nebel 2001), over literals, so that what has to be false is a fact like any other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from executive.types import Atom, Condition, DerivedRules, Step

Literal: TypeAlias = "tuple[Atom, bool]"


class _Operator(NamedTuple):
    """What has to hold, what then comes about, at which cost, and by which step: none, where an axiom says so."""

    needs: Condition
    gives: tuple[Literal, ...]
    cost: float
    step: Step | None


@dataclass(frozen=True, slots=True)
class RelaxedPlan:
    """A relaxed plan: its steps in an order in which they can be carried out, their costs together, the literals of the
    first state that it starts from, and all literals that hold at some time."""

    steps: tuple[Step, ...]
    cost: float
    starts_from: frozenset[Literal]
    reached: frozenset[Literal]

    def reaches(self, condition: Condition) -> bool:
        """Whether the condition holds once all of it is carried out, as if nothing ceased to be."""
        return all((atom, value) in self.reached for atom, value in condition.facts.items()) and all(
            any(map(self.reaches, choice)) for choice in condition.choices
        )


class RelaxedTask:
    """The grounded actions of a task, and how derived atoms follow from others."""

    def __init__(self, steps: Iterable[Step], rules: DerivedRules) -> None:
        self._derived = frozenset(rules.rules)
        operators = [
            _Operator(step.precondition & effect.condition, tuple(effect.facts.items()), step.cost, step)
            for step in steps
            for effect in step.effects
        ]
        operators += [_Operator(rule, ((atom, True),), 0.0, None) for atom, rule in rules.rules.items()]
        self._operators = operators
        self._users: dict[Literal, list[int]] = {}
        for number, operator in enumerate(operators):
            for literal in _literals(operator.needs):
                self._users.setdefault(literal, []).append(number)
        self._free = [number for number, operator in enumerate(operators) if not operator.needs.atoms]

    def plan(self, state: Mapping[Atom, bool], goal: Condition) -> RelaxedPlan | None:
        """Return a relaxed plan from a complete state to a goal; None where even that is not to be had."""
        first = {(atom, value) for atom, value in state.items()}
        # What is derived and not known to follow yet is false, as axioms say.
        first |= {(atom, False) for atom in self._derived}
        cost: dict[Literal, float] = dict.fromkeys(first, 0.0)
        by: dict[Literal, int] = {}
        waiting = dict.fromkeys([*self._free, *(n for each in sorted(first) for n in self._users.get(each, ()))])
        while waiting:
            number = next(iter(waiting))
            del waiting[number]
            operator = self._operators[number]
            total = operator.cost + _cost(operator.needs, cost)
            for literal in operator.gives if total < math.inf else ():
                if total < cost.get(literal, math.inf) - 1e-9:
                    cost[literal], by[literal] = total, number
                    waiting.update(dict.fromkeys(self._users.get(literal, ())))
        if _cost(goal, cost) == math.inf:
            return None
        return self._extracted(goal, cost, by, first)

    def _extracted(
        self, goal: Condition, cost: Mapping[Literal, float], by: Mapping[Literal, int], first: set[Literal]
    ) -> RelaxedPlan:
        needed, chosen = dict[Literal, None](), dict[int, None]()

        def support(condition: Condition) -> None:
            for literal in _cheapest(condition, cost):
                if literal not in needed:
                    needed[literal] = None
                    if (number := by.get(literal)) is not None:
                        support(self._operators[number].needs)
                        chosen[number] = None

        support(goal)
        operators = [self._operators[number] for number in chosen]
        steps = tuple(dict.fromkeys(each.step for each in operators if each.step is not None))
        reached = first | {literal for each in operators for literal in each.gives}
        starts = frozenset(literal for literal in needed if literal not in by)
        return RelaxedPlan(steps, sum(step.cost for step in steps), starts, frozenset(reached))


def _cost(condition: Condition, cost: Mapping[Literal, float]) -> float:
    """What a condition costs: the sum over its parts, and the least over alternatives."""
    total = 0.0
    for literal in condition.facts.items():
        total += cost.get(literal, math.inf)
    for choice in condition.choices:
        total += min((_cost(part, cost) for part in choice), default=math.inf)
    return total


def _cheapest(condition: Condition, cost: Mapping[Literal, float]) -> Iterator[Literal]:
    """Yield the literals by which a condition comes about at the least cost."""
    yield from condition.facts.items()
    for choice in condition.choices:
        yield from _cheapest(min(choice, key=lambda part: (_cost(part, cost), str(part))), cost)


def _literals(condition: Condition) -> Iterator[Literal]:
    yield from condition.facts.items()
    parts: Sequence[Condition] = [part for choice in condition.choices for part in choice]
    for part in parts:
        yield from _literals(part)
