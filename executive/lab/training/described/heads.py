"""What is learned about described objects beside the model itself: dense labels of cells, and the codes of channels."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.lab.training.described.space import DescribedSpace, Scenes
from executive.lab.training.described.words import Words
from executive.lab.training.presets import ModelSize
from executive.lab.training.vision_encoder import FEWEST

MASK = 96
"""The side of a mask, in pixels: small objects are told from each other by it."""

_CLEAR = 20
"""The mask pixels of an object from which on its values are to be told."""

_EDGE = 4
"""Mask pixels from the edge of what is shown, within which an object's surroundings may be out of view."""

_FULL = 0.2
"""The share of a cell from which on an object counts in it as much as one that fills it."""


class Dense(nn.Module):
    """The linear heads on the cells of the encoder's last stage, which read the channels of the objects that a cell
    shows, and on those of the stage before, half as wide, which read values alone.

    A cell that shows a sliver of a block cannot say what it is; what all cells say that show the block, each by how
    much of it, has to be right (`named`), and what they say of what it is on, and of what is on it (`related`). That is
    how answers are read off them, too.
    """

    def __init__(self, size: ModelSize, space: DescribedSpace) -> None:
        super().__init__()
        self._values = len(space.values)
        ends = list(accumulate(map(len, space.attributes.values())))
        self._own = [slice(first, end) for first, end in zip([0, *ends], ends, strict=False)]
        starts = range(self._values + len(space.unary), space.size, self._values)
        self._related = [slice(start + of.start, start + of.stop) for start in starts for of in self._own]
        self.cells = nn.Conv2d(size.widths[-1], space.size, 1)
        self.halves = nn.Conv2d(size.widths[-2], self._values, 1)

    def forward(
        self,
        last: torch.Tensor,
        before: torch.Tensor,
        masks: torch.Tensor,
        channels: torch.Tensor,
        told: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, dict[str, float]]:
        """Returns the loss and its components.

        Args:
            last: the output of the last stage, (B, C, G, G).
            before: the output of the stage before, (B, C', 2G, 2G).
            masks: the object that each pixel shows, (B, MASK, MASK).
            channels: what can be read off each object, (B, K, H).
            told: which channels the pictures tell, (B, H), 1 or 0; all of them if None.
        """
        grid, masks, channels = last.shape[-1], masks.to(last.device), channels.to(last.device)
        told = torch.ones_like(channels[:, 0]) if told is None else told.to(last.device)
        values, others = told[:, : self._values, None, None], told[:, self._values :, None, None]
        pixels = shown(masks, channels.shape[1], grid)
        amount = torch.einsum("bkhw,bkv->bvhw", pixels, channels[..., : self._values])
        out = self.cells(last.float())
        seen = functional.binary_cross_entropy_with_logits(
            out[:, : self._values],
            (amount >= 1).float(),
            weight=values * torch.where((amount > 0) & (amount < FEWEST), 0.3, 1.0),
        )
        inner = ~at_edge(masks, channels.shape[1])
        clear = (pixels >= FEWEST).float() * inner[..., None, None]
        there = clear.amax(1, keepdim=True)
        true = torch.einsum("bkhw,bkv->bvhw", clear, channels[..., self._values :]).clamp_max(1.0)
        wrong = functional.binary_cross_entropy_with_logits(out[:, self._values :], true, reduction="none")
        known = (wrong * there * others).sum() / ((there * others).sum() + 1.0)
        finer = shown(masks, channels.shape[1], 2 * grid)
        amount = torch.einsum("bkhw,bkv->bvhw", finer, channels[..., : self._values])
        read = self.halves(before.float())
        halves = functional.binary_cross_entropy_with_logits(read, (amount >= 1).float(), values.expand_as(read))
        shows = torch.ones_like(inner)
        named = _told(out, pixels, channels, told, self._own, shows) + _told(
            read, finer, channels, told, self._own, shows
        )
        related = _told(out, pixels, channels, told, self._related, inner)
        losses = {"seen": seen, "named": named, "known": known, "related": related, "finer": halves}
        total = 5.0 * seen + named + 2.0 * known + related + 2.0 * halves
        return total, {name: float(loss.detach()) for name, loss in losses.items()}


