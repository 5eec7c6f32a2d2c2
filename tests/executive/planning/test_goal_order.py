"""Reordering keeps plans valid, loses no step, and follows the goals' order where steps commute."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.domain.pddl import Schema, read_task
from executive.planning.goal_order import State, by_goals, replay
from executive.types import Atom, Condition, Facts, Step
from tests.executive.domain.pddl.test_reader import PAIRS, instances

SCHEMAS = {name: read_task(*PAIRS[name]) for name in ("sort-all", "tray", "dishes")}
STEPS = {name: instances(schema) for name, schema in SCHEMAS.items()}


def walk(name: str, seed: int, length: int) -> tuple[Facts, list[Step], frozenset[Atom]]:
    """A state, steps that can be carried out from it one after the other, and what is true after them."""
    choose = random.Random(seed)
    start = {atom for atom in SCHEMAS[name].task.atoms if choose.random() < 0.4}
    true: set[Atom] = set(start)
    steps: list[Step] = []
    for _ in range(length):
        possible = [step for step in STEPS[name] if step.precondition.truth(State(true))]
        if not possible:
            break
        steps.append(choose.choice(possible))
        true = (true - steps[-1].unconditional.false) | steps[-1].unconditional.true
    return Facts.closed(start, SCHEMAS[name].task.atoms), steps, frozenset(true)


@given(st.sampled_from(sorted(SCHEMAS)), st.integers(0, 10**6), st.integers(0, 14), st.data())
@settings(max_examples=150, deadline=None)
def test_a_reordered_plan_is_as_valid_and_has_the_same_steps(
    name: str, seed: int, length: int, data: st.DataObject
) -> None:
    state, steps, end = walk(name, seed, length)
    order = data.draw(st.lists(st.sampled_from(SCHEMAS[name].task.atoms), unique=True, max_size=6))
    goal = Condition.of({atom: atom in end for atom in order})
    reordered = by_goals(state.true, steps, goal, order)
    assert Counter(reordered) == Counter(steps)
    after = replay(state.true, reordered)
    assert after is not None
    assert goal.truth(State(after))


def pick_and_place(schema: Schema, *moves: str) -> list[Step]:
    steps = []
    for move in moves:
        item, start, end = move.split()
        steps += [schema.ground("pick", (item, start)), schema.ground("place", (item, end))]
    return steps


@given(st.permutations(["lemon", "bread-loaf", "soda-can", "milk-carton"]), st.permutations(range(4)))
@settings(max_examples=40, deadline=None)
def test_items_are_sorted_in_the_order_of_the_goal_whatever_the_planner_chose(
    order: list[str], found: list[int]
) -> None:
    schema = SCHEMAS["sort-all"]
    state = Facts.parse("robot-gripper-empty", *(f"on-table({item},black-table)" for item in order))
    goals = [Atom("on-table", (item, "white-table")) for item in order]
    moves = [f"{item} black-table white-table" for item in order]
    steps = pick_and_place(schema, *(moves[index] for index in found))
    goal = Condition.of(dict.fromkeys(goals, True))
    assert list(by_goals(state.true, steps, goal, goals)) == pick_and_place(schema, *moves)


def test_what_is_needed_first_stays_first() -> None:
    schema = SCHEMAS["sort-all"]
    state = Facts.parse("robot-gripping(lemon)", "on-table(soda-can,black-table)")
    steps = [
        schema.ground("place", ("lemon", "wood-table")),
        *pick_and_place(schema, "soda-can black-table white-table"),
    ]
    order = [Atom.parse("on-table(soda-can,white-table)"), Atom.parse("on-table(lemon,wood-table)")]
    assert list(by_goals(state.true, steps, Condition.of(dict.fromkeys(order, True)), order)) == steps


@pytest.mark.parametrize("missing", ["robot-gripper-empty", "on-table(lemon,black-table)"])
def test_replay_stops_where_a_precondition_fails(missing: str) -> None:
    steps = pick_and_place(SCHEMAS["sort-all"], "lemon black-table white-table")
    state = Facts.parse("robot-gripper-empty", "on-table(lemon,black-table)")
    assert replay(state.true, steps) == Facts.parse("robot-gripper-empty", "on-table(lemon,white-table)").true
    assert replay(state.without([Atom.parse(missing)]).true, steps) is None
