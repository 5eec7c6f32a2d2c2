"""A phrase for each code, which has the code's parameters in it."""

from __future__ import annotations

import ast
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given

from executive import core
from executive.trace.phrases import REASONS, why
from executive.types import Atom, Cause, Decision, DecisionKind, Reason, SkillStatus
from tests.executive.trace.strategies import causes

FULL = Cause(
    Reason.RECORDED,
    atoms=(Atom("at", ("a", "p")), Atom("free")),
    ages=(3, None),
    literals=("not at(a,p)", "free()"),
    steps=("pick(a,p)",),
    status=SkillStatus.DROPPED,
    what="looks",
    count=7,
    total=11.0,
    seconds=2.5,
    detail="the hand is empty",
    probabilities=(0.75, 0.25),
    costs=(0.5, 1.5),
)
"""A cause with every parameter."""

PARAMETERS: dict[Reason, str] = {
    Reason.CANNOT_TELL: "atoms ages",
    Reason.UNKNOWN_AS_FALSE: "atoms",
    Reason.HIDDEN: "atoms",
    Reason.NOTHING_SEEN: "count steps",
    Reason.PRECONDITION_UNMET: "steps literals atoms",
    Reason.WAITING: "count",
    Reason.TRIED_ANYWAY: "atoms",
    Reason.SKILL_DONE: "steps",
    Reason.SKILL_FAILED: "steps status detail seconds",
    Reason.SKILL_FAILED_YET_SEEN: "steps status detail seconds",
    Reason.SKILL_CRASHED: "steps detail",
    Reason.STEP_FAILED: "steps",
    Reason.EFFECT_MISSING: "atoms",
    Reason.SEEN_INSTEAD: "atoms",
    Reason.UNEXPECTED: "atoms",
    Reason.PLAN_INVALID: "steps",
    Reason.FOUND_OTHERWISE: "atoms",
    Reason.STEPS_UNNEEDED: "count total",
    Reason.RETRY: "count total",
    Reason.FAILED_WITH_SAME_FACTS: "count",
    Reason.FAILED_TOO_OFTEN: "count",
    Reason.LOOK_FIRST: "literals probabilities costs",
    Reason.LOOK_ELSEWHERE: "literals probabilities costs",
    Reason.PLAN_FOUND: "count",
    Reason.UNSOLVABLE: "steps detail count",
    Reason.PLANNER_TIMED_OUT: "steps detail count",
    Reason.PLANNER_CRASHED: "steps detail count",
    Reason.UNCERTAIN: "atoms",
    Reason.OPTIMISTIC_PLAN: "atoms",
    Reason.PLAN_CLEARS: "atoms",
    Reason.GOAL_GIVEN_UP: "literals",
    Reason.GOAL_KEPT: "literals",
    Reason.GOAL_UNCERTAIN: "atoms",
    Reason.GOAL_NOT_SEEN: "atoms",
    Reason.GOAL_UNKNOWN: "atoms",
    Reason.GOAL_RECALLED: "atoms",
    Reason.TO_BE_SEEN: "atoms",
    Reason.GOAL_ONLY_BELIEVED: "atoms count",
    Reason.DONE_AGAIN: "atoms",
    Reason.REACHABLE_AGAIN: "literals",
    Reason.GIVEN_UP_BEFORE: "literals",
    Reason.BUDGET_SPENT: "what total",
    Reason.INTERRUPTED: "what detail",
    Reason.STAGE_FAILED: "what detail",
    Reason.RECORDED: "detail",
}
"""The parameters that each code has, as `Reason` says; the others have none."""


def test_each_code_has_a_phrase_of_its_own() -> None:
    assert set(REASONS) == set(Reason)
    phrases = [why([replace(FULL, code=code)]) for code in Reason if code is not Reason.STAGE_FAILED]
    assert all(phrases)
    assert len(set(phrases)) == len(phrases)


@pytest.mark.parametrize("code", Reason)
def test_a_phrase_has_the_parameters_of_its_code_and_no_others(code: Reason) -> None:
    full = replace(FULL, code=code)
    without: dict[str, Any] = {field.name: field.default for field in fields(Cause) if field.name != "code"}
    used = {name for name, value in without.items() if why([full]) != why([replace(full, **{name: value})])}
    assert used == set(PARAMETERS.get(code, "").split())


def test_the_page_of_reasons_has_each_code_with_its_parameters() -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "reasons.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z-]+)` \| [^|]+ \| ([^|]*)\|$", page, flags=re.MULTILINE)
    names = {field.name for field in fields(Cause)}
    shown = {code: {name for name in re.findall(r"`(\w+)`", told) if name in names} for code, told in rows}
    assert shown == {str(code): set(PARAMETERS.get(code, "").split()) for code in Reason}


@given(causes)
def test_the_reasons_of_a_decision_are_told_in_their_order(some: tuple[Cause, ...]) -> None:
    text, at = why(Decision(DecisionKind.CONTINUE, some)), 0
    for cause in some:
        phrase = why([cause])
        at = text.index(phrase, at) + len(phrase)


def test_what_there_is_too_much_of_is_counted() -> None:
    atoms = tuple(Atom("at", (name, "p")) for name in "abcdef")
    text = why([Cause(Reason.EFFECT_MISSING, atoms)])
    assert [str(atom) in text for atom in atoms] == [True] * 4 + [False] * 2
    assert "2 more" in text


def test_every_code_is_given_by_the_loop_or_by_a_reader_of_old_records() -> None:
    """Read from the sources, as the tests of the policy come to most codes but not to all in one place."""
    given: set[str] = set()
    for file in Path(core.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Reason":
                given.add(node.attr)
    assert {code.name for code in Reason} - given == {Reason.RECORDED.name}


def test_no_decision_is_put_into_words_where_it_is_made() -> None:
    """Core has no English for decisions: a cause is given codes, and texts of parts from outside."""
    for file in Path(core.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Cause":
                texts = [str(each.value) for each in ast.walk(node) if isinstance(each, ast.Constant)]
                assert not [text for text in texts if " " in text], f"{file.name}:{node.lineno}"
