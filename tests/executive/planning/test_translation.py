"""Tasks that the translator grounds: every formula, conditional effects, axioms and costs; once, for all states."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task
from executive.planning import translation
from executive.planning.fast_downward import FastDownwardPlanner
from executive.planning.goal_order import State, replay
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan

LIGHTS = """(define (domain lights) (:requirements :adl :derived-predicates)
  (:types room lamp) (:predicates (in ?r - room) (door ?a ?b - room) (lamp-in ?l - lamp ?r - room) (on ?l - lamp)
    (broken ?l - lamp) (bright ?r - room) (all-bright))
  (:derived (bright ?r - room) (exists (?l - lamp) (and (lamp-in ?l ?r) (on ?l))))
  (:derived (all-bright) (forall (?r - room) (bright ?r)))
  (:action go :parameters (?a ?b - room)
    :precondition (and (in ?a) (or (door ?a ?b) (door ?b ?a))) :effect (and (in ?b) (not (in ?a))))
  (:action switch :parameters (?r - room) :precondition (in ?r)
    :effect (forall (?l - lamp) (when (and (lamp-in ?l ?r) (not (broken ?l))) (on ?l))))
  (:action mend :parameters (?r - room ?l - lamp)
    :precondition (and (in ?r) (bright ?r) (broken ?l) (lamp-in ?l ?r)) :effect (not (broken ?l))))"""

HOUSE = """(define (problem house) (:domain lights) (:objects hall kitchen cellar - room a b c - lamp)
  (:init (in hall) (door hall kitchen) (door cellar kitchen) (lamp-in a hall) (lamp-in b kitchen) (lamp-in c cellar))
  (:goal (and (all-bright) (in hall))))"""

ROADS = """(define (domain roads) (:requirements :action-costs :typing)
  (:types place) (:predicates (at ?p - place) (road ?a ?b - place)) (:functions (total-cost) (toll ?a ?b - place))
  (:action go :parameters (?a ?b - place) :precondition (and (at ?a) (road ?a ?b))
    :effect (and (at ?b) (not (at ?a)) (increase (total-cost) (toll ?a ?b)))))"""

THREE = """(define (problem three) (:domain roads) (:objects a b c - place)
  (:init (at a) (road a b) (road b c) (road a c) (= (total-cost) 0)
    (= (toll a b) 1) (= (toll b c) {toll}) (= (toll a c) 5))
  (:goal (at c)) (:metric minimize (total-cost)))"""


def task(folder: Path, domain: str, problem: str) -> Schema:
    (folder / "domain.pddl").write_text(domain)
    (folder / "problem.pddl").write_text(problem)
    return read_task(folder / "domain.pddl", folder / "problem.pddl")


def declared(schema: Schema) -> Facts:
    return Facts.closed(schema.task.declared, schema.task.atoms)


def steps(answer: Plan | NoPlan) -> list[str]:
    assert isinstance(answer, Plan), answer
    return [str(step) for step in answer.steps]


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A line for every time that the translator runs."""
    run, lines = translation.run_translator, list[str]()

    def counted(*arguments: object) -> str:
        lines.append("run")
        return run(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(translation, "run_translator", counted)
    return lines


@pytest.mark.parametrize("optimal", [True, False])
def test_quantifiers_conditional_effects_and_axioms_are_planned_with(tmp_path: Path, optimal: bool) -> None:
    schema = task(tmp_path, LIGHTS, HOUSE)
    found = steps(FastDownwardPlanner(schema, optimal=optimal).plan(declared(schema), schema.task.goal))
    assert sorted(found) == sorted(
        ["switch(hall)", "go(hall,kitchen)", "switch(kitchen)", "go(kitchen,cellar)", "switch(cellar)"]
        + ["go(cellar,kitchen)", "go(kitchen,hall)"]
    )


def test_what_is_broken_is_not_switched_on_and_dark_rooms_are_not_mended_in(tmp_path: Path) -> None:
    schema = task(tmp_path, LIGHTS, HOUSE)
    planner = FastDownwardPlanner(schema)
    broken = declared(schema) | Facts.parse("broken(b)")
    answer = planner.plan(broken, schema.task.goal)
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.UNSOLVABLE
    assert steps(planner.plan(broken | Facts.parse("on(b)"), Condition.parse("not broken(b)"))) == [
        "go(hall,kitchen)",
        "mend(kitchen,b)",
    ]


def test_any_formula_may_be_a_goal_and_a_part_of_the_goal_may_be_left(tmp_path: Path, runs: list[str]) -> None:
    schema = task(tmp_path, LIGHTS, HOUSE)
    planner = FastDownwardPlanner(schema)
    start = declared(schema)
    assert len(steps(planner.plan(start, schema.task.goal))) == 7
    assert steps(planner.plan(start, Condition.parse("in(hall)"))) == []
    assert steps(planner.plan(start, Condition.parse("in(cellar) or on(a)"))) == ["switch(hall)"]
    assert steps(planner.plan(start, Condition.parse("in(cellar) or (on(b) and in(kitchen))"))) in (
        ["go(hall,kitchen)", "go(kitchen,cellar)"],
        ["go(hall,kitchen)", "switch(kitchen)"],
    )
    assert len(runs) == 1
    assert steps(planner.plan(start, Condition.parse("bright(kitchen)"))) == ["go(hall,kitchen)", "switch(kitchen)"]
    assert len(runs) == 2, "an axiom that nothing asked for until now"


@pytest.mark.parametrize(("toll", "cost", "length"), [(1, 2.0, 2), (9, 5.0, 1), (0, 1.0, 2)])
@pytest.mark.parametrize("grounded", [True, False])
def test_the_cheapest_way_is_found_and_not_the_shortest(
    tmp_path: Path, toll: int, cost: float, length: int, grounded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not grounded:
        monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    schema = task(tmp_path, ROADS, THREE.format(toll=toll))
    answer = FastDownwardPlanner(schema, optimal=True).plan(declared(schema), schema.task.goal)
    assert isinstance(answer, Plan)
    assert (answer.cost, len(answer.steps)) == (cost, length)


PARCELS = """(define (domain parcels) (:requirements :typing) (:types city parcel van)
  (:predicates (at ?p - parcel ?c - city) (in ?p - parcel ?v - van) (van-at ?v - van ?c - city) (road ?a ?b - city)
    (home ?c - city))
  (:action load :parameters (?p - parcel ?v - van ?c - city)
    :precondition (and (at ?p ?c) (van-at ?v ?c)) :effect (and (in ?p ?v) (not (at ?p ?c))))
  (:action unload :parameters (?p - parcel ?v - van ?c - city)
    :precondition (and (in ?p ?v) (van-at ?v ?c)) :effect (and (at ?p ?c) (not (in ?p ?v))))
  (:action drive :parameters (?v - van ?a ?b - city)
    :precondition (and (van-at ?v ?a) (road ?a ?b)) :effect (and (van-at ?v ?b) (not (van-at ?v ?a)))))"""


def islands(vans: int) -> str:
    """Two islands without a road between them, all parcels on the first one, and vans on both."""
    roads = "(road a b) (road b a) (road c d) (road d c)"
    at = " ".join(f"(van-at v{number} {'ac'[number % 2]})" for number in range(vans))
    return f"""(define (problem islands) (:domain parcels)
      (:objects a b c d - city p q r - parcel {" ".join(f"v{number}" for number in range(vans))} - van)
      (:init {roads} {at} (at p a) (at q a) (at r b)) (:goal (and (at p b) (at q b))))"""


def test_states_that_actions_do_not_lead_to_are_planned_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: list[str]
) -> None:
    """Each parcel and each van in any one place: no road leads from island to island, and yet somebody carried them.
    What the translator was not yet told of has the task grounded once more, with all that was so before; a plan is
    found where one is found for the task grounded over all objects, and as short a one."""
    schema = task(tmp_path, PARCELS, islands(2))
    judge = FastDownwardPlanner(schema, optimal=True)
    monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    planner, choose, solved = FastDownwardPlanner(schema, optimal=True), random.Random(1), 0
    vans, parcels = ["v0", "v1"], ["p", "q", "r"]
    for _ in range(100):
        true = {Atom("van-at", (van, choose.choice("abcd"))) for van in vans}
        for parcel in parcels:
            places = [Atom("at", (parcel, city)) for city in "abcd"] + [Atom("in", (parcel, van)) for van in vans]
            true.add(choose.choice(places))
        state = Facts.closed(true, schema.task.atoms)
        answer, other = planner.plan(state, schema.task.goal), judge.plan(state, schema.task.goal)
        if isinstance(other, NoPlan):
            assert isinstance(answer, NoPlan)
            assert answer.reason is other.reason is NoPlanReason.UNSOLVABLE
        else:
            assert isinstance(answer, Plan)
            assert answer.cost == other.cost
            end = replay(frozenset(true), answer.steps)
            assert end is not None
            assert schema.task.goal.truth(State(end))
            solved += 1
    assert 20 < solved < 100
    assert 1 < len(runs) < 10
    before = len(runs)
    planner.plan(declared(schema), schema.task.goal)
    assert len(runs) == before


def test_a_plan_anew_does_not_run_the_translator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: list[str]
) -> None:
    monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    schema = task(tmp_path, PARCELS, islands(4))
    planner, true = FastDownwardPlanner(schema), frozenset(schema.task.declared)
    for _ in range(4):
        answer = planner.plan(Facts.closed(true, schema.task.atoms), schema.task.goal)
        assert isinstance(answer, Plan)
        end = replay(true, answer.steps[:1])
        assert end is not None
        true = end
    assert len(runs) == 1


