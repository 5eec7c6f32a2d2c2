"""The command `plan`: a plan as validators read it, and an exit code for each way not to get one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executive import cli

LAMPS = """(define (domain lamps) (:predicates (on ?x) (off ?x))
  (:action press :parameters (?x) :precondition (off ?x) :effect (and (on ?x) (not (off ?x)))))"""


@pytest.fixture
def pair(tmp_path: Path) -> list[str]:
    (tmp_path / "lamps.pddl").write_text(LAMPS)
    (tmp_path / "two.pddl").write_text(
        "(define (problem two) (:domain lamps) (:objects a b) (:init (off a) (off b)) (:goal (and (on b) (on a))))"
    )
    return [str(tmp_path / "lamps.pddl"), str(tmp_path / "two.pddl")]


def test_a_plan_is_printed_as_validators_read_it(pair: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["plan", *pair]) == 0
    assert capsys.readouterr().out.splitlines() == ["(press b)", "(press a)", "; cost = 2"]


def test_a_plan_as_json(pair: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["plan", *pair, "--json", "--optimal"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told.pop("seconds") >= 0
    assert told == {"status": "solved", "plan": ["(press b)", "(press a)"], "cost": 2.0}


def test_a_folder_is_planned_for_and_what_it_leaves_open_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["plan", "grocery", "--problem", "breakfast"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("(pick ") for line in lines)
    assert sum(line.startswith(";") and "on-table" in line for line in lines) > 0


@pytest.mark.parametrize(
    ("goal", "more", "code", "status"),
    [
        ("(and (on a) (off a))", [], 1, "unsolvable"),
        ("(on a)", ["--planner", "none-such"], 2, "refused"),
        ("(on c)", [], 2, "refused"),
    ],
)
def test_no_plan_has_a_status_and_a_reason(
    pair: list[str], goal: str, more: list[str], code: int, status: str, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = Path(pair[1])
    problem.write_text(problem.read_text().replace("(and (on b) (on a))", goal))
    assert cli.exit_code(["plan", *pair, *more, "--json"]) == code
    told = json.loads(capsys.readouterr().out)
    assert (told["status"], told["plan"], told["cost"]) == (status, None, None)
    assert told["reason"]


def test_a_planner_that_is_not_here_is_missing(pair: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["plan", *pair, "--planner", "tamer"]) == 3
    assert "fast-downward" in capsys.readouterr().err


@pytest.mark.parametrize("more", [["--time", "0"], ["--time", "nan"], ["--planner", "enhsp", "--optimal"]])
def test_options_that_cannot_be(pair: list[str], more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["plan", *pair, *more]) == 2
    assert capsys.readouterr().err.count("\n") == 1
