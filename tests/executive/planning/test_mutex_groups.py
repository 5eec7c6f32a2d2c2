"""Mutex groups from the translator, held against all states that can be reached."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.belief.mutex_inference import Group
from executive.domain.loader import load_domain
from executive.domain.pddl import Schema, read_task
from executive.errors import MissingError
from executive.planning import mutex_groups, programs, translation
from executive.planning.mutex_groups import Mutexes, find_mutexes
from executive.planning.pddl_text import PddlText
from executive.planning.programs import Ended
from executive.types import Atom, Step

ROOT = Path(__file__).parents[3]
TRAY = ROOT / "tests" / "domains" / "tray"
PDDL = ROOT / "tests" / "data" / "pddl"


def instances(schema: Schema) -> list[Step]:
    found = []
    for name, action in schema.actions.items():
        for args in schema.typing.tuples([kind for _, kind in action.parameters]):
            try:
                found.append(schema.ground(name, args))
            except ValueError:  # it contradicts itself
                continue
    return found


def reachable(schema: Schema, start: frozenset[Atom], most: int = 20_000) -> set[frozenset[Atom]]:
    steps, seen, frontier = instances(schema), {start}, [start]
    while frontier:
        state = frontier.pop()
        for step in steps:
            if all((atom in state) is value for atom, value in step.precondition.facts.items()):
                after = (state - step.unconditional.false) | step.unconditional.true
                if after not in seen:
                    seen.add(after)
                    frontier.append(after)
        assert len(seen) < most
    return seen


def holds(found: Mutexes, states: Iterable[frozenset[Atom]]) -> None:
    for state in states:
        for group in found.groups:
            assert not group.violated(state), (group, state)


def pairs(groups: Iterable[Group]) -> set[frozenset[Atom]]:
    return {frozenset(pair) for group in groups for pair in combinations(group.atoms, 2)}


def on(item: str) -> list[str]:
    return [f"on-table({item},{table}-table)" for table in ("black", "white", "wood")]


ITEMS = ("bread-loaf", "cereal-box", "lemon", "milk-carton", "soda-can", "water-bottle")


@pytest.mark.parametrize("problem", [None, "breakfast", "one-item"])
def test_an_item_is_in_one_place_at_most_and_the_gripper_is_empty_or_grips_one(problem: str | None) -> None:
    schema = load_domain("grocery", problem).parsed
    items = [item for item in ITEMS if item in schema.typing.objects]
    expected = {
        *(Group(tuple(map(Atom.parse, (*on(item), f"robot-gripping({item})")))) for item in items),
        Group(
            tuple(map(Atom.parse, ("robot-gripper-empty()", *(f"robot-gripping({item})" for item in items)))),
            exact=True,
        ),
    }
    found = find_mutexes(schema)
    assert set(found.groups) == expected  # though :init does not say where any item is
    assert len(found.groups) == len(expected)
    assert schema.task.declared <= found.state
    assert not any(group.violated(found.state) for group in expected)
    for item in items:
        assert sum(Atom.parse(place) in found.state for place in on(item)) == 1


def test_whatever_excludes_each_other_in_every_reachable_state_of_the_tray_is_found() -> None:
    schema = load_domain(TRAY).parsed
    found = find_mutexes(schema)
    states = reachable(schema, found.state)
    holds(found, states)
    fluents = [atom for atom in schema.task.atoms if any(atom in state for state in states)]
    excluded = {frozenset(pair) for pair in combinations(fluents, 2) if not any(set(pair) <= state for state in states)}
    assert pairs(found.groups) == excluded
    assert [group.exact for group in found.groups] == [True, False, False]  # a cube can fall, the hand cannot


def test_tiles_are_at_one_cell_and_cells_hold_one_tile() -> None:
    schema = read_task(PDDL / "sliding-tiles.pddl", PDDL / "fifteen.pddl")
    found = find_mutexes(schema)
    tiles = [name for name, kind in schema.typing.objects.items() if kind == "tile"]
    cells = [name for name, kind in schema.typing.objects.items() if kind == "cell"]
    of_tiles = {Group(tuple(Atom("at", (tile, cell)) for cell in cells)) for tile in tiles}
    of_cells = {Group((Atom("empty", (cell,)), *(Atom("at", (tile, cell)) for tile in tiles))) for cell in cells}
    assert of_tiles | of_cells <= set(found.groups)


def test_where_nothing_excludes_anything_no_group_is_found_and_nothing_is_added() -> None:
    schema = read_task(PDDL / "dishes.pddl", PDDL / "dishes-problem.pddl")
    found = find_mutexes(schema)
    assert found[:2] == ((), schema.task.declared)


HAND = """(define (domain blocks)
  (:types block)
  (:predicates (on ?a ?b - block) (on-floor ?a - block) (clear ?a - block) (holding ?a - block) (free))
  (:action lift :parameters (?a - block) :precondition (and (on-floor ?a) (clear ?a) (free))
    :effect (and (holding ?a) (not (on-floor ?a)) (not (clear ?a)) (not (free))))
  (:action put :parameters (?a - block) :precondition (holding ?a)
    :effect (and (on-floor ?a) (clear ?a) (free) (not (holding ?a))))
  (:action stack :parameters (?a ?b - block) :precondition (and (holding ?a) (clear ?b))
    :effect (and (on ?a ?b) (clear ?a) (free) (not (holding ?a)) (not (clear ?b))))
  (:action unstack :parameters (?a ?b - block) :precondition (and (on ?a ?b) (clear ?a) (free))
    :effect (and (holding ?a) (clear ?b) (not (on ?a ?b)) (not (clear ?a)) (not (free)))))
