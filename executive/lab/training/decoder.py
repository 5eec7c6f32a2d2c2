"""The decoder in training: the loss of answers and probes for scenes as tokens, followed by questions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.lab.training.label_space import LabelSpace
from executive.lab.training.optimiser import autocast, compute_dtype
from executive.lab.training.presets import ModelSize
from executive.lab.training.question_batches import QuestionBatch
from executive.lab.training.wordings import Wordings
from executive.s3e.backends.packages import importing


class CellEmbeddings(nn.Module):
    """The target embedding of a cell: the negative sum of the word embeddings of what it shows. There is one code per
    item, one per facet, and one for everything else. Of a name, only the words count that fewest others have: the first
    column from the left is looked up by `first`."""

    def __init__(self, model: Any, tokenizer: Any, labels: LabelSpace, wordings: Wordings) -> None:
        super().__init__()
        embedding = model.model.language_model.embed_tokens.weight.detach()

        def tokens(text: str) -> list[int]:
            return list(tokenizer(text, add_special_tokens=False)["input_ids"])

        names = {name: tokens(called[0]) for name, called in wordings.names.items()}
        having = Counter(token for name in names.values() for token in set(name))
        own = {
            name: [token for token in found if having[token] == min(having[each] for each in found)]
            for name, found in names.items()
        }

        def mean_embedding(found: Sequence[int]) -> torch.Tensor:
            mean: torch.Tensor = embedding[torch.tensor(found)].mean(0)
            return mean

        items = [mean_embedding(own[item]) for item in labels.items]
        facets = []
        for number, (item, index) in enumerate(labels.facets):
            others = [token for name in labels.atoms[index].args if name != labels.items[item] for token in own[name]]
            facets.append(mean_embedding(others or tokens(labels.label(number))))
        self.codes = nn.Parameter(-torch.stack([*items, *facets]))
        self.ground = nn.Parameter(0.3 * torch.randn(embedding.shape[1]) * embedding.std())

    def forward(self, shown: torch.Tensor) -> torch.Tensor:
        """Maps how much a cell shows of each, (..., items + facets), to its token, (..., D)."""
        tokens: torch.Tensor = self.ground + shown @ self.codes
        return tokens


class Probe(nn.Module):
    """A linear head that predicts an item's facets from the inner state at its name."""

    def __init__(self, size: ModelSize, labels: LabelSpace) -> None:
        super().__init__()
        self.read = nn.Linear(size.hidden, len(labels.facets))

    def forward(self, inner: torch.Tensor) -> torch.Tensor:
        logits: torch.Tensor = self.read(functional.rms_norm(inner.float(), inner.shape[-1:]))
        return logits


@dataclass(frozen=True, slots=True)
class Loss:
    """The total loss, and accuracies: on yes/no questions whose answer is yes, on those whose answer is no, on open
    questions, and of the probe (items with all facets right)."""

    total: torch.Tensor
    yes: float
    no: float
    open: float
    probe: float


ATTENTION = "scene-first"
"""The name by which transformers knows `attend_scene_first`."""


def attend_scene_first(
    module: nn.Module,
    query: torch.Tensor,
    key: torch.Tensor,
    value: torch.Tensor,
    attention_mask: torch.Tensor,
    scaling: float,
    scene: int = 0,
    **_: Any,
) -> tuple[torch.Tensor, None]:
    """Attention where the first `scene` tokens of each row attend to those before them, and the rest as the mask says:
    the same as torch's own with the mask for all, which takes longer on a CPU.

    Args:
        query, key, value: (B, H, L, D).
        attention_mask: what is added to scores, (B, 1, L, L).
    """
    first = functional.scaled_dot_product_attention(
        query[:, :, :scene], key[:, :, :scene], value[:, :, :scene], is_causal=True, scale=scaling
    )
    scores = query[:, :, scene:] @ key.transpose(2, 3) * scaling + attention_mask[:, :, scene:]
    rest = torch.softmax(scores.float(), dim=-1).to(value.dtype) @ value
    return torch.cat([first, rest], 2).transpose(1, 2).contiguous(), None


