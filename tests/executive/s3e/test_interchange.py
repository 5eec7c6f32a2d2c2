"""Prediction sets and Platt profiles, by round trip and against s3e itself; backends of either side as the other's."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.errors import InputError, MissingError
from executive.s3e import S3E, YES_NO, AnswerWords, PlattProfile, Prediction, PredictionSet, observe
from executive.s3e.backends.interface import Answer
from executive.s3e.backends.s3e_package import FromS3E, as_s3e
from executive.s3e.calibration import Calibration, Scaling, fit
from executive.s3e.calibration_file import read
from executive.types import Atom, Belief, Questions

ON, HELD, FREE = Atom.parse("on(a,b)"), Atom.parse("held(a)"), Atom.parse("hand-free()")
QUESTIONS = Questions({ON: "Is a on b?", HELD: "Is a held?", FREE: "Is the hand free?"}, "Look.", "none")

masses = st.floats(0.0, 0.5)
predictions = st.builds(
    Prediction, st.text(max_size=9), masses, masses, masses, masses, st.none() | st.floats(0.0, 1.0)
)
numbers = st.floats(-5.0, 5.0)
profiles = st.builds(
    PlattProfile,
    st.just("lifted"),
    st.dictionaries(st.sampled_from(["on", "held", "hand-free"]), st.tuples(st.floats(0.01, 5.0), numbers)),
)


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(st.sampled_from([ON, HELD, FREE]), predictions))
def test_a_prediction_set_that_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, told: dict[Atom, Prediction]
) -> None:
    file = tmp_path_factory.mktemp("set") / "predictions.json"
    made = PredictionSet(told, YES_NO)
    again = PredictionSet.read(made.write(file))
    assert dict(again.predictions) == told
    belief = again.belief(3)
    for atom, each in told.items():
        assert belief.probability.get(atom) == each.probability
        assert (atom in belief.unanswered) is (each.probability is None)


@settings(max_examples=30, deadline=None)
@given(profiles)
def test_a_profile_that_is_written_is_read_and_is_a_calibration(
    tmp_path_factory: pytest.TempPathFactory, profile: PlattProfile
) -> None:
    file = profile.write(tmp_path_factory.mktemp("profile") / "platt.json")
    again = PlattProfile.read(file)
    calibration = again.calibration()
    assert Calibration.load(file) == calibration, "--calibration takes a profile"
    for atom in (ON, HELD, FREE):
        for probability in (0.01, 0.3, 0.9):
            assert again(atom, probability) == pytest.approx(profile(atom, probability), abs=1e-12)
            assert calibration(atom, probability) == pytest.approx(again(atom, probability), abs=2e-6)
    assert PlattProfile.of(calibration).calibration() == calibration


def test_what_was_estimated_becomes_a_prediction_set() -> None:
    estimator = S3E(Fixed({"Is a on b?": (0.6, 0.2), "Is a held?": (0.1, 0.1)}), QUESTIONS, calibrate=lambda *_: 0.7)
    belief = estimator.estimate(observe({"front": np.zeros((4, 4, 3), np.uint8)}), [ON, HELD])
    made = PredictionSet.of(belief, QUESTIONS)
    assert made.predictions[ON].true_mass == pytest.approx(0.6)
    assert (made.predictions[ON].probability, made.predictions[ON].query) == (0.7, "Is a on b?")
    assert made.predictions[HELD].unassigned_mass == pytest.approx(0.8)


def test_profiles_of_other_scopes() -> None:
    everything = PlattProfile("global", {"__global__": (2.0, 0.5)})
    assert everything.calibration() == Calibration(Scaling(2.0, 0.5))
    assert everything(ON, 0.5) == pytest.approx(1 / (1 + math.exp(-0.5)))
    single = PlattProfile("grounded", {"on(a,b)": (2.0, 0.5)})
    assert single(HELD, 0.3) == 0.3
    with pytest.raises(InputError, match="each atom by itself"):
        single.calibration()
    with pytest.raises(InputError, match="reverses"):
        PlattProfile("lifted", {"on": (-1.0, 0.0)}).calibration()


GOOD: dict[str, Any] = {
    "format_version": 1,
    "kind": "platt",
    "scope": "lifted",
    "groups": {"on": {"a": -1.0, "b": 0.0}},
}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"format_version": 2}, "format_version"),
        ({"kind": "isotonic"}, "kind"),
        ({"scope": "local"}, "scope"),
        ({"groups": {"on": {"a": -1.0}}}, "groups.on.b"),
        ({"groups": {"on": {"a": "1", "b": 0.0}}}, "groups.on.a"),
        ({"groups": [1]}, "groups"),
    ],
)
def test_a_damaged_profile_is_one_line(tmp_path: Path, changes: dict[str, Any], key: str) -> None:
    file = tmp_path / "platt.json"
    file.write_text(json.dumps({**GOOD, **changes}))
    with pytest.raises(InputError) as caught:
        PlattProfile.read(file)
    assert (caught.value.file, caught.value.key) == (file, key)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('"yes": 0.5', '"yes": -1', "predictions.on(a,b).masses"),
        ('"on(a,b)"', '"on(a,b"', "predictions.on(a,b"),
        ('"true_label": "yes"', '"true_label": "maybe"', "predictions.on(a,b).masses"),
        ('"binary"', '"categorical"', "predictions.on(a,b)"),
        ('"format_version": 1', '"format_version": 9', "format_version"),
    ],
)
def test_a_damaged_prediction_set_is_one_line(tmp_path: Path, old: str, new: str, key: str) -> None:
    file = PredictionSet({ON: Prediction("q", 0.5, 0.25)}, YES_NO).write(tmp_path / "p.json")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        PredictionSet.read(file)
    assert (caught.value.file, caught.value.key) == (file, key)


# Against s3e itself


def test_s3e_reads_what_is_written_and_the_other_way_round(tmp_path: Path) -> None:
    s3e = pytest.importorskip("s3e", reason="the extra s3e is not installed")
    told = {
        ON: Prediction("q", 0.6, 0.2, 0.0, 0.2),
        HELD: Prediction("r", 0.1, 0.1, 0.7, 0.1),
        FREE: Prediction("s", 0.3, 0.6, 0.0, 0.1, 0.8),
    }
    file = PredictionSet(told, YES_NO).write(tmp_path / "p.json")
    theirs = s3e.PredictionSet.from_dict(json.loads(file.read_text()))
    assert theirs.probabilities() == pytest.approx({"on(a,b)": 0.75, "held(a)": 0.5, "hand-free()": 0.8})
    assert not theirs["held(a)"].has_answer
    assert told[HELD].probability is None, "what is 0.5 there for want of an answer is unanswered here"
    (tmp_path / "again.json").write_text(json.dumps(theirs.to_dict()))
    assert dict(PredictionSet.read(tmp_path / "again.json").predictions) == told


def test_a_profile_corrects_as_in_s3e(tmp_path: Path) -> None:
    s3e = pytest.importorskip("s3e", reason="the extra s3e is not installed")
    rng = np.random.default_rng(0)
    samples = []
    for predicate in ("on(a,b)", "held(a)"):
        for score in rng.normal(0.0, 2.0, 200):
            label = bool(rng.random() < 1 / (1 + math.exp(-0.5 * score + 0.3)))
            samples.append(s3e.CalibrationSample(predicate, float(score), label))
    theirs = s3e.PlattCalibrator.fit(s3e.CalibrationSet(samples, {"scoring": "logprobs"}), scope="lifted")
    theirs.save(tmp_path / "platt.json")
    ours = PlattProfile.read(tmp_path / "platt.json")
    assert ours.calibration().predicates["on"].true == theirs.groups["on"].positive_count
    ours.write(tmp_path / "again.json")
    assert s3e.PlattCalibrator.load(tmp_path / "again.json").groups == theirs.groups
    for true in (0.05, 0.4, 0.9):
        made = PredictionSet({ON: Prediction("q", true, 1.0 - true)}, YES_NO).write(tmp_path / "p.json")
        applied = theirs.apply(s3e.PredictionSet.from_dict(json.loads(made.read_text())))
        assert ours(ON, true) == pytest.approx(applied["on(a,b)"].probability, abs=1e-6)
        assert read(tmp_path / "platt.json").correction is not None
    labelled = [
        (
            Belief(0, {Atom.parse(each.predicate): 1 / (1 + math.exp(-each.score))}),
            {Atom.parse(each.predicate): each.label},
        )
        for each in samples
    ]
    fitted = fit(labelled).predicates["on"]
    assert fitted.slope == pytest.approx(ours.groups["on"][0], abs=0.1), "fitted by either side, it is nearly the same"


class Fixed:
    """A model with an opinion on each question."""

    name = "fixed"

    def __init__(self, masses: dict[str, tuple[float, float]]) -> None:
        self.masses = masses

    def look(self, images: Sequence[Any], system: str, words: AnswerWords = YES_NO) -> Fixed:
        assert images[0].shape == (4, 4, 3)
        return self

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        return [Answer(question, *self.masses[question]) for question in questions]


def test_a_backend_of_either_side_serves_as_the_others() -> None:
    s3e = pytest.importorskip("s3e", reason="the extra s3e is not installed")
    from PIL import Image as Picture

    said = {"Is a on b?": (0.6, 0.2), "Is a held?": (0.05, 0.9)}
    theirs = as_s3e(Fixed(said))
    assert isinstance(theirs, s3e.VLMBackend)
    engine = s3e.QueryEngine(theirs, answers=s3e.BinaryAnswers("yes", "no"))
    asked = engine.ask([Picture.new("RGB", (4, 4))], list(said))
    assert asked.probabilities() == pytest.approx({"Is a on b?": 0.75, "Is a held?": 0.05 / 0.95})
    with pytest.raises(ValueError, match="writes no text"):
        engine.ask([Picture.new("RGB", (4, 4))], list(said), scoring="text_match")

    ours = FromS3E(theirs, "there and back")
    estimator = S3E(ours, QUESTIONS)
    belief = estimator.estimate(observe({"front": np.zeros((4, 4, 3), np.uint8)}), [ON, HELD])
    assert belief.probability == pytest.approx({ON: 0.75, HELD: 0.05 / 0.95})
    with pytest.raises(InputError, match="no picture"):
        ours.look([], "")


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "s3e", None)
    with pytest.raises(MissingError, match=r"executive\[s3e\]"):
        as_s3e(Fixed({}))
