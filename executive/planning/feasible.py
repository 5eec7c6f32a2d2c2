"""A planner for a task of which some steps are known to be infeasible."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from executive.protocols import Planner
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan, Step


class FeasiblePlanner:
    """Plans without infeasible steps, and explains why a goal that needs them is unsolvable."""

    def __init__(self, planner: Planner, infeasible: frozenset[Step], why: Mapping[Atom, str]) -> None:
        """`why` says of each atom that only infeasible steps make true what is in the way."""
        self._planner, self._infeasible, self._why = planner, infeasible, why

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        """See `executive.protocols.Planner`."""
        result = self._planner.plan(state, goal, avoid | self._infeasible, seconds)
        why = [self._why[atom] for atom in sorted(goal.facts.true & self._why.keys()) if not state.get(atom)]
        if isinstance(result, NoPlan) and result.reason is NoPlanReason.UNSOLVABLE and why:
            return replace(result, detail="; ".join(why))
        return result
