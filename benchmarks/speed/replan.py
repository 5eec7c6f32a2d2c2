"""A plan anew against unified-planning's one-shot call from the PDDL text, on the task of six groceries."""

from __future__ import annotations

import random
import resource
import statistics
import time
from collections.abc import Callable

from benchmarks.speed.table import Row
from executive.domain.loader import load_domain
from executive.domain.pddl import Schema
from executive.planning.fast_downward import FastDownwardPlanner
from executive.types import Atom, Facts, Plan


def measure(everything: bool) -> list[Row]:
    domain = load_domain("grocery")
    schema, task = domain.parsed, domain.task
    text = (domain.folder / "domain.pddl").read_text()
    choose = random.Random(0)
    began = time.process_time()
    planner = FastDownwardPlanner(schema)
    states = [_state(schema, choose) for _ in range(20 if everything else 6)]
    planner.plan(states[0], task.goal)
    first = time.process_time() - began
    _one_shot(text, _problem(schema, states[0]))
    ours, theirs, same = [], [], 0
    for state in states:
        mine, length = _spent(lambda state=state: planner.plan(state, task.goal))  # type: ignore[misc]
        other, judged = _spent(lambda state=state: _one_shot(text, _problem(schema, state)))  # type: ignore[misc]
        assert isinstance(length, Plan)
        ours.append(mine)
        theirs.append(other)
        same += len(length.steps) == judged
    ratio = statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    note = f"ratio {ratio:.1f}; {same} of {len(states)} plans are as short; the first one of a task takes {first:.3f} s"
    return [
        Row("replan", statistics.median(ours), statistics.median(theirs), "s", "half", ratio >= 2,
            "unified-planning's one-shot call from PDDL", note),
    ]  # fmt: skip


def _spent(work: Callable[[], object]) -> tuple[float, object]:
    """Seconds of processor time, those of the processes that it starts included, and what it returns."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)

    def clock() -> float:
        return sum(usage.ru_utime + usage.ru_stime for usage in map(resource.getrusage, kinds))

    began = clock()
    result = work()
    return clock() - began, result


def _state(schema: Schema, choose: random.Random) -> Facts:
    """Every item on some table, the gripper empty."""
    on: dict[str, list[Atom]] = {}
    for atom in schema.task.atoms:
        if atom.predicate == "on-table":
            on.setdefault(atom.args[0], []).append(atom)
    true = {choose.choice(atoms) for atoms in on.values()} | {Atom("robot-gripper-empty", ())}
    return Facts.closed(frozenset(true), schema.task.atoms)


def _problem(schema: Schema, state: Facts) -> str:
    def told(atoms: object) -> str:
        return " ".join(f"({' '.join((atom.predicate, *atom.args))})" for atom in sorted(atoms))  # type: ignore[call-overload]

    objects = " ".join(f"{name} - {kind}" for name, kind in schema.typing.objects.items())
    return (
        f"(define (problem anew) (:domain grocery) (:objects {objects}) (:init {told(state.true)})"
        f" (:goal (and {told(schema.task.goal.facts.true)})))"
    )


def _one_shot(domain: str, problem: str) -> int:
    """As its documentation shows it; the length of the plan."""
    from unified_planning.io import PDDLReader
    from unified_planning.shortcuts import OneshotPlanner, get_environment

    get_environment().credits_stream = None
    read = PDDLReader().parse_problem_string(domain, problem)
    with OneshotPlanner(name="fast-downward") as planner:
        return len(planner.solve(read).plan.actions)
