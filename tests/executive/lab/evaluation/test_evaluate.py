"""A scripted model is measured as it deserves, from the command line to the report."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from executive import cli
from executive.app.config import EstimatorConfig
from executive.domain.loader import load_subject
from executive.errors import InputError
from executive.lab.common.progress import Progress
from executive.lab.config import EvalConfig
from executive.lab.evaluation import report as reporting
from executive.lab.evaluation import store
from executive.lab.evaluation.evaluate import FRUITLESS, Evaluation, Evaluator, row_name
from executive.lab.evaluation.looks import Look, Observer, Opened, Said
from executive.lab.evaluation.metrics import Answers
from executive.lab.evaluation.mistakes import Mistakes
from executive.lab.evaluation.published import Published
from executive.s3e import Templates
from executive.s3e.questions.prompts import GROCERY_INSTRUCTIONS
from executive.types import Atom, Belief
from tests.executive.cli.test_cli import one_error_line
from tests.executive.lab import looks
from tests.executive.lab.inline import Inline
from tests.executive.s3e.chat_server import ChatServerUnderTest, serving

SUBJECT = load_subject(looks.TRAY)
assert SUBJECT.questions is not None
QUESTIONS = {text: atom for atom, text in Templates.read(SUBJECT.questions).translate(SUBJECT.task).text.items()}
RED_IN_TRAY = Atom.parse("resting-on(red-cube,tray)")
Say = Callable[[int, Atom, bool], float | None]

OTHER_WORDS = """
[questions]
resting-on = ["Does the {2} carry the {1}?", "Would I find the {cube} on the {support}?"]
holding = ["Has the hand got the {cube}?"]
hand-free = ["Does the hand hold nothing?"]
[objects]
red-cube = ["red block"]
"""
NAMES = (("red-cube", "red block"), ("green-cube", "green cube"))
SUPPORTS = ("bench", "tray")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return looks.write(tmp_path / "data")


@pytest.fixture
def model() -> Iterator[Callable[..., ChatServerUnderTest]]:
    """Starts servers with a scripted model."""
    running = []

    def start(say: Say = lambda number, atom, truth: None, questions: Any = QUESTIONS) -> ChatServerUnderTest:
        context = serving(looks.knowing(questions, say))
        running.append(context)
        return context.__enter__()

    yield start
    for context in running:
        context.__exit__(None, None, None)


def config(server: ChatServerUnderTest, data: Path, **options: Any) -> EvalConfig:
    return EvalConfig(str(looks.TRAY), data, EstimatorConfig(server=server.url), **options)


def here(evaluator: Evaluator) -> Inline[Look, Opened | Said]:
    """Looks are taken in this process, one after the other."""
    return Inline(evaluator.looker, 1)


def evaluated(config: EvalConfig) -> tuple[Evaluation, Evaluator]:
    with Evaluator(config) as evaluator:
        made = evaluator.run(here(evaluator))
    assert made is not None
    return made, evaluator


def test_one_who_knows_scores_as_one_who_knows(data: Path, model: Any) -> None:
    made, evaluator = evaluated(config(model(), data))
    document = store.document(made)
    for key in ("ap_micro", "ap_macro", "accuracy_0.3", "accuracy_0.5", "accuracy_0.7", "exact_state"):
        assert document[key] == 1.0, key
    assert document["ece"] == pytest.approx(0.02, abs=1e-3)
    assert (document["looks"], document["unanswered"], document["missed"]) == (len(looks.STATES), 0, 0)
    assert document["seconds_per_look"] > 0.0
    assert made.looks == tuple((point.episode, point.step) for point in looks.points())
    assert [bool(each) for each in made.surprising] == [number == 4 for number in range(6)]
    assert made.name == "tiny + Instruct + Pose"
    truth = np.array([[atom in state for atom in made.answers.atoms] for state in looks.STATES])
    assert np.array_equal(made.answers.truth, truth)
    # Nothing is wrong, so that the sheet has what came nearest to it.
    assert all(not answer.wrong for mistake in evaluator.mistakes.sheet() for answer in mistake.answers)


def test_what_a_run_would_believe_is_scored_beside_the_answers(data: Path, model: Any, tmp_path: Path) -> None:
    def unsure(number: int, atom: Atom, truth: bool) -> float | None:
        return 0.6 if (number, atom) == (0, RED_IN_TRAY) else None  # it is in the hand, which is surely so

    made, _ = evaluated(config(model(unsure), data))
    document = store.save(tmp_path, made)
    believed = document["posterior"]
    assert document["exact_state"] == pytest.approx(5 / 6)
    assert (believed["exact_state"], believed["asked"]) == (1.0, document["asked"])
    assert believed["ap_micro"] == pytest.approx(1.0)
    assert store.document(store.load(tmp_path)) == document
    rows = [row for table in reporting.rows({made.name: made}, None) for row in table.rows]
    assert [row.name for row in rows] == ["tiny + Instruct + Pose", "tiny, as believed + Instruct + Pose"]


def test_what_no_run_could_carry_out_is_evaluated_all_the_same(data: Path, model: Any, tmp_path: Path) -> None:
    alone = tmp_path / "tray"
    alone.mkdir()
    for name in ("domain.pddl", "problem.pddl", "questions.toml"):
        shutil.copy(looks.TRAY / name, alone / name)
    warned: list[str] = []
    settings = replace(config(model(), data), domain=str(alone))
    with Evaluator(settings, warned.append) as evaluator:
        made = evaluator.run(here(evaluator))
    assert made is not None
    assert made.posterior is None
    assert "posterior" not in store.document(made)
    assert store.document(made)["exact_state"] == 1.0
    assert len([line for line in warned if line.startswith("what a run would believe")]) == 1


def test_a_mistake_is_counted_and_shown(data: Path, model: Any) -> None:
    def wrong(number: int, atom: Atom, truth: bool) -> float | None:
        return 0.9 if (number, atom) == (4, RED_IN_TRAY) else None

    made, evaluator = evaluated(config(model(wrong), data))
    document = store.document(made)
    assert document["exact_state"] == pytest.approx(5 / 6)
    assert (document["false_alarms"], document["missed"]) == (1, 0)
    assert document["atoms"][str(RED_IN_TRAY)]["accuracy_0.5"] == pytest.approx(5 / 6)
    assert document["predicates"]["holding"]["accuracy_0.5"] == 1.0
    assert document["looks_by_action"]["expected"]["exact_state"] == 1.0
    assert document["looks_by_action"]["surprising"]["exact_state"] == 0.0
    worst = evaluator.mistakes.sheet()[0]
    assert (worst.episode, worst.step, worst.cameras) == (1, 2, looks.CAMERAS)
    assert [(each.atom, each.truth, each.wrong) for each in worst.answers] == [(RED_IN_TRAY, False, True)]
    assert worst.answers[0].probability == pytest.approx(0.9)
    assert QUESTIONS[worst.answers[0].question] == RED_IN_TRAY
    assert looks.number_of(worst.picture[:, : worst.picture.shape[1] // 3]) == 4


def test_what_no_picture_can_show_is_neither_scored_nor_shown_as_a_mistake(
    data: Path, model: Any, tmp_path: Path
) -> None:
    domain = tmp_path / "tray"
    shutil.copytree(looks.TRAY, domain)
    manifest = (domain / "domain.toml").read_text(encoding="utf-8")
    covered = manifest.replace("[predicates.resting-on]", '[predicates.resting-on]\nvisible = "(hand-free)"')
    (domain / "domain.toml").write_text(covered, encoding="utf-8")

    def wrong(number: int, atom: Atom, truth: bool) -> float | None:
        return 0.9 if number in (4, 5) and atom == RED_IN_TRAY else None  # in 5, the hand holds something

    made, evaluator = evaluated(replace(config(model(wrong), data), domain=str(domain)))
    document = store.document(made)
    assert document["false_alarms"] == 1
    assert document["exact_state"] == pytest.approx(5 / 6)
    free = sum(Atom("hand-free") in state for state in looks.STATES)
    resting = sum(atom.predicate == "resting-on" for atom in made.answers.atoms)
    assert document["predicates"]["resting-on"]["asked"] == free * resting
    assert document["predicates"]["holding"]["accuracy_0.5"] == 1.0
    shown = [answer for mistake in evaluator.mistakes.sheet() for answer in mistake.answers if answer.wrong]
    assert [answer.atom for answer in shown] == [RED_IN_TRAY]
    (tmp_path / "kept").mkdir()
    store.save(tmp_path / "kept", made)
    kept = store.load(tmp_path / "kept")
    assert np.array_equal(kept.answers.asked, made.answers.asked)
    assert kept.answers.has_columns


def test_the_first_looks_alone(data: Path, model: Any) -> None:
    made, _ = evaluated(config(model(), data, looks=4))
    assert made.looks == ((0, 1), (0, 2), (0, 3), (1, 1))


def test_other_wordings_are_asked_and_drawn_by_seed(data: Path, model: Any, tmp_path: Path) -> None:
    file = tmp_path / "other.toml"
    file.write_text(OTHER_WORDS, encoding="utf-8")
    said = {f"Would I find the {n} on the {s}?": Atom("resting-on", (c, s)) for c, n in NAMES for s in SUPPORTS}
    said |= {f"Does the {s} carry the {n}?": Atom("resting-on", (c, s)) for c, n in NAMES for s in SUPPORTS}
    said |= {f"Has the hand got the {n}?": Atom("holding", (c,)) for c, n in NAMES}
    said |= {"Does the hand hold nothing?": Atom("hand-free")}
    server = model(questions=said)
    made, _ = evaluated(config(server, data, paraphrases=file))
    assert store.document(made)["exact_state"] == 1.0
    assert made.name == "tiny (paraphrased) + Instruct + Pose"
    asked = [request.question for request in server.requests if request.images]
    assert set(asked) == set(said)
    again = model(questions=said)
    evaluated(config(again, data, paraphrases=file))
    assert sorted(asked) == sorted(request.question for request in again.requests if request.images)
    other = model(questions=said)
    evaluated(config(other, data, paraphrases=file, seed=1))
    assert sorted(asked) != sorted(request.question for request in other.requests if request.images)


def test_pictures_are_compressed_when_told(data: Path, model: Any) -> None:
    made, _ = evaluated(config(model(), data, disturb=("jpeg=40",), looks=2))
    assert made.name == "tiny (jpeg=40) + Instruct + Pose"
    assert store.document(made)["exact_state"] == 1.0


def test_the_papers_settings_are_measured_and_kept(data: Path, model: Any) -> None:
    server = model()
    eye = EstimatorConfig(server=server.url, cameras=(looks.CAMERAS[1],), abstention=False, instructions="paper")
    with Evaluator(replace(config(server, data, looks=2), eye=eye)) as evaluator:
        pool = here(evaluator)
        made = evaluator.run(pool)
        assert isinstance(pool.work, Observer)
        assert pool.work.eye.least_mass == 0.0
    assert made is not None
    assert made.name == "tiny (paper) + Instruct + Pose"
    kept = store.document(made)["about"]
    assert (kept["cameras"], kept["abstention"], kept["instructions"]) == ([looks.CAMERAS[1]], False, "paper")
    assert kept["system_prompt"].endswith(GROCERY_INSTRUCTIONS)
    assert {len(request.images) for request in server.requests} == {0, 1}
    with pytest.raises(InputError, match="cameras: there is no camera 'nowhere'"):
        Evaluator(replace(config(server, data), eye=replace(eye, cameras=("nowhere",))))


def test_an_unanswered_atom_is_wrong_and_nothing_else(data: Path, model: Any) -> None:
    made, _ = evaluated(config(model(lambda number, atom, truth: 2.0 if atom == RED_IN_TRAY else None), data))
    document = store.document(made)
    assert document["unanswered"] == len(looks.STATES)
    assert document["exact_state"] == 0.0
    assert document["accuracy_0.5"] == pytest.approx(1 - 1 / len(SUBJECT.task.atoms))
    assert np.isnan(made.answers.of(RED_IN_TRAY).probability).all()


def test_a_model_that_says_nothing_any_more_is_given_up(data: Path, model: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr("executive.lab.evaluation.evaluate.FRUITLESS", 3)
    assert FRUITLESS > 3
    silent = config(model(lambda number, atom, truth: 2.0 if number >= 2 else None), data)
    with Evaluator(silent) as evaluator, pytest.raises(InputError, match="no answer in 3 looks in a row: too little"):
        evaluator.run(here(evaluator))


def test_cancelled_after_the_look_at_hand(data: Path, model: Any) -> None:
    server = model()
    with Evaluator(config(server, data)) as evaluator:

        def watch(progress: Progress) -> None:
            if progress.points == 2:
                evaluator.cancel()

        assert evaluator.run(here(evaluator), watch=watch) is None
    assert {looks.number_of(request.images[0]) for request in server.requests if request.images} == {0, 1}


@pytest.mark.parametrize(
    ("about", "name"),
    [
        ({}, "eye"),
        ({"instructions": True, "data": {"home_pose": True}}, "eye + Instruct + Pose"),
        ({"translator": "none", "data": {"home_pose": True}}, "eye (no trans) + Pose"),
        ({"translator": "llm", "instructions": True}, "eye + Instruct"),
        ({"instructions": "some/own.md"}, "eye (own.md) + Instruct"),
        ({"instructions": "paper", "data": {"home_pose": True}}, "eye (paper) + Instruct + Pose"),
        ({"disturb": ["lights", "jpeg=40"], "per_image": True}, "eye (one by one, lights, jpeg=40)"),
        ({"paraphrases": "p.toml", "rename": False}, "eye (paraphrased, same names)"),
    ],
)
def test_rows_are_named_as_the_papers(about: dict[str, Any], name: str) -> None:
    bare: dict[str, Any] = {"translator": "templates", "per_image": False, "paraphrases": None, "rename": True}
    bare |= {"disturb": [], "instructions": False, "data": {"home_pose": False}}
    assert row_name("eye", bare | about) == name


def test_the_command_is_read_back(data: Path, tmp_path: Path) -> None:
    file = tmp_path / "p q.toml"
    eye = EstimatorConfig(vlm="m", instructions=False, per_image=True)
    made = EvalConfig("d", data, eye, "one", 5, file, False, ("lights", "jpeg=40"), 3)
    assert made.command.startswith("executive eval d ")
    for part in ("--problem one", "--vlm m", "--looks 5", "--seed 3", "--disturb lights --disturb jpeg=40"):
        assert part in made.command
    assert set(shlex.split(made.command)) >= {"--no-instructions", "--per-image", "--no-rename"}
    eye = EstimatorConfig(server="http://h/v1", instructions="own.md", cameras=("front", "hand"), abstention=False)
    assert shlex.split(EvalConfig("d", data, eye).command)[4:] == [
        *(
            "--server",
            "http://h/v1",
            "--instructions",
            "own.md",
            "--cameras",
            "front",
            "--cameras",
            "hand",
            "--no-abstention",
        )
    ]
    assert f"'{file}'" in made.command


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"looks": 0}, "looks: "),
        ({"seed": -1}, "seed: "),
        ({"disturb": ("light",)}, "did you mean 'lights'"),
        ({"rename": False}, "rename: needs `paraphrases`"),
        ({"paraphrases": Path("x"), "eye": EstimatorConfig(vlm="m", translator="none")}, "paraphrases: "),
    ],
)
def test_options_that_make_no_sense(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        EvalConfig(**{"domain": "d", "data": Path("x"), "eye": EstimatorConfig(vlm="m"), **options})


# Files and the report.


def test_what_is_saved_is_read_back(data: Path, model: Any, tmp_path: Path) -> None:
    made, _ = evaluated(config(model(lambda n, atom, truth: 2.0 if (n, atom) == (1, RED_IN_TRAY) else None), data))
    told = store.save(tmp_path, made)
    again = store.load(tmp_path)
    assert store.document(again) == told == json.loads((tmp_path / store.RESULTS).read_text())
    assert np.array_equal(again.answers.probability, made.answers.probability, equal_nan=True)
    assert np.isnan(again.answers.probability).sum() == 1
    (tmp_path / store.ANSWERS).write_bytes((tmp_path / store.ANSWERS).read_bytes()[:100])
    with pytest.raises(InputError, match="damaged"):
        store.load(tmp_path)
    with pytest.raises(InputError, match="holds no evaluation"):
        store.load(tmp_path / "data")


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("all of it")
    with pytest.raises(InputError, match="holds something else"), store.claimed(tmp_path, "eval"):
        pytest.fail("never gets here")
    fresh = tmp_path / "a" / "b"
    with store.claimed(fresh, "eval"):
        assert fresh.is_dir()
    assert not fresh.exists()


def simple(name: str, probability: list[list[float]], truth: list[list[bool]]) -> Evaluation:
    atoms = tuple(Atom("p", (f"a{index}",)) for index in range(len(truth[0])))
    about = {
        **{"domain": "x <y>", "data": {"folder": "d", "seed": 1, "home_pose": True}, "instructions": True},
        **{"translator": "none", "per_image": True, "calibrated": True, "paraphrases": "p", "rename": False},
        **{"disturb": ["lights"], "command": "executive eval <x>", "system_prompt": "A & B"},
    }
    answers = Answers(atoms, np.array(probability), np.array(truth))
    places = tuple((0, step) for step in range(answers.looks))
    return Evaluation(name, about, answers, places, np.arange(answers.looks) % 2 == 0, np.ones(answers.looks))


NAN = math.nan


@pytest.mark.parametrize(
    ("probability", "truth"),
    [
        ([[0.9, 0.1]], [[True, False]]),
        ([[NAN, NAN]], [[True, False]]),
        ([[0.2, 0.1], [NAN, 0.8]], [[False, False], [False, False]]),
        ([[1.0]] * 30, [[True]] * 30),
    ],
)
def test_a_report_is_written_whatever_the_answers(
    probability: list[list[float]], truth: list[list[bool]], tmp_path: Path
) -> None:
    one = simple("<eye>", probability, truth)
    reporting.write(tmp_path, one, beside=[one] if one.answers.looks < 3 else [])
    page = (tmp_path / reporting.REPORT).read_text(encoding="utf-8")
    assert "&lt;eye&gt;" in page
    assert "<eye>" not in page
    assert "executive eval &lt;x&gt;" in page
    assert re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", page)) is None
    assert reporting.summary(store.document(one), tmp_path).endswith(reporting.REPORT)


def test_the_report_needs_nothing_from_outside(data: Path, model: Any, tmp_path: Path) -> None:
    def bad(number: int, atom: Atom, truth: bool) -> float | None:
        return 1.0 - truth if number % 2 else None

    made, evaluator = evaluated(config(model(bad), data))
    other, _ = evaluated(config(model(), data))
    columns = ["accuracy_0.5", "ap_macro"]
    table: dict[str, Any] = {"name": "Table 9", "title": "old", "rows": {"7B + Instruct + Pose": [0.5, 0.25]}}
    published = Published.model_validate(
        {"source": "Them.", "columns": columns, "curves": ["holding(red-cube)"], "table": [table]}
    )
    reporting.write(tmp_path, made, evaluator.mistakes.sheet(), [other], published)
    page = (tmp_path / reporting.REPORT).read_text(encoding="utf-8")
    assert re.findall(r"""(?:src|href)=["'](?!data:)""", page) == []
    assert re.findall(r"<link|<script|<iframe|@import|url\(", page) == []
    for text in ("Table 9: old", "Them.", "7B + Instruct + Pose", "tiny + Instruct + Pose #2", "The worst answers"):
        assert text in page
    assert page.count('class="mistake"') == len(evaluator.mistakes.sheet())
    for name in (reporting.CURVES, reporting.PRECISIONS, reporting.RELIABILITY, reporting.SHEET):
        with Picture.open(tmp_path / name) as picture:
            assert min(picture.size) > 100


