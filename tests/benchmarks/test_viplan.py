"""The benchmark of recorded answers, on a small recording of its own."""

from __future__ import annotations

import gzip
import itertools
import json
import random
from collections import Counter
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from benchmarks.viplan import __main__ as viplan
from benchmarks.viplan import arm, decoding, household, loop
from benchmarks.viplan.recorded import Answer, Look, Run, Tasks, read_runs
from executive.errors import InputError
from executive.lab.campaign.config_file import read_campaign
from executive.types import Atom

DOMAIN = """
(define (domain plates) (:requirements :strips :typing :conditional-effects :equality :negative-preconditions)
  (:types plate shelf)
  (:predicates (at ?a - plate ?s - shelf) (top ?a - plate) (on ?a ?b - plate) (left ?s ?t - shelf))
  (:action move :parameters (?a - plate ?s - shelf)
    :precondition (and (top ?a) (not (at ?a ?s)))
    :effect (and
      (forall (?b - plate) (and
        (when (on ?a ?b) (and (not (on ?a ?b)) (top ?b)))
        (when (and (at ?b ?s) (top ?b) (not (= ?a ?b))) (and (on ?a ?b) (not (top ?b))))))
      (forall (?t - shelf) (when (at ?a ?t) (not (at ?a ?t))))
      (at ?a ?s) (top ?a))))
"""
PROBLEM = """
(define (problem p) (:domain plates) (:objects X Y Z - plate U V W - shelf)
  (:init (left U V) (left V W) {init})
  (:goal (and (at x u) (at y u) (on y x) (at z w))))
"""
PLATES, SHELVES = "xyz", "uvw"
PLACED = ((("x", "y", "z"), (), ()), (("x",), ("z", "y"), ()), (("z",), ("y",), ("x",)), ((), ("y", "x", "z"), ()))


