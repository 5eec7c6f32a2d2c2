"""Every mistake in a PDDL file is answered in one line that names the file, the line and what would have been right."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.domain.pddl import MOST_ATOMS, Schema, read_task
from executive.errors import DomainError
from executive.types import NEVER, Facts

DOMAIN = """(define (domain grocery)
  (:requirements :strips :typing)
  (:types item table)
  (:predicates
    (on-table ?item - item ?table - table)
    (robot-gripping ?item - item)
    (robot-gripper-empty))
  (:action pick
    :parameters (?item - item ?table - table)
    :precondition (and (on-table ?item ?table) (robot-gripper-empty))
    :effect (and (robot-gripping ?item) (not (on-table ?item ?table)) (not (robot-gripper-empty)))))
"""
PROBLEM = """(define (problem lunch)
  (:domain grocery)
  (:objects lemon bread - item
            wood-table - table)
  (:init (robot-gripper-empty))
  (:goal (and (on-table lemon wood-table)
              (on-table bread wood-table))))
"""
PRE = ":precondition (and (on-table ?item ?table) (robot-gripper-empty))"
EFFECT = ":effect (and (robot-gripping ?item) (not (on-table ?item ?table)) (not (robot-gripper-empty)))"
GOAL = "(and (on-table lemon wood-table)\n              (on-table bread wood-table))"


def read(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> Schema:
    (folder / "d.pddl").write_text(domain)
    (folder / "p.pddl").write_text(problem)
    return read_task(folder / "d.pddl", folder / "p.pddl")


# What is replaced, by what, on which line the mistake is then found, and what is said of it.
# fmt: off
IN_DOMAIN = {
    "not closed": ("(robot-gripper-empty)))))", "(robot-gripper-empty))))", 1, "'(' that is never closed"),
    "not closed in the middle": (
        "(robot-gripper-empty))\n  (:a", "(robot-gripper-empty)\n  (:a", 4, "before the next section, on line 8",
    ),
    "closed twice": ("(robot-gripper-empty)))))", "(robot-gripper-empty))))))", 11, "')' without its '('"),
    "two definitions": ("(define", "(define (domain a)) (define", 1, "after the end of the definition"),
    "no definition": (
        "(define (domain grocery)", "(hello (domain grocery)", 1, "expected (define (domain <name>) ...)",
    ),
    "swapped files": ("(define (domain grocery)", "(define (problem grocery)", 1, "expected (define (domain <name>)"),
    "unknown section": (":predicates", ":predikates", 4, "unknown section (:predikates"),
    "section twice": ("(:types item table)", "(:types item table) (:types a)", 3, "a second :types"),
    "unknown requirement": (":typing", ":types", 2, "unknown requirement :types; did you mean ':typing'"),
    "unknown type of a predicate": ("(robot-gripping ?item - item)", "(robot-gripping ?item - itm)", 6, "mean 'item'?"),
    "unknown type of a parameter": (
        "(?item - item ?table - table)\n    :pre", "(?item - i)\n    :pre", 9, "unknown type i;",
    ),
    "a type of its own descent": (
        "(:types item table)", "(:types item - table table - item)", 3, "descends from itself",
    ),
    "a dash with nothing behind": ("(:types item table)", "(:types item - )", 3, "a type behind it"),
    "predicate twice": (
        "(robot-gripper-empty))\n  (:a", "(robot-gripper-empty) (robot-gripper-empty))\n  (:a", 7, "twice",
    ),
    "a sign in a name": ("(robot-gripping ?item - item)", "(grip&hold)", 6, "grip&hold cannot be a predicate"),
    "a reserved name": ("(robot-gripping ?item - item)", "(not ?item - item)", 6, "not cannot be a predicate"),
    "parameter without ?": ("(robot-gripping ?item - item)", "(robot-gripping item)", 6, "begins with '?'"),
    "action without a name": (":action pick", ":action", 9, "cannot be an action's name"),
    "action twice": (
        "  (:action pick", "  (:action pick :effect (robot-gripper-empty))\n(:action pick", 9, "pick is declared twice",
    ),
    "parameter twice": (
        "(?item - item ?table - table)\n    :pre", "(?item - item ?item - table)\n    :pre", 9, "declared twice",
    ),
    "unknown key of an action": (":precondition", ":preconditions", 10, "did you mean ':precondition'?"),
    "key without a value": (EFFECT, ":effect", 11, "expected one bracketed list after :effect"),
    "no effect": (EFFECT, "", 8, "pick has no :effect"),
    "unknown predicate": (
        "(not (robot-gripper-empty))", "(not (robot-griper-empty))", 11, "mean 'robot-gripper-empty'?",
    ),
    "a predicate without brackets": (PRE, ":precondition (and robot-gripper-empty)", 10, "(robot-gripper-empty)"),
    "wrong number of arguments": ("(and (on-table ?item ?table)", "(and (on-table ?item)", 10, "(on-table item table)"),
    "wrong type of an argument": ("(and (on-table ?item ?table)", "(and (on-table ?table ?table)", 10, "expected item"),
    "unknown variable": ("(and (on-table ?item ?table)", "(and (on-table ?itm ?table)", 10, "did you mean '?item'?"),
    "unknown constant": ("(and (on-table ?item ?table)", "(and (on-table lemon ?table)", 10, "unknown object lemon"),
    "not of two": ("(not (robot-gripper-empty))", "(not (robot-gripper-empty) (robot-gripper-empty))", 11, "takes one"),
    "a list for a predicate": (PRE, ":precondition ((robot-gripper-empty))", 10, "unknown predicate"),
    # Scenario 22: what is not judged right is refused by name.
    "a comparison": (PRE, ":precondition (>= (weight ?item) 2)", 10, "declared function and a number in (>="),
    "= of numbers": (PRE, ":precondition (= (weight ?item) 2)", 10, "declared function and a number in (= (w"),
    "increase": (EFFECT, ":effect (increase (weight) 1)", 11, "declared function and a number in (incr"),
    "assign": (EFFECT, ":effect (assign (weight) 1)", 11, "declared function and a number in (assi"),
    "a cost that depends": (
        EFFECT, ":effect (when (robot-gripper-empty) (increase (total-cost) 1))", 11, "depends on a condition",
    ),
    "a cost of an unknown function": (EFFECT, ":effect (increase (total-cost) (weight))", 11, "numeric fluents"),
    "probabilities": (EFFECT, ":effect (probabilistic 0.5 (robot-gripper-empty))", 11, "not supported: probabilities"),
    "an effect that is a choice": (EFFECT, ":effect (or (robot-gripper-empty))", 11, "or is no effect"),
    "an equality for an effect": (EFFECT, ":effect (= ?item ?item)", 11, "= is no effect"),
    "a preference": (PRE, ":precondition (preference p (robot-gripper-empty))", 10, "not supported: a preference"),
    "an implication of three": (PRE, ":precondition (imply () () ())", 10, "takes two conditions"),
    "when without an effect": (EFFECT, ":effect (when (robot-gripper-empty))", 11, "expected (when condition effect)"),
    "a derived effect": (
        "  (:action", "  (:derived (robot-gripper-empty) ())\n(:action", 12, "is derived by axioms",
    ),
    "derived from its own negation": (
        "  (:predicates", "  (:derived (a) (not (a)))\n  (:predicates (a)", 4, "its own negation",
    ),
    "derived of another arity": ("  (:action", "  (:derived (robot-gripping) (and))\n(:action", 8, "does not fit"),
    "processes": (":action pick", ":process pick", 8, ":process is not supported: processes"),
    "an observation": (EFFECT, f":observe (robot-gripper-empty) {EFFECT}", 11, "partial observability"),
    "durative": (":action pick", ":durative-action pick", 8, "actions that take time"),
}
IN_PROBLEM = {
    "not closed": ("bread wood-table))))", "bread wood-table)))", 1, "never closed"),
    "another domain": ("(:domain grocery)", "(:domain blocks)", 2, "is for domain blocks, and d.pddl defines grocery"),
    "no domain": ("(:domain grocery)", "", 1, "expected (:domain <name>)"),
    "unknown type": ("wood-table - table", "wood-table - tabel", 4, "unknown type tabel; did you mean 'table'?"),
    "object twice": ("lemon bread - item", "lemon lemon - item", 3, "object lemon is declared twice"),
    "unknown object": ("(on-table bread wood-table)", "(on-table bred wood-table)", 7, "did you mean 'bread'?"),
    "unknown object in :init": ("(:init ", "(:init (on-table bred wood-table) ", 5, "did you mean 'bread'?"),
    "unknown predicate": ("(on-table bread wood-table)", "(on-tabel bread wood-table)", 7, "did you mean 'on-table'?"),
    "wrong number": ("(on-table bread wood-table)", "(on-table bread)", 7, "does not fit"),
    "wrong type": ("(on-table bread wood-table)", "(on-table wood-table bread)", 7, "is of type table, expected item"),
    "a variable": ("(on-table bread wood-table)", "(on-table ?x wood-table)", 7, "unknown variable ?x"),
    "no goal": (f"(:goal {GOAL})", "", 1, "expected (:goal <condition>)"),
    "= of one": ("(on-table bread wood-table)", "(= bread)", 7, "= compares two objects"),
    "a number in :init": ("(:init ", "(:init (= (weight lemon) 3) ", 5, "expected (= (<function> <objects>) <number>)"),
    "a fact at a time": ("(:init ", "(:init (at 5 (robot-gripper-empty)) ", 5, "facts that come about at a time"),
    "the metric of numbers": ("(:goal", "(:metric minimize (weight)) (:goal", 6, "numeric fluents"),
    "the metric of time": ("(:goal", "(:metric minimize (total-time)) (:goal", 6, "actions that take time"),
    "the metric of preferences": ("(:goal", "(:metric minimize (is-violated p)) (:goal", 6, "a preference"),
    "a trajectory": ("(and (on-table lemon", "(always (on-table lemon", 6, "not supported: a trajectory constraint"),
    "constraints": ("(:goal", "(:constraints (and)) (:goal", 6, "trajectory constraints"),
}
# fmt: on


def said(folder: Path, domain: str, problem: str) -> str:
    with pytest.raises(DomainError) as caught:
        read(folder, domain, problem)
    return str(caught.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize(("old", "new", "line", "words"), IN_DOMAIN.values(), ids=IN_DOMAIN)
def test_a_mistake_in_the_domain_is_named(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    assert DOMAIN.count(old) == 1
    message = said(tmp_path, DOMAIN.replace(old, new), PROBLEM)
    assert message.startswith(f"d.pddl: line {line}: ")
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(("old", "new", "line", "words"), IN_PROBLEM.values(), ids=IN_PROBLEM)
def test_a_mistake_in_the_problem_is_named(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    assert PROBLEM.count(old) == 1
    message = said(tmp_path, DOMAIN, PROBLEM.replace(old, new))
    assert message.startswith(f"p.pddl: line {line}: ")
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "text", ["", " ; only a comment\n", "hello", "()", "(" * 100_000, "(define ((((a", "\x00\x1b[31m("]
)
def test_what_is_no_pddl_at_all_is_one_line_too(tmp_path: Path, text: str) -> None:
    for message in (said(tmp_path, text, PROBLEM), said(tmp_path, DOMAIN, text)):
        assert message.isprintable()


def test_bytes_that_are_no_text_and_missing_files_are_named(tmp_path: Path) -> None:
    read(tmp_path)
    (tmp_path / "p.pddl").write_bytes(b"(define \xff")
    with pytest.raises(DomainError, match=r"p\.pddl: is not UTF-8"):
        read_task(tmp_path / "d.pddl", tmp_path / "p.pddl")
    with pytest.raises(DomainError, match=r"q\.pddl: there is no such file"):
        read_task(tmp_path / "d.pddl", tmp_path / "q.pddl")


def test_a_task_too_large_to_be_looked_at_is_refused(tmp_path: Path) -> None:
    many = " ".join(f"i{number}" for number in range(MOST_ATOMS))
    assert f"more than {MOST_ATOMS} fluent atoms" in said(
        tmp_path, DOMAIN, PROBLEM.replace("lemon bread", f"lemon bread {many}")
    )
    nested = "(forall (?a ?b ?c ?d ?e - object) (robot-gripper-empty))"
    few = " ".join(f"i{number}" for number in range(40))
    domain = DOMAIN.replace(PRE, f":precondition {nested}")
    assert "conditions once written out" in said(tmp_path, domain, PROBLEM.replace("lemon bread", f"lemon bread {few}"))


def test_case_order_of_sections_and_missing_parts_do_not_matter(tmp_path: Path) -> None:
    plain = read(tmp_path)
    shouting = read(tmp_path, DOMAIN.upper(), PROBLEM.upper())
    assert shouting.task == plain.task
    assert shouting.actions == plain.actions
    lines = PROBLEM.splitlines()
    moved = "\n".join([lines[0], lines[4], lines[2], lines[3], lines[1], *lines[5:]])
    assert read(tmp_path, problem=moved).task == plain.task
    predicates, action = "(:predicates (on-table ?a ?b))", "(:action f :effect (on-table lemon lemon))"
    bare = f"(define (domain grocery) {predicates} {action} (:constants lemon))"
    untyped = "(define (problem p) (:domain grocery) (:goal (on-table lemon lemon)))"
    schema = read(tmp_path, bare, untyped)
    assert schema.task.objects == {"lemon": "object"}
    assert schema.ground("f", ()).precondition.facts == Facts()


def test_a_goal_that_no_state_reaches_is_read_and_the_reason_kept(tmp_path: Path) -> None:
    line = PROBLEM[: PROBLEM.index("(:goal")].count("\n") + 1
    schema = read(tmp_path, DOMAIN, PROBLEM.replace("(on-table bread wood-table)", "(not (on-table lemon wood-table))"))
    assert schema.unreachable is not None
    assert schema.unreachable.line == line
    assert schema.task.goal == NEVER
    assert read(tmp_path, DOMAIN, PROBLEM).unreachable is None
