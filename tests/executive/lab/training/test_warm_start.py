"""A training that starts from a trained model, and one that has to fit into a budget."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from transformers import AutoModelForImageTextToText, AutoTokenizer

from executive import cli
from executive.domain.loader import load_domain
from executive.errors import InputError, OptionError
from executive.lab.config import TrainConfig
from executive.lab.training import network, tokenizer, vision_encoder, warm_start
from executive.lab.training.presets import PRESETS, SMALLEST, Pace, Preset
from executive.lab.training.stages import Trainer
from executive.lab.training.train import PACE, Training
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"
PACE_HERE = Pace(moment=0.1, tower=0.5, language=0.2, together=0.7, fewer=0.6)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small model of another domain, with random weights."""
    torch.manual_seed(7)
    words = tokenizer.make_tokenizer(["is the red cube on a shelf", "does the robot hold the jar"] * 3, 200)
    folder = tmp_path_factory.mktemp("model") / "shelf-eye"
    network.save(network.build(SMALLEST, words), words, SMALLEST, folder)
    return folder


def test_it_begins_with_the_weights_of_the_other_and_the_words_that_both_have(model: Path) -> None:
    trainer = Trainer(load_domain(TRAY), PRESETS["smallest"], 0, start=model)
    before = AutoModelForImageTextToText.from_pretrained(model, dtype=torch.float32)
    old, new = before.state_dict(), trainer.model.state_dict()
    for name, value in old.items():
        if "embed_tokens" not in name and "lm_head" not in name:
            assert torch.equal(value, new[name]), name
    known, here = AutoTokenizer.from_pretrained(model).get_vocab(), trainer.tokenizer.get_vocab()
    rows = {
        name: part.model.language_model.embed_tokens.weight for name, part in (("old", before), ("new", trainer.model))
    }
    shared = known.keys() & here.keys()
    assert {"yes", "no", "red", "cube"} <= shared
    assert all(torch.equal(rows["old"][known[word]], rows["new"][here[word]]) for word in shared)
    fresh = torch.tensor([here[word] for word in here.keys() - known.keys()])
    assert len(fresh)
    assert float(rows["new"][fresh].detach().std()) == pytest.approx(float(rows["old"].detach().std()), rel=0.2)


