"""From evaluations and runs to a model's calibration file, on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from executive.app.config import CONFIG
from executive.app.sensor_fit import load
from executive.cli import BAD_INPUT, exit_code
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.evaluation import prediction_sets, store
from executive.lab.evaluation.calibrate import RELIABILITY
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.metrics import Answers
from executive.lab.evaluation.repeats import changed, combined, in_evaluations
from executive.s3e import AnswerWords, PlattProfile, Prediction, PredictionSet
from executive.s3e.calibration import Calibration
from executive.s3e.calibration_file import FILE
from executive.trace.record.log import EventLog
from executive.types import Atom, Belief, Event, Facts, Judged, Looked, LookKind, Started
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"
ATOMS = load_domain(TRAY).task.atoms


def evaluation(
    folder: Path, looks: int, seed: int, model: str = "eye", atoms: tuple[Atom, ...] = ATOMS, episodes: int = 1
) -> Path:
    """An evaluation on disk, of a model that is wrong now and then and sometimes does not answer."""
    rng = np.random.default_rng(seed)
    truth = rng.random((looks, len(atoms))) < 0.3
    probability = np.clip(np.where(truth, 0.85, 0.1) + rng.normal(0.0, 0.15, truth.shape), 0.0, 1.0)
    probability[rng.random(truth.shape) < 0.02] = np.nan
    folder.mkdir(parents=True)
    made = Evaluation(
        "eye",
        {"model": model},
        Answers(atoms, probability, truth),
        tuple((step % episodes, step) for step in range(looks)),
        np.zeros(looks, dtype=np.bool_),
        np.ones(looks),
    )
    store.save(folder, made)
    return folder


def test_evaluations_make_the_file_that_runs_find_beside_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model"
    model.mkdir()
    first, second = evaluation(tmp_path / "a", 60, 1), evaluation(tmp_path / "b", 70, 2)
    assert exit_code(["calibrate", str(TRAY), str(first), str(second), "--out", str(model)]) == 0
    printed = capsys.readouterr().out
    assert "learned from 130 looks" in printed
    assert "too few looks" in printed  # for an error rate of 0.01
    assert f"written to {model / FILE}" in printed
    fitted = load(model, "tray")
    assert fitted.looks == 130
    correction = Calibration.load(model)
    assert correction.model == "eye"
    assert set(correction.predicates) == set(fitted.sensor_model.error_models)
    assert (
        set(fitted.sensor_model.error_models) == set(fitted.conformal.scores) == {"resting-on", "holding", "hand-free"}
    )
    for scores in fitted.conformal.scores.values():
        assert 60 < len(scores) <= 65  # where nothing of a predicate was answered there is none


def test_episodes_that_can_be_held_out_show_what_calibration_is_worth(tmp_path: Path) -> None:
    model = tmp_path / "model"
    model.mkdir()
    done = evaluation(tmp_path / "a", 120, 1, episodes=8)
    assert exit_code(["calibrate", str(TRAY), str(done), "--out", str(model)]) == 0
    with Picture.open(model / RELIABILITY) as picture:
        assert picture.format == "PNG"
    shared = Calibration.load(model).shared
    assert shared.slope > 1.2, "answers of 0.85 and 0.1 are nearly always right: they get surer"


def test_runs_say_how_much_repeated_questions_repeat_mistakes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, run = tmp_path / "model", tmp_path / "run"
    model.mkdir()
    recorded(run, disagree=True)
    command = ["calibrate", str(TRAY), str(run), "--out", str(model)]
    assert exit_code(command) == BAD_INPUT
    assert "there is no such file" in capsys.readouterr().err, "a record does not tell error rates"
    assert exit_code(["calibrate", str(TRAY), str(evaluation(tmp_path / "a", 60, 1)), "--out", str(model)]) == 0
    before = load(model, "tray")
    assert exit_code(command) == 0
    after = load(model, "tray")
    assert after.sensor_model.error_models == before.sensor_model.error_models
    assert exit_code(["calibrate", str(TRAY), str(recorded(tmp_path / "same", False)), "--out", str(model)]) == 0
    repeated = load(model, "tray").repeats
    assert after.repeats["holding"]["again"] < 0.8 < repeated["holding"]["again"] <= 1.0
    assert "again" in capsys.readouterr().out


def recorded(run: Path, disagree: bool) -> Path:
    """A record of a run that looks 200 times without an action, and is told the same each time, or the opposite."""
    log = EventLog(run)
    (run / CONFIG).write_text("")
    events: list[Any] = [Started("run", "tray", load_domain(TRAY).task, "m", 0)]
    for number in range(200):
        said = 0.9 if disagree and number % 2 else 0.1
        events += [
            Belief(number, dict.fromkeys(ATOMS, said)),
            Looked(number, LookKind.FULL, 1, 1, ("front",)),
            Judged(number, dict.fromkeys(ATOMS, 0.1), Facts()),
        ]
    for event in events:
        log.write(Event(0, 0.0, 0.0, event))
    log.close()
    return run


def test_two_evaluations_of_the_same_looks_say_what_other_words_are_worth() -> None:
    rng = np.random.default_rng(0)
    truth = rng.random((400, len(ATOMS))) < 0.5
    wrong = rng.random(truth.shape) < 0.2
    again = np.where(rng.random(truth.shape) < 0.5, wrong, rng.random(truth.shape) < 0.2)
    looks = tuple((0, step) for step in range(400))

    def answered(errors: np.ndarray[Any, Any], **about: object) -> Evaluation:
        answers = Answers(ATOMS, np.where(errors, ~truth, truth).astype(float), truth)
        return Evaluation("m", {"model": "m", **about}, answers, looks, np.zeros(400, dtype=bool), np.ones(400))

    one, other = answered(wrong, paraphrases=None), answered(again, paraphrases="p.toml")
    for predicate, told in combined(in_evaluations([one, other])).items():
        assert told["wording"] == pytest.approx(0.5, abs=0.15), predicate
        assert told["again"] < 0.2, predicate
    assert changed(one.about, {**other.about, "cameras": ["front"]}) is None, "two things"
    assert changed(one.about, {**other.about, "model": "n"}) is None
    assert changed(one.about, one.about) is None


def test_what_is_no_evaluation_of_this_eye_and_task_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = evaluation(tmp_path / "a", 6, 1)
    other = evaluation(tmp_path / "b", 6, 2, model="another")
    few = evaluation(tmp_path / "c", 6, 3, atoms=ATOMS[:-1])
    (tmp_path / "empty").mkdir()
    for folder, words in (
        (other, "is of another model"),
        (few, "is about other atoms"),
        (tmp_path / "empty", "no eval"),
    ):
        command = ["calibrate", str(TRAY), str(first), str(folder), "--out", str(tmp_path / "known.json")]
        assert exit_code(command) == BAD_INPUT
        error = capsys.readouterr().err
        assert words in error
        assert str(folder) in error
    assert not (tmp_path / "known.json").exists()


def test_a_file_that_cannot_be_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = evaluation(tmp_path / "a", 60, 1)
    assert exit_code(["calibrate", str(TRAY), str(done), "--out", str(tmp_path / ("a" * 300))]) == BAD_INPUT
    assert "File name too long" in capsys.readouterr().err


def test_corrected_probabilities_are_not_corrected_again(tmp_path: Path) -> None:
    model = tmp_path / "model"
    model.mkdir()
    raw = evaluation(tmp_path / "raw", 60, 1)
    assert exit_code(["calibrate", str(TRAY), str(raw), "--out", str(model)]) == 0
    before = Calibration.load(model)
    done = evaluation(tmp_path / "a", 60, 3)
    about = done / store.RESULTS
    about.write_text(about.read_text().replace('"model": "eye"', '"model": "eye", "calibrated": true'))
    assert exit_code(["calibrate", str(TRAY), str(done), "--out", str(model)]) == 0
    assert [file.name for file in model.iterdir()] == [FILE]
    assert Calibration.load(model) == before
    assert exit_code(["calibrate", str(TRAY), str(done), "--out", str(tmp_path / "new.json")]) == BAD_INPUT
    other = evaluation(tmp_path / "b", 60, 2)
    assert exit_code(["calibrate", str(TRAY), str(done), str(other), "--out", str(model)]) == BAD_INPUT


def test_the_files_of_s3e_say_the_same(tmp_path: Path) -> None:
    done = evaluation(tmp_path / "a", 60, 1, episodes=8)
    sets, profile, ours, theirs = (tmp_path / name for name in ("sets", "platt.json", "ours.json", "theirs.json"))
    options = ["--platt", str(profile), "--prediction-sets", str(sets)]
    assert exit_code(["calibrate", str(TRAY), str(done), "--out", str(ours), *options]) == 0
    assert len(list(sets.glob("episode-*.json"))) == 60
    assert exit_code(["calibrate", str(TRAY), str(sets), "--out", str(theirs)]) == 0
    one, other, platt = Calibration.load(ours), Calibration.load(theirs), PlattProfile.read(profile)
    for atom in ATOMS:
        for probability in (0.1, 0.5, 0.9):
            assert other(atom, probability) == pytest.approx(one(atom, probability), abs=1e-6)
            assert platt(atom, probability) == pytest.approx(one(atom, probability), abs=1e-6)
    assert load(theirs, "tray").looks == 60


@pytest.mark.parametrize(
    ("truth", "key"),
    [
        ("[]", None), ("{}", None), ('{"look.json": 3}', "look.json"), ('{"../look.json": []}', "../look.json"),
        ('{"look.json": ["nowhere(x)"]}', "look.json"),
    ],
)  # fmt: skip
def test_prediction_sets_without_a_proper_truth_are_refused(truth: str, key: str | None, tmp_path: Path) -> None:
    predictions = {ATOMS[0]: Prediction("", 0.9, 0.1)}
    PredictionSet(predictions, AnswerWords("yes", "no")).write(tmp_path / "look.json")
    (tmp_path / "truth.json").write_text(truth)
    with pytest.raises(InputError) as caught:
        prediction_sets.read(tmp_path)
    assert (caught.value.file, caught.value.key) == (tmp_path / "truth.json", key)


def test_prediction_sets_are_written_where_nothing_is(tmp_path: Path) -> None:
    done = evaluation(tmp_path / "a", 4, 1)
    with pytest.raises(InputError):
        prediction_sets.write(done, store.load(done))