def test_what_cannot_matter_for_the_goal_is_left_out(tmp_path: Path) -> None:
    schema = task(tmp_path, PARCELS, islands(1))
    found = translation.TranslatedTask(schema)
    found.ground(schema.task.declared, schema.task.goal, 60.0)
    operators, _ = found.relevant(schema.task.declared, schema.task.goal)
    assert len(found) == 14, "two drives, and each of three parcels loaded and unloaded in two cities"
    assert len(operators) == 10, "r need not be moved"
    gone = Facts.parse("van-at(v0,a)").true
    operators, _ = found.relevant(schema.task.declared - gone, schema.task.goal)
    assert operators == [], "without a van nothing can be done"


def test_a_predicate_that_is_looked_at_may_be_otherwise_than_init_says(tmp_path: Path) -> None:
    (tmp_path / "domain.pddl").write_text(
        "(define (domain d) (:requirements :adl) (:predicates (free ?x) (moved ?x))"
        " (:action move :parameters (?x) :precondition (or (free ?x) (moved ?x)) :effect (moved ?x)))"
    )
    (tmp_path / "problem.pddl").write_text(
        "(define (problem p) (:domain d) (:objects a b) (:init (free a)) (:goal (and (moved a) (moved b))))"
    )
    schema = read_task(tmp_path / "domain.pddl", tmp_path / "problem.pddl", seen=["free"])
    planner = FastDownwardPlanner(schema)
    assert sorted(steps(planner.plan(Facts.parse("free(a)", "free(b)"), schema.task.goal))) == ["move(a)", "move(b)"]
    answer = planner.plan(Facts.parse("free(b)"), schema.task.goal)
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.UNSOLVABLE


