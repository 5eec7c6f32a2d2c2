"""A plan anew: on the task of six groceries against unified-planning's one-shot call from the PDDL text, and on one of
tens of thousands of actions against the same search of the same file by the engine alone."""

from __future__ import annotations

import random
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.speed.table import Row
from executive.domain.loader import load_domain
from executive.domain.pddl import Schema, read_task
from executive.planning.fast_downward import EVALUATORS, GREEDY, LAMA, FastDownwardPlanner
from executive.planning.programs import SasFile, find_search
from executive.planning.sas_task import GroundedTask
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
        large(3 if everything else 1),
    ]  # fmt: skip


PARCELS = """(define (domain parcels) (:requirements :typing) (:types city parcel van)
  (:predicates (at ?p - parcel ?c - city) (in ?p - parcel ?v - van) (van-at ?v - van ?c - city))
  (:action load :parameters (?p - parcel ?v - van ?c - city)
    :precondition (and (at ?p ?c) (van-at ?v ?c)) :effect (and (in ?p ?v) (not (at ?p ?c))))
  (:action unload :parameters (?p - parcel ?v - van ?c - city)
    :precondition (and (in ?p ?v) (van-at ?v ?c)) :effect (and (at ?p ?c) (not (in ?p ?v))))
  (:action drive :parameters (?v - van ?a ?b - city)
    :precondition (van-at ?v ?a) :effect (and (van-at ?v ?b) (not (van-at ?v ?a)))))"""


def large(rounds: int) -> Row:
    """A plan anew for parcels, vans and cities."""
    choose = random.Random(0)
    parcels, vans, cities = ([f"{name}{n}" for n in range(count)] for name, count in (("p", 60), ("v", 6), ("c", 40)))
    at = [f"(at {parcel} {choose.choice(cities)})" for parcel in parcels]
    at += [f"(van-at {van} {choose.choice(cities)})" for van in vans]
    goal = " ".join(f"(at {parcel} {choose.choice(cities)})" for parcel in parcels)
    with tempfile.TemporaryDirectory() as name:
        domain, problem = Path(name) / "domain.pddl", Path(name) / "problem.pddl"
        domain.write_text(PARCELS)
        objects = f"{' '.join(parcels)} - parcel {' '.join(vans)} - van {' '.join(cities)} - city"
        problem.write_text(
            f"(define (problem many) (:domain parcels) (:objects {objects})"
            f" (:init {' '.join(at)}) (:goal (and {goal})))"
        )
        schema = read_task(domain, problem)
    task, true = schema.task, schema.task.declared
    planner, grounded = FastDownwardPlanner(schema, timeout=300.0), GroundedTask(schema)
    grounded.ground(lambda: False)
    text = grounded.text(true, task.goal, schema.goals)
    assert text is not None
    state = Facts.closed(true, task.atoms)
    first, found = _spent(lambda: planner.plan(state, task.goal))
    assert isinstance(found, Plan), found
    search = next(way for way in (GREEDY, LAMA) if found.planner.endswith(way.name))
    ours, alone = [], []
    with SasFile(find_search(), text) as file:
        for _ in range(rounds):
            ours.append(_spent(lambda: planner.plan(state, task.goal))[0])
            alone.append(_spent(lambda: file.search(search.text.format(**EVALUATORS), 300.0))[0])
    mine, other = statistics.median(ours), statistics.median(alone)
    note = f"{len(task.atoms):,} fluents, {len(grounded):,} actions, {found.planner}; the first one takes {first:.1f} s"
    return Row("replan, large", mine, other, "s", "half", mine <= 2 * other, "the engine alone, same file", note)


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
