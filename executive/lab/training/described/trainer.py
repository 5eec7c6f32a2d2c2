"""The stages of training for described objects: the same ones (`executive.lab.training.stages`), with other labels."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from executive.domain.loader import Domain
from executive.lab.training import decoder, network, vision_encoder, warm_start
from executive.lab.training.described import heads
from executive.lab.training.described.crops import around_objects
from executive.lab.training.described.disguises import disguised, told_by_colour
from executive.lab.training.described.questions import DescribedQuestions
from executive.lab.training.described.shards import DescribedPool
from executive.lab.training.described.space import DescribedSpace, Scenes
from executive.lab.training.described.words import Words
from executive.lab.training.optimiser import Metrics
from executive.lab.training.presets import Preset
from executive.lab.training.stages import EncodedScenes, Trainer
from executive.s3e.questions import prompts
from executive.s3e.questions.templates import Templates, generic, load_instructions
from executive.sim.spec import read_scene

_GAIN = 8.0
"""Of the probe: what is looked up is a small part of an inner state, and a head of a usual size is slow to find it."""

_CLOSE, _PARTS = 0.95, 2
"""The share of steps that show parts of pictures around objects, and how many there are in place of a whole one: they
take a quarter of the time, and show nearly as many objects."""


class DescribedTrainer(Trainer):
    """The parts of the model that is trained, and the sampler of its questions.

    Args:
        space: the vocabulary of the domain's scenes.
        seed: fixes everything.
        start: the folder of a trained model whose weights are the first ones; of one of another size, those of its
            vision encoder alone.
    """

    keeps_words = True

    def __init__(
        self,
        domain: Domain,
        space: DescribedSpace,
        preset: Preset,
        seed: int,
        wordings: Path | None = None,
        start: Path | None = None,
    ) -> None:
        torch.manual_seed(seed)
        self.preset, self.seed, self.domain, self.space = preset, seed, domain, space
        self.cameras = len(read_scene(domain.scene).cameras)
        said = domain.subject
        templates = Templates.read(said.questions) if said.questions is not None else generic(domain.task)
        self.words = Words.of(space, domain.task, templates, wordings)
        instructions = load_instructions(said.instructions) if said.instructions is not None else ""
        instructed = prompts.instructed(prompts.QUESTION_ANSWERING, instructions)
        self.systems = [("", 0.45), (prompts.QUESTION_ANSWERING, 0.3), (instructed, 0.25)]
        self.tokenizer = self._tokenizer(start, lambda: self._texts(instructed))
        self.model = network.build(preset.size, self.tokenizer)
        language = self.model.model.language_model
        network.gather_words(language)
        words_of = [
            self.tokenizer(self.words.values[v][0], add_special_tokens=False)["input_ids"] for v in space.values
        ]
        network.tell_apart(
            language.embed_tokens.weight, [ids[0] for ids in words_of if len(ids) == 1], preset.size.heads, seed
        )
        if start is not None:
            warm_start.begin(self.model, self.tokenizer, start, preset.size)
        self.dense = heads.Dense(preset.size, space)
        self.codes = heads.Codes(self.model, self.tokenizer, space, self.words)
        self.probe = decoder.Probe(preset.size, space.size - len(space.values), len(space.attributes), _GAIN)
        self.sampler = DescribedQuestions(space, self.words, self.tokenizer, self.systems, seed)
        self._place()

    def _texts(self, instructed: str) -> Sequence[str]:
        rng, space = random.Random(self.seed), self.space
        names = [" ".join(self.words.values[v][0] for v in each.values()) for each in space.descriptions]
        arity = {name: n for n, of in enumerate((space.nullary, space.unary, space.binary)) for name in of}
        asked = [
            self.words.question(predicate, rng.sample(names, count), rng)
            for _ in range(1500)
            for predicate, count in arity.items()
        ]
        texts = [word for each in self.words.values.values() for word in each]
        return [*asked, *(5 * [instructed, *DescribedQuestions.corpus(space), *names, *texts])]

    def pool(self, folder: Path) -> DescribedPool:
        return DescribedPool(folder)

    def vision_loss(self, pool: Any, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
        close = rng.random() < _CLOSE
        return self._disguised_loss(pool, (_PARTS if close else 1) * self.preset.batch, rng, close)

    def _disguised_loss(
        self, pool: Any, count: int, rng: np.random.Generator, close: bool = False
    ) -> tuple[torch.Tensor, Metrics]:
        """The loss of the dense labels on single pictures, of which some do not tell all, or on parts of them."""
        raw, masks, scenes = pool.single(count, rng)
        if close:
            raw, masks = around_objects(raw, masks, self.preset.size.stride, rng)
        raw, told, plain = disguised(raw, self.space, rng)
        pictures = vision_encoder.prepared(raw, rng).to(self.device)
        last, before = vision_encoder.features(self.model.model.vision_tower, pictures)
        loss, metrics = self.dense(
            last, before, torch.from_numpy(masks), _float(scenes.channels()), torch.from_numpy(told)
        )
        return self._with_teacher(loss, metrics, last[torch.from_numpy(plain)], pictures[torch.from_numpy(plain)])

    def language_loss(self, states: Any, rng: np.random.Generator, open_share: float) -> tuple[torch.Tensor, Metrics]:
        chosen = rng.integers(len(states.own), size=self.preset.imagined)
        scenes = self.space.described_anew(Scenes(*(part[chosen] for part in states)), rng)
        read_off = heads.synthetic(self.space, scenes, rng)
        self.sampler.reseed(int(rng.integers(2**31)))
        asked = self.sampler.ask(scenes, read_off.shape[1], self.preset.questions, open_share)
        tokens = self.codes(read_off.to(self.device))
        tokens = tokens + 0.05 * torch.randn_like(tokens)
        return self._question_loss(tokens, asked)

    def _encoded(
        self, pool: Any, rng: np.random.Generator, cameras: list[int] | None, learning: bool = True
    ) -> EncodedScenes:
        raw, masks, scenes = pool.scenes(self.preset.scenes, rng)
        if cameras is not None:
            raw, masks = raw[:, cameras], masks[:, cameras]
        count, shown = raw.shape[:2]
        flat = vision_encoder.prepared(raw.reshape(-1, *raw.shape[2:]), rng).to(self.device)
        with torch.set_grad_enabled(learning):
            last, before = vision_encoder.features(self.model.model.vision_tower, flat)
        cells = self.model.model.multi_modal_projector(last.float().flatten(2).permute(0, 2, 1))
        channels = _float(np.repeat(scenes.channels(), shown, axis=0)).to(self.device)
        each = torch.from_numpy(masks.reshape(-1, *masks.shape[2:])).to(self.device)
        meant = self.codes(heads.read_off_cells(each, channels, self.preset.size.grid)).detach()
        apart = functional.mse_loss(cells, meant) / meant.var()
        told = torch.from_numpy(told_by_colour(self.space)).expand(len(channels), -1)
        dense, metrics = self.dense(last, before, each, channels, told)
        if learning:  # or else colours would tell shapes again
            dense = 0.5 * (dense + self._disguised_loss(pool, max(1, count // 3), rng)[0])
        tokens = self.row(cells.reshape(count, shown, *cells.shape[1:]))
        return EncodedScenes(scenes, tokens, apart, dense, metrics)


def _float(array: np.ndarray[Any, Any]) -> torch.Tensor:
    return torch.from_numpy(array.astype(np.float32))