"""


def blocks(folder: Path, init: str) -> Schema:
    (folder / "domain.pddl").write_text(HAND)
    (folder / "problem.pddl").write_text(
        f"(define (problem p) (:domain blocks) (:objects a b c - block) (:init {init}) (:goal (on a b)))"
    )
    return read_task(folder / "domain.pddl", folder / "problem.pddl")


FULL = "(on a b) (on-floor b) (on-floor c) (clear a) (clear c) (free)"


def test_blocks_are_in_one_place_have_one_thing_on_them_and_are_at_most_one_in_hand(tmp_path: Path) -> None:
    schema = blocks(tmp_path, FULL)
    found = find_mutexes(schema)
    holds(found, reachable(schema, found.state))
    assert found.state == schema.task.declared
    (hand,) = (group for group in found.groups if Atom("free") in group.atoms)
    assert hand.exact
    assert len(hand.atoms) == 4
    assert not any(group.exact for group in found.groups if group != hand)  # any block can be lost


@pytest.mark.parametrize("init", ["", "(free)", "(on a b)", "(on-floor a) (holding c)"])
def test_what_the_problem_leaves_open_is_filled_in_so_that_no_group_is_lost(tmp_path: Path, init: str) -> None:
    complete = find_mutexes(blocks(tmp_path, FULL))
    schema = blocks(tmp_path, init)
    found = find_mutexes(schema)
    assert schema.task.declared <= found.state
    holds(found, [found.state])
    of_blocks = {group for group in complete.groups if Atom("free") not in group.atoms}
    assert of_blocks <= set(found.groups)


PREDICATES = [("p", 1), ("q", 1), ("r", 2), ("s", 0)]


@st.composite
def domains(draw: st.DrawFn) -> str:
    """Small domains of any shape, with an initial state of any kind."""
    terms = ["?x", "?y"]
    literal = st.sampled_from(PREDICATES).flatmap(
        lambda predicate: st.lists(st.sampled_from(terms), min_size=predicate[1], max_size=predicate[1]).map(
            lambda args: f"({' '.join((predicate[0], *args))})"
        )
    )
    signed = st.dictionaries(literal, st.sampled_from(["{}", "(not {})"]), max_size=4).map(
        lambda signs: " ".join(sign.format(text) for text, sign in signs.items())
    )
    actions = []
    for number in range(draw(st.integers(1, 3))):
        before, after = draw(signed), draw(signed.filter(bool))
        parameters = ":parameters (?x ?y - thing)"
        actions.append(f"(:action a{number} {parameters} :precondition (and {before}) :effect (and {after}))")
    atoms = ["(p a)", "(p b)", "(q a)", "(q b)", "(r a a)", "(r a b)", "(r b a)", "(r b b)", "(s)"]
    init = " ".join(sorted(draw(st.sets(st.sampled_from(atoms), max_size=4))))
    return (
        "(define (domain d) (:types thing)"
        " (:predicates (p ?x - thing) (q ?x - thing) (r ?x ?y - thing) (s)) "
        + " ".join(actions)
        + f")\n---\n(define (problem p) (:domain d) (:objects a b - thing) (:init {init}) (:goal (s)))"
    )


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(domains())
def test_groups_of_any_small_domain_hold_wherever_its_actions_lead(tmp_path: Path, text: str) -> None:
    for name, part in zip(("domain.pddl", "problem.pddl"), text.split("\n---\n"), strict=True):
        (tmp_path / name).write_text(part)
    schema = read_task(tmp_path / "domain.pddl", tmp_path / "problem.pddl", seen=["s"])
    found = find_mutexes(schema)
    assert schema.task.declared <= found.state
    assert {atom for group in found.groups for atom in group.atoms} <= set(schema.task.atoms)
    holds(found, reachable(schema, found.state))


@pytest.mark.parametrize("ended", [Ended(-signal.SIGKILL, "", expired=True), Ended(21, "", expired=False)])
def test_a_translator_that_does_not_end_costs_the_groups_and_not_the_run(
    ended: Ended, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    schema = load_domain(TRAY).parsed
    monkeypatch.setattr(translation, "run_program", lambda *_: ended)
    assert find_mutexes(schema)[:2] == ((), schema.task.declared)
    assert "did not finish in time; answers are not made consistent" in caplog.text


def test_completing_the_state_is_part_of_what_has_to_be_done_in_time(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The translator answers, and then there is no time left for the grounded actions."""
    schema, run, late = load_domain(TRAY).parsed, translation.run_translator, 0.0

    def slow(*arguments: Any, **more: Any) -> str:
        nonlocal late
        late = 1000.0
        return run(*arguments, **more)

    now = time.monotonic
    monkeypatch.setattr(mutex_groups, "run_translator", slow)
    monkeypatch.setattr(time, "monotonic", lambda: now() + late)
    assert find_mutexes(schema)[:2] == ((), schema.task.declared)
    assert "did not finish in time; answers are not made consistent" in caplog.text


def test_a_translator_that_fails_says_why(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    schema = load_domain(TRAY).parsed
    monkeypatch.setattr(PddlText, "domain", lambda text, *more: "(define (domain task) (:nonsense))")
    assert find_mutexes(schema).groups == ()
    assert "Fast Downward's translator failed (" in caplog.text


def test_a_missing_translator_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "TRANSLATOR", "fast_downward_is_not_here.translate")
    with pytest.raises(MissingError, match="pip install up-fast-downward"):
        find_mutexes(load_domain(TRAY).parsed)