def _told(
    read: torch.Tensor,
    pixels: torch.Tensor,
    channels: torch.Tensor,
    told: torch.Tensor,
    attributes: Sequence[slice],
    counted: torch.Tensor,
) -> torch.Tensor:
    """The cross-entropy of what is read (B, H, G, G) off the cells that show an object, weighed by how many `pixels`
    (B, K, G, G) of it they show: the sum over attributes, the mean over those of the `counted` (B, K) objects of which
    an attribute has one value."""
    each = pixels.sum((2, 3))
    means = torch.einsum("bkhw,bvhw->bkv", pixels, read) / each.clamp_min(1.0)[..., None]
    loss = read.new_zeros(())
    for of in attributes:
        true = channels[..., of]
        counts = ((each >= _CLEAR) & counted & (true.sum(2) == 1.0)) * told[:, None, of.start]
        missed = functional.cross_entropy(means[..., of].flatten(0, 1), true.argmax(2).flatten(), reduction="none")
        loss = loss + (missed.view_as(counts) * counts).sum() / (counts.sum() + 1.0)
    return loss


def at_edge(masks: torch.Tensor, objects: int) -> torch.Tensor:
    """Which objects (B, K) reach the edge of what masks (B, M, M) show: what they are on may be out of view."""
    band = masks.clone()
    band[:, _EDGE:-_EDGE, _EDGE:-_EDGE] = 0
    reached = torch.zeros(len(masks), objects + 1, dtype=torch.bool, device=masks.device)
    return reached.scatter_(1, band.flatten(1).long(), value=True)[:, 1:]


class Codes(nn.Module):
    """The target embedding of a cell: the sum of the codes of what can be read off it. The code of a value is the
    negative embedding of its word; those of what an object stands in a relation to are other vectors, so that a cell
    says which of two descriptions is which."""

    def __init__(self, model: Any, tokenizer: Any, space: DescribedSpace, words: Words) -> None:
        super().__init__()
        embedding = model.model.language_model.embed_tokens.weight.detach()

        def mean_embedding(text: str) -> torch.Tensor:
            mean: torch.Tensor = embedding[torch.tensor(tokenizer(text, add_special_tokens=False)["input_ids"])].mean(0)
            return mean

        values = torch.stack([mean_embedding(words.values[value][0]) for value in space.values])
        others = embedding.std() * torch.randn(space.size - len(values), embedding.shape[1])
        self.codes = nn.Parameter(torch.cat([-values, others]))
        self.ground = nn.Parameter(0.3 * torch.randn(embedding.shape[1]) * embedding.std())

    def forward(self, read_off: torch.Tensor) -> torch.Tensor:
        """Maps how much of each channel a cell shows, (..., H), to its token, (..., D)."""
        tokens: torch.Tensor = self.ground + read_off @ self.codes
        return tokens


def shown(masks: torch.Tensor, objects: int, grid: int) -> torch.Tensor:
    """Counts the mask pixels of each object in each cell: (B, K, grid, grid)."""
    cell = masks.shape[-1] // grid
    each = functional.one_hot(masks.long(), objects + 1)[..., 1:].permute(0, 3, 1, 2).float()
    return functional.avg_pool2d(each, cell) * cell**2


def read_off_cells(masks: torch.Tensor, channels: torch.Tensor, grid: int) -> torch.Tensor:
    """The input of `Codes` for each cell of pictures: (B, grid * grid, H)."""
    full = _FULL * (masks.shape[-1] / grid) ** 2
    amount = (shown(masks, channels.shape[1], grid) / full).clamp_max_(1.0)
    return torch.einsum("bkhw,bkc->bhwc", amount, channels).flatten(1, 2)


TOKENS = 96
"""Cells of a synthetic scene."""


def synthetic(space: DescribedSpace, scenes: Scenes, rng: np.random.Generator) -> torch.Tensor:
    """The cells that a perfect vision encoder would make of scenes, (B, TOKENS, H): each object in some of them."""
    channels = scenes.channels().astype(np.float32)
    there = scenes.own[:, : space.most].any(axis=2)
    read_off = np.zeros((len(channels), TOKENS, space.size), np.float32)
    for row, number in np.argwhere(there):
        for cell in rng.integers(TOKENS, size=int(rng.integers(1, 5))):
            read_off[row, cell] += rng.uniform(0.3, 1.0) * channels[row, number]
    return torch.from_numpy(read_off)
