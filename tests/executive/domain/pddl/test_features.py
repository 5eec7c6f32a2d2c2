"""What classical PDDL has beyond conjunctions of literals over a tree of types."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task, read_vocabulary
from executive.errors import DomainError
from executive.types import ALWAYS, Atom, Condition, Effect, Facts

HOUSE = Path(__file__).resolve().parents[3] / "data" / "pddl"


def read(folder: Path, domain: str, problem: str = "(:goal (p))", init: str = "") -> Schema:
    """The task of these sections."""
    (folder / "d.pddl").write_text(f"(define (domain d) {domain})")
    (folder / "p.pddl").write_text(f"(define (problem q) (:domain d) (:init {init}) {problem})")
    return read_task(folder / "d.pddl", folder / "p.pddl")


def parsed(*conjuncts: str) -> Condition:
    return Condition.parse(*conjuncts)


@pytest.fixture
def house() -> Schema:
    return read_task(HOUSE / "house.pddl", HOUSE / "house-problem.pddl")


def test_conditions_are_written_out_and_simplified_by_what_never_changes(house: Schema) -> None:
    into_the_dark = house.ground("go", ("hall", "study"))
    assert into_the_dark.precondition == parsed("here(hall)", "lit(bulb)", "not locked(hall,study)")
    to_the_kitchen = house.ground("go", ("hall", "kitchen"))
    assert to_the_kitchen.precondition == parsed(
        "here(hall)", "not locked(hall,kitchen)", "lit(bulb) or not dark(kitchen)"
    )
    count = house.ground("count-all", ())
    assert count.precondition == parsed("not lit(bulb)", "not lit(candle)", "not here(study) or not spinning(breeze)")
    with pytest.raises(ValueError, match="can never be carried out"):
        house.ground("go", ("kitchen", "study"))


def test_effects_have_their_conditions(house: Schema) -> None:
    always, dusted = house.ground("go", ("hall", "study")).effects
    assert always == Effect(ALWAYS, Facts.parse("here(study)", "not here(hall)"))
    assert dusted == Effect(parsed("spinning(breeze)"), Facts.parse("not dusty(study)"))
    assert house.ground("lock-all", ("study",)).effects == (), "no door leads out of it"
    assert house.ground("blow", ("breeze", "study")).unconditional == Facts.parse("spinning(breeze)", "dusty(study)")


def test_costs_are_sums_of_numbers_and_of_what_init_says(house: Schema) -> None:
    assert house.has_costs
    assert [house.ground("go", ("hall", to)).cost for to in ("kitchen", "study")] == [3.0, 2.0]
    assert house.ground("switch", ("bulb", "hall")).cost == 1.0
    assert house.ground("blow", ("breeze", "study")).cost == 0.0


def test_a_goal_may_be_any_condition(house: Schema) -> None:
    assert house.task.goal == parsed(
        "counted(bulb,candle) or here(study)", "locked(hall,kitchen) or locked(hall,study)"
    ), "what never changes, and the equality, are settled"
    assert {str(atom) for atom in house.goals} == {str(atom) for atom in house.task.goal.atoms}


def test_what_no_action_changes_is_known_atom_by_atom(house: Schema) -> None:
    atoms = {str(atom) for atom in house.task.atoms}
    assert "counted(bulb,candle)" in atoms
    assert "counted(bulb,bulb)" not in atoms, "two have to be different"
    assert "dark(study)" not in atoms, "no lamp is in the study"
    assert Atom("dark", ("study",)) in house.task.static
    assert "locked(kitchen,study)" not in atoms, "no door is between them"


def test_its_features_are_named(house: Schema) -> None:
    assert {"disjunctive-preconditions", "conditional-effects", "action-costs"} <= house.features
    assert "derived-predicates" not in house.features


TOWERS = """(:requirements :derived-predicates) (:types block)
  (:predicates (on ?a ?b - block) (above ?a ?b - block) (free ?a - block) (glued ?a - block) (heavy ?a - block))
  (:derived (above ?a ?b) (or (on ?a ?b) (exists (?c - block) (and (on ?a ?c) (above ?c ?b)))))
  (:derived (free ?a) (not (exists (?b - block) (above ?b ?a))))
  (:derived (heavy ?a) (glued ?a))
  (:action put :parameters (?a ?b - block) :precondition (and (free ?a) (free ?b) (not (= ?a ?b)) (not (heavy ?a)))
   :effect (on ?a ?b))
  (:action take :parameters (?a ?b - block) :precondition (and (free ?a) (on ?a ?b)) :effect (not (on ?a ?b)))"""


def test_derived_atoms_are_computed_and_not_asked_about(tmp_path: Path) -> None:
    schema = read(tmp_path, TOWERS, "(:objects a b c - block) (:goal (above a c))", "(on b c) (glued c)")
    assert set(schema.task.atoms) == {Atom("on", pair) for pair in product("abc", "abc")}
    assert schema.derived == {"above", "free", "heavy"}
    assert "above" not in schema.task.parameters
    known = schema.task.derived.complete({atom: atom in schema.task.declared for atom in schema.task.atoms})
    assert known[Atom("above", ("b", "c"))]
    assert not known[Atom("free", ("c",))]
    assert schema.task.goal == parsed("above(a,c)")
    assert schema.ground("put", ("a", "b")).precondition == parsed("free(a)", "free(b)"), "what is heavy never changes"
    with pytest.raises(ValueError, match="can never be carried out"):
        schema.ground("put", ("c", "a"))
    vocabulary = read_vocabulary(tmp_path / "d.pddl", tmp_path / "p.pddl")
    assert {atom.predicate for atom in vocabulary.atoms} == {"on"}


def test_an_action_that_changes_what_is_derived_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match=r"put: :effect: on is derived by axioms"):
        read(tmp_path, TOWERS.replace("(:derived (heavy ?a) (glued ?a))", "(:derived (on ?a ?b) (glued ?a))"))


def test_a_domain_may_be_about_nothing(tmp_path: Path) -> None:
    schema = read(tmp_path, "(:predicates (p) (q)) (:action a :precondition (q) :effect (and (p) (not (q))))")
    assert schema.task.atoms == (Atom("p"), Atom("q"))
    assert schema.ground("a", ()).precondition == parsed("q")


@pytest.mark.parametrize("goal", ["(and)", "()", "(and (and) (= a a))", "(exists (?x) (still ?x))"])
def test_a_goal_may_ask_for_nothing(tmp_path: Path, goal: str) -> None:
    domain = "(:predicates (p) (still ?x)) (:constants a) (:action b :effect (p))"
    assert read(tmp_path, domain, f"(:goal {goal})", "(still a)").task.goal == ALWAYS


def test_an_atom_both_added_and_deleted_is_true(tmp_path: Path) -> None:
    schema = read(tmp_path, "(:predicates (p)) (:action a :effect (and (p) (not (p))))")
    assert schema.ground("a", ()).unconditional == Facts.parse("p")


def test_a_question_mark_begins_a_word(tmp_path: Path) -> None:
    domain = "(:predicates (at?x?y)(p)) (:constants a)(:action go :parameters(?x?y) :precondition(at?x?y) :effect(p))"
    assert read(tmp_path, domain, init="(at a a)").actions["go"].parameters == (("?x", "object"), ("?y", "object"))


TYPES = """(:types car truck - vehicle boat car - floating (either vehicle floating) - thing stone)
  (:constants c - car t - truck b - boat s - stone e - (either stone boat))
  (:predicates (p) (moved ?x - (either truck boat)) (afloat ?x - floating))
  (:action move :parameters (?x - (either truck boat)) :effect (and (p) (moved ?x)))
  (:action swim :parameters (?x - floating) :effect (afloat ?x))"""


def test_types_may_have_several_supertypes_and_be_unions(tmp_path: Path) -> None:
    schema = read(tmp_path, TYPES.replace("(either vehicle floating) - thing ", ""))
    assert set(schema.arguments("move")) == {("t",), ("b",), ("e",)}
    assert set(schema.arguments("swim")) == {("c",), ("b",), ("e",)}
    assert {atom for atom in schema.task.atoms if atom.predicate == "moved"} == {Atom("moved", (x,)) for x in "tbe"}
    assert schema.typing.descends("car", "vehicle")
    assert schema.typing.descends("car", "floating")


def test_a_predicate_in_the_place_of_a_type_means_those_of_which_it_is_true(tmp_path: Path) -> None:
    condition = "(and (forall (?x - hot) (seen ?x)) (exists (?x - hot) (seen ?x)))"
    domain = f"""(:predicates (p) (hot ?x) (seen ?x)) (:action a :precondition {condition} :effect (p))
        (:action see :parameters (?x) :effect (forall (?y - hot) (seen ?y)))"""
    schema = read(tmp_path, domain, "(:objects a b c) (:goal (p))", "(hot a) (hot b)")
    assert schema.ground("a", ()).precondition == parsed("seen(a)", "seen(b)")
    assert schema.ground("see", ("c",)).unconditional == Facts.parse("seen(a)", "seen(b)")


def test_a_requirement_that_nothing_uses_is_no_matter(tmp_path: Path) -> None:
    flags = ":strips :durative-actions :preferences :numeric-fluents :probabilistic-effects :constraints :time"
    domain = f"(:requirements {flags}) (:functions (fuel ?x) (total-cost) - number) (:predicates (p))"
    schema = read(tmp_path, f"{domain} (:action a :effect (p))", init="(= (total-cost) 0)")
    assert not schema.features
    assert not schema.has_costs


GRID = """(:requirements :typing) (:types cell robot) (:predicates (at ?r - robot ?c - cell) (next ?a ?b - cell))
  (:action move :parameters (?r - robot ?a ?b - cell) :precondition (and (at ?r ?a) (next ?a ?b))
   :effect (and (at ?r ?b) (not (at ?r ?a))))"""


def test_what_never_changes_does_not_count_and_is_not_walked_through(tmp_path: Path) -> None:
    """Ten thousand fluents, a hundred million pairs of cells: only neighbours are looked at."""
    cells = [f"c{number}" for number in range(10_000)]
    edges = " ".join(f"(next {one} {other})" for one, other in pairwise(cells))
    problem = f"(:objects {' '.join(cells)} - cell r - robot) (:goal (at r c7))"
    schema = read(tmp_path, GRID, problem, f"(at r c0) {edges}")
    assert len(schema.task.atoms) == len(cells)
    assert len(schema.task.static) == len(cells) - 1
    assert sum(1 for _ in schema.arguments("move")) == len(cells) - 1


def test_what_is_too_large_to_be_written_out_is_refused(tmp_path: Path) -> None:
    names = " ".join(f"o{number}" for number in range(50))
    body = "(forall (?a ?b ?c ?d) (imply (q ?a ?b) (q ?c ?d)))"
    domain = f"(:predicates (p) (q ?a ?b)) (:action a :parameters (?x ?y) :precondition {body} :effect (not (q ?x ?y)))"
    with pytest.raises(DomainError, match=r"d\.pddl: line 1: action a has 12500001 conditions once written out"):
        read(tmp_path, domain, f"(:objects {names}) (:goal (p))")


def test_names_may_begin_with_a_digit(tmp_path: Path) -> None:
    domain = """(:types 2d-place)
        (:predicates (at ?p - 2d-place) (4-free ?p - 2d-place))
        (:action go :parameters (?p ?q - 2d-place) :precondition (and (at ?p) (4-free ?q))
         :effect (and (at ?q) (not (at ?p)) (not (4-free ?q)) (4-free ?p)))"""
    schema = read(tmp_path, domain, "(:objects 2 1st _x - 2d-place) (:goal (at 1st))", "(at 2) (4-free 1st)")
    step = schema.ground("go", ("2", "1st"))
    assert step.precondition == parsed("at(2)", "4-free(1st)")
