"""Any planner of unified-planning, asked through its public interface in a process of its own."""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from executive.domain.pddl import Schema
from executive.errors import InputError, MissingError, nearest
from executive.planning.goal_order import State, replay
from executive.planning.pddl_text import PddlText
from executive.planning.programs import last_words, run_program
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan, Step

_PROCESS = Path(__file__).with_name("engine_process.py")
_SECONDS_TO_CHECK = 60.0


_EXTRAS = {"enhsp": "executive[numeric]", "enhsp-opt": "executive[numeric]"}
"""Planners that an extra of ours brings."""


class UnifiedPlanner:
    """Plans for one task with an engine of unified-planning, from any of the task's states.

    The engine is asked about PDDL that is written from the task. Its plan is carried out on paper before it is handed
    out. Whether two calls give the same plan is up to the engine.

    Raises:
        InputError: there is no such planner, or the task has a feature that the engine does not take.
        MissingError: unified-planning or the engine's package is not installed.
    """

    def __init__(self, schema: Schema, engine: str, *, timeout: float = 30.0) -> None:
        """`timeout` is the wall time in seconds that one call of `plan` may take."""
        if not timeout > 0:
            raise ValueError(f"timeout: expected seconds above zero, got {timeout}")
        self.name, self._schema, self._timeout = engine, schema, timeout
        self._text = PddlText(schema)
        self._atoms = frozenset(schema.task.atoms)
        if schema.task.derived:
            raise InputError(f"{engine}: derived predicates are beyond unified-planning", key="--planner")
        answer = self._asked(schema.task.declared, schema.task.goal, frozenset(), _SECONDS_TO_CHECK)
        if isinstance(answer, NoPlan):
            raise InputError(f"{engine}: {answer.detail}", key="--planner")
        self._check(answer)

    def warm_up(self) -> None:
        """Nothing: every call starts anew."""

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        """A plan from `state` to `goal`, or why there is none; see `executive.protocols.Planner`.

        Raises:
            ValueError: an atom that the task does not have.
        """
        unknown = (state.keys() | goal.atoms) - self._atoms
        if unknown:
            raise ValueError(f"the task has no atom {', '.join(map(str, sorted(unknown)))}")
        started, limit = time.perf_counter(), min(self._timeout, seconds)
        if goal.truth(State(state.true)):
            return Plan((), 0.0, self.name, 0.0)
        answer = self._asked(state.true, goal, avoid, limit, solve=True)
        found = answer if isinstance(answer, NoPlan) else self._read(answer)
        spent = time.perf_counter() - started
        if isinstance(found, NoPlan):
            detail = found.detail or f"neither a plan nor a proof that there is none within {round(limit, 2):g} s"
            return NoPlan(found.reason, detail, self.name, spent)
        end = replay(state.true, found)
        if end is None or not goal.truth(State(end)):
            return NoPlan(NoPlanReason.CRASHED, "the engine's plan does not reach the goal", self.name, spent)
        return Plan(found, float(sum(step.cost for step in found)), self.name, spent)

    def _asked(
        self, true: frozenset[Atom], goal: Condition, avoid: frozenset[Step], seconds: float, solve: bool = False
    ) -> Mapping[str, Any] | NoPlan:
        """What the engine's process finds out about a state and a goal."""
        if seconds <= 0:
            return NoPlan(NoPlanReason.TIMED_OUT)
        command = [sys.executable, "-P", str(_PROCESS), self.name, *([f"{seconds:g}"] if solve else [])]
        with tempfile.TemporaryDirectory(prefix="executive-plan-") as name:
            folder = Path(name)
            (folder / "domain.pddl").write_text(self._text.domain(avoid=avoid), encoding="ascii")
            (folder / "problem.pddl").write_text(self._text.problem(true, goal, avoid), encoding="ascii")
            try:
                ended = run_program(command, folder, seconds)
                if ended.expired:
                    return NoPlan(NoPlanReason.TIMED_OUT)
                if ended.code:
                    missing = "No module named 'unified_planning'" in ended.said
                    if missing:
                        raise MissingError("unified-planning is not installed", command="pip install unified-planning")
                    return NoPlan(NoPlanReason.CRASHED, f"the engine's process failed: {ended.last_words}")
                answer: Mapping[str, Any] = json.loads((folder / "answer.json").read_text(encoding="utf-8"))
                return answer
            except (OSError, ValueError) as error:
                return NoPlan(NoPlanReason.CRASHED, f"{type(error).__name__}: {error}")

    def _check(self, answer: Mapping[str, Any]) -> None:
        """
        Raises:
            InputError, MissingError: the engine cannot be used for this task.
        """
        installed: Sequence[str] = answer["installed"]
        if self.name not in installed:
            if answer["known"]:
                message = f"planner {self.name} is not installed; installed: {', '.join(installed)}"
                package = _EXTRAS.get(self.name) or f"unified-planning[{self.name.partition('-')[0]}]"
                raise MissingError(message, command=f"pip install {package}")
            raise InputError(f"no planner {self.name!r}; {nearest(self.name, installed)}", key="--planner")
        if lacking := answer.get("lacking"):
            features = ", ".join(feature.lower().replace("_", " ") for feature in lacking)
            raise InputError(f"{self.name} does not take what this task has: {features}", key="--planner")

    def _read(self, answer: Mapping[str, Any]) -> tuple[Step, ...] | NoPlan:
        """The plan in an engine's answer, or what the answer means."""
        if lacking := answer.get("lacking"):
            return NoPlan(NoPlanReason.CRASHED, f"{self.name} does not take {', '.join(lacking).lower()}")
        if "plan" in answer:
            calls = (self._text.action(" ".join(call)) for call in answer["plan"])
            return tuple(self._schema.ground(*call) for call in calls if call is not None)
        status = answer["status"]
        if status == "UNSOLVABLE_PROVEN":
            return NoPlan(NoPlanReason.UNSOLVABLE, "the goal cannot be reached from this state")
        if status == "UNSOLVABLE_INCOMPLETELY":
            return NoPlan(NoPlanReason.TIMED_OUT, "the engine found no plan and proves nothing")
        if status in ("TIMEOUT", "MEMOUT"):
            return NoPlan(NoPlanReason.TIMED_OUT, "the engine ran out of memory" if status == "MEMOUT" else "")
        return NoPlan(
            NoPlanReason.CRASHED, f"the engine ended with {status}: {last_words(answer['said'].splitlines())}"
        )
