"""A collection with other objects in each episode is evaluated: each look with questions of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from executive.app.config import EstimatorConfig
from executive.app.sensor_fit import load as load_fit
from executive.errors import InputError, OptionError
from executive.lab.config import EvalConfig
from executive.lab.evaluation import report as reporting
from executive.lab.evaluation import store
from executive.lab.evaluation.calibrate import calibrate
from executive.lab.evaluation.evaluate import Evaluator
from executive.lab.evaluation.looks import Look
from executive.lab.training import network, tokenizer
from executive.lab.training.presets import SMALLEST
from executive.types import Questions
from tests.executive.lab import described
from tests.executive.lab.inline import Inline


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(1)
    words = tokenizer.make_tokenizer(["is the small red metal cube on top of the large blue sphere"] * 5, 200)
    folder = tmp_path_factory.mktemp("model") / "tiny-eye"
    network.save(network.build(SMALLEST, words), words, SMALLEST, folder)
    return folder


def test_every_look_is_asked_about_its_own_objects(model: Path, tmp_path: Path) -> None:
    data, out = described.write(tmp_path / "data"), tmp_path / "report"
    for folder in (out, tmp_path / "other"):
        folder.mkdir()
    config = EvalConfig("blocksworld", data, EstimatorConfig(vlm=str(model), abstention=False))
    with Evaluator(config) as evaluator:
        evaluation = evaluator.run(Inline(evaluator.looker))
        assert evaluation is not None
        document = reporting.write(out, evaluation, evaluator.mistakes.sheet(), (), evaluator.published)
    each = [len(described.facts_of(names)) for names in described.EPISODES]
    assert document["asked"] == 2 * sum(each)
    assert document["unanswered"] == 0
    assert (document["groups"]["at most 3"]["looks"], document["groups"]["at most 5"]["looks"]) == (2, 4)
    assert document["groups"]["no-colour-conflict"]["looks"] == 4
    assert document["groups"]["rubber-only"]["looks"] == 0
    brown = sum("brown" in name for atom in described.facts_of(described.EPISODES[1]) for name in set(atom.args))
    assert document["combinations"]["held out"]["asked"] == 2 * brown
    assert document["combinations"]["seen"]["asked"] == document["asked"] - 2 * brown
    assert document["posterior"]["asked"] == document["asked"]
    assert evaluation.posterior is not None
    hands = np.array([[n >= 0 and evaluation.answers.atoms[n].predicate == "hand-empty" for n in row]
                      for row in evaluation.answers.numbers])  # fmt: skip
    held = np.array([[n >= 0 and evaluation.answers.atoms[n].predicate == "holding" for n in row]
                     for row in evaluation.answers.numbers])  # fmt: skip
    # A hand holds one thing or nothing, whatever a model says that was never trained.
    together = np.where(hands | held, evaluation.posterior, 0.0).sum(axis=1)
    assert together == pytest.approx(np.ones(len(together)), abs=1e-3)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all(
        row in page
        for row in (
            "72B + Instruct (≤ 3)",
            "tiny-eye + Instruct + Pose (≤ 3)",
            "tiny-eye, as believed + ",
            "large brown",
        )
    )
    # What is kept is read again, and serves beside another one.
    kept = store.load(out)
    assert kept.answers.which is not None
    assert kept.held_out is not None
    assert store.document(kept)["combinations"] == document["combinations"]
    reporting.write(tmp_path / "other", evaluation, (), [kept], evaluator.published)
    # No atom of one episode is in another: what is fitted is of predicates.
    file, fitted = calibrate("blocksworld", [out], tmp_path / "calibration.json")
    assert set(fitted.sensor_model.error_models) == {atom.predicate for atom in kept.answers.atoms}
    assert (fitted.sensor_model.atoms, fitted.looks) == ({}, 4)
    assert load_fit(file, "blocksworld").sensor_model == fitted.sensor_model
    with pytest.raises(InputError, match="other atoms"):
        calibrate("grocery", [out], tmp_path / "other.json")


def test_questions_name_the_objects_of_the_episode(model: Path, tmp_path: Path) -> None:
    data = described.write(tmp_path / "data")
    shown = Evaluator(EvalConfig("blocksworld", data, eye=EstimatorConfig(vlm=str(model))))._shown
    shown.show(None)
    for number, names in enumerate(described.EPISODES):
        point = shown.point(Look(1, number, 0))
        asked = shown.questions(point, Questions({}, "", ""))
        assert asked.text.keys() == described.facts_of(names).keys()
        assert names[0].replace("-", " ") in " ".join(asked.text.values())


def test_such_moments_are_not_drawn_anew(model: Path, tmp_path: Path) -> None:
    data = described.write(tmp_path / "data")
    eye = EstimatorConfig(vlm=str(model))
    with pytest.raises(OptionError, match="lights and cameras"):
        Evaluator(EvalConfig("blocksworld", data, eye=eye, disturb=("lights",)))


def test_the_looks_of_a_group_are_those_it_names(model: Path, tmp_path: Path) -> None:
    twins = ("small-red-metal-cube", "large-red-metal-cube", "small-blue-metal-sphere")
    data = described.write(tmp_path / "data", [twins])
    eye = EstimatorConfig(vlm=str(model))
    evaluator = Evaluator(EvalConfig("blocksworld", data, eye=eye))
    assert evaluator._varying is not None
    evaluator._shown.show(None)
    groups = evaluator._varying.groups([evaluator._shown.point(Look(1, 0, 0))])
    true = {name for name, looks in groups.items() if np.asarray(looks).all()}
    assert true == {"at most 3", "at most 5", "at most 7", "at most 10", "metal-only", "no-colour-size-conflict"}
