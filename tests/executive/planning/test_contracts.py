"""Both planners keep the contract that their stand-in in other tests keeps, too."""

from __future__ import annotations

from executive.domain.pddl import read_task
from executive.planning.fast_downward import FastDownwardPlanner
from executive.planning.unified_planning import UnifiedPlanner
from executive.protocols import Planner
from executive.types import Condition, Facts
from tests.contracts import PlannerContract
from tests.executive.domain.pddl.test_reader import PAIRS

SCHEMA = read_task(*PAIRS["breakfast"])
HERE = Facts.parse(
    "robot-gripper-empty",
    "on-table(milk-carton,black-table)",
    "on-table(cereal-box,wood-table)",
    "on-table(lemon,white-table)",
)


class _Breakfast(PlannerContract):
    def solvable(self) -> tuple[Facts, Condition]:
        return Facts.closed(HERE.true, SCHEMA.task.atoms), SCHEMA.task.goal

    def unsolvable(self) -> tuple[Facts, Condition]:
        nowhere = [atom for atom in HERE.true if "milk-carton" not in atom.args]
        return Facts.closed(nowhere, SCHEMA.task.atoms), SCHEMA.task.goal


class TestFastDownwardPlanner(_Breakfast):
    def make(self) -> Planner:
        return FastDownwardPlanner(SCHEMA)


class TestUnifiedPlanner(_Breakfast):
    def make(self) -> Planner:
        return UnifiedPlanner(SCHEMA, "fast-downward-opt", timeout=300.0)  # however busy the machine is
