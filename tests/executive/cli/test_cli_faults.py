"""`executive faults`, and faults given to `executive run` in a file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executive import cli
from executive.faults import KINDS, parse_fault


def test_every_fault_is_listed_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["faults"]) == cli.REACHED
    told = capsys.readouterr().out
    for kind in KINDS.values():
        assert kind.example in told
        assert kind.description in told
    assert cli.exit_code(["faults", "--json"]) == cli.REACHED
    listed = json.loads(capsys.readouterr().out)
    assert (
        [parse_fault(entry["example"]).kind for entry in listed] == [entry["kind"] for entry in listed] == list(KINDS)
    )


def test_a_file_of_faults_that_is_wrong_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "faults.toml"
    file.write_text('faults = ["drop@4", "camra:front=black@3"]')
    assert cli.exit_code(["run", "grocery", "--faults", str(file)]) == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{file}: faults[1]: fault 'camra:front=black@3': no kind 'camra', did you mean 'camera'?" in error


def test_a_fault_names_what_there_is_in_the_domain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for spec, words in (
        ("camera:frnt=black@1", "no camera 'frnt', did you mean 'front'?"),
        ("block:table=wod-table@1", "no table 'wod-table', did you mean 'wood-table'?"),
    ):
        assert cli.exit_code(["run", "grocery", "--fault", spec, "--runs", str(tmp_path)]) == cli.BAD_INPUT
        assert words in capsys.readouterr().err