def test_it_trains_to_the_end_and_says_where_it_came_from(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    told: list[dict[str, float]] = []
    config = TrainConfig(str(TRAY), out, recipe="smallest", start=str(model), minutes=600, jobs=1)
    made = Training(config).run(tell=lambda seconds: told.append(dict(seconds)))
    assert made is not None
    assert "shelf-eye" in (made / "README.md").read_text(encoding="utf-8")
    # What was measured is kept: the next process plans the same.
    measured = (out / PACE).read_bytes()
    assert Training(config).run(tell=lambda seconds: told.append(dict(seconds))) == made
    assert told[0] == told[1]
    assert (out / PACE).read_bytes() == measured
    with pytest.raises(InputError, match="another training"):
        Training(TrainConfig(str(TRAY), out, recipe="smallest", jobs=1))


def test_a_finer_model_begins_with_the_other_s_way_to_see(model: Path) -> None:
    finer = replace(SMALLEST, side=128, widths=SMALLEST.widths[:3], depths=SMALLEST.depths[:3], hidden=48, layers=3)
    warm_start.check(model, finer, "finer")
    new, old = network.build(finer, AutoTokenizer.from_pretrained(model)), warm_start._read(model)
    warm_start.load_vision(new, model)
    shown = torch.rand(2, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        last = new.eval().model.vision_tower(shown).last_hidden_state
        whole = old.eval().model.vision_tower(shown, output_hidden_states=True).hidden_states
    assert torch.equal(last, whole[-2])
    assert (warm_start.is_alike(model, SMALLEST), warm_start.is_alike(model, finer)) == (True, False)
    with pytest.raises(InputError, match="recipe 'wider' makes: hidden_sizes is"):
        warm_start.check(model, replace(finer, widths=(8, 8, 32)), "wider")
    with pytest.raises(InputError, match="depths is"):
        warm_start.check(model, replace(finer, depths=(1, 1, 2)), "deeper")


def test_a_model_whose_encoder_is_another_is_refused(model: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recipe 'small' makes: embedding_size is 8 there and 32 here"):
        Training(TrainConfig(str(TRAY), tmp_path / "x", start=str(model)))
    assert not (tmp_path / "x").exists()


def test_a_model_of_another_architecture_is_refused(model: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(model, other)
    config = json.loads((other / "config.json").read_text(encoding="utf-8"))
    (other / "config.json").write_text(json.dumps({**config, "model_type": "smolvlm"}), encoding="utf-8")
    with pytest.raises(InputError, match="'smolvlm'"):
        warm_start.check(warm_start.find(str(other)), SMALLEST, "smallest")


def test_the_model_that_comes_along_has_two_names() -> None:
    assert warm_start.find("grocery") == warm_start.find("grocery-eye")
    warm_start.check(warm_start.find("grocery"), PRESETS["small"].size, "small")
    warm_start.check(warm_start.find("grocery"), PRESETS["fine"].size, "fine")


def test_a_model_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["train", str(TRAY), "--out", str(tmp_path / "x"), "--from", "grocery-eyes"]) == 2
    message = capsys.readouterr().err
    assert all(word in message for word in ("--from", "'grocery-eyes'", "grocery-eye"))


@given(st.floats(1.0, 1e6))
def test_what_is_fitted_into_a_budget_fits(seconds: float) -> None:
    whole = PRESETS["small"]
    needed = sum(whole.efforts(PACE_HERE).values())
    try:
        fitted = whole.fitted(PACE_HERE, seconds)
    except ValueError:
        assert seconds < 0.05 * needed
        return
    assert sum(fitted.efforts(PACE_HERE).values()) <= seconds + whole.moments * PACE_HERE.moment + 4.0
    assert fitted.size == whole.size
    assert all(getattr(fitted, name).steps >= 1 for name in ("tower", "language", "together", "fewer"))
    if seconds >= needed:
        assert fitted == whole


def test_a_warm_training_is_shorter_and_one_camera_has_no_subsets() -> None:
    whole: Preset = PRESETS["small"]
    several, one = whole.warmed(5), whole.warmed(1)
    assert sum(several.efforts(PACE_HERE).values()) < 0.65 * sum(whole.efforts(PACE_HERE).values())
    assert (one.fewer.steps, "fewer" in one.efforts(PACE_HERE)) == (0, False)
    assert {**asdict(one), "fewer": None} == {**asdict(several), "fewer": None}
    seeing = whole.warmed(5, alike=False)  # which has an encoder to start from, and no decoder
    assert seeing.tower.steps < whole.tower.steps
    assert {**asdict(seeing), "tower": None} == {**asdict(whole), "tower": None}


def test_a_budget_that_is_too_small_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    training = Training(TrainConfig(str(TRAY), out, minutes=1, jobs=1))
    (out / PACE).write_text(json.dumps(asdict(PACE_HERE)), encoding="utf-8")
    with pytest.raises(OptionError, match="minutes"):
        training.run()


def test_a_training_goes_on_with_a_model_of_its_domain_and_with_its_words(tmp_path: Path) -> None:
    first = TrainConfig(str(TRAY), tmp_path / "first", recipe="smallest", minutes=600, jobs=1)
    begun = Training(first).run()
    assert begun is not None
    config = TrainConfig(
        str(TRAY), tmp_path / "more", recipe="smallest", start=str(begun), further=True, seed=5, jobs=1
    )
    told: list[dict[str, float]] = []
    training = Training(config)
    made = training.run(tell=lambda seconds: told.append(dict(seconds)))
    assert made is not None
    assert "language" not in told[0]
    assert AutoTokenizer.from_pretrained(made).get_vocab() == AutoTokenizer.from_pretrained(begun).get_vocab()
    before, after = (warm_start._read(folder).model.vision_tower.state_dict() for folder in (begun, made))
    assert any(not torch.equal(before[name], after[name]) for name in before)
    with pytest.raises(InputError, match="another training"):
        Training(replace(config, further=False))


def test_what_a_model_says_of_a_picture_is_held_on_to_while_it_learns_to_see_better(tmp_path: Path) -> None:
    domain, preset = load_domain(TRAY), PRESETS["smallest"]
    folder = tmp_path / "start"
    first = Trainer(domain, preset, 0)
    network.save(first.model, first.tokenizer, SMALLEST, folder)
    trainer = Trainer(domain, preset.furthered(1), 1, start=folder)
    pictures = torch.rand(2, 3, 64, 64)
    last, _ = vision_encoder.features(trainer.model.model.vision_tower.eval(), pictures)
    zero = torch.zeros(())
    same, said = trainer._with_teacher(zero, {}, last, pictures)
    assert float(same.detach()) == pytest.approx(0.0, abs=1e-6)
    other, _ = trainer._with_teacher(zero, {}, last + 1.0, pictures)
    assert float(other.detach()) > 0.01
    assert said.keys() == {"apart"}
    assert Trainer(domain, preset, 1)._with_teacher(zero, {}, last, pictures) == (zero, {})


def test_going_on_needs_a_model_of_the_same_size(model: Path, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="needs the model"):
        TrainConfig(str(TRAY), tmp_path / "out", further=True)
    with pytest.raises(OptionError, match="is another"):
        Training(TrainConfig("blocksworld", tmp_path / "out", recipe="fine", start="grocery", further=True))
