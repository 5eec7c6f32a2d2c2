"""What a domain has is counted, and why it is refused is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executive import cli
from executive.app.check import check
from tests.executive.symbolic.couriers import PROBLEM, write


def test_a_pair_of_files_is_counted(tmp_path: Path) -> None:
    domain, problem = write(tmp_path)
    report = check(str(domain), str(problem))
    assert (report.domain, report.problem) == ("couriers", "two")
    assert report.objects == {"place": 3, "thing": 2}
    assert report.fluents == 2 * 3 + 2 + 1 + 3
    assert (report.statics, report.true_statics) == (9, 4)
    assert report.actions == 4 + 6 + 6  # along four roads; either thing at each place
    assert report.groups == 4, "where each thing is, where the courier is, and what the hand holds"


def test_a_folder_is_counted_and_its_scene_checked() -> None:
    report = check("grocery", "one-item")
    assert report.fluents > report.groups > 0
    assert report.actions == 2 * report.objects["item"] * report.objects["table"]


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = list(map(str, write(tmp_path)))
    assert cli.exit_code(["check", *files, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["accepted"], told["refused_because"], told["line"]) == (True, None, None)
    assert (told["fluents"], told["statics"], told["actions"], told["groups"]) == (12, 9, 16, 4)
    assert told["seconds"] > 0.0
    assert cli.exit_code(["check", *files]) == 0
    assert "16" in capsys.readouterr().out
    assert cli.exit_code(["check", files[0]]) == cli.BAD_INPUT
    assert cli.exit_code(["check", *files, "--time", "0"]) == cli.BAD_INPUT


def test_what_is_refused_is_said_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = list(map(str, write(tmp_path, PROBLEM.replace("(at y b)", "\n(at y nowhere)"))))
    assert cli.exit_code(["check", *files, "--json"]) == cli.BAD_INPUT
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert (told["accepted"], told["line"], told["fluents"]) == (False, 5, None)
    assert "nowhere" in told["refused_because"]
    assert err.count("\n") == 1


def test_a_goal_that_nothing_can_make_true_is_unsolvable_in_files_and_refused_in_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    domain, problem = write(tmp_path)
    text = problem.read_text()
    problem.write_text(text.replace("(:goal (and ", "(:goal (and (road a c) "))
    assert problem.read_text() != text
    assert cli.exit_code(["check", str(domain), str(problem), "--json"]) == 0
    assert "road(a,c)" in json.loads(capsys.readouterr().out)["unreachable"]
    assert cli.exit_code(["plan", str(domain), str(problem), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "unsolvable"
