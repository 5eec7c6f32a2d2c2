"""What is estimated: every boolean fluent over every tuple that fits its types, as unified-planning grounds it, too."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.domain.pddl import read_task, read_vocabulary
from executive.errors import DomainError
from executive.types import Atom, Task
from tests.executive.domain.pddl.test_reader import PAIRS


@st.composite
def domains(draw: st.DrawFn) -> tuple[str, str]:
    """The text of a domain and of a problem: a tree of types, constants, objects, predicates of up to three parameters
    and numeric fluents. Some types have no objects, and some predicates therefore no atoms."""
    types = [f"t{index}" for index in range(draw(st.integers(1, 4)))]
    parents = [draw(st.sampled_from(["object", *types[:index]])) for index in range(len(types))]
    kind = st.sampled_from(["object", *types])
    names = [f"o{index}" for index in range(draw(st.integers(1, 6)))]
    typed = [f"{name} - {draw(st.sampled_from(types))}" for name in names]  # its reader knows no objects of type object
    split = draw(st.integers(0, len(names) - 1))

    def declared(prefix: str, most: int) -> list[str]:
        return [
            f"({prefix}{index} {' '.join(f'?v{slot} - {draw(kind)}' for slot in range(draw(st.integers(0, 3))))})"
            for index in range(draw(st.integers(1, most)))
        ]

    domain = f"""(define (domain d) (:requirements :typing :numeric-fluents)
        (:types {" ".join(f"{own} - {parent}" for own, parent in zip(types, parents, strict=True))})
        (:constants {" ".join(typed[:split])})
        (:predicates {" ".join(declared("p", 4))})
        (:functions {" ".join(declared("f", 2))})
        (:action a :parameters () :precondition () :effect (and)))"""
    problem = f"(define (problem q) (:domain d) (:objects {' '.join(typed[split:])}) (:init) (:goal (and)))"
    return domain, problem


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    from unified_planning.environment import get_environment

    monkeypatch.setattr(get_environment(), "_error_used_name", False)  # a type and an object may share a name
    monkeypatch.setattr(get_environment(), "_credits_stream", None)


def by_unified_planning(domain: Path, problem: Path) -> tuple[set[Atom], set[str], dict[str, str]]:
    """The atoms, the names of the fluents that are not boolean, and the objects with their types."""
    from unified_planning.io import PDDLReader
    from unified_planning.model.fluent import get_all_fluent_exp

    theirs = PDDLReader().parse_problem(str(domain), str(problem))
    boolean = [fluent for fluent in theirs.fluents if fluent.type.is_bool_type()]
    atoms = {Atom.parse(str(grounded)) for fluent in boolean for grounded in get_all_fluent_exp(theirs, fluent)}
    others = {fluent.name for fluent in theirs.fluents if not fluent.type.is_bool_type()}
    return atoms, others, {item.name: item.type.name for item in theirs.all_objects}


def agrees(mine: Task, domain: Path, problem: Path) -> None:
    atoms, numeric, objects = by_unified_planning(domain, problem)
    assert set(mine.atoms) == atoms
    assert len(mine.atoms) == len(atoms)
    assert set(mine.numeric) == numeric
    assert mine.objects == objects


pytestmark = pytest.mark.filterwarnings("ignore:Name .* already defined", "ignore:'parseString' deprecated")


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", PAIRS)
def test_the_tasks_at_hand_are_grounded_as_unified_planning_grounds_them(name: str) -> None:
    agrees(read_vocabulary(*PAIRS[name], seen=["same-size"]), *PAIRS[name])
    task, planned = read_vocabulary(*PAIRS[name]), read_task(*PAIRS[name]).task
    assert (task.atoms, task.objects, task.parameters) == (planned.atoms, planned.objects, planned.parameters)


@pytest.mark.usefixtures("quiet")
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(files=domains())
def test_any_domain_is_grounded_as_unified_planning_grounds_it(tmp_path: Path, files: tuple[str, str]) -> None:
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(files[0])
    problem.write_text(files[1])
    seen = [f"p{number}" for number in range(4)]
    agrees(read_vocabulary(domain, problem, seen), domain, problem)
    assert read_task(domain, problem, seen).task.atoms == read_vocabulary(domain, problem, seen).atoms


def test_parameters_are_known_by_their_names() -> None:
    task = read_vocabulary(*PAIRS["sort-all"])
    assert task.parameters == {"on-table": ("item", "table"), "robot-gripping": ("item",), "robot-gripper-empty": ()}


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("(:objects", "(:objets", "line 4: unknown section (:objets"),
        ("(:objects lemon", "(:objects lemon lemon", "line 4: object lemon is declared twice"),
        ("- table)", "- tabel)", "line 5: unknown type tabel; did you mean 'table'?"),
        ("(:domain grocery)", "(:domain groceries)", "line 3: is for domain groceries"),
    ],
)
def test_a_mistake_in_what_is_read_is_named(tmp_path: Path, old: str, new: str, line: str) -> None:
    domain, problem = PAIRS["one-item"]
    broken = tmp_path / "problem.pddl"
    text = problem.read_text()
    assert old in text
    broken.write_text(text.replace(old, new, 1))
    with pytest.raises(DomainError) as caught:
        read_vocabulary(domain, broken)
    assert line in str(caught.value)


def test_a_problem_without_objects_has_the_atoms_that_are_about_none(tmp_path: Path) -> None:
    problem = tmp_path / "problem.pddl"
    problem.write_text("(define (problem q) (:domain grocery) (:goal (robot-gripper-empty)))")
    assert read_vocabulary(PAIRS["sort-all"][0], problem).atoms == (Atom("robot-gripper-empty"),)


STATIC = """(define (domain d) (:predicates (at ?x) (gone ?x) (lit) (road ?x ?y) (heavy ?x) (open ?x))
  (:functions (total-cost))
  {deeds})"""


@pytest.mark.parametrize(
    ("deeds", "asked"),
    [
        ("", {"at", "gone", "lit", "road", "heavy", "open"}),  # nothing is known to stay
        ("(:action a :parameters (?x) :precondition (heavy ?x) :effect (and (at ?x) (not (lit))))", {"at", "lit"}),
        ("(:action a :parameters (?x) :effect (forall (?y) (when (road ?x ?y) (not (gone ?y)))))", {"gone"}),
        (
            "(:durative-action a :parameters (?x) :duration (= ?duration 1) :condition (at start (heavy ?x))"
            " :effect (at end (open ?x)))",
            {"open"} | {"at"},  # which PDDL has a word of its own for
        ),
        ("(:derived (lit) (exists (?x) (open ?x)))", {"at", "gone", "road", "heavy", "open"}),  # what is derived, never
        ("(:action a :parameters (?x) :effect (and (at ?x) (increase (total-cost) 1)))", {"at"}),
    ],
)
def test_what_nothing_changes_is_not_asked_about(tmp_path: Path, deeds: str, asked: set[str]) -> None:
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(STATIC.format(deeds=deeds))
    problem.write_text("(define (problem p) (:domain d) (:objects a b) (:init (road a b)) (:goal (lit)))")
    task = read_vocabulary(domain, problem)
    assert {atom.predicate for atom in task.atoms} == task.parameters.keys() == asked
    assert read_vocabulary(domain, problem, ["road"]).parameters.keys() == asked | {"road"}
