"""From nothing to an eye: the stages of training, one after the other, each of which can be gone on with.

1. Pictures: moments are drawn, and kept with what each pixel shows (`pictures`).
2. Tower: it learns from dense labels what each cell shows, and what is true of that (`tower`).
3. Language: the decoder learns to look words up, on scenes that are only imagined (`decoder`).
4. Together: the projector is taught to say in the decoder's words what the tower sees; then all of it learns from
   pictures, questions and answers.
5. Fewer: the same with some of the pictures, for closer looks and for cameras that fail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.nn import functional

from executive.domain.loader import Domain
from executive.lab.training import decoder, image_shards, network, tokenizer, vision_tower
from executive.lab.training.label_space import Subject
from executive.lab.training.optimiser import Report, Told, descend
from executive.lab.training.presets import Pace, Recipe
from executive.lab.training.question_batches import Asker
from executive.lab.training.wordings import Wordings
from executive.s3e.questions import prompts
from executive.s3e.questions.templates import Templates, generic, load_instructions
from executive.sim.spec import read_scene

TOWER, LANGUAGE, TOGETHER, FEWER = "tower.pt", "language.pt", "together.pt", "fewer.pt"

Watch = Callable[[Report], None]


class _Scenes(NamedTuple):
    """Scenes taken in: what is true (B, A), the tokens of each (B, P, D), and how wrong tokens and tower are."""

    facts: np.ndarray[Any, Any]
    tokens: torch.Tensor
    apart: torch.Tensor
    dense: torch.Tensor
    told: Told


class Eye:
    """An eye that is being grown: all of its parts, and what it is asked.

    Args:
        seed: fixes everything.
    """

    def __init__(self, domain: Domain, recipe: Recipe, seed: int, wordings: Path | None = None) -> None:
        torch.manual_seed(seed)
        self.recipe, self.seed, self.domain = recipe, seed, domain
        self.subject = Subject.of(domain)
        stage = read_scene(domain.scene)
        self.cameras = len(stage.cameras)
        said = domain.subject
        templates = Templates.read(said.questions) if said.questions is not None else generic(domain.task)
        there = {item.name for item in stage.items} | {table.name for table in stage.tables}
        self.wordings = Wordings.of(domain.task, templates, wordings, there)
        instructions = load_instructions(said.instructions) if said.instructions is not None else ""
        instructed = prompts.instructed(prompts.QUESTION_ANSWERING, instructions)
        untranslated = prompts.no_translation(said.pddl.read_text(encoding="utf-8"), domain.task.objects)
        self.systems = [("", 0.45), (prompts.QUESTION_ANSWERING, 0.3), (instructed, 0.25)]
        self.tokenizer = tokenizer.make_tokenizer(self._corpus([instructed, untranslated]), recipe.vocabulary)
        self.model = network.build(recipe.size, self.tokenizer)
        self.dense = vision_tower.Dense(recipe.size, self.subject)
        self.codes = decoder.Codes(self.model, self.tokenizer, self.subject, self.wordings)
        self.probe = decoder.Probe(recipe.size, self.subject)
        self.asker = Asker(self.subject, self.wordings, self.tokenizer, self.systems, untranslated, seed)
        marks = self.tokenizer.convert_tokens_to_ids(list(tokenizer.PICTURES))
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._marks = torch.tensor(marks, device=self.device)
        for part in (self.model, self.dense, self.codes, self.probe):
            part.to(self.device)

    def _corpus(self, texts: Sequence[str]) -> list[str]:
        import random

        rng = random.Random(self.seed)
        asked = [self.wordings.draw(atom, rng)[0] for _ in range(400) for atom in self.domain.task.atoms]
        named = [name for names in self.wordings.names.values() for name in names]
        return [*asked, *(5 * [*texts, *Asker.corpus(self.subject), *named, *map(str, self.domain.task.atoms)])]

    # Stage 2.

    def learn_to_see(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Train the tower on the shards in `folder`."""
        pool, recipe = Pool(folder), self.recipe
        seeing = self.model.model.vision_tower.to(memory_format=torch.channels_last)

        def one(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Told]:
            raw, masks, facts = pool.single(recipe.batch, rng)
            last, before = vision_tower.features(seeing, vision_tower.prepared(raw, rng).to(self.device))
            loss, told = self.dense(last, before, torch.from_numpy(masks), torch.from_numpy(facts))
            return loss, told

        parts = {"tower": seeing, "dense": self.dense}
        seeing.train()
        descend("tower", file, parts, recipe.tower, one, self.seed, watch, stopped)

    # Stage 3.

    def learn_to_read(
        self, states: np.ndarray[Any, Any], file: Path, watch: Watch, stopped: Callable[[], bool]
    ) -> None:
        """Train the decoder on imagined scenes, in states (N, A) such as these."""
        recipe, asker = self.recipe, self.asker

        def one(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Told]:
            facts, shown = decoder.Imagined(self.subject, states, rng).scenes(recipe.scenes)
            asker.begin(int(rng.integers(2**31)))
            asked = asker.ask(facts, shown.shape[1], recipe.questions, max(0.1, 0.6 - step / 400))
            tokens = self.codes(shown.to(self.device))
            tokens = tokens + 0.05 * torch.randn_like(tokens)
            return self._learn(tokens, asked)

        parts = {"decoder": self.model.model.language_model, "codes": self.codes, "probe": self.probe}
        self.model.train()
        descend("language", file, parts, recipe.language, one, self.seed + 1, watch, stopped)

    # Stages 4 and 5.

    def learn_together(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Train everything on pictures and questions."""
        pool, recipe = Pool(folder), self.recipe

        def one(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Told]:
            if step < recipe.align:
                return self._align(pool, rng)
            return self._look(pool, rng, 0.3 * max(0.0, 1.0 - 2.0 * step / recipe.together.steps))

        self._descend("together", file, recipe.together, one, self.seed + 2, watch, stopped)

    def learn_with_fewer(self, folder: Path, file: Path, watch: Watch, stopped: Callable[[], bool]) -> None:
        """Go on, in half of the steps with some of the pictures alone: a run looks closer through the camera that shows
        best what is in doubt, and leaves out one that shows nothing. What cannot be seen then is to be told as what it
        is as often as it is."""
        pool = Pool(folder)

        def one(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, Told]:
            return self._look(pool, rng, 0.0, fewer=True)

        self._descend("fewer", file, self.recipe.fewer, one, self.seed + 3, watch, stopped)

    def _descend(
        self,
        stage: str,
        file: Path,
        pace: Pace,
        one: Callable[[int, np.random.Generator], tuple[torch.Tensor, Told]],
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
        descend(stage, file, parts, pace, one, seed, watch, stopped, {"tower": 0.6, "dense": 0.6})

    def _align(self, pool: Pool, rng: np.random.Generator) -> tuple[torch.Tensor, Told]:
        """How far the projector's tokens are from the codes of what they show; the tower is left as it is."""
        scenes = self._taken_in(pool, rng, None, learning=False)
        return scenes.apart, {"apart": float(scenes.apart.detach())}

    def _look(
        self, pool: Pool, rng: np.random.Generator, share: float, fewer: bool = False
    ) -> tuple[torch.Tensor, Told]:
        """Pictures, questions, answers. `share` is the weight of the tokens' distance from their codes."""
        scenes = self._taken_in(pool, rng, self._some(rng) if fewer and rng.random() < 0.5 else None)
        self.asker.begin(int(rng.integers(2**31)))
        asked = self.asker.ask(scenes.facts, scenes.tokens.shape[1], self.recipe.questions, 0.1)
        loss, told = self._learn(scenes.tokens, asked)
        apart = {"apart": float(scenes.apart.detach())} if share else {}
        return loss + 0.3 * scenes.dense + share * scenes.apart, {**told, **scenes.told, **apart}

    def _taken_in(
        self, pool: Pool, rng: np.random.Generator, cameras: list[int] | None, learning: bool = True
    ) -> _Scenes:
        """Scenes at random through the tower and the projector; with `cameras`, their pictures alone, in this order."""
        raw, masks, facts = pool.scenes(self.recipe.scenes, rng)
        if cameras is not None:
            raw, masks = raw[:, cameras], masks[:, cameras]
        shown = raw.shape[1]
        flat = vision_tower.prepared(raw.reshape(-1, *raw.shape[2:]), rng).to(self.device)
        with torch.set_grad_enabled(learning):
            last, before = vision_tower.features(self.model.model.vision_tower, flat)
        cells = self.model.model.multi_modal_projector(last.float().flatten(2).permute(0, 2, 1))
        every, each = np.repeat(facts, shown, axis=0), masks.reshape(-1, *masks.shape[2:])
        meant = self.codes(self._shown(each, every)).detach()
        apart = functional.mse_loss(cells, meant) / meant.var()
        dense, told = self.dense(last, before, torch.from_numpy(each), torch.from_numpy(every))
        tokens = self.row(cells.reshape(len(facts), shown, *cells.shape[1:]))
        return _Scenes(facts, tokens, apart, dense, told)

    def _some(self, rng: np.random.Generator) -> list[int]:
        """Some of the cameras, in order: all but one as often as one or two."""
        count = self.cameras
        few = int(rng.integers(1, min(2, count) + 1)) if rng.random() < 0.5 else max(1, count - 1)
        return sorted(rng.choice(count, few, replace=False).tolist())

    def row(self, cells: torch.Tensor) -> torch.Tensor:
        """The tokens that a scene's row begins with: (B, C, N, D) to (B, C * (1 + N), D), each picture's mark first."""
        count, cameras, _, width = cells.shape
        marks = self.model.model.language_model.embed_tokens(self._marks[:cameras])
        marks = marks[None, :, None, :].expand(count, cameras, 1, width)
        return torch.cat([marks, cells], 2).reshape(count, -1, width)

    # Inside.

    def _learn(self, tokens: torch.Tensor, asked: Any) -> tuple[torch.Tensor, Told]:
        asked = asked.to(self.device)
        logits, inner = decoder.answers(self.model, tokens, asked)
        loss = decoder.loss_of(logits, inner, self.probe, asked, self.asker.affirmative)
        told = {"loss": float(loss.total.detach()), "yes": loss.yes, "no": loss.no}
        return loss.total, {**told, "open": loss.open, "probe": loss.probe}

    def _shown(self, masks: np.ndarray[Any, Any], facts: np.ndarray[Any, Any]) -> torch.Tensor:
        """What each cell shows as `Codes` takes it: (B, N, items + facets), from 0 to 1."""
        pixels = vision_tower.shown(torch.from_numpy(masks), len(self.subject.items), self.recipe.size.grid)
        amount = (pixels / 12.0).clamp_max_(1.0)
        true = torch.from_numpy(facts).float()[:, self.subject.facet_atoms, None, None]
        each = torch.cat([amount, amount[:, self.subject.facet_items] * true], 1)
        return each.flatten(2).permute(0, 2, 1).to(self.device)


class Pool:
    """Random access to the shards of a folder, those that are added meanwhile included."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: dict[int, image_shards.Shard] = {}

    def scenes(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray[Any, Any], ...]:
        """Pictures (B, C, S, S, 3), masks (B, C, M, M) and facts (B, A) of moments at random."""
        drawn = [self._one(rng) for _ in range(count)]
        return tuple(
            np.stack([getattr(shard, name)[index] for shard, index in drawn]) for name in ("pictures", "items", "facts")
        )

    def single(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray[Any, Any], ...]:
        """The same of single pictures: (B, S, S, 3), (B, M, M), (B, A)."""
        drawn = [self._one(rng) for _ in range(count)]
        chosen = [(shard, at, int(rng.integers(shard.pictures.shape[1]))) for shard, at in drawn]
        return (
            np.stack([shard.pictures[at, camera] for shard, at, camera in chosen]),
            np.stack([shard.items[at, camera] for shard, at, camera in chosen]),
            np.stack([shard.facts[at] for shard, at, _ in chosen]),
        )

    def states(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """The states of all moments, (N, A)."""
        return np.concatenate([self._shard(number).facts for number in image_shards.shards(self._folder)])

    def _one(self, rng: np.random.Generator) -> tuple[image_shards.Shard, int]:
        numbers = image_shards.shards(self._folder)
        shard = self._shard(numbers[int(rng.integers(len(numbers)))])
        return shard, int(rng.integers(len(shard.facts)))

    def _shard(self, number: int) -> image_shards.Shard:
        if number not in self._open:
            self._open[number] = image_shards.read_shard(self._folder, number)
        return self._open[number]