def test_the_sheet_has_the_worst_of_each_episode_and_atom() -> None:
    chance, sheet = np.random.default_rng(0), Mistakes(most=3)
    errors: dict[tuple[int, Atom], float] = {}
    (point,) = looks.points()[:1]
    for number in range(40):
        probability = {atom: float(chance.uniform()) for atom in point.facts}
        now = replace(point, episode=number % 5, step=number)
        sheet.add(now, Belief(number, probability), lambda now=now: now.images, {})  # type: ignore[misc]
        error, atom = max((abs(value - point.facts[atom]), atom) for atom, value in probability.items())
        errors[now.episode, atom] = max(error, errors.get((now.episode, atom), 0.0))
    kept = [mistake.error for mistake in sheet.sheet()]
    assert kept == sorted(errors.values(), reverse=True)[:3]


# The command line.


def run(data: Path, server: ChatServerUnderTest, *more: object) -> int:
    return cli.exit_code(["eval", str(looks.TRAY), str(data), "--server", server.url, *map(str, more)])


def test_the_command_prints_a_summary_and_writes_the_report(
    data: Path, model: Any, tmp_path: Path, capsys: Any
) -> None:
    out = tmp_path / "made"
    assert run(data, model(), "--out", out) == cli.REACHED
    printed, progress = capsys.readouterr()
    assert "6 of 6 looks" in progress
    assert "1.000 micro, 1.000 macro (over atoms)" in printed
    assert str(out / reporting.REPORT) in printed
    assert {file.name for file in out.iterdir()} >= {store.RESULTS, store.ANSWERS, reporting.REPORT, reporting.SHEET}
    # Again into the same folder, beside itself, and as JSON.
    assert run(data, model(), "--out", out, "--beside", out, "--json", "--no-instructions") == cli.REACHED
    told = json.loads(capsys.readouterr().out)
    assert told["name"] == "tiny + Pose"
    assert told["report"] == str(out / reporting.REPORT)
    keys = {"ap_micro", "ap_macro", "accuracy_0.3", "accuracy_0.5", "accuracy_0.7", "exact_state", "ece", "looks"}
    assert told.keys() >= keys | {"seconds_per_look", "brier", "predicates", "atoms"}
    assert "tiny + Instruct + Pose" in (out / reporting.REPORT).read_text(encoding="utf-8")


