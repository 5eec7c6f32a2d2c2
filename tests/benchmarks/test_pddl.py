"""The table of which planning tasks are read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.pddl import reading

DOMAIN = "(define (domain d) (:predicates (p)) (:action a :effect (p)))"
PROBLEM = "(define (problem q) (:domain d) (:goal (p)))"
TIMED = "(define (domain d) (:predicates (p))\n (:durative-action a :effect (p)))"


def test_what_is_read_and_what_is_refused_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, domain in (("plain", DOMAIN), ("timed", TIMED)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "domain.pddl").write_text(domain)
        (tmp_path / name / "q.pddl").write_text(PROBLEM)
    for part, names in (("accepted", ["plain", "plain", "timed"]), ("refused", ["timed"])):
        entries = [{"domain": f"{name}/domain.pddl", "problem": f"{name}/q.pddl"} for name in names]
        (tmp_path / f"{part}.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    assert reading.main([str(tmp_path), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["list"], row["task"], row["fluents"], row["line"]) for row in rows] == [
        ("accepted", "plain/q", 1, ""),
        ("accepted", "plain/q", 1, ""),
        ("accepted", "timed/q", 0, "line 2"),
        ("refused", "timed/q", 0, "line 2"),
    ]
    assert reading.main([str(tmp_path)]) == 0
    accepted, refused, *why = capsys.readouterr().out.splitlines()[1:]
    assert accepted.split()[:4] == ["accepted", "3", "2", "66.7%"]
    assert refused.split()[:4] == ["refused", "1", "0", "0.0%"]
    assert why[0].split() == ["accepted,", "refused", "1:", "actions", "that", "take", "time"]
