"""On small random tasks there is a plan exactly where an exhaustive search of all states finds one."""

from __future__ import annotations

import random
from itertools import pairwise
from pathlib import Path

import pytest

from executive.core.compare import progress
from executive.domain.pddl import Schema, read_task
from executive.planning.fast_downward import FastDownwardPlanner
from executive.types import Condition, Facts, NoPlan, NoPlanReason, Plan, Step

OBJECTS = ("a", "b", "c")
TASKS, STATES = 120, 2


def _condition(rng: random.Random, terms: list[str], depth: int, derived: bool = True) -> str:
    predicate = rng.choice("pqrd" if derived else "pqr")
    atom = f"({predicate} {' '.join(rng.choice(terms) for _ in range(1 + (predicate == 'r')))})"
    kind = rng.choice(("atom", "atom", "not", "and", "or", "imply", "exists", "forall") if depth else ("atom", "not"))
    if kind in ("atom", "not"):
        return atom if kind == "atom" else f"(not {atom})"
    if kind in ("exists", "forall"):
        return f"({kind} (?v{depth}) {_condition(rng, [*terms, f'?v{depth}'], depth - 1, derived)})"
    return f"({kind} {_condition(rng, terms, depth - 1, derived)} {_condition(rng, terms, depth - 1, derived)})"


def _effect(rng: random.Random, terms: list[str]) -> str:
    atom = f"({rng.choice('pq')} {rng.choice(terms)})"
    atom = atom if rng.random() < 0.6 else f"(not {atom})"
    return f"(when {_condition(rng, terms, 1)} {atom})" if rng.random() < 0.4 else atom


def _task(rng: random.Random, folder: Path) -> Schema:
    # In a chain, where actions change what is further along alone, the atoms of its first object never change.
    is_chain, actions = rng.random() < 0.5, []
    for number in range(rng.randint(1, 3)):
        terms = ["?x", "?y"][: 2 if is_chain else rng.randint(1, 2)]
        needed = _condition(rng, terms, 2)
        needed = f"(and ({rng.choice('pq')} ?x) (r ?x ?y) {needed})" if is_chain else needed
        effects = " ".join(_effect(rng, ["?y"] if is_chain else terms) for _ in range(rng.randint(1, 3)))
        actions.append(
            f"(:action a{number} :parameters ({' '.join(terms)}) :precondition {needed} :effect (and {effects}))"
        )
    init = [f"({name} {one})" for name in "pq" for one in OBJECTS if rng.random() < 0.3]
    pairs = [(one, other) for one in OBJECTS for other in OBJECTS if rng.random() < 0.3]
    init += [f"(r {one} {other})" for one, other in (pairwise(OBJECTS) if is_chain else pairs)]
    init += ["(p a) (q a)"] if is_chain else []
    goal = f"(and {_condition(rng, list(OBJECTS), 1)} {_condition(rng, list(OBJECTS), 1)})"
    (folder / "domain.pddl").write_text(
        "(define (domain d) (:requirements :adl :derived-predicates) (:predicates (p ?x) (q ?x) (r ?x ?y) (d ?x))"
        f" (:derived (d ?x) {_condition(rng, ['?x'], 2, derived=False)}) {' '.join(actions)})"
    )
    (folder / "problem.pddl").write_text(
        f"(define (problem p) (:domain d) (:objects {' '.join(OBJECTS)}) (:init {' '.join(init)}) (:goal {goal}))"
    )
    return read_task(folder / "domain.pddl", folder / "problem.pddl")


def _steps(schema: Schema) -> list[Step]:
    found = []
    for name in schema.actions:
        for args in schema.arguments(name):
            try:
                found.append(schema.ground(name, args))
            except ValueError:  # it can never be carried out
                continue
    return found


def _reachable(schema: Schema, steps: list[Step], state: Facts, goal: Condition) -> bool:
    rules = schema.task.derived
    seen, waiting = {state}, [state]
    while waiting:
        state = waiting.pop()
        known = rules.complete(state)
        if goal.truth(known):
            return True
        for step in steps:
            after = progress(state, step, rules) if step.precondition.truth(known) else state
            if after not in seen:
                seen.add(after)
                waiting.append(after)
    return False


@pytest.mark.parametrize("seed", range(TASKS))
def test_there_is_a_plan_where_a_search_of_all_states_finds_one(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    schema = _task(rng, tmp_path)
    steps, goal, planner = _steps(schema), schema.task.goal, FastDownwardPlanner(schema)
    told = Facts.closed(schema.task.declared, schema.task.atoms)
    drawn = [Facts({atom: rng.random() < 0.5 for atom in schema.task.atoms}) for _ in range(STATES - 1)]
    for state in (told, *drawn):
        answer = planner.plan(state, goal)
        if _reachable(schema, steps, state, goal):
            assert isinstance(answer, Plan)
        else:
            assert isinstance(answer, NoPlan)
            assert answer.reason is NoPlanReason.UNSOLVABLE