def test_without_a_folder_it_chooses_one(data: Path, model: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(data, model()) == cli.REACHED
    (made,) = (tmp_path / "evaluations").iterdir()
    assert made.name.endswith("-tray-data")


def test_ctrl_c_says_so_and_keeps_the_looks_that_were_taken(
    data: Path, model: Any, tmp_path: Path, capsys: Any
) -> None:
    orders = [signal.SIGINT]

    def interrupt(number: int, atom: Atom, truth: bool) -> float | None:
        if not orders:
            return None
        if number == 3:
            os.kill(os.getpid(), orders.pop())
        return 0.9 if truth else 0.1

    server, out = model(interrupt), tmp_path / "made"
    assert run(data, server, "--out", out) == cli.INTERRUPTED
    printed, told = capsys.readouterr()
    assert printed == ""
    assert "Traceback" not in told
    last = told.splitlines()[-1]
    assert last.startswith("interrupted; the looks that were taken are kept, continue with: executive eval ")
    assert not (out / store.RESULTS).exists()
    before = len(server.requests)
    assert orders == []
    assert cli.exit_code(shlex.split(last.partition("executive ")[2])) == cli.REACHED
    again = [looks.number_of(request.images[0]) for request in server.requests[before:] if request.images]
    assert set(again) <= {3, 4, 5}
    probability = store.load(out).answers.probability
    assert set(np.unique(probability[:3].round(6))) == {0.1, 0.9}
    assert set(np.unique(probability[4:].round(6))) == {0.02, 0.98}
    assert not (out / store.KEPT).exists()


def test_an_interruption_before_the_first_look_leaves_nothing(
    data: Path, model: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    """Twice while the first look is under way. Never more often: an order that came after the end would kill pytest."""
    acknowledged, first = threading.Event(), threading.Lock()
    cancel = Evaluator.cancel

    def acknowledge(evaluator: Evaluator) -> None:
        cancel(evaluator)
        acknowledged.set()

    def interrupt(number: int, atom: Atom, truth: bool) -> float | None:
        if first.acquire(blocking=False):
            os.kill(os.getpid(), signal.SIGTERM)
            assert acknowledged.wait(60.0)
            os.kill(os.getpid(), signal.SIGTERM)
        return None

    monkeypatch.setattr(Evaluator, "cancel", acknowledge)
    assert run(data, model(interrupt), "--out", tmp_path / "made") == 128 + signal.SIGTERM
    assert not (tmp_path / "made").exists()


def test_the_same_command_finds_what_it_left_and_another_does_not(
    data: Path, model: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    server = model()
    one = config(server, data)
    folder = store.default_folder(one)
    folder.mkdir(parents=True)
    with Evaluator(one) as evaluator:

        def watch(progress: Progress) -> None:
            if progress.points == 2:
                evaluator.cancel()

        assert evaluator.run(here(evaluator), keep=folder / store.KEPT, watch=watch) is None
    later = folder.with_name("2999" + folder.name[4:])
    folder.rename(later)
    assert store.default_folder(config(server, data, looks=3)) == later
    assert store.default_folder(config(server, data, seed=1)) != later
    kept = later / store.KEPT
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-20])  # cut off by a kill
    server.requests.clear()
    with Evaluator(one) as evaluator:
        made = evaluator.run(here(evaluator), keep=kept)
    assert made is not None
    taken = {looks.number_of(request.images[0]) for request in server.requests if request.images}
    assert taken == {1, 2, 3, 4, 5}
    other, _ = evaluated(one)
    assert np.array_equal(made.answers.probability, other.answers.probability)
    # What is asked is another thing now: nothing is taken over.
    server.requests.clear()
    with Evaluator(config(server, data, paraphrases=None, looks=2, seed=2)) as evaluator:
        evaluator.run(here(evaluator), keep=kept)
    assert {looks.number_of(request.images[0]) for request in server.requests if request.images} == {0, 1}


def test_nothing_answered_is_not_a_success(data: Path, model: Any, tmp_path: Path, capsys: Any) -> None:
    assert run(data, model(lambda number, atom, truth: 2.0), "--out", tmp_path / "made") == cli.NOT_REACHED
    assert "unanswered" in capsys.readouterr().out


def test_an_unfinished_collection_is_refused(model: Any, tmp_path: Path, capsys: Any) -> None:
    unfinished = looks.write(tmp_path / "begun", finished=False)
    assert run(unfinished, model(), "--out", tmp_path / "made") == cli.BAD_INPUT
    assert "resume with: executive collect" in one_error_line(capsys)
    assert not (tmp_path / "made").exists()


def test_data_of_another_problem_is_refused(data: Path, model: Any, tmp_path: Path, capsys: Any) -> None:
    code = cli.exit_code(["eval", "grocery", str(data), "--server", model().url, "--out", str(tmp_path / "made")])
    assert code == cli.BAD_INPUT
    assert "was collected in the problem 'fill-tray', which has other atoms than 'sort-all'" in one_error_line(capsys)
