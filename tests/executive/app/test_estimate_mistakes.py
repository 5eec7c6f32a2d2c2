"""The command `estimate`: whatever is wrong is one line, and nothing is loaded before it is needed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from executive import cli
from executive.app import estimators
from executive.app.config import EstimatorConfig
from executive.errors import InputError
from executive.s3e.calibration import Calibration, Scaling
from executive.s3e.calibration_file import FILE
from tests.executive.app.estimating import ANSWER, LEMON, Estimate, estimating, say, write_pictures
from tests.executive.cli.test_cli import one_error_line
from tests.executive.s3e.chat_server import ChatServerUnderTest, completion, serving
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.videos import greys, write_video
from tests.executive.sim.stage import ROOT
from tests.executive.test_imports import HEAVY, loaded_by


@pytest.fixture(scope="module")
def server() -> Iterator[ChatServerUnderTest]:
    with serving(say) as running:
        yield running


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_pictures(tmp_path_factory.mktemp("pictures"))


@pytest.fixture
def estimate(server: ChatServerUnderTest) -> Estimate:
    return estimating(server)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "a clip.mp4", greys(20))


# Whatever is wrong


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "pass pictures with --image, or a video with --video"),
        (["--image", "{dark}", "--video", "clip.mp4"], "pass pictures with --image, or a video with --video"),
        (["--image", "{here}/nothing.png"], "nothing.png: there is no such file"),
        (["--image", "{here}/empty.png"], "empty.png: is empty"),
        (["--image", "{here}/text.png"], "text.png: is no picture"),
        (["--image", "{here}"], "is a folder; wanted a picture"),
        (["--video", "{here}/text.png"], "text.png: is no video"),
        (["--video", "{clip}", "--every", "0"], "--every: expected seconds"),
        (["--video", "{clip}", "--out", "{dark}"], "dark.png: --out: nothing can be written there"),
        (["--video", "{clip}", "--out", "{dark}/below"], "below: --out: nothing can be written there"),
        (["--video", "{clip}", "--cameras", "front"], "--cameras: chooses among several pictures"),
        (["--image", "{dark}", "--cameras", "light"], "--cameras: there is no camera 'light'; valid: dark"),
        (
            ["--image", "{dark}", "--instructions", "papr"],
            "there is no file 'papr'; or, of the words: did you mean 'paper'?",
        ),
        (["--image", "{dark}", "--instructions", "paper", "--no-instructions"], "--no-instructions: does not go with"),
        (["--image", "{dark}", "--instructions", "{here}/empty.png"], "empty.png: is empty"),
        (["--image", "{dark}", "--calibration", "{here}/other.json"], "other.json: format: expected 2, got 3"),
        (["--image", "{dark}", "--translator", "lmm"], "--translator: no translator 'lmm'; did you mean 'llm'?"),
        (["--image", "{dark}", "--llm", "writer"], "--llm: goes with --translator llm"),
        (["--image", "{dark}", "--problem", "breakfst"], "did you mean 'breakfast'?"),
        (["--image", "{dark}", "--question", "one\ntwo"], "--question: 'one\\ntwo' is not a line of text"),
        (["--image", "{dark}", "--question", " "], "--question: ' ' is not a line of text"),
        (["--image", "{dark}", "--calibration", "{here}/text.png"], "text.png: is not JSON"),
    ],
)
def test_what_is_wrong_is_one_line(
    arguments: Sequence[str],
    said: str,
    estimate: Estimate,
    pictures: list[Path],
    clip: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("hello, I am no picture")
    (tmp_path / "other.json").write_text('{"format": 3, "domains": {}}')
    filled = [each.format(dark=pictures[0], here=tmp_path, clip=clip) for each in arguments]
    assert estimate(*filled) == 2
    assert said in one_error_line(capsys)


def test_pddl_without_objects_is_one_line(
    estimate: Estimate, pictures: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "domain.pddl").write_text("(define (domain d) (:predicates (on ?a ?b)))")
    (tmp_path / "problem.pddl").write_text("(define (problem p) (:domain d) (:init) (:goal (and)))")
    assert estimate("--image", pictures[0], domain=tmp_path) == 2
    assert "no objects" in one_error_line(capsys)


def test_no_model_is_one_line_that_says_what_to_pass(pictures: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    """The tray has no eye of its own."""
    assert cli.exit_code(["estimate", str(ROOT / "tests" / "domains" / "tray"), "--image", str(pictures[0])]) == 2
    said = one_error_line(capsys)
    assert "--vlm" in said
    assert "--server" in said


@pytest.mark.parametrize(
    ("server", "said"),
    [
        ("http://127.0.0.1:9/v1", "http://127.0.0.1:9/v1: no server answers there"),
        ("127.0.0.1:9", "--server: is not a server's address"),
        ("http://me:secret@127.0.0.1:9/v1", "--server: a server's address is scheme, host, port and path alone"),
    ],
)
def test_a_server_that_is_not_there_is_one_line(
    server: str, said: str, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.exit_code(["estimate", "grocery", "--image", str(pictures[0]), "--server", server]) == 2
    line = one_error_line(capsys)
    assert said in line
    assert "secret" not in line


def test_a_server_that_gives_no_logprobs_is_one_line(pictures: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    with serving(lambda request: completion({}, text="yes")) as running:
        assert cli.exit_code(["estimate", "grocery", "--image", str(pictures[0]), "--server", running.url]) == 2
    assert one_error_line(capsys).startswith(f"{running.url}: the reply has no logprobs")


# A checkpoint in this process


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("fastvlm", tmp_path_factory.mktemp("checkpoint") / "tiny-fastvlm")


def test_a_checkpoint_answers_in_this_process(
    checkpoint: Path, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["estimate", "grocery", *LEMON, "--image", str(pictures[1]), "--vlm", str(checkpoint), "--json"]
    assert cli.exit_code(command) in (0, 1)
    document = json.loads(capsys.readouterr().out)
    assert document["model"] == "tiny-fastvlm"
    wood = document["atoms"]["on-table(lemon,wood-table)"]
    assert set(wood) - {"why"} == ANSWER
    assert "<|im_start|>system\n" + document["system_prompt"] in wood["prompt"]  # as the model's template renders it
    assert wood["question"] in wood["prompt"]
    assert 0 < wood["yes_mass"] + wood["no_mass"] <= 1


def test_a_correction_beside_the_checkpoint_is_taken(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(checkpoint, tmp_path / "corrected")
    assert estimators.load_calibration(EstimatorConfig(vlm=str(folder))) is None
    Calibration(Scaling(2.0, 1.0)).save(folder)
    assert estimators.load_calibration(EstimatorConfig(vlm=str(folder))) == Calibration(Scaling(2.0, 1.0))
    assert estimators.load_calibration(EstimatorConfig(vlm=str(folder), server="http://127.0.0.1:9")) is None
    (folder / FILE).write_text("{")
    with pytest.raises(InputError, match="is not JSON"):
        estimators.load_calibration(EstimatorConfig(vlm=str(folder)))


@pytest.mark.parametrize("damage", ["no such folder", "no config", "another kind", "cut off", "no weights"])
def test_a_checkpoint_that_is_none_is_one_line(
    damage: str, checkpoint: Path, pictures: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(checkpoint, tmp_path / "damaged")
    weights, config = folder / "model.safetensors", folder / "config.json"
    match damage:
        case "no such folder":
            shutil.rmtree(folder)
        case "no config":
            config.unlink()
        case "another kind":
            config.write_text(json.dumps({"model_type": "bert"}))
        case "cut off":
            weights.write_bytes(weights.read_bytes()[:-1000])
        case "no weights":
            weights.unlink()
    assert cli.exit_code(["estimate", "grocery", "--image", str(pictures[0]), "--vlm", str(folder)]) == 2
    assert one_error_line(capsys).startswith(str(folder))


# What it costs to import


@pytest.mark.parametrize(
    "statement",
    [
        "import executive.app.estimate, executive.app.estimators",
        "import executive.s3e.backends.openai_client, executive.s3e.backends.openai_backend",
        "import executive.s3e.calibration, executive.s3e.reliability",
        "import executive.s3e.pictures, executive.s3e.video, executive.trace.report.chart",
    ],
)
def test_what_is_needed_later_is_loaded_later(statement: str) -> None:
    assert loaded_by(statement).isdisjoint((HEAVY | {"httpx2", "sklearn", "av", "platformdirs"}) - {"pydantic"})


def test_help_loads_nothing_heavy() -> None:
    modules = loaded_by("from executive.cli import exit_code; exit_code(['estimate', '--help'])")
    assert modules.isdisjoint(HEAVY - {"typer", "pydantic", "rich"})
