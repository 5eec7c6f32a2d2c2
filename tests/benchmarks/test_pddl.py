"""The table of which planning tasks are read."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from benchmarks.pddl import loop, reading
from executive.lab.campaign.episode import Row

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


def tasks_of(folder: Path, *names: str) -> Path:
    entries = [
        {"domain": f"{name}/domain.pddl", "problem": f"{name}/q.pddl", "status": 1 if name == "plain" else "?"}
        for name in names
    ]
    for name in {*names}:
        (folder / name).mkdir()
        (folder / name / "domain.pddl").write_text(TIMED if name == "timed" else DOMAIN)
        (folder / name / "q.pddl").write_text(PROBLEM)
    (folder / "accepted.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    return folder


def test_each_task_that_is_read_is_played_once_within_its_own_budget(tmp_path: Path) -> None:
    found = list(loop.tasks(tasks_of(tmp_path, "plain", "plain", "timed", "other")))
    assert [(str(task.place), task.fluents, task.length) for task in found] == [
        ("plain/q", 1, 1),
        ("other/q", 1, None),
    ]
    episodes = list(loop.campaign(found, 2, {"flip": 0.1, "max_seconds": 5.0}).episodes())
    assert [(episode.place.domain, episode.seed) for episode in episodes] == [
        ("plain", 0),
        ("other", 0),
        ("plain", 1),
        ("other", 1),
    ]
    assert {(episode.config.world, episode.config.flip) for episode in episodes} == {("symbolic", 0.1)}
    assert [episode.config.max_actions for episode in episodes[:2]] == [53, 350]


@pytest.mark.parametrize(
    ("values", "late"),
    [({}, False), ({"actions": 110}, False), ({"actions": 111}, True), ({"wall_seconds": 12.0}, True)],
)
def test_a_run_that_took_more_than_it_was_allowed_is_counted(
    tmp_path: Path, values: dict[str, float], late: bool
) -> None:
    (task,) = loop.tasks(tasks_of(tmp_path, "plain"))
    row = Row("plain", "q", "none", "oracle", "full", 0, "goal-reached", "", goal_true=True)
    row = dataclasses.replace(row, **values)  # type: ignore[arg-type]
    limits = {"max_actions": 100, "max_seconds": 10.0}
    place = dataclasses.replace(task.place, options={})
    made = loop.figures([row], {("plain", "q"): task._replace(place=place)}, limits)
    assert (made.runs, made.success, made.false_success, made.overrun) == (1, 1.0, 0.0, int(late))


@pytest.mark.slow
def test_a_folder_of_tasks_is_played_and_a_second_time_there_is_nothing_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(tasks_of(tmp_path, "plain")), "--out", str(tmp_path / "out"), "--seeds", "2", "--jobs", "1", "--json"]
    said = []
    for _ in range(2):
        assert loop.main(words) == 0
        said.append(json.loads(capsys.readouterr().out))
    assert said[0] == said[1]
    assert said[0]["figures"] == {
        "tasks": 1,
        "runs": 2,
        "success": 1.0,
        "false_success": 0.0,
        "overrun": 0,
        "looks": said[0]["figures"]["looks"],
    }