def test_a_translator_that_fails_or_takes_too_long_is_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    schema = task(tmp_path, LIGHTS, HOUSE)
    late = FastDownwardPlanner(schema).plan(declared(schema), schema.task.goal, seconds=0.01)
    assert isinstance(late, NoPlan)
    assert late.reason is NoPlanReason.TIMED_OUT
    monkeypatch.setattr("executive.planning.pddl_text.PddlText.domain", lambda *_: "(define (domain task) (:nonsense))")
    broken = FastDownwardPlanner(schema).plan(declared(schema), schema.task.goal)
    assert isinstance(broken, NoPlan)
    assert (broken.reason, "translator failed" in broken.detail) == (NoPlanReason.CRASHED, True)


TORCHES = """(define (domain torches) (:requirements :adl)
  (:predicates (lit ?t) (beside ?a ?b) (wet ?t))
  (:action pass-on :parameters (?a ?b) :precondition (and (lit ?a) (beside ?a ?b) (imply (wet ?b) (not (wet ?a))))
    :effect (and (lit ?b) (when (wet ?b) (not (wet ?b))))))"""


def test_an_atom_that_never_changes_counts_though_others_of_its_predicate_do(tmp_path: Path) -> None:
    init = "(:init (lit a) (beside a b) (beside b c))"
    problem = f"(define (problem p) (:domain torches) (:objects a b c) {init} (:goal (lit c)))"
    schema = task(tmp_path, TORCHES, problem)
    assert Atom("lit", ("a",)) in schema.task.static, "nothing is beside it on the other side"
    planner = FastDownwardPlanner(schema)
    assert steps(planner.plan(declared(schema), schema.task.goal)) == ["pass-on(a,b)", "pass-on(b,c)"]
    soaked = Facts({**declared(schema), Atom("wet", ("b",)): True})
    assert steps(planner.plan(soaked, schema.task.goal)) == ["pass-on(a,b)", "pass-on(b,c)"]


def test_names_that_begin_with_a_digit_go_through_the_translator(tmp_path: Path) -> None:
    (tmp_path / "d.pddl").write_text(
        """(define (domain d) (:predicates (at ?p) (4-free ?p))
        (:action go-2 :parameters (?p ?q) :precondition (and (at ?p) (4-free ?q))
         :effect (and (at ?q) (not (at ?p)) (not (4-free ?q)) (4-free ?p))))"""
    )
    (tmp_path / "p.pddl").write_text(
        "(define (problem p) (:domain d) (:objects 2 1st _x) (:init (at 2) (4-free 1st)) (:goal (at 1st)))"
    )
    schema = read_task(tmp_path / "d.pddl", tmp_path / "p.pddl")
    planner = FastDownwardPlanner(schema)
    assert steps(planner.plan(declared(schema), schema.task.goal)) == ["go-2(2,1st)"]
