"""The decoder at work in training: scenes as tokens, questions after them, answers and probes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.lab.training.label_space import Subject
from executive.lab.training.presets import Size
from executive.lab.training.question_batches import Asked
from executive.lab.training.wordings import Wordings

PROBED = 2
"""After which layer of the decoder the probe reads."""


class Codes(nn.Module):
    """What a token is that shows something: minus the words for it. One code for each item, one for each facet, and
    one for everything else."""

    def __init__(self, model: Any, tokenizer: Any, subject: Subject, wordings: Wordings) -> None:
        super().__init__()
        embedding = model.model.language_model.embed_tokens.weight.detach()

        def meant(text: str) -> torch.Tensor:
            mean: torch.Tensor = embedding[torch.tensor(tokenizer(text, add_special_tokens=False)["input_ids"])].mean(0)
            return mean

        items = [meant(wordings.names[item][0]) for item in subject.items]
        facets = []
        for number, (item, index) in enumerate(subject.facets):
            others = [wordings.names[name][0] for name in subject.atoms[index].args if name != subject.items[item]]
            facets.append(meant(" ".join(others) or subject.said(number)))
        self.codes = nn.Parameter(-torch.stack([*items, *facets]))
        self.ground = nn.Parameter(0.3 * torch.randn(embedding.shape[1]) * embedding.std())

    def forward(self, shown: torch.Tensor) -> torch.Tensor:
        """Tokens (..., D) for what they show: (..., items + facets), how much of each."""
        tokens: torch.Tensor = self.ground + shown @ self.codes
        return tokens


class Probe(nn.Module):
    """Reads what is true of an item at its name."""

    def __init__(self, size: Size, subject: Subject) -> None:
        super().__init__()
        self.read = nn.Linear(size.hidden, len(subject.facets))

    def forward(self, inner: torch.Tensor) -> torch.Tensor:
        logits: torch.Tensor = self.read(functional.rms_norm(inner.float(), inner.shape[-1:]))
        return logits


@dataclass(frozen=True, slots=True)
class Loss:
    """The loss to descend, and how good the answers are: shares of right answers to yes/no questions whose answer is
    yes, to those whose answer is no, to open questions, and of items of which the probe has everything right."""

    total: torch.Tensor
    yes: float
    no: float
    open: float
    probe: float


def answers(model: Any, tokens: torch.Tensor, asked: Asked) -> tuple[torch.Tensor, torch.Tensor]:
    """Logits (N, V) where answers are read, and the inner states (M, D) where items are named.

    Args:
        tokens: what the scenes' rows begin with, (B, P, D).
    """
    decoder = model.model.language_model
    rows = torch.cat([tokens, decoder.embed_tokens(asked.ids).to(tokens.dtype)], 1)
    mask = torch.zeros(asked.mask.shape, dtype=torch.bfloat16, device=rows.device).masked_fill_(~asked.mask, -1e4)
    with torch.autocast(rows.device.type, torch.bfloat16):
        out = decoder(
            inputs_embeds=rows,
            attention_mask=mask,
            position_ids=asked.positions,
            use_cache=False,
            output_hidden_states=True,
        )
    width = rows.shape[-1]
    last = out.last_hidden_state.reshape(-1, width)[asked.last].float()
    inner = out.hidden_states[min(PROBED, len(out.hidden_states) - 2)].reshape(-1, width)[asked.probed].float()
    return last @ decoder.embed_tokens.weight.T, inner


def loss_of(logits: torch.Tensor, inner: torch.Tensor, probe: Probe, asked: Asked, yes: Sequence[int]) -> Loss:
    """How wrong the answers are. `yes` are the tokens that affirm."""
    target, yes_no = asked.answers, asked.yes_no
    total = functional.cross_entropy(logits, target)
    right = logits.argmax(1) == target
    affirmed = torch.isin(target, torch.tensor(yes, device=target.device))
    probed = float("nan")
    if len(inner):
        read = probe(inner).gather(1, asked.facets)
        known = asked.known >= 0
        wrong = functional.binary_cross_entropy_with_logits(read, asked.known.clamp_min(0.0), reduction="none")
        total = total + (wrong * known).sum() / known.sum()
        probed = float((((read > 0) == (asked.known > 0.5)) | ~known).all(1).float().mean())
    return Loss(
        total, _share(right, yes_no & affirmed), _share(right, yes_no & ~affirmed), _share(right, ~yes_no), probed
    )


def _share(right: torch.Tensor, among: torch.Tensor) -> float:
    return float(right[among].float().mean()) if among.any() else float("nan")


class Imagined:
    """Scenes that nobody has seen: tokens as a perfect tower would make them, for states drawn at random."""

    TOKENS = 64

    def __init__(self, subject: Subject, states: np.ndarray[Any, np.dtype[np.bool_]], rng: np.random.Generator) -> None:
        self._subject, self._states, self._rng = subject, states, rng

    def scenes(self, count: int) -> tuple[np.ndarray[Any, Any], torch.Tensor]:
        """`count` states (B, A), and what their tokens show (B, TOKENS, items + facets)."""
        rng, subject = self._rng, self._subject
        facts = self._states[rng.integers(len(self._states), size=count)].copy()
        shown = np.zeros((count, self.TOKENS, len(subject.items) + len(subject.facets)), np.float32)
        for row in range(count):
            for item in range(len(subject.items)):
                own = subject.of_item(item)
                true = [facet for facet in own if facts[row, subject.facets[facet][1]]]
                cells = int(rng.integers(1, 7)) if true else int(rng.integers(0, 4))
                for cell in rng.integers(self.TOKENS, size=cells):
                    amount = rng.uniform(0.3, 1.0)
                    shown[row, cell, item] += amount
                    for facet in true:
                        shown[row, cell, len(subject.items) + facet] += amount
        return facts, torch.from_numpy(shown)
