"""What the two PDDL files say is read and grounded exactly."""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import pytest

from executive.domain.pddl import MOST_ATOMS, Schema, read_task
from executive.errors import DomainError
from executive.types import Atom, Condition, Facts, Step

ROOT = Path(__file__).resolve().parents[4]
DATA = ROOT / "tests" / "data" / "pddl"
PAIRS = {
    "sort-all": (ROOT / "domains/grocery/domain.pddl", ROOT / "domains/grocery/problem.pddl"),
    "breakfast": (ROOT / "domains/grocery/domain.pddl", ROOT / "domains/grocery/problems/breakfast.pddl"),
    "one-item": (ROOT / "domains/grocery/domain.pddl", ROOT / "domains/grocery/problems/one-item.pddl"),
    "tray": (ROOT / "tests/domains/tray/domain.pddl", ROOT / "tests/domains/tray/problem.pddl"),
    "dishes": (DATA / "dishes.pddl", DATA / "dishes-problem.pddl"),
}
ALL = {**PAIRS, "house": (DATA / "house.pddl", DATA / "house-problem.pddl")}
"""With one that is more than conjunctions of literals."""


@pytest.fixture
def dishes() -> Schema:
    return read_task(*PAIRS["dishes"])


def test_atoms_are_every_type_correct_tuple_in_the_order_of_the_files(dishes: Schema) -> None:
    dishware, places = ("mug", "saucer"), ("sink", "table", "shelf")
    expected = [
        *(Atom("at", pair) for pair in itertools.product(dishware, places)),
        *(Atom("clean", (dish,)) for dish in dishware),
        Atom("served"),
    ]
    assert list(dishes.task.atoms) == expected
    assert dishes.task.objects == {"sink": "place", "mug": "cup", "saucer": "plate", "table": "place", "shelf": "place"}
    assert dishes.task.declared == Facts.parse("at(mug,shelf)", "at(saucer,table)").true


def test_what_no_action_changes_is_what_the_problem_says() -> None:
    known, seen = read_task(*PAIRS["dishes"]), read_task(*PAIRS["dishes"], seen=["same-size"])
    assert known.static == frozenset(["same-size"])
    assert known.task.static == frozenset([Atom("same-size", ("mug", "saucer"))])
    assert not {*known.task.atoms, *known.init} & known.task.static
    assert "same-size" not in known.task.parameters
    assert not seen.static
    assert not seen.task.static
    assert seen.task.declared == known.task.declared | known.task.static
    assert set(seen.task.atoms) - set(known.task.atoms) == {atom for atom in seen.task.atoms if "same" in str(atom)}
    steps = {str(step) for step in instances(known)}
    false = {atom: False for atom in seen.task.atoms if atom.predicate == "same-size"}
    sizes = Facts({**false, **dict.fromkeys(known.task.static, True)})
    possible = {str(step) for step in instances(seen) if sizes.entails(step.precondition.facts.only(sizes))}
    assert steps == possible, "steps that need it otherwise can never be carried out"


CHESTS = """(define (domain chests) (:predicates (open ?c) (locked ?c) (key ?c))
  (:action unlock :parameters (?c) :precondition (and (key ?c) (locked ?c)) :effect (not (locked ?c)))
  (:action lift :parameters (?c) :precondition (not (locked ?c)) :effect (open ?c)))"""


def chests(folder: Path, init: str, goal: str) -> Schema:
    (folder / "d.pddl").write_text(CHESTS)
    (folder / "p.pddl").write_text(
        f"(define (problem p) (:domain chests) (:objects a b)\n  (:init {init})\n  (:goal {goal}))"
    )
    return read_task(folder / "d.pddl", folder / "p.pddl")


def test_what_the_goal_asks_of_what_never_changes_is_settled_when_it_is_read(tmp_path: Path) -> None:
    schema = chests(tmp_path, "(key a) (locked a)", "(and (open a) (key a) (not (key b)))")
    assert schema.task.goal == Condition.parse("open(a)")
    assert schema.ground("unlock", ["a"]).precondition.facts == Facts.parse("locked(a)")
    with pytest.raises(ValueError, match="can never be carried out"):
        schema.ground("unlock", ["b"])
    for goal, atom in (("(and (open a) (key b))", "key(b)"), ("(and (open a) (not (key a)))", "key(a)")):
        unreachable = chests(tmp_path, "(key a)", goal).unreachable
        assert unreachable is not None
        assert unreachable.line == 3
        assert atom in unreachable.reason


def test_what_the_problem_says_of_the_beginning_is_kept_with_its_sign_and_line(tmp_path: Path) -> None:
    schema = chests(tmp_path, "(locked a)\n (not (open a))\n (key a)", "(open a)")
    assert schema.init == {Atom("locked", ("a",)): (True, 2), Atom("open", ("a",)): (False, 3)}
    assert schema.task.declared == {Atom("locked", ("a",))}
    with pytest.raises(DomainError, match=r"line 3: :init says locked\(a\) and its opposite, on line 2"):
        chests(tmp_path, "(locked a)\n (not (locked a))", "(open a)")


