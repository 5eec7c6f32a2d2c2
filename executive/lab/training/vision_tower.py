"""Stage 1: to see. The tower learns, for each cell of a picture, which items it shows and what is true of each.

The labels are dense and free: the simulator draws which item each pixel shows, and an item's atoms are true wherever it
is seen.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.lab.training.image_shards import MASK
from executive.lab.training.label_space import Subject
from executive.lab.training.network import MEAN, STD
from executive.lab.training.presets import Size

FEWEST = 3
"""Pixels of the mask that a cell must show of an item before the cell is asked what is true of it."""

_PLAIN, _BLUR, _JPEG = 0.4, 0.15, 0.15
_GRAIN = 1 << 22


class Dense(nn.Module):
    """What is read off the tower's cells while it learns, and off those of the stage before, which are half as wide."""

    def __init__(self, size: Size, subject: Subject) -> None:
        super().__init__()
        self._owner, self._atom = subject.facet_items, subject.facet_atoms
        self._items = len(subject.items)
        self.cells = nn.Conv2d(size.widths[-1], self._items + len(subject.facets), 1)
        self.halves = nn.Conv2d(size.widths[-2], self._items, 1)

    def forward(
        self, last: torch.Tensor, before: torch.Tensor, masks: torch.Tensor, facts: torch.Tensor
    ) -> tuple[torch.Tensor, dict[str, float]]:
        """The loss, and what it is made of.

        Args:
            last: the tower's output, (B, C, G, G).
            before: that of the stage before, (B, C', 2G, 2G).
            masks: which item a pixel shows, (B, M, M).
            facts: which atoms are true, (B, A).
        """
        grid, masks, facts = last.shape[-1], masks.to(last.device), facts.to(last.device)
        pixels = shown(masks, self._items, grid)
        out = self.cells(last.float())
        seen = functional.binary_cross_entropy_with_logits(
            out[:, : self._items], (pixels >= 1).float(), weight=torch.where((pixels > 0) & (pixels < FEWEST), 0.3, 1.0)
        )
        clear = (pixels >= FEWEST).float()[:, self._owner]
        true = facts.float()[:, self._atom, None, None].expand_as(clear)
        wrong = functional.binary_cross_entropy_with_logits(out[:, self._items :], true, reduction="none")
        known = (wrong * clear).sum() / (clear.sum() + 1.0)
        halves = (shown(masks, self._items, 2 * grid) >= 1).float()
        finer = functional.binary_cross_entropy_with_logits(self.halves(before.float()), halves)
        told = {"seen": float(seen.detach()), "known": float(known.detach()), "finer": float(finer.detach())}
        return 5.0 * seen + known + 2.0 * finer, told


def shown(masks: torch.Tensor, items: int, grid: int) -> torch.Tensor:
    """How many pixels of the mask each cell shows of each item: (B, items, grid, grid)."""
    cell = MASK // grid
    each = torch.stack([masks == item + 1 for item in range(items)], 1).float()
    return functional.avg_pool2d(each, cell) * cell**2


def features(tower: nn.Module, pictures: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The outputs of the tower's last stage and of the one before."""
    with torch.autocast(pictures.device.type, torch.bfloat16):
        states = tower(pictures, output_hidden_states=True).hidden_states
    return states[-1], states[-2]


def prepared(raw: np.ndarray[Any, np.dtype[np.uint8]], rng: np.random.Generator, spoil: bool = True) -> torch.Tensor:
    """Pictures (B, S, S, 3) as the model takes them, (B, 3, S, S): normalised, and most of them made worse.

    Contrast, brightness, saturation and the colours' balance are one matrix a picture; then there are grain, blur, and
    JPEG of qualities from 25 on.
    """
    count, side = len(raw), raw.shape[1]
    if spoil:
        raw = raw.copy()
        for index in np.flatnonzero(rng.random(count) < _JPEG):
            raw[index] = _through_jpeg(raw[index], int(rng.integers(25, 90)))
    x = torch.from_numpy(np.ascontiguousarray(raw)).float().view(count, side * side, 3)
    worse = (rng.random(count) >= _PLAIN) * float(spoil)
    contrast, saturation = (1.0 + worse * rng.uniform(-spread, spread, count) for spread in (0.25, 0.3))
    bright = worse * rng.uniform(-0.08, 0.08, count)
    balance = 1.0 + worse[:, None] * rng.uniform(-0.06, 0.06, (count, 3))
    matrix = np.eye(3) * saturation[:, None, None] + ((1.0 - saturation) / 3.0)[:, None, None]
    matrix = matrix * (balance * contrast[:, None])[:, :, None]
    mean = x.mean((1, 2)).numpy() / 255.0
    offset = (bright + mean * (1.0 - contrast) - MEAN) / STD
    y = torch.baddbmm(
        torch.from_numpy(offset)[:, None, None].float().expand(count, 1, 3),
        x,
        torch.from_numpy(matrix.transpose(0, 2, 1) / (255.0 * STD)).float(),
    )
    if spoil:
        _add_grain(y, worse * rng.uniform(0.0, 0.04, count) / STD, rng)
    y = y.view(count, side, side, 3).permute(0, 3, 1, 2)
    blurred = torch.from_numpy(np.flatnonzero((rng.random(count) < _BLUR) & (worse > 0)))
    if len(blurred):
        y[blurred] = functional.avg_pool2d(functional.pad(y[blurred], (1, 1, 1, 1), mode="replicate"), 3, 1)
    return y.clamp_((0.0 - MEAN) / STD, (1.0 - MEAN) / STD)


_grain: torch.Tensor | None = None


def _add_grain(y: torch.Tensor, strength: np.ndarray[Any, Any], rng: np.random.Generator) -> None:
    """Add noise, in place. Drawing as much as is needed each time would cost more than the tower; it is cut from one
    long piece."""
    global _grain
    length = y[0].numel()
    if _grain is None or len(_grain) < 2 * length:
        _grain = torch.randn(max(_GRAIN, 2 * length), generator=torch.Generator().manual_seed(0))
    for index in np.flatnonzero(strength):
        begin = int(rng.integers(len(_grain) - length))
        y[index].view(-1).add_(_grain[begin : begin + length], alpha=float(strength[index]))


def _through_jpeg(picture: np.ndarray[Any, np.dtype[np.uint8]], quality: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=quality)
    return np.asarray(Image.open(buffer))
