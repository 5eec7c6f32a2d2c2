"""Whole runs in the simulator that see through a model: behind a server or in this process, good or hopeless."""

from __future__ import annotations

import json
import math
import shlex
import threading
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executive import cli
from executive.app.config import EstimatorConfig
from executive.app.run import Run, RunConfig, read_config
from executive.errors import InputError
from executive.replay.comparison import compare_run
from executive.s3e.backends.openai_replies import KEY
from executive.s3e.questions.prompts import GROCERY_INSTRUCTIONS
from executive.trace.report.summary import Summary
from executive.types import Belief, Dispatched, Ended, Looked, Observation, OutcomeKind, Questions, Started
from tests.executive.cli.test_cli import FakeRun, ends, one_error_line
from tests.executive.s3e.chat_server import Request, Response, completion, serving
from tests.executive.s3e.checkpoints import build
from tests.executive.sim.stage import ROOT
from tests.fakes import Recorder

TRAY = ROOT / "tests" / "domains" / "tray"
SECRET = "sk-THE-KEY-1234567890"


class Judge:
    """Answers as the simulator has it, once it knows the run; before that, and to whatever is no question of the run,
    neither yes nor no. The loop waits for the answer meanwhile, so that the simulator stands still."""

    def __init__(self) -> None:
        self.run: Run | None = None
        self.pictures: list[int] = []
        self.broken = False
        self._alone = threading.Lock()

    def __call__(self, request: Request) -> Response:
        if not request.images:
            return completion({"Yes": 0.9, "No": 0.1})
        self.pictures.append(len(request.images))
        questions = self.run.executive.observer.questions if self.run is not None else None
        if self.broken or self.run is None or questions is None:
            return completion({"Hm": 1.0})
        atoms = {text: atom for atom, text in questions.text.items()}
        atom = atoms[request.question]
        with self._alone:  # questions come at the same time, and the simulator's state is no thing to share
            truth = self.run.truth.of([atom])[atom]
        return completion({"Yes": 0.9, "no": 0.1} if truth else {"yes": 0.1, "NO": 0.9})


@pytest.fixture
def seen(tmp_path: Path) -> Iterator[Callable[..., tuple[Run, Recorder]]]:
    """Puts a run of the tray together that sees through a model."""
    made: list[Run] = []

    def prepare(eye: EstimatorConfig, **options: Any) -> tuple[Run, Recorder]:
        recorder = Recorder()
        settings = {"estimator": "vlm", "runs": tmp_path / "runs", "viewer": False, "name": "x", "max_actions": 8}
        made.append(Run(RunConfig(**{"domain": str(TRAY), "eye": eye, **settings, **options}), [recorder]))
        return made[-1], recorder

    yield prepare
    for run in made:
        run.world.close()


def of(recorder: Recorder, kind: type[Any]) -> list[Any]:
    return [event.payload for event in recorder.events if isinstance(event.payload, kind)]


