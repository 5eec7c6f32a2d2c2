"""The decoder in training: the loss of answers and probes for scenes as tokens, followed by questions."""

from __future__ import annotations

import math
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
    """The linear heads that predict an item's facets from the inner state at its name, and from the last state before
    an answer in which attributes two objects agree (`Question`).

    Args:
        facets, attributes: how many there are; items have no attributes.
        gain: of the facets' logits.
    """

    def __init__(self, size: ModelSize, facets: int, attributes: int = 0, gain: float = 1.0) -> None:
        super().__init__()
        self._gain = gain
        self.read = nn.Linear(size.hidden, facets)
        self.compared = nn.Linear(size.hidden, attributes) if attributes else None

    def forward(self, inner: torch.Tensor) -> torch.Tensor:
        logits: torch.Tensor = self._gain * self.read(functional.rms_norm(inner.float(), inner.shape[-1:]))
        return logits

    def agreement(self, last: torch.Tensor) -> torch.Tensor:
        """Logits (N, A) that the attributes agree, from the last states (N, D)."""
        logits: torch.Tensor = last[:, :0] if self.compared is None else self.compared(last)
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


ATTENTION = "by-question"
"""The name by which transformers knows `attend_by_question`."""


def attend_by_question(
    module: nn.Module,
    query: torch.Tensor,
    key: torch.Tensor,
    value: torch.Tensor,
    attention_mask: torch.Tensor,
    scaling: float,
    questions: torch.Tensor | None = None,
    **_: Any,
) -> tuple[torch.Tensor, None]:
    """Attention where the tokens before the questions attend to those before them, and those of a question to all of
    these and to those before them in the question: the same as torch's own with the mask, which computes the attention
    between questions, too.

    Args:
        query, key, value: (B, H, L, D).
        attention_mask: not read; `questions` say the same.
        questions: the places of each question's tokens in a row, (B, Q, T), -1 after its last one.
    """
    assert questions is not None
    batch, heads, length, width = query.shape
    count, longest = questions.shape[1:]
    start = int(questions[questions >= 0].min())
    before_key, before_value = key[:, :, :start], value[:, :, :start]
    first = functional.scaled_dot_product_attention(
        query[:, :, :start], before_key, before_value, is_causal=True, scale=scaling
    )
    flat = questions.view(batch, 1, -1, 1).expand(batch, heads, count * longest, width)
    each = query.gather(2, flat.clamp_min(0))
    blocks = (batch, heads, count, longest, -1)
    keys, values = (part.gather(2, flat.clamp_min(0)).view(blocks) for part in (key, value))
    later = torch.ones(longest, longest, dtype=torch.bool, device=query.device).triu(1)
    own = (each.view(blocks) @ keys.transpose(3, 4)).masked_fill(later, -math.inf)
    scores = torch.cat([(each @ before_key.transpose(2, 3)).view(blocks), own], 4) * scaling
    weights = torch.softmax(scores.float(), dim=-1).to(value.dtype)
    read = weights[..., :start].flatten(2, 3) @ before_value + (weights[..., start:] @ values).flatten(2, 3)
    rest = read.new_zeros(batch, heads, length + 1, width)  # the last place takes what is no token
    rest = rest.scatter(2, flat.where(flat >= 0, length), read)[:, :, start:length]
    return torch.cat([first, rest.to(first.dtype)], 2).transpose(1, 2).contiguous(), None


def prepare(model: Any) -> None:
    """Have a model's decoder attend by `attend_by_question`, which `answers` asks for."""
    with importing():
        from transformers import AttentionInterface

    AttentionInterface.register(ATTENTION, attend_by_question)
    model.model.language_model.set_attn_implementation(ATTENTION)


def answers(model: Any, tokens: torch.Tensor, batch: QuestionBatch) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Returns the logits (N, V) at the answers, the last states (N, D) there, and the inner states (M, D) at the names
    of items.

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
            questions=batch.questions,
        )
    width = rows.shape[-1]
    last = out.last_hidden_state.reshape(-1, width)[batch.last].float()
    inner = out.hidden_states[-2].reshape(-1, width)[batch.probed].float()
    return last @ decoder.embed_tokens.weight.T, last, inner


def loss_of(
    logits: torch.Tensor,
    last: torch.Tensor,
    inner: torch.Tensor,
    probe: Probe,
    batch: QuestionBatch,
    yes: Sequence[int],
) -> Loss:
    """The cross-entropy of the answers plus those of the probe. `yes` are the affirmative tokens."""
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
    if batch.agree.shape[1]:
        told, known = probe.agreement(last), batch.agree >= 0
        wrong = functional.binary_cross_entropy_with_logits(told, batch.agree.clamp_min(0.0), reduction="none")
        total = total + (wrong * known).sum() / known.sum().clamp_min(1.0)
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
