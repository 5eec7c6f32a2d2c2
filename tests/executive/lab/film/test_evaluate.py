"""A scripted model is measured on a film as it deserves, from the command line to the tables."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive import cli
from executive.app.config import EstimatorConfig
from executive.domain.loader import load_subject
from executive.lab.common.folder_lock import LOCK
from executive.lab.config import EvalConfig
from executive.lab.evaluation import published
from executive.lab.film import evaluate
from executive.lab.film.evaluate import ANSWERS, KEPT, TABLES, FilmEvaluator, load_watched
from executive.lab.film.frames import Frames, read_truth
from executive.lab.film.record import TRUTH, VIDEO
from executive.s3e import Templates
from tests.executive.cli.test_cli import one_error_line
from tests.executive.lab.inline import Inline
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, completion, serving
from tests.executive.s3e.videos import greys, write_video

SUBJECT = load_subject("tabletop", "one-item")
assert SUBJECT.questions is not None
QUESTIONS = {text: atom for atom, text in Templates.read(SUBJECT.questions).translate(SUBJECT.task).text.items()}
START = frozenset(
    {
        "in-table-section(green-mug,white)", "in-table-section(water-bottle,white)",
        "in-table-section(soda-can,white)", "in-table-section(spray-bottle,blue)", "robot-gripper-empty()",
    }
)  # fmt: skip


def say(request: Request) -> Response:
    """Says of every frame what is so in the first one."""
    if request.question not in QUESTIONS:  # whether it answers at all
        return completion({"Yes": 0.9, "No": 0.1})
    yes = 0.9 if str(QUESTIONS[request.question]) in START else 0.1
    return completion({"Yes": yes, "No": 1.0 - yes})


@pytest.fixture(scope="module")
def server() -> Iterator[ChatServerUnderTest]:
    with serving(say) as running:
        yield running


@pytest.fixture(scope="module")
def truth(film: Path) -> Frames:
    return read_truth(film / TRUTH, SUBJECT.task.atoms)


def expected(truth: Frames, rows: Any) -> dict[str, float]:
    """What a model deserves that says of every frame what is so in the first one."""
    said = np.array([str(atom) in START for atom in truth.atoms])
    right = truth.truth[rows] == said
    return {"accuracy_0.5": right.mean(), "exact_state": right.all(axis=1).mean(), "looks": len(right)}


def check(part: dict[str, Any], wanted: dict[str, float]) -> None:
    for key, value in wanted.items():
        assert part[key] == pytest.approx(value), key


def test_a_film_is_scored_over_all_frames_and_at_mid_poses(
    film: Path, truth: Frames, server: ChatServerUnderTest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["eval", "tabletop", str(film), "--problem", "one-item", "--server", server.url, "--out", str(out)]
    assert cli.exit_code([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    for part, rows in (
        ("frames", slice(None)), ("mid_poses", truth.mid_pose), ("during_actions", ~truth.mid_pose),
    ):  # fmt: skip
        check(document[part], expected(truth, rows))
        assert 0.0 <= document[part]["ap_macro"] <= 1.0
        assert document["with_memory"][part]["looks"] == document[part]["looks"]
    left = {path.name for path in out.iterdir() if path.name != LOCK}
    assert left == {"evaluation.json", TABLES, ANSWERS}
    assert {path.name for path in (out / ANSWERS).iterdir()} == {"film.npz", "film.png", "film.rrd"}
    watched = load_watched(out / ANSWERS / "film.npz", "film")
    assert np.array_equal(watched.truth, truth.truth)
    assert np.isfinite(watched.remembered).all()
    text = " ".join((out / TABLES).read_text(encoding="utf-8").split())
    assert text.count("> tiny |") == text.count("> tiny Mid-poses") == 2, "in both tables"
    assert "72B Mid-poses" in text


def test_an_interrupted_evaluation_goes_on_with_the_films_that_are_missing(
    film: Path, server: ChatServerUnderTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    films = tmp_path / "films"
    for name in ("film-000", "film-001"):
        shutil.copytree(film, films / name)
    config = EvalConfig("tabletop", films, EstimatorConfig(server=server.url), problem="one-item")
    out = tmp_path / "out"
    out.mkdir()
    stopped = FilmEvaluator(config, out)
    seen: list[str] = []
    original = evaluate.Watcher.__call__

    def watching(self: Any, clip: Any, tell: Any) -> Any:
        seen.append(clip.name)
        stopped.cancel()
        return original(self, clip, tell)

    monkeypatch.setattr(evaluate.Watcher, "__call__", watching)
    with Inline(stopped.watcher, 1) as pool:
        assert stopped.run(pool) is None
    assert len(seen) == 1
    assert (out / KEPT / f"{seen[0]}.npz").exists()
    going_on = FilmEvaluator(config, out)
    with Inline(going_on.watcher, 1) as pool:
        document = going_on.run(pool)
    assert document is not None
    assert sorted(seen) == ["film-000", "film-001"], "neither was watched twice"
    assert document["films"] == 2
    assert document["name"] == "tiny"
    assert "Table 2" in going_on.tell(document)
    assert published.read(SUBJECT.pddl.parent) is not None


def test_one_video_is_scored_against_a_table_of_intervals(
    film: Path, truth: Frames, server: ChatServerUnderTest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "mine.csv"
    lines = [f"{atom},0," for atom in sorted(START)]
    table.write_text("\n".join(["atom,from,to", *lines, "mid-pose,0,0.5"]))
    command = ["estimate", "tabletop", "--problem", "one-item", "--server", server.url, "--every", "0.4"]
    command += ["--video", str(film / VIDEO), "--out", str(tmp_path / "out")]
    assert cli.exit_code([*command, "--truth", str(table), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    for part in (document, document["with_memory"]):
        assert part["frames"]["exact_state"] == part["mid_poses"]["exact_state"] == 1.0
    assert document["mid_poses"]["looks"] == 2
    assert document["frames"]["looks"] == len(document["answers"]) == -(-len(truth.times) // 2)
    assert all(set(each) == {"time", "seconds", "atoms", "with_memory"} for each in document["answers"])
    assert Path(document["recording"]).stat().st_size > 10_000
    assert cli.exit_code([*command, "--truth", str(film / TRUTH), "--atoms", "robot-gripping"]) == 0
    out = capsys.readouterr().out
    assert "tiny Mid-poses" in out
    assert "with memory" not in out, "it is about all atoms"


def test_what_is_wrong_is_one_line_and_leaves_nothing(
    film: Path, server: ChatServerUnderTest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    estimate = ["estimate", "tabletop", "--problem", "one-item", "--server", server.url, "--out", out]
    films = ["eval", "tabletop", str(film), "--server", server.url, "--out", out]
    long = write_video(tmp_path / "long.mp4", greys(25), rate=2)
    broken = tmp_path / "broken.mp4"
    broken.write_bytes((film / VIDEO).read_bytes()[:3000])
    truth, video = ["--truth", str(film / TRUTH)], ["--video", str(film / VIDEO)]
    for command, words in (
        ([*estimate, *truth, "--image", str(film)], "--truth: goes with --video"),
        ([*estimate, *video, *truth, "--question", "Is it?"], "--truth: is of atoms"),
        ([*estimate, *video, "--truth", str(tmp_path / "none.csv")], "none.csv"),
        ([*estimate, *video, "--truth", str(film / VIDEO)], "no Parquet file"),
        ([*estimate, "--video", str(broken), *truth], "broken.mp4"),
        ([*films, "--disturb", "noisy=40"], "--disturb: is for collected pictures"),
        ([*films, "--cameras", "hand"], "there is no camera 'hand'"),
        (["eval", "grocery", str(film), "--server", server.url, "--out", out], "is a film of the domain 'tabletop'"),
    ):
        assert cli.exit_code(command) == 2
        assert words in one_error_line(capsys)
        assert not Path(out).exists()
    assert cli.exit_code([*estimate, "--video", str(long), *truth, "--every", "4"]) == 2
    assert "the truth says nothing of 12.00 s into the film" in capsys.readouterr().err