def prepare(model: Any) -> None:
    """Have a model's decoder attend by `attend_scene_first`, which `answers` asks for."""
    with importing():
        from transformers import AttentionInterface

    AttentionInterface.register(ATTENTION, attend_scene_first)
    model.model.language_model.set_attn_implementation(ATTENTION)


def answers(model: Any, tokens: torch.Tensor, batch: QuestionBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns the logits (N, V) at the answers, and the inner states (M, D) at the names of items.

    Args:
        model: one that `prepare` has seen.
        tokens: the scenes, at the beginning of each row, (B, P, D).
    """
    decoder = model.model.language_model
    rows = torch.cat([tokens, decoder.embed_tokens(batch.ids).to(tokens.dtype)], 1)
    mask = torch.zeros(batch.mask.shape, dtype=compute_dtype(rows.device), device=rows.device).masked_fill_(
        ~batch.mask, -1e4
    )
    with autocast(rows.device):
        out = decoder(
            inputs_embeds=rows,
            attention_mask=mask,
            position_ids=batch.positions,
            use_cache=False,
            output_hidden_states=True,
            scene=tokens.shape[1],
        )
    width = rows.shape[-1]
    last = out.last_hidden_state.reshape(-1, width)[batch.last].float()
    inner = out.hidden_states[-2].reshape(-1, width)[batch.probed].float()
    return last @ decoder.embed_tokens.weight.T, inner


def loss_of(
    logits: torch.Tensor, inner: torch.Tensor, probe: nn.Module, batch: QuestionBatch, yes: Sequence[int]
) -> Loss:
    """The cross-entropy of the answers plus that of the probe. `yes` are the affirmative tokens."""
    target, yes_no = batch.answers, batch.yes_no
    total = functional.cross_entropy(logits, target)
    right = logits.argmax(1) == target
    affirmed = torch.isin(target, torch.tensor(yes, device=target.device))
    probed = float("nan")
    if len(inner):
        read = probe(inner).gather(1, batch.facets)
        known = batch.known >= 0
        wrong = functional.binary_cross_entropy_with_logits(read, batch.known.clamp_min(0.0), reduction="none")
        total = total + (wrong * known).sum() / known.sum()
        probed = float((((read > 0) == (batch.known > 0.5)) | ~known).all(1).float().mean())
    return Loss(
        total, _share(right, yes_no & affirmed), _share(right, yes_no & ~affirmed), _share(right, ~yes_no), probed
    )


def _share(right: torch.Tensor, among: torch.Tensor) -> float:
    return float(right[among].float().mean()) if among.any() else float("nan")


class SyntheticScenes:
    """Synthetic scenes: the tokens that a perfect vision encoder would make, for states drawn at random."""

    TOKENS = 64

    def __init__(
        self, labels: LabelSpace, states: np.ndarray[Any, np.dtype[np.bool_]], rng: np.random.Generator
    ) -> None:
        self._labels, self._states, self._rng = labels, states, rng

    def scenes(self, count: int) -> tuple[np.ndarray[Any, Any], torch.Tensor]:
        """Draws `count` states (B, A), and what their tokens show (B, TOKENS, items + facets)."""
        rng, labels = self._rng, self._labels
        facts = self._states[rng.integers(len(self._states), size=count)].copy()
        shown = np.zeros((count, self.TOKENS, len(labels.items) + len(labels.facets)), np.float32)
        for row in range(count):
            for item in range(len(labels.items)):
                own = labels.of_item(item)
                true = [facet for facet in own if facts[row, labels.facets[facet][1]]]
                cells = int(rng.integers(1, 7)) if true else int(rng.integers(0, 4))
                for cell in rng.integers(self.TOKENS, size=cells):
                    amount = rng.uniform(0.3, 1.0)
                    shown[row, cell, item] += amount
                    for facet in true:
                        shown[row, cell, len(labels.items) + facet] += amount
        return facts, torch.from_numpy(shown)