def truth(shelves: tuple[tuple[str, ...], ...]) -> dict[str, bool]:
    true = set()
    for shelf, pile in zip(SHELVES, shelves, strict=True):
        true |= {f"at({plate},{shelf})" for plate in pile} | {
            f"on({up},{down})" for down, up in itertools.pairwise(pile)
        }
        true |= {f"top({pile[-1]})"} if pile else set()
    every = [f"at({p},{s})" for p in PLATES for s in SHELVES]
    every += [f"on({p},{q})" for p in PLATES for q in PLATES] + [f"top({p})" for p in PLATES]
    return {name: name in true for name in every}


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A recording of a model that is wrong now and then, and its tasks."""
    rng = random.Random(3)
    pddl = {"domain.pddl": DOMAIN}
    rows: list[dict[str, Any]] = []
    for number, shelves in enumerate(PLACED * 3):
        held = truth(shelves)
        init = " ".join(f"({name.replace('(', ' ').replace(',', ' ')}" for name, value in held.items() if value)
        pddl[f"problems/easy/p{number}.pddl"] = PROBLEM.format(init=init)
        said = {name: value != (rng.random() < 0.06) for name, value in held.items()}
        asked = {
            name: ["yes" if value else "no", 0.9 if value else 0.3, 0.1 if value else 0.7, held[name]]
            for name, value in said.items()
        }
        plain = {name: [word, None, None, value] for name, (word, _, _, value) in asked.items()}
        first = {"kind": "all", "step": 0, "answers": plain}
        later = {"kind": "preconditions", "step": 0, "action": "move(x,v)", "worked": "success", "answers": asked}
        looks = [first, later]
        rows.append(
            {"model": "m", "split": "easy", "problem": f"p{number}.pddl", "goal_reached": False, "looks": looks}
        )
    answers, tasks = tmp_path / "answers.jsonl.gz", tmp_path / "pddl.json.gz"
    answers.write_bytes(gzip.compress("\n".join(map(json.dumps, rows)).encode()))
    tasks.write_bytes(gzip.compress(json.dumps(pddl).encode()))
    return answers, tasks


def test_whole_states_are_decoded_from_the_pddl_alone(files: tuple[Path, Path]) -> None:
    runs, tasks = read_runs(files[0]), Tasks(files[1])
    decoded = list(decoding.decode(runs, tasks))
    figures = decoding.figures(decoded)
    assert figures["states"] == len(PLACED) * 3
    assert figures["thresholded"] < figures["legal"] >= 11
    assert figures["thresholded"] <= figures["groups"] <= figures["legal"]
    assert 0.0 <= figures["brier"] < 0.05
    (row,) = decoding.table(decoded)
    assert row["split"] == "easy"


def test_nothing_of_the_problem_at_hand_is_used(files: tuple[Path, Path]) -> None:
    """What is learned for a problem is what is learned without it."""
    runs = read_runs(files[0])
    counts = decoding.Counts((run, run.looks) for run in runs)
    other = [run for run in runs if run.problem != "p0.pddl"]
    alone = decoding.Counts((run, run.looks) for run in other)
    atom = next(iter(runs[0].looks[0].answers))
    assert counts.elsewhere(("easy", "p0.pddl")).error_model(atom) == alone.elsewhere(("easy", "none")).error_model(
        atom
    )


def test_the_loop_is_played_kept_and_gone_on_with(files: tuple[Path, Path], tmp_path: Path) -> None:
    runs, tasks = read_runs(files[0]), Tasks(files[1])
    kept = tmp_path / "rows.jsonl"
    (row,) = loop.measure(runs, tasks, 1, kept)
    assert row["problems"] == len(PLACED) * 3
    assert row["simulated"] is True
    assert row[loop.WHOLE]["success"] >= 0.9
    assert row[loop.WHOLE]["success"] >= row[loop.PLAIN]["success"]
    assert row[loop.WHOLE]["false_success"] == 0.0
    assert len(kept.read_text().splitlines()) == 2 * row["problems"]
    assert loop.measure(runs, tasks, 1, kept) == [row]
    assert len(kept.read_text().splitlines()) == 2 * row["problems"], "nothing was played again"


def test_calibration_and_memory_have_a_row_for_each_model(files: tuple[Path, Path]) -> None:
    (row,) = household.measure(read_runs(files[0]))
    assert row["answers"] == len(PLACED) * 3 * len(truth(PLACED[0]))
    assert row["ece_after"] <= row["ece_before"] + 0.005
    assert set(row["repeats"]) == {"at", "on", "top"}
    for way in household.WAYS:
        assert 0.0 <= row[way]["brier"] <= 1.0


def test_what_a_model_itself_says_hides_an_atom_tells_whether_it_could_be_seen() -> None:
    inside, near, is_open = Atom.parse("inside(cup,box)"), Atom.parse("reachable(box)"), Atom.parse("open(box)")
    assert household.can_be_seen(inside, {})
    assert household.can_be_seen(inside, {near: True, is_open: True})
    assert not household.can_be_seen(inside, {near: True, is_open: False})
    assert not household.can_be_seen(is_open, {near: False})
    assert household.can_be_seen(near, {near: False})

    def look(step: int, **answers: bool) -> Look:
        atoms = {"inside": inside, "open": is_open}
        return Look("all", step, None, True, {atoms[key]: Answer(yes, None, True) for key, yes in answers.items()})

    counted: Counter[household.Answered] = Counter()
    run = Run("m", "easy", "p", True, (look(0, inside=True), look(1, open=False), look(2, inside=False)))
    segments = {atom: said for atom, _, said in household._segments(run, counted)}
    assert segments[inside] == [(True, True), (False, False)]
    assert counted == {(False, True, True): 1, (False, True, False): 1, (True, True, False): 1}
    assert (
        household._informedness({(True, True, True): 3, (True, True, False): 1, (True, False, False): 2}, True) == 0.75
    )
    assert household._informedness(counted, True) is None, "no answer about a false atom"


def test_chance_leaves_more_error_where_a_question_is_asked_often() -> None:
    probability = [0.1 + 0.8 * number / 400 for number in range(400)]
    alone = household.by_chance(probability, list(range(400)))
    repeated = household.by_chance(probability, [number // 20 for number in range(400)])
    assert 0.02 < alone < repeated


def test_it_is_one_command(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["viplan", str(files[0]), "--pddl", str(files[1]), "--seeds", "1", "--json"])
    assert viplan.main() == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"decoded", "loop", "household"}
    assert document["decoded"].keys() >= {"states", "thresholded", "groups", "legal"}


@pytest.mark.parametrize("content", [b"plain", gzip.compress(b'{"model": 1}'), gzip.compress(b"")])
def test_what_is_no_recording_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.gz").write_bytes(content)
    with pytest.raises(InputError):
        read_runs(tmp_path / "bad.gz")
    with pytest.raises(InputError):
        Tasks(tmp_path / "bad.gz")


def test_the_problems_become_a_campaign_of_the_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem = """
    (define (problem simple_problem_3) (:domain blocksworld) (:objects R G - block C1 C2 - column)
      (:init (clear R) (clear G) (inColumn R C1) (inColumn G C2) (rightOf C2 C1) (leftOf C1 C2))
      (:goal (and (on R G))))
    """
    file, out = tmp_path / "pddl.json.gz", tmp_path / "out"
    texts = {"domain.pddl": DOMAIN, "problems/simple/simple_problem_3.pddl": problem, "other.pddl": problem}
    with gzip.open(file, "wt", encoding="utf-8") as stream:
        json.dump(texts, stream)
    with patch("sys.argv", ["arm", str(file), str(out)]):
        assert arm.main() == 0
    campaign = read_campaign(out / "viplan.toml")
    played = [(each.place.domain, each.config.estimator) for each in campaign.episodes()]
    assert sorted(played) == [("columns", "oracle"), ("columns", "vlm")]
    results = tmp_path / "results"
    results.mkdir()
    with patch("sys.argv", ["arm", str(file), str(out), "--results", str(results)]):
        assert arm.main() == 2
    assert "results" in capsys.readouterr().err
