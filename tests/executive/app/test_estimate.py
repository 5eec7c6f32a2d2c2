"""The command `estimate`: what it prints can be asked again by anyone."""

from __future__ import annotations

import json
import shutil
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Picture

from executive import cli
from executive.app import estimators
from executive.app.config import EstimatorConfig
from executive.app.estimate import Session, choose, read_images, tell_video
from executive.domain.loader import load_subject
from executive.errors import InputError
from executive.s3e.backends.openai_backend import data_url
from executive.s3e.backends.openai_replies import KEY
from executive.s3e.calibration import Calibration, Scaling
from executive.s3e.questions.prompts import GROCERY_INSTRUCTIONS, QUESTION_ANSWERING
from executive.s3e.video import read_frames
from executive.types import Atom
from tests.executive.app.estimating import ANSWER, GROCERY, LEMON, Estimate, estimating, printed, say, write_pictures
from tests.executive.cli.test_cli import one_error_line
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, as_json, completion, serving
from tests.executive.s3e.videos import greys, write_video


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


# The document


def test_the_document_has_everything_and_nothing_else(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate(*LEMON, "--image", pictures[1], "--json") == 0
    document = printed(capsys)
    assert set(document) == {"model", "system_prompt", "images", "seconds", "atoms"}
    assert document["model"] == "tiny"
    assert document["images"] == [str(pictures[1])]
    assert document["seconds"] >= 0
    assert document["system_prompt"].startswith(QUESTION_ANSWERING)
    assert "lemon" in document["system_prompt"]  # the domain's instructions
    atoms = {str(atom) for atom in load_subject("grocery", "one-item").task.atoms}
    assert set(document["atoms"]) == atoms
    wood = document["atoms"]["on-table(lemon,wood-table)"]
    assert set(wood) == ANSWER
    assert wood["answered"] is True
    assert (wood["yes_mass"], wood["no_mass"]) == pytest.approx((0.9, 0.05))
    assert wood["probability"] == pytest.approx(0.9 / 0.95)
    assert wood["question"] == "Is the lemon standing or lying on the wooden table?"
    empty = document["atoms"]["robot-gripper-empty()"]
    assert empty["answered"] is False
    assert empty["probability"] is None
    assert empty["why"] == "only 10% of the probability is on either answer; it would rather say 'maybe' (90%)"


def test_an_outsider_can_ask_the_same_again(
    estimate: Estimate, pictures: list[Path], server: ChatServerUnderTest, capsys: pytest.CaptureFixture[str]
) -> None:
    """With nothing but the document and an HTTP client."""
    files = [word for file in pictures for word in ("--image", file)]
    assert estimate(*LEMON, *files, "--json", "--question", "Is it wood?", "--atoms", "on-table") == 0
    document = printed(capsys)
    assert set(document["questions"]) == {"Is it wood?"}
    urls = {
        f"<image {number}>": data_url(np.asarray(Picture.open(file)))
        for number, file in enumerate(document["images"], start=1)
    }
    for asked in (*document["atoms"].values(), *document["questions"].values()):
        messages = json.loads(asked["prompt"])
        assert messages[0]["content"] == document["system_prompt"]
        assert messages[1]["content"][-1]["text"] == asked["question"]
        for part in messages[1]["content"][:-1]:
            part["image_url"]["url"] = urls[part["image_url"]["url"]]
        body = {"model": document["model"], "messages": messages, "max_tokens": 1, "logprobs": True, "top_logprobs": 20}
        request = urllib.request.Request(f"{server.url}/chat/completions", json.dumps(body).encode())
        top = json.load(urllib.request.urlopen(request))["choices"][0]["logprobs"]["content"][0]["top_logprobs"]
        yes = sum(np.exp(each["logprob"]) for each in top if each["token"].strip().lower() == "yes")
        no = sum(np.exp(each["logprob"]) for each in top if each["token"].strip().lower() == "no")
        assert (asked["yes_mass"], asked["no_mass"]) == pytest.approx((yes, no))


def test_the_key_is_nowhere_in_it(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY, "sk-SECRET")
    assert estimate(*LEMON, "--image", pictures[0], "--json") == 0
    assert "SECRET" not in "".join(capsys.readouterr())


def test_a_question_alone_is_asked_alone(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate("--image", pictures[0], "--question", "Is it wood?", "--question", "Is it black?", "--json") == 0
    document = printed(capsys)
    assert document["atoms"] == {}
    assert list(document["questions"]) == ["Is it wood?", "Is it black?"]
    assert set(document["questions"]["Is it wood?"]) == ANSWER


def test_pictures_are_shown_together_or_one_by_one(
    estimate: Estimate, pictures: list[Path], server: ChatServerUnderTest, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [word for file in pictures for word in ("--image", file)]
    wood = ("--atoms", "on-table(lemon,wood-table)", "--json")
    assert estimate(*LEMON, *files, *wood) == 0
    together = printed(capsys)["atoms"]["on-table(lemon,wood-table)"]
    assert len(server.requests[-1].images) == 2
    assert estimate(*LEMON, *files, *wood, "--per-image") == 0
    alone = printed(capsys)["atoms"]["on-table(lemon,wood-table)"]
    assert len(server.requests[-1].images) == 1
    assert together["probability"] == pytest.approx(0.65 / 0.95)
    assert alone["probability"] == pytest.approx((0.4 / 0.95 + 0.9 / 0.95) / 2)
    assert [view["image"] for view in alone["views"]] == ["dark", "light"]
    assert [view["yes_mass"] for view in alone["views"]] == pytest.approx([0.4, 0.9])
    assert "views" not in together


def test_without_instructions_the_model_is_told_the_papers_prompt_alone(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate(*LEMON, "--image", pictures[0], "--no-instructions", "--json") == 0
    assert printed(capsys)["system_prompt"] == QUESTION_ANSWERING


def test_the_papers_settings(
    estimate: Estimate,
    pictures: list[Path],
    server: ChatServerUnderTest,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One picture, the paper's own words of how things look, and an answer to whatever there is of one."""
    own = tmp_path / "own.md"
    own.write_text("All is dark.")
    shown = [word for file in pictures for word in ("--image", file)]
    for told, said in (("paper", GROCERY_INSTRUCTIONS), (own, "All is dark."), ("none", ""), ("domain", "lemon is")):
        before = len(server.requests)
        settings = ("--cameras", "light", "--no-abstention", "--instructions", told)
        assert estimate(*LEMON, *shown, *settings, "--json") == 0
        document = printed(capsys)
        assert document["system_prompt"].startswith(QUESTION_ANSWERING)
        assert said in document["system_prompt"]
        assert (document["system_prompt"] == QUESTION_ANSWERING) == (told == "none")
        assert {image.mean() for request in server.requests[before:] for image in request.images} == {255}
        faint = document["atoms"]["robot-gripper-empty()"]
        assert (faint["probability"], faint["answered"]) == (0.5, True)
        assert faint["yes_mass"] == pytest.approx(0.05)


def test_without_translation_predicates_are_shown_and_true_or_false_asked_for(
    pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    def judge(request: Request) -> Response:
        return completion({"True": 0.7, "false": 0.2} if request.images else {"Yes": 1.0})

    with serving(judge) as running:
        arguments = ["estimate", "grocery", *LEMON, "--image", str(pictures[0]), "--server", running.url]
        assert cli.exit_code([*arguments, "--translator", "none", "--json"]) == 0
    document = printed(capsys)
    wood = document["atoms"]["on-table(lemon,wood-table)"]
    assert wood["question"] == "on-table(lemon,wood-table)"
    assert wood["probability"] == pytest.approx(7 / 9)
    assert "(define (domain grocery)" in document["system_prompt"]


def test_a_language_model_at_the_server_words_the_questions_once(
    pictures: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "cache_folder", lambda: tmp_path / "cache")

    def word(request: Request) -> Response:
        if "logprobs" in request.body:
            return say(request)
        atom = Atom.parse(request.question)
        if atom.predicate != "on-table":
            return completion({"As": 1.0}, "As a language model I cannot say.")
        item, table = atom.args
        return completion({"Is": 1.0}, f"Does the {item} rest on the {table.replace('-', ' ')}?")

    with serving(word, ["seer", "writer"]) as running:
        command = ["estimate", "grocery", *LEMON, "--image", str(pictures[0]), "--server", running.url, "--vlm", "seer"]
        command += ["--translator", "llm", "--llm", "writer", "--json"]
        assert cli.exit_code(command) == 0
        out, err = capsys.readouterr()
        worded = [request for request in running.requests if "logprobs" not in request.body]
        assert {request.body["model"] for request in worded} == {"writer"}
        assert {request.body["model"] for request in running.requests if "logprobs" in request.body} == {"seer"}
        asked = json.loads(out)["atoms"]
        assert asked["on-table(lemon,wood-table)"]["question"] == "Does the lemon rest on the wood table?"
        assert asked["robot-gripper-empty()"]["question"] == "Is the robot's gripper empty?"  # the template's
        assert err.count("warning: ") == err.count("\n") > 0
        assert "robot-gripper-empty()" in err
        before = len(worded)
        assert cli.exit_code(command) == 0
        assert len([request for request in running.requests if "logprobs" not in request.body]) == before
    assert list((tmp_path / "cache").iterdir())


def test_probabilities_are_corrected_and_that_is_said(
    estimate: Estimate, pictures: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = Calibration(predicates={"on-table": Scaling(1.0, -2.0)}).save(tmp_path / "correction.json")
    assert estimate(*LEMON, "--image", pictures[1], "--calibration", file, "--json") == 0
    document = printed(capsys)
    assert document["calibrated"] is True
    wood = document["atoms"]["on-table(lemon,wood-table)"]
    assert wood["probability"] < 0.8 < wood["yes_mass"] / (wood["yes_mass"] + wood["no_mass"])


# What a person sees


def test_a_person_gets_a_line_for_each_atom_by_predicate(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate(*LEMON, "--image", pictures[1], "--question", "Is it black?", "--atoms", "*") == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].startswith("tiny, 1 picture, ")
    assert "0.95  █████████·  on-table(lemon,wood-table)   Is the lemon standing or lying on the wooden table?" in lines
    unanswered = next(line for line in lines if "robot-gripper-empty()" in line)
    assert unanswered.startswith("   ? ")
    assert unanswered.endswith(
        "(unanswered: only 10% of the probability is on either answer; it would rather say 'maybe' (90%))"
    )
    assert lines[-1].strip() == "0.11  █·········  Is it black?"
    assert len([line for line in lines if not line]) == 4  # below the head, and between four groups


def test_no_answer_at_all_is_exit_code_1(pictures: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    def fail(request: Request) -> Response:
        return say(request) if not request.images else as_json({"error": {"message": "no such picture"}}, 400)

    with serving(fail) as running:
        command = ["estimate", "grocery", *LEMON, "--image", str(pictures[0]), "--server", running.url]
        assert cli.exit_code(command) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert out.count("unanswered: the server answers with status 400: no such picture") == 5


# Which atoms


def test_a_pattern_without_end_is_refused() -> None:
    with pytest.raises(InputError, match=r"a pattern has 100,000 characters, and may have 1,000"):
        choose(GROCERY.atoms, ["[" * 100_000])


@given(st.sets(st.sampled_from(GROCERY.atoms), min_size=1))
def test_every_atom_is_chosen_by_its_own_name(atoms: set[Atom]) -> None:
    chosen = choose(GROCERY.atoms, [str(atom) for atom in atoms])
    assert set(chosen) == atoms
    assert list(chosen) == [atom for atom in GROCERY.atoms if atom in atoms]


@pytest.mark.parametrize(
    ("patterns", "count"),
    [
        ([], 25),
        (["*"], 25),
        (["on-table(*,wood-table)"], 6),
        (["on-table( * , wood-table )"], 6),
        (["On-Table(LEMON,*)"], 3),
        (["on-table(lemon,[bw]*)"], 3),
        (["on-table"], 18),
        (["robot-*"], 7),
        (["robot-gripper-empty"], 1),
        (["robot-gripper-empty()"], 1),
        (["*(lemon*"], 4),
        (["on-table(lemon,*)", "*(lemon*"], 4),
    ],
)
def test_patterns(patterns: list[str], count: int) -> None:
    assert len(choose(GROCERY.atoms, patterns)) == count


def test_a_pattern_that_matches_nothing_is_one_line_with_the_nearest(
    estimate: Estimate, pictures: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate("--image", pictures[0], "--atoms", "on-table(lemno,wood-table)") == 2
    said = one_error_line(capsys)
    assert "no atom matches 'on-table(lemno,wood-table)'; the nearest is on-table(lemon,wood-table)" in said
    assert "robot-gripper-empty" in said


def test_pictures_with_the_same_name_keep_apart(tmp_path: Path, pictures: list[Path]) -> None:
    (tmp_path / "a").mkdir()
    for place in (tmp_path / "dark.png", tmp_path / "a" / "dark.png"):
        shutil.copy(pictures[0], place)
    names = list(read_images([pictures[0], tmp_path / "dark.png", tmp_path / "a" / "dark.png", pictures[1]]))
    assert names == ["dark", "dark-2", "dark-3", "light"]


# A video


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "a clip.mp4", greys(20))


def test_a_video_is_estimated_frame_after_frame(
    estimate: Estimate, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "made" / "for it"
    assert estimate(*LEMON, "--video", clip, "--every", "0.5", "--out", out, "--json") == 0
    document = printed(capsys)
    heads = {"model", "system_prompt", "video", "every", "plot", "recording", "seconds", "frames"}
    assert set(document) == heads
    assert [frame["time"] for frame in document["frames"]] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    wood = [frame["atoms"]["on-table(lemon,wood-table)"] for frame in document["frames"]]
    assert all(set(each) == ANSWER for each in wood)
    shades = [0, 50, 100, 150]
    assert [each["yes_mass"] for each in wood] == pytest.approx([0.4 + 0.5 * shade / 255 for shade in shades], abs=0.02)
    with Picture.open(document["plot"]) as plot:
        assert plot.format == "PNG"
    assert Path(document["recording"]).stat().st_size > 10_000
    assert {path.name for path in out.iterdir()} == {"a clip-estimate.png", "a clip-estimate.rrd"}


def test_a_video_without_frames_leaves_nothing_behind(
    estimate: Estimate, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = write_video(tmp_path / "empty.avi", greys(2))
    whole = empty.read_bytes()
    empty.write_bytes(whole[: whole.index(b"movi") + 4])  # the frames come after this word
    assert estimate(*LEMON, "--video", empty, "--out", tmp_path / "out") == 2
    assert one_error_line(capsys).endswith("empty.avi: has no frames")
    assert not (tmp_path / "out").exists()


def test_a_video_of_which_nothing_was_found_leaves_nothing_behind(
    server: ChatServerUnderTest, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session("grocery", "one-item", EstimatorConfig(server=server.url))

    def interrupted(self: Session, images: object) -> Estimate:
        raise KeyboardInterrupt

    monkeypatch.setattr(Session, "look", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tell_video(session, clip, read_frames(clip, 0.5), 0.5, tmp_path / "out", as_json=False)
    assert list(tmp_path.iterdir()) == []


def test_a_person_sees_what_changes(
    estimate: Estimate, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--video", clip, "--atoms", "on-table(lemon,*)", "--atoms", "robot-gripper-empty", "--out", tmp_path)
    assert estimate(*LEMON, *arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = [line.strip() for line in out.splitlines()]
    # Yes to wood outweighs no at a brightness of 38.
    assert lines[:4] == [
        "0.00 s  robot-gripper-empty() unanswered",
        "0.50 s  on-table(lemon,wood-table) true",
        "1.00 s  -",
        "1.50 s  -",
    ]
    assert f"plot: {tmp_path / 'a clip-estimate.png'}" in lines
    assert lines[-1].startswith(f"recording: {tmp_path / 'a clip-estimate.rrd'} (to play it: rerun '")


def test_what_was_seen_before_a_video_breaks_off_is_kept(
    server: ChatServerUnderTest, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(path: Path, every: float) -> Iterator[tuple[float, Any]]:
        yield 0.0, greys(1)[0]
        raise InputError("breaks off after 0.0 s", file=path)

    monkeypatch.setattr("executive.s3e.video.read_frames", breaks)
    command = ["estimate", "grocery", *LEMON, "--video", "clip.mp4", "--out", str(tmp_path), "--server", server.url]
    assert cli.exit_code(command) == 2
    out, err = capsys.readouterr()
    assert err == "error: clip.mp4: breaks off after 0.0 s\n"
    assert out.strip().startswith("0.00 s")
    assert {path.name for path in tmp_path.iterdir()} == {"clip-estimate.png", "clip-estimate.rrd"}