def test_a_model_that_sees_well_reaches_the_goal_through_a_server(
    seen: Callable[..., tuple[Run, Recorder]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY, SECRET)
    judge = Judge()
    with serving(judge) as server:
        run, recorder = seen(EstimatorConfig(server=server.url), viewer=True)
        judge.run = run
        summary = run.execute()
        sent = {request.headers["Authorization"] for request in server.requests}
    assert summary["outcome"] == OutcomeKind.GOAL_REACHED
    assert summary["goal_seen"] is True
    assert summary["goal_true"] is True
    assert summary["estimator"] == "s3e:tiny"
    assert len(of(recorder, Dispatched)) == 4
    cameras = {len(observation.images) for observation in of(recorder, Observation)}
    assert set(judge.pictures) == cameras  # every look shows all cameras together
    # The record says what was asked, what the answers rest on, and how to do it again, and tells no key.
    (questions,) = of(recorder, Questions)
    assert set(questions.text) == set(run.domain.task.atoms)
    assert all(belief.evidence.keys() == belief.probability.keys() for belief in of(recorder, Belief))
    assert of(recorder, Started)[0].estimator == "s3e:tiny"
    config = tomllib.loads((run.folder / "config.toml").read_text())
    assert config["estimator"] == "vlm"
    assert config["eye"] == {
        "server": server.url,
        "translator": "templates",
        "instructions": True,
        "per_image": False,
        "cameras": [],
        "abstention": True,
    }
    assert sent == {f"Bearer {SECRET}"}
    files = [file for file in run.folder.rglob("*") if file.is_file()]
    assert len(files) > 5
    assert not [file for file in files if SECRET.encode() in file.read_bytes()]


def test_the_papers_settings_decide_what_is_asked_and_are_kept(
    seen: Callable[..., tuple[Run, Recorder]],
) -> None:
    """One camera, the paper's own instructions, and an answer to whatever there is of one. What reads the run's
    configuration again goes on like that."""
    judge = Judge()
    eye = EstimatorConfig(cameras=("front",), abstention=False, instructions="paper")

    def faint(request: Request) -> Response:
        told = json.loads(judge(request).body)["choices"][0]["logprobs"]["content"][0]["top_logprobs"]
        return completion({"Hm": 0.9, **{top["token"]: math.exp(top["logprob"]) / 10 for top in told}})

    with serving(faint) as server:
        run, recorder = seen(replace(eye, server=server.url), domain="grocery", problem="one-item", max_actions=1)
        judge.run = run
        run.execute()
        (questions,) = of(recorder, Questions)
        assert questions.system.endswith(GROCERY_INSTRUCTIONS)
        assert {request.system for request in server.requests if request.images} == {questions.system}
    assert len(of(recorder, Dispatched)) == 1
    assert set(judge.pictures) == {1}
    shown = {camera for observation in of(recorder, Observation) for camera in observation.images}
    assert shown == {"front"} == {camera for looked in of(recorder, Looked) for camera in looked.cameras}
    assert read_config(run.folder).eye == replace(eye, server=server.url)
    compared = compare_run(run.folder)
    assert compared.replays[0].decisions == compared.records[0].decisions


def test_a_camera_that_is_none_is_one_line(seen: Callable[..., tuple[Run, Recorder]]) -> None:
    with pytest.raises(InputError, match="cameras: there is no camera 'fornt'; did you mean 'front'"):
        seen(EstimatorConfig(server="http://127.0.0.1:9", cameras=("fornt",)))


@pytest.mark.parametrize("after", [0, 1])
def test_a_model_that_stops_answering_ends_the_run_by_name(
    seen: Callable[..., tuple[Run, Recorder]], after: int
) -> None:
    judge = Judge()
    with serving(judge) as server:
        run, recorder = seen(EstimatorConfig(server=server.url))
        judge.run = run
        recorder_write = recorder.write

        def write(event: Any) -> None:
            recorder_write(event)
            judge.broken = judge.broken or len(of(recorder, Dispatched)) >= after

        recorder.write = write  # type: ignore[method-assign]
        judge.broken = after == 0
        summary = run.execute()
    assert summary["outcome"] in {OutcomeKind.GAVE_UP, OutcomeKind.NO_PLAN, OutcomeKind.PARTIAL}
    assert summary["goal_seen"] is False
    assert len(of(recorder, Dispatched)) == after
    assert of(recorder, Ended)[0].causes


def test_a_server_that_goes_away_ends_the_run_by_name(seen: Callable[..., tuple[Run, Recorder]]) -> None:
    with serving(Judge()) as server:
        run, recorder = seen(EstimatorConfig(server=server.url))
    summary = run.execute()
    assert summary["outcome"] == OutcomeKind.GAVE_UP
    assert of(recorder, Dispatched) == []
    for belief in of(recorder, Belief):
        assert belief.unanswered == frozenset(run.domain.task.atoms)
        assert all("connection" in evidence.error.lower() for views in belief.evidence.values() for evidence in views)


@pytest.mark.parametrize("translator", ["templates", "none"])
def test_a_random_checkpoint_fails_by_name(
    seen: Callable[..., tuple[Run, Recorder]], tmp_path: Path, translator: str
) -> None:
    folder = build("fastvlm", tmp_path / "tiny-fastvlm", seed=1)
    run, recorder = seen(EstimatorConfig(vlm=str(folder), translator=translator, instructions=False), max_replans=3)
    summary: Summary = run.execute()
    assert OutcomeKind(summary["outcome"]) not in {OutcomeKind.CRASHED, OutcomeKind.INTERRUPTED}
    assert summary["estimator"] == "s3e:tiny-fastvlm"
    (questions,) = of(recorder, Questions)
    assert questions.answers == (("yes", "no") if translator == "templates" else ("true", "false"))
    assert len(of(recorder, Ended)) == 1


def test_a_model_that_is_none_leaves_no_folder(seen: Callable[..., tuple[Run, Recorder]], tmp_path: Path) -> None:
    for eye in (EstimatorConfig(vlm=str(tmp_path)), EstimatorConfig(server="http://127.0.0.1:9")):
        with pytest.raises(InputError):
            seen(eye)
    assert not (tmp_path / "runs").exists()


# The command line


def test_every_option_reaches_the_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("executive.app.run.Run", FakeRun)
    monkeypatch.setattr(FakeRun, "meanwhile", staticmethod(ends(OutcomeKind.GOAL_REACHED)))
    line = (
        "run grocery --quiet --estimator vlm --vlm seer --server http://127.0.0.1:9/v1 --translator llm --llm writer "
        f"--no-instructions --per-image --calibration {tmp_path / 'correction.json'} --cameras front,left "
        "--cameras hand --no-abstention"
    )
    assert cli.exit_code(shlex.split(line)) == 0
    corrected, shown = tmp_path / "correction.json", ("front", "left", "hand")
    eye = EstimatorConfig("seer", "http://127.0.0.1:9/v1", "llm", "writer", False, True, corrected, shown, False)
    assert FakeRun.last.config == RunConfig("grocery", estimator="vlm", eye=eye)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--estimator oracle --vlm seer", "--vlm and --server go with --estimator vlm"),
        ("--estimator none --server http://127.0.0.1:9", "--vlm and --server go with --estimator vlm"),
        ("--estimator vlm --server http://me:pw@127.0.0.1:9", "scheme, host, port and path alone"),
        ("--estimator vlm --server http://127.0.0.1:9", "no server answers there"),
        ("--estimator vlm --vlm nowhere/at/all", "no such folder"),
        ("--estimator vmm", "did you mean 'vlm'?"),
    ],
)
def test_what_does_not_go_together_is_one_line(
    line: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.exit_code(["run", "grocery", "--quiet", "--runs", str(tmp_path / "runs"), *line.split()]) == 2
    assert said in one_error_line(capsys)
    assert not (tmp_path / "runs").exists()


def test_the_record_can_be_read_by_anyone(seen: Callable[..., tuple[Run, Recorder]]) -> None:
    """Questions and masses as plain JSON, a line an event."""
    judge = Judge()
    with serving(judge) as server:
        run, _ = seen(EstimatorConfig(server=server.url), max_actions=1)
        judge.run = run
        run.execute()
    events = [json.loads(line) for line in (run.folder / "events.jsonl").read_text().splitlines()]
    (questions,) = [event["data"] for event in events if event["type"] == "Questions"]
    assert set(questions["text"]) == set(map(str, run.domain.task.atoms))
    assert any(event["type"] == "Belief" and event["data"]["evidence"] for event in events)


def test_a_domain_without_an_eye_of_its_own_says_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["run", str(TRAY), "--quiet", "--runs", str(tmp_path / "runs")]) == 2
    said = one_error_line(capsys)
    assert "--vlm" in said
    assert "executive train tray" in said
    assert not (tmp_path / "runs").exists()
