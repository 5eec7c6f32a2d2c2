"""Numeric fluents are read as an atom for each value; comparisons and changes become formulas and effects."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task
from executive.errors import DomainError
from executive.types import Atom, Facts

DOMAIN = """(define (domain crates) (:requirements :typing :numeric-fluents)
  (:types item crate)
  (:predicates (loose ?i - item))
  (:functions (count ?c - crate) (room ?c - crate) (total-cost))
  (:action put :parameters (?i - item ?c - crate)
    :precondition (and (loose ?i) (< (count ?c) (room ?c)))
    :effect (and (not (loose ?i)) (increase (count ?c) 1) (increase (total-cost) 2.5)))
  (:action tip :parameters (?from ?to - crate)
    :precondition (and (> (count ?from) 0) (<= (+ (count ?from) (count ?to)) (room ?to)))
    :effect (and (assign (count ?from) 0) (increase (count ?to) (count ?from)))))
"""
PROBLEM = """(define (problem three) (:domain crates)
  (:objects a b c d - item k m - crate)
  (:init (loose a) (loose b) (loose c) (loose d) (= (count k) 0) (= (count m) 1) (= (room k) 5) (= (room m) 1))
  (:goal (>= (count k) 3)))
"""


def read(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> Schema:
    (folder / "d.pddl").write_text(domain)
    (folder / "p.pddl").write_text(problem)
    return read_task(folder / "d.pddl", folder / "p.pddl")


def count(crate: str, value: int) -> Atom:
    return Atom("count", (crate, f"n{value}"))


def with_counts(schema: Schema, **counts: int) -> Facts:
    true = {count(crate, value) for crate, value in counts.items()}
    return Facts.closed(true | {Atom("loose", (name,)) for name in "abcd"}, schema.task.atoms)


def test_a_fluent_has_an_atom_for_each_value_and_what_no_action_changes_has_none(tmp_path: Path) -> None:
    task = read(tmp_path).task
    assert [str(fluent) for fluent in task.fluents] == ["count(k)", "count(m)"]
    assert [value for value, _ in task.fluents[0].values] == list(range(10))
    assert {count("k", 0), count("m", 1)} <= task.declared
    assert Atom("room", ("k", "n5")) in task.static
    assert "n3" not in task.objects


@pytest.mark.parametrize("comparison", ["<", "<=", "=", ">=", ">"])
@pytest.mark.parametrize("number", [0, 3, 9])
def test_a_comparison_is_true_of_the_values_that_satisfy_it(tmp_path: Path, comparison: str, number: int) -> None:
    schema = read(
        tmp_path, problem=PROBLEM.replace("(>= (count k) 3)", f"(or (loose d) ({comparison} (count k) {number}))")
    )
    satisfied = {"<": int.__lt__, "<=": int.__le__, "=": int.__eq__, ">=": int.__ge__, ">": int.__gt__}[comparison]
    for value in range(10):
        state = with_counts(schema, k=value, m=0) | {Atom("loose", ("d",)): False}
        assert schema.task.goal.truth(state) is satisfied(value, number)


def test_what_is_known_in_part_is_enough_where_it_decides(tmp_path: Path) -> None:
    goal = read(tmp_path).task.goal
    assert goal.truth({count("k", value): False for value in (0, 1, 2)}) is True, "whichever it is"
    assert goal.truth({count("k", value): False for value in (0, 1)}) is None
    assert goal.truth({count("k", 2): True}) is False


def test_actions_change_numbers_as_arithmetic_says(tmp_path: Path) -> None:
    schema = read(tmp_path)
    put, tip = schema.ground("put", ("a", "k")), schema.ground("tip", ("m", "k"))
    for k, m in itertools.product(range(10), repeat=2):
        state = with_counts(schema, k=k, m=m)
        assert put.precondition.truth(state) is (k < 5)
        assert tip.precondition.truth(state) is (m > 0 and k + m <= 5)
        if k < 5:
            after = state | {atom: bool(value) for atom, value in put.changes(state).items()}
            assert [value for value in range(10) if after[count("k", value)]] == [k + 1]
        if m > 0 and k + m <= 5:
            after = state | {atom: bool(value) for atom, value in tip.changes(state).items()}
            assert (after[count("k", k + m)], after[count("m", 0)]) == (True, True)


def test_an_unknown_number_leaves_what_it_becomes_unknown(tmp_path: Path) -> None:
    schema = read(tmp_path)
    changes = schema.ground("put", ("a", "k")).changes({count("k", 0): False})
    assert changes[count("k", 1)] is None
    assert changes[Atom("loose", ("a",))] is False


def test_numbers_end_where_the_files_do_not_need_more(tmp_path: Path) -> None:
    plain = DOMAIN.replace(" (< (count ?c) (room ?c))", "")
    schema = read(tmp_path, plain)
    put = schema.ground("put", ("a", "k"))
    assert put.precondition.truth(with_counts(schema, k=9, m=0)) is False, "there is no ten"
    assert put.precondition.truth(with_counts(schema, k=8, m=0)) is True
    larger = read(tmp_path, plain, PROBLEM.replace("(>= (count k) 3)", "(>= (count k) 12)"))
    assert max(value for value, _ in larger.task.fluents[0].values) == 12


def test_a_distribution_has_a_mean_and_a_most_probable_value(tmp_path: Path) -> None:
    fluent = read(tmp_path).task.fluents[0]
    believed = {count("k", 2): 0.3, count("k", 3): 0.6, count("k", 4): 0.3}
    assert fluent.mean(believed) == pytest.approx(3.0)
    assert fluent.most_probable(believed) == 3
    assert (fluent.mean({}), fluent.most_probable({})) == (None, None)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("(= (count k) 0)", "(= (count k) 0.5)", 3, "whole values"),
        ("(= (count k) 0)", "(= (count k) 0) (= (count k) 1)", 3, "two values"),
        ("(>= (count k) 3)", "(>= (count k) 101)", 4, "from 0 to 100"),
        ("(>= (count k) 3)", "(>= (count k) (weight k))", 4, "weight"),
        ("(>= (count k) 3)", "(>= (count a) 3)", 4, "of type item, expected crate"),
        ("(>= (count k) 3)", "(>= (count k))", 4, "expected a declared function"),
    ],
)
def test_what_cannot_be_read_is_one_line_with_its_number(
    tmp_path: Path, old: str, new: str, line: int, words: str
) -> None:
    with pytest.raises(DomainError) as error:
        read(tmp_path, problem=PROBLEM.replace(old, new))
    assert error.value.key == f"line {line}"
    assert words in str(error.value)
