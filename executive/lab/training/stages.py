"""The stages of training, one after the other; each can be resumed.

1. Pictures: samples are rendered, and kept with the item that each pixel shows (`image_shards`).
2. Tower: the vision encoder learns from dense labels what each cell shows, and which atoms are true (`vision_encoder`).
3. Language: the decoder learns to look words up, on synthetic scenes without pictures (`decoder`).
4. Together: the projector learns to map the encoder's cells to the decoder's word embeddings; then all parts learn from
   pictures, questions and answers.
5. Fewer: the same with a subset of the cameras, for closer looks and for cameras that fail.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.domain.loader import Domain
from executive.lab.training import decoder, image_shards, network, tokenizer, vision_encoder, warm_start
from executive.lab.training.label_space import LabelSpace
from executive.lab.training.optimiser import Metrics, Report, train_stage
from executive.lab.training.presets import Preset, Schedule
from executive.lab.training.question_batches import QuestionSampler
from executive.lab.training.wordings import Wordings
from executive.s3e.questions import prompts
from executive.s3e.questions.templates import Templates, generic, load_instructions
from executive.sim.spec import read_scene

TOWER, LANGUAGE, TOGETHER, FEWER = "tower.pt", "language.pt", "together.pt", "fewer.pt"

Watch = Callable[[Report], None]


_FULL = 0.1875
"""The share of a cell from which on an item counts in it as much as one that fills it."""

_KEEPING = {"words": 0.1, "codes": 0.1, "probe": 3.0}
"""Factors of the learning rate where words and codes were chosen so that names are found from the first step on: base
rates, which are learned before that is of any use, would change them beyond recognition."""


class EncodedScenes(NamedTuple):
    """Encoded scenes: their truth as the sampler of questions takes it (facts (B, A)), tokens (B, P, D), and the losses
    of tokens and encoder with their metrics."""

    facts: Any
    tokens: torch.Tensor
    apart: torch.Tensor
    dense: torch.Tensor
    metrics: Metrics


class Trainer:
    """The parts of the model that is trained, and the sampler of its questions, for a domain whose objects are the same
    in all of its pictures.

    Args:
        seed: fixes everything.
        start: the folder of a trained model whose weights are the first ones; of one of another size, those of its
            vision encoder alone.
    """

    keeps_words = False
    """Whether words and their codes are changed slowly in stage 3."""

    def __init__(
        self, domain: Domain, preset: Preset, seed: int, wordings: Path | None = None, start: Path | None = None
    ) -> None:
        torch.manual_seed(seed)
        self.preset, self.seed, self.domain = preset, seed, domain
        self.labels = LabelSpace.of(domain)
        stage = read_scene(domain.scene)
        self.cameras = len(stage.cameras)
        said = domain.subject
        templates = Templates.read(said.questions) if said.questions is not None else generic(domain.task)
        there = set(stage.kinds)
        self.wordings = Wordings.of(domain.task, templates, wordings, there)
        instructions = load_instructions(said.instructions) if said.instructions is not None else ""
        instructed = prompts.instructed(prompts.QUESTION_ANSWERING, instructions)
        untranslated = prompts.no_translation(said.pddl.read_text(encoding="utf-8"), domain.task.objects)
        self.systems = [("", 0.45), (prompts.QUESTION_ANSWERING, 0.3), (instructed, 0.25)]
        self.tokenizer = self._tokenizer(start, partial(self._corpus, [instructed, untranslated]))
        self.model = network.build(preset.size, self.tokenizer)
        if start is not None:
            warm_start.begin(self.model, self.tokenizer, start, preset.size)
        self.dense: nn.Module = vision_encoder.Dense(preset.size, self.labels)
        self.codes: nn.Module = decoder.CellEmbeddings(self.model, self.tokenizer, self.labels, self.wordings)
        self.probe = decoder.Probe(preset.size, len(self.labels.facets))
        self.sampler: Any = QuestionSampler(
            self.labels, self.wordings, self.tokenizer, self.systems, untranslated, seed
        )
        self._place()

    def _place(self) -> None:
        """Brings all parts to the device that there is."""
        decoder.prepare(self.model)
        self.teacher: nn.ModuleList | None = None
        if self.preset.further:
            seeing = [self.model.model.vision_tower, self.model.model.multi_modal_projector]
            self.teacher = nn.ModuleList(copy.deepcopy(seeing)).requires_grad_(False).eval()
        markers = self.tokenizer.convert_tokens_to_ids(list(tokenizer.PICTURES))
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._markers = torch.tensor(markers, device=self.device)
        for part in (self.model, self.dense, self.codes, self.probe):
            part.to(self.device)

    def _tokenizer(self, start: Path | None, corpus: Callable[[], Sequence[str]]) -> Any:
        """A tokenizer for a corpus, or that of the model that the training goes on with."""
        if self.preset.further and start is not None:
            return warm_start.tokenizer_of(start)
        return tokenizer.make_tokenizer(corpus(), self.preset.vocabulary)

    def _corpus(self, texts: Sequence[str]) -> list[str]:
        import random

        rng = random.Random(self.seed)
        asked = [self.wordings.draw(atom, rng)[0] for _ in range(400) for atom in self.domain.task.atoms]
        named = [name for names in self.wordings.names.values() for name in names]
        return [
            *asked,
            *(5 * [*texts, *QuestionSampler.corpus(self.labels), *named, *map(str, self.domain.task.atoms)]),
        ]

    def pool(self, folder: Path) -> Any:
        """The pictures in a folder of shards."""
        return ShardPool(folder)

    # Stage 2.

    def train_vision_encoder(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Trains the vision encoder on the shards in `folder`."""
        pool, preset = self.pool(folder), self.preset
        encoder = self.model.model.vision_tower.to(memory_format=torch.channels_last)

        def step_loss(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
            return self.vision_loss(pool, rng)

        parts = {"tower": encoder, "dense": self.dense}
        encoder.train()
        train_stage("tower", file, parts, preset.tower, step_loss, self.seed, watch, stopped)

    def vision_loss(self, pool: ShardPool, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
        """The loss of the dense labels on single pictures."""
        raw, masks, facts = pool.single(self.preset.batch, rng)
        pictures = vision_encoder.prepared(raw, rng).to(self.device)
        last, before = vision_encoder.features(self.model.model.vision_tower, pictures)
        loss, metrics = self.dense(last, before, torch.from_numpy(masks), torch.from_numpy(facts))
        return self._with_teacher(loss, metrics, last, pictures)

    def _with_teacher(
        self, loss: torch.Tensor, metrics: Metrics, last: torch.Tensor, pictures: torch.Tensor
    ) -> tuple[torch.Tensor, Metrics]:
        """The loss, and how far the tokens of pictures are from those of the model that the training goes on with: its
        decoder reads these."""
        if self.teacher is None or not len(pictures):
            return loss, metrics
        encoder, projector = self.teacher
        with torch.no_grad():
            meant = projector(vision_encoder.features(encoder, pictures)[0].float().flatten(2).permute(0, 2, 1))
        tokens = self.model.model.multi_modal_projector(last.float().flatten(2).permute(0, 2, 1))
        apart = functional.mse_loss(tokens, meant) / meant.var()
        return loss + apart, {**metrics, "apart": float(apart.detach())}

    # Stage 3.

    def train_decoder(self, states: Any, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Trains the decoder on synthetic scenes, whose states are drawn from `states` (N, A)."""
        preset = self.preset

        def step_loss(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
            return self.language_loss(states, rng, max(0.1, 0.6 - step / 400))

        language = self.model.model.language_model
        parts: dict[str, nn.Module] = {"decoder": language}
        if self.keeps_words:  # which have a rate of their own
            parts = {"words": language.embed_tokens, "layers": language.layers, "norm": language.norm}
        parts |= {"codes": self.codes, "probe": self.probe}
        self.model.train()
        rates = _KEEPING if self.keeps_words else None
        train_stage("language", file, parts, preset.language, step_loss, self.seed + 1, watch, stopped, rates)

    def language_loss(self, states: Any, rng: np.random.Generator, open_share: float) -> tuple[torch.Tensor, Metrics]:
        """The loss of answers on synthetic scenes."""
        facts, shown = decoder.SyntheticScenes(self.labels, states, rng).scenes(self.preset.imagined)
        self.sampler.reseed(int(rng.integers(2**31)))
        asked = self.sampler.ask(facts, shown.shape[1], self.preset.questions, open_share)
        tokens = self.codes(shown.to(self.device))
        tokens = tokens + 0.05 * torch.randn_like(tokens)
        return self._question_loss(tokens, asked)

    # Stages 4 and 5.

    def train_jointly(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Trains all parts on pictures and questions."""
        pool, preset = self.pool(folder), self.preset

        def step_loss(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
            if step < preset.align:
                return self._alignment_loss(pool, rng)
            share = 0.0 if preset.further else 0.3 * max(0.0, 1.0 - 2.0 * step / preset.together.steps)
            return self.answer_loss(pool, rng, share)

        self._train_all("together", file, preset.together, step_loss, self.seed + 2, watch, stopped)

    def train_camera_subsets(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Continues, in half of the steps with a subset of the cameras: a closer look of a run uses one camera, and a
        failed camera is left out. For atoms that cannot be seen, the model is to answer with their frequency."""
        pool = self.pool(folder)

        def step_loss(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
            return self.answer_loss(pool, rng, 0.0, fewer=True)

        self._train_all("fewer", file, self.preset.fewer, step_loss, self.seed + 3, watch, stopped)

    def _train_all(
        self,
        stage: str,
        file: Path,
        schedule: Schedule,
        step_loss: Callable[[int, np.random.Generator], tuple[torch.Tensor, Metrics]],
        seed: int,
        watch: Watch,
        stopped: Callable[[], bool],
    ) -> None:
        model = self.model.model
        model.vision_tower.to(memory_format=torch.channels_last)
        parts = {
            "tower": model.vision_tower,
            "dense": self.dense,
            "projector": model.multi_modal_projector,
            "decoder": model.language_model,
            "probe": self.probe,
        }
        self.model.train()
        train_stage(stage, file, parts, schedule, step_loss, seed, watch, stopped, {"tower": 0.6, "dense": 0.6})

    def _alignment_loss(self, pool: ShardPool, rng: np.random.Generator) -> tuple[torch.Tensor, Metrics]:
        """The distance of the projector's tokens from the codes of what they show; the encoder is not trained."""
        scenes = self._encoded(pool, rng, None, learning=False)
        return scenes.apart, {"apart": float(scenes.apart.detach())}

    def answer_loss(
        self, pool: ShardPool, rng: np.random.Generator, share: float, fewer: bool = False
    ) -> tuple[torch.Tensor, Metrics]:
        """The loss of answers on pictures. `share` is the weight of the tokens' distance from their codes."""
        scenes = self._encoded(pool, rng, self._camera_subset(rng) if fewer and rng.random() < 0.5 else None)
        self.sampler.reseed(int(rng.integers(2**31)))
        asked = self.sampler.ask(scenes.facts, scenes.tokens.shape[1], self.preset.questions, 0.1)
        loss, metrics = self._question_loss(scenes.tokens, asked)
        apart = {"apart": float(scenes.apart.detach())} if share else {}
        return loss + 0.3 * scenes.dense + share * scenes.apart, {**metrics, **scenes.metrics, **apart}

    def _encoded(
        self, pool: ShardPool, rng: np.random.Generator, cameras: list[int] | None, learning: bool = True
    ) -> EncodedScenes:
        """Encodes random scenes by encoder and projector; with `cameras`, their pictures alone, in this order."""
        raw, masks, facts = pool.scenes(self.preset.scenes, rng)
        if cameras is not None:
            raw, masks = raw[:, cameras], masks[:, cameras]
        shown = raw.shape[1]
        flat = vision_encoder.prepared(raw.reshape(-1, *raw.shape[2:]), rng).to(self.device)
        with torch.set_grad_enabled(learning):
            last, before = vision_encoder.features(self.model.model.vision_tower, flat)
        cells = self.model.model.multi_modal_projector(last.float().flatten(2).permute(0, 2, 1))
        every, each = np.repeat(facts, shown, axis=0), masks.reshape(-1, *masks.shape[2:])
        meant = self.codes(self._shown(each, every)).detach()
        apart = functional.mse_loss(cells, meant) / meant.var()
        dense, metrics = self.dense(last, before, torch.from_numpy(each), torch.from_numpy(every))
        tokens = self.row(cells.reshape(len(facts), shown, *cells.shape[1:]))
        return EncodedScenes(facts, tokens, apart, dense, metrics)

    def _camera_subset(self, rng: np.random.Generator) -> list[int]:
        """A random subset of the cameras, in order: all but one as often as one or two."""
        count = self.cameras
        few = int(rng.integers(1, min(2, count) + 1)) if rng.random() < 0.5 else max(1, count - 1)
        return sorted(rng.choice(count, few, replace=False).tolist())

    def row(self, cells: torch.Tensor) -> torch.Tensor:
        """The tokens at the beginning of a scene's row: (B, C, N, D) to (B, C * (1 + N), D), each picture's marker
        first."""
        count, cameras, _, width = cells.shape
        markers = self.model.model.language_model.embed_tokens(self._markers[:cameras])
        markers = markers[None, :, None, :].expand(count, cameras, 1, width)
        return torch.cat([markers, cells], 2).reshape(count, -1, width)

    def _question_loss(self, tokens: torch.Tensor, asked: Any) -> tuple[torch.Tensor, Metrics]:
        asked = asked.to(self.device)
        logits, last, inner = decoder.answers(self.model, tokens, asked)
        loss = decoder.loss_of(logits, last, inner, self.probe, asked, self.sampler.affirmative)
        metrics = {"loss": float(loss.total.detach()), "yes": loss.yes, "no": loss.no}
        return loss.total, {**metrics, "open": loss.open, "probe": loss.probe}

    def _shown(self, masks: np.ndarray[Any, Any], facts: np.ndarray[Any, Any]) -> torch.Tensor:
        """The input of `CellEmbeddings` for each cell: (B, N, items + facets), from 0 to 1."""
        pixels = vision_encoder.shown(torch.from_numpy(masks), len(self.labels.items), self.preset.size.grid)
        amount = (pixels / (_FULL * (masks.shape[-1] / self.preset.size.grid) ** 2)).clamp_max_(1.0)
        true = torch.from_numpy(facts).float()[:, self.labels.facet_atoms, None, None]
        each = torch.cat([amount, amount[:, self.labels.facet_items] * true], 1)
        return each.flatten(2).permute(0, 2, 1).to(self.device)


class ShardPool:
    """Random access to the shards of a folder, including those that are added later."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: dict[int, image_shards.Shard] = {}

    def scenes(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray[Any, Any], ...]:
        """Pictures (B, C, S, S, 3), masks (B, C, M, M) and facts (B, A) of random samples."""
        drawn = [self._one(rng) for _ in range(count)]
        return tuple(
            np.stack([getattr(shard, name)[index] for shard, index in drawn]) for name in ("pictures", "items", "facts")
        )

    def single(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray[Any, Any], ...]:
        """Single random pictures: (B, S, S, 3), (B, M, M), (B, A)."""
        drawn = [self._one(rng) for _ in range(count)]
        chosen = [(shard, at, int(rng.integers(shard.pictures.shape[1]))) for shard, at in drawn]
        return (
            np.stack([shard.pictures[at, camera] for shard, at, camera in chosen]),
            np.stack([shard.items[at, camera] for shard, at, camera in chosen]),
            np.stack([shard.facts[at] for shard, at, _ in chosen]),
        )

    def states(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """The states of all samples, (N, A)."""
        return np.concatenate([self._shard(number).facts for number in image_shards.shards(self._folder)])

    def _one(self, rng: np.random.Generator) -> tuple[image_shards.Shard, int]:
        numbers = image_shards.shards(self._folder)
        shard = self._shard(numbers[int(rng.integers(len(numbers)))])
        return shard, int(rng.integers(len(shard.facts)))

    def _shard(self, number: int) -> image_shards.Shard:
        if number not in self._open:
            self._open[number] = image_shards.read_shard(self._folder, number)
        return self._open[number]
