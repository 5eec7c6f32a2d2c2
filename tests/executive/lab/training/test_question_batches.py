"""Questions in one row are as good as asked alone, and each answer is the one that the facts have."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from executive.domain.loader import load_domain
from executive.lab.training import decoder
from executive.lab.training.presets import PRESETS
from executive.lab.training.stages import Trainer
from executive.lab.training.wordings import WORDINGS
from tests.executive.sim.stage import ROOT

GROCERY = ROOT / "domains" / "grocery"


@pytest.fixture(scope="module")
def trainer() -> Trainer:
    return Trainer(load_domain(GROCERY), PRESETS["smallest"], 0, GROCERY / WORDINGS)


def states(trainer: Trainer, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((count, len(trainer.labels.atoms))) < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_no_question_is_influenced_by_another_nor_by_another_scene(trainer: Trainer, seed: int) -> None:
    """Each question's logits are the same when the others are overwritten."""
    torch.manual_seed(seed)
    trainer.model.eval()
    trainer.sampler.reseed(seed)
    asked = trainer.sampler.ask(states(trainer, 2, seed), 7, 5, 0.3)
    tokens = torch.randn(2, 7, trainer.preset.size.hidden)
    with torch.no_grad():
        before, *_ = decoder.answers(trainer.model, tokens, asked)
        chosen = int(asked.last[6])
        row, at = divmod(chosen, asked.positions.shape[1])
        seen = asked.mask[row, 0, at]
        for other in range(2):
            keep = seen[7:] if other == row else torch.zeros_like(seen[7:])
            asked.ids[other][~keep] = torch.randint(20, 200, (int((~keep).sum()),))
        after, *_ = decoder.answers(trainer.model, tokens, asked)
    assert torch.allclose(before[6], after[6], atol=2e-2)  # bfloat16
    assert not torch.allclose(before, after, atol=2e-2)


def test_it_attends_as_torch_itself_does_with_the_mask(trainer: Trainer) -> None:
    trainer.model.eval()
    trainer.sampler.reseed(3)
    asked = trainer.sampler.ask(states(trainer, 2, 3), 7, 5, 0.3)
    tokens = torch.randn(2, 7, trainer.preset.size.hidden, generator=torch.Generator().manual_seed(3))
    language = trainer.model.model.language_model
    with torch.no_grad():
        ours = decoder.answers(trainer.model, tokens, asked)
        language.set_attn_implementation("sdpa")
        try:
            theirs = decoder.answers(trainer.model, tokens, asked)
        finally:
            language.set_attn_implementation(decoder.ATTENTION)
    for one, other in zip(ours, theirs, strict=True):
        assert float((one - other).abs().max()) < 0.01 * float(other.abs().max())  # bfloat16


def test_answers_are_what_the_facts_say(trainer: Trainer) -> None:
    facts = states(trainer, 3, 0)
    asked = trainer.sampler.official(facts, 4)
    assert asked.yes_no.all()
    expected = torch.from_numpy(np.where(facts, trainer.sampler.yes, trainer.sampler.no).reshape(-1))
    assert torch.equal(asked.answers, expected)


@pytest.mark.parametrize("seed", range(5))
def test_a_probe_sits_at_the_end_of_the_items_name(trainer: Trainer, seed: int) -> None:
    trainer.sampler.reseed(seed)
    asked = trainer.sampler.ask(states(trainer, 3, seed), 4, 6, 0.5)
    facets = trainer.labels.facets
    for index, own in zip(asked.probed.tolist(), asked.facets.tolist(), strict=True):
        row, at = divmod(index, asked.positions.shape[1])
        item = trainer.labels.items[facets[own[0]][0]]
        said = trainer.tokenizer.decode(asked.ids[row, max(0, at - 9) : at - 3])
        assert any(said.replace(" - ", "-").endswith(name) for name in trainer.wordings.names[item]), (said, item)


def test_true_atoms_are_asked_about_more_often_than_they_are_found(trainer: Trainer) -> None:
    facts = np.zeros((1, len(trainer.labels.atoms)), bool)
    facts[0, 3] = True
    trainer.sampler.reseed(1)
    answers = [answer for _ in range(30) for answer in trainer.sampler.ask(facts, 4, 10, 0.0).answers.tolist()]
    assert 0.15 < sum(answer in trainer.sampler.affirmative for answer in answers) / len(answers) < 0.45


def test_an_imagined_scene_shows_what_its_state_has(trainer: Trainer) -> None:
    facts = states(trainer, 50, 3)
    drawn, shown = decoder.SyntheticScenes(trainer.labels, facts, np.random.default_rng(0)).scenes(20)
    items = len(trainer.labels.items)
    for row in range(20):
        assert any((drawn[row] == state).all() for state in facts)
        for number, (item, atom) in enumerate(trainer.labels.facets):
            part = shown[row, :, items + number]
            assert torch.equal(part, shown[row, :, item] if drawn[row, atom] else torch.zeros_like(part))
