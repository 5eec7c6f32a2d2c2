"""What :init says is not known: read in one form, and refused where it cannot be meant."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from executive.domain.loader import load_domain
from executive.domain.pddl import Schema, read_task
from executive.errors import DomainError
from executive.planning.initial_state import draw_initial, draw_one
from executive.planning.mutex_groups import find_mutexes
from executive.planning.state_listing import list_states
from executive.types import Atom

DOMAIN = """
(define (domain boxes) (:requirements :strips :typing) (:types thing box)
  (:predicates (inside ?t - thing ?b - box) (held ?t - thing) (free) (open ?b - box) (red ?b - box) (full ?b - box))
  (:derived (full ?b - box) (exists (?t - thing) (inside ?t ?b)))
  (:action lift :parameters (?b - box) :precondition (free) :effect (open ?b))
  (:action get :parameters (?t - thing ?b - box)
    :precondition (and (open ?b) (free) (inside ?t ?b))
    :effect (and (held ?t) (not (inside ?t ?b)) (not (free))))
  (:action put :parameters (?t - thing ?b - box)
    :precondition (and (open ?b) (held ?t)) :effect (and (inside ?t ?b) (not (held ?t)) (free))))
"""


def boxes(folder: Path, init: str) -> Schema:
    domain, problem = folder / "domain.pddl", folder / "problem.pddl"
    domain.write_text(DOMAIN)
    problem.write_text(
        f"(define (problem p) (:domain boxes) (:objects x y - thing a b c - box)\n(:init (free)\n{init})\n"
        "(:goal (held x)))"
    )
    return read_task(domain, problem)


def at(thing: str, box: str) -> Atom:
    return Atom("inside", (thing, box))


def test_what_is_not_known_is_read_and_is_neither_so_nor_not_so(tmp_path: Path) -> None:
    schema = boxes(tmp_path, "(inside y c) (oneof (inside x a) (inside x b)) (unknown (open a)) (unknown (open b))")
    assert schema.oneof == ((at("x", "a"), at("x", "b")),)
    assert schema.unknown == {Atom("open", ("a",)), Atom("open", ("b",))}
    assert schema.task.declared == {Atom("free"), at("y", "c")}
    assert not schema.init.keys() & {*schema.oneof[0], *schema.unknown}


@pytest.mark.parametrize(
    ("init", "message"),
    [
        ("(oneof (inside x a))", "expected (oneof <atom> <atom> ...)"),
        ("(unknown)", "expected (unknown <atom>)"),
        ("(unknown (inside x a) (inside x b))", "expected (unknown <atom>)"),
        ("(oneof (inside x a) (inside x a))", "inside(x,a) stands in a (oneof ...) twice"),
        ("(oneof (inside x a) (inside x b)) (oneof (inside x a) (inside x c))", "in a (oneof ...) twice"),
        ("(oneof (inside x a) (inside x d))", "unknown object d"),
        ("(oneof (inside x a) (insid x b))", "unknown predicate"),
        ("(inside x a) (oneof (inside x a) (inside x b))", "is called unknown, and :init says on line"),
        ("(unknown (red a))", "red(a) is called unknown, and is static"),
        ("(unknown (full a))", "full(a) is called unknown, and is derived"),
        ("(oneof (not (inside x a)) (inside x b))", "unknown predicate in (not"),
    ],
)
def test_what_cannot_be_meant_is_refused_on_its_line(tmp_path: Path, init: str, message: str) -> None:
    with pytest.raises(DomainError, match=re.escape(message)) as caught:
        boxes(tmp_path, init)
    assert caught.value.key == "line 3"


def test_one_of_several_is_drawn_and_all_of_them_in_time(tmp_path: Path) -> None:
    boxes(tmp_path, "(oneof (inside x a) (inside x b)) (inside y c) (unknown (open a))")
    domain = load_domain(tmp_path / "domain.pddl", str(tmp_path / "problem.pddl"))
    drawn = [
        draw_initial(domain.parsed, np.random.default_rng(seed), leaves_open=domain.leaves_open) for seed in range(40)
    ]
    assert all(sum(at("x", box) in true for box in "ab") == 1 for true in drawn)
    assert {frozenset(box for box in "ab" if at("x", box) in true) for true in drawn} == {
        frozenset("a"),
        frozenset("b"),
    }
    assert {Atom("open", ("a",)) in true for true in drawn} == {True, False}
    for true in drawn:
        assert Atom("open", ("b",)) not in true
        assert at("y", "c") in true
        assert Atom("held", ("x",)) not in true
    again = draw_initial(domain.parsed, np.random.default_rng(0), leaves_open=False)
    assert again == drawn[0]


def test_one_of_several_is_drawn_as_often_as_is_usual() -> None:
    atoms, rng = [at("x", box) for box in "abc"], np.random.default_rng(0)
    usual = {at("x", "a"): 0.7, at("y", "b"): 1.0}  # what is left of x is shared evenly; y is not in question
    drawn = [draw_one(atoms, usual, rng) for _ in range(2000)]
    assert [drawn.count(atom) / 2000 for atom in atoms] == pytest.approx([0.7, 0.15, 0.15], abs=0.03)
    assert draw_one(atoms[1:], {at("x", "b"): 0.0, at("x", "c"): 1.0}, rng) == at("x", "c")
    assert draw_one(atoms[:1], {at("x", "a"): 0.0}, rng) == at("x", "a")


def test_states_are_not_listed_from_what_is_not_known(tmp_path: Path) -> None:
    schema = boxes(tmp_path, "(inside x a) (inside y c) (unknown (open a))")
    assert list_states(schema, find_mutexes(schema, leaves_open=False)) is None


def test_where_a_thing_may_be_though_no_action_brings_it_there_is_in_its_group(tmp_path: Path) -> None:
    """Nothing can be put into a box here, so that from a thing in the one box none leads to the other."""
    folder = tmp_path / "takes-only"
    folder.mkdir()
    text = (
        DOMAIN[: DOMAIN.index("(:action put")].replace(
            "(:derived (full ?b - box) (exists (?t - thing) (inside ?t ?b)))", ""
        )
        + ")"
    )
    (folder / "domain.pddl").write_text(text)
    (folder / "problem.pddl").write_text(
        "(define (problem p) (:domain boxes) (:objects x - thing a b - box)"
        " (:init (free) (oneof (inside x a) (inside x b))) (:goal (held x)))"
    )
    schema = read_task(folder / "domain.pddl", folder / "problem.pddl")
    for leaves_open in (False, True):
        found = find_mutexes(schema, leaves_open=leaves_open).groups
        assert any({at("x", "a"), at("x", "b"), Atom("held", ("x",))} <= set(group.atoms) for group in found)