def test_the_limit_of_atoms_is_for_what_can_change(tmp_path: Path) -> None:
    names = " ".join(f"c{number}" for number in range(250))
    keys = " ".join(f"(key c{number})" for number in range(250))
    (tmp_path / "d.pddl").write_text(CHESTS.replace("(key ?c))", "(key ?c) (beside ?c ?d))", 1))
    (tmp_path / "p.pddl").write_text(
        f"(define (problem p) (:domain chests) (:objects {names}) (:init (beside c1 c2) {keys}) (:goal (open c1)))"
    )
    schema = read_task(tmp_path / "d.pddl", tmp_path / "p.pddl")
    assert (len(schema.task.atoms), len(schema.task.static)) == (500, 251)
    with pytest.raises(DomainError, match=f"line 1: there are more than {MOST_ATOMS} fluent atoms"):
        read_task(tmp_path / "d.pddl", tmp_path / "p.pddl", seen=["beside"])


def test_the_steps_that_bring_something_about_are_all_that_do(dishes: Schema) -> None:
    wanted = Facts.parse("at(mug,table)", "served()").true
    assert dishes.giving(wanted) == {step for step in instances(dishes) if step.unconditional.true & wanted}
    assert dishes.giving([]) == frozenset()


def test_the_goal_is_signed_and_written_out_and_its_order_is_kept(dishes: Schema) -> None:
    assert dishes.task.goal == Condition.parse("served", "at(mug,table)", "not clean(saucer)")
    assert [str(atom) for atom in dishes.goals] == ["served()", "at(mug,table)", "clean(saucer)"]


@pytest.mark.parametrize(
    ("step", "preconditions", "effects"),
    [
        ("move mug shelf table", "at(mug,shelf); not served", "not at(mug,shelf); at(mug,table)"),
        ("wash saucer", "at(saucer,sink); not clean(saucer)", "clean(saucer)"),
        ("serve", "not served; clean(mug); not at(mug,sink)", "served"),
        (
            "clear-away",  # what is both deleted and added is true afterwards
            "",
            "not served; not at(mug,table); not at(mug,shelf); not at(saucer,table); not at(saucer,shelf); "
            "at(mug,sink); at(saucer,sink); not clean(mug); not clean(saucer)",
        ),
        (
            "swap mug saucer shelf table",
            "at(mug,shelf); at(saucer,table)",  # that they are of one size is known
            "at(mug,table); at(saucer,shelf); not at(mug,shelf); not at(saucer,table)",
        ),
    ],
)
def test_steps_are_grounded_with_every_literal(dishes: Schema, step: str, preconditions: str, effects: str) -> None:
    name, *args = step.split()
    grounded = dishes.ground(name, args)
    assert (grounded.action, grounded.args) == (name, tuple(args))
    assert grounded.precondition.facts == Facts.parse(*filter(None, preconditions.split("; ")))
    assert grounded.unconditional == Facts.parse(*effects.split("; "))


@pytest.mark.parametrize(
    "step", ["move mug table table", "move table mug shelf", "move mug table", "wash mug mug", "fly mug", "wash spoon"]
)
def test_what_can_never_be_carried_out_is_not_grounded(dishes: Schema, step: str) -> None:
    name, *args = step.split()
    with pytest.raises(ValueError):
        dishes.ground(name, args)


def instances(schema: Schema) -> list[Step]:
    """Every step of the task that can be carried out in some state."""
    steps = []
    for action in schema.actions.values():
        for args in schema.typing.tuples([kind for _, kind in action.parameters]):
            try:
                steps.append(schema.ground(action.name, args))
            except ValueError:
                continue
    return steps


@pytest.mark.filterwarnings("ignore:Name .* already defined", "ignore:'parseString' deprecated")
@pytest.mark.parametrize("name", ALL)
def test_an_independent_reader_and_simulator_agree(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """unified-planning's own PDDL reader and simulator judge: objects, atoms, initial state, and on a random walk
    the steps that can be carried out and what they lead to."""
    from unified_planning.environment import get_environment
    from unified_planning.io import PDDLReader

    environment = get_environment()  # its reader mixes environments up where an effect has a forall
    monkeypatch.setattr(environment, "_error_used_name", False)  # a type and an object may share a name
    monkeypatch.setattr(environment, "_credits_stream", None)
    mine = read_task(*ALL[name])
    theirs = PDDLReader().parse_problem(*map(str, ALL[name]))
    atoms = {Atom.parse(str(fluent)): fluent for fluent in theirs.initial_values if fluent.type.is_bool_type()}
    assert {item.name: item.type.name for item in theirs.all_objects} == mine.task.objects
    assert set(mine.task.atoms) <= {atom for atom in atoms if atom.predicate not in mine.static}
    assert name == "house" or set(mine.task.atoms) == {atom for atom in atoms if atom.predicate not in mine.static}
    initially = {atom for atom, fluent in atoms.items() if theirs.initial_value(fluent).is_true()}
    assert initially == mine.task.declared | mine.task.static

    steps, choose = instances(mine), random.Random(3)
    true = {atom: atom in mine.task.declared for atom in mine.task.atoms}
    with environment.factory.SequentialSimulator(problem=theirs) as simulator:
        state = simulator.get_initial_state()
        for _ in range(20):
            applicable = {str(step): step for step in steps if step.precondition.truth(true)}
            judged = {
                f"{action.name}({','.join(map(str, args))})": (action, args)
                for action, args in simulator.get_applicable_actions(state)
            }
            assert judged.keys() == applicable.keys()
            if not applicable:
                break
            chosen = choose.choice(sorted(applicable))
            true.update({atom: bool(value) for atom, value in applicable[chosen].changes(true).items()})
            state = simulator.apply(state, *judged[chosen])
            now = {atom for atom, fluent in atoms.items() if state.get_value(fluent).is_true()}
            assert now == {atom for atom, value in true.items() if value} | mine.task.static
            assert simulator.is_goal(state) is mine.task.goal.truth(true)
