"""Stage 2: the vision encoder learns for each cell of a picture which items it shows, and which atoms are true of each.

The labels are dense: the simulator renders which item each pixel shows, and an item's atoms hold wherever it is
visible.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from executive.lab.training.label_space import LabelSpace
from executive.lab.training.network import MEAN, STD
from executive.lab.training.optimiser import autocast
from executive.lab.training.presets import ModelSize

FEWEST = 3
"""The pixels of an item that a cell has to show before the item's atoms enter its loss."""

_PLAIN, _BLUR, _JPEG = 0.4, 0.15, 0.15
_NOISE_LENGTH = 1 << 22


class Dense(nn.Module):
    """The linear heads on the cells of the encoder's last stage, and on those of the stage before, half as wide."""

    def __init__(self, size: ModelSize, labels: LabelSpace) -> None:
        super().__init__()
        self._owner, self._atom = labels.facet_items, labels.facet_atoms
        self._items = len(labels.items)
        self.cells = nn.Conv2d(size.widths[-1], self._items + len(labels.facets), 1)
        self.halves = nn.Conv2d(size.widths[-2], self._items, 1)

    def forward(
        self, last: torch.Tensor, before: torch.Tensor, masks: torch.Tensor, facts: torch.Tensor
    ) -> tuple[torch.Tensor, dict[str, float]]:
        """Returns the loss and its components.

        Args:
            last: the output of the last stage, (B, C, G, G).
            before: the output of the stage before, (B, C', 2G, 2G).
            masks: the item that each pixel shows, (B, M, M).
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
        parts = {"seen": float(seen.detach()), "known": float(known.detach()), "finer": float(finer.detach())}
        return 5.0 * seen + known + 2.0 * finer, parts


def shown(masks: torch.Tensor, items: int, grid: int) -> torch.Tensor:
    """Counts the mask pixels of each item in each cell: (B, items, grid, grid)."""
    cell = masks.shape[-1] // grid
    each = torch.stack([masks == item + 1 for item in range(items)], 1).float()
    return functional.avg_pool2d(each, cell) * cell**2


def features(encoder: nn.Module, pictures: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The outputs of the encoder's last stage and of the one before."""
    with autocast(pictures.device):
        states = encoder(pictures, output_hidden_states=True).hidden_states
    return states[-1], states[-2]


def prepared(raw: np.ndarray[Any, np.dtype[np.uint8]], rng: np.random.Generator, augment: bool = True) -> torch.Tensor:
    """Normalises pictures (B, S, S, 3) to (B, 3, S, S), and augments most of them.

    Contrast, brightness, saturation and colour balance are one matrix per picture; noise, blur, and JPEG of quality 25
    and more follow.
    """
    count, side = len(raw), raw.shape[1]
    if augment:
        raw = raw.copy()
        for index in np.flatnonzero(rng.random(count) < _JPEG):
            raw[index] = _through_jpeg(raw[index], int(rng.integers(25, 90)))
    x = torch.from_numpy(np.ascontiguousarray(raw)).float().view(count, side * side, 3)
    worse = (rng.random(count) >= _PLAIN) * float(augment)
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
    if augment:
        _add_noise(y, worse * rng.uniform(0.0, 0.04, count) / STD, rng)
    y = y.view(count, side, side, 3).permute(0, 3, 1, 2)
    blurred = torch.from_numpy(np.flatnonzero((rng.random(count) < _BLUR) & (worse > 0)))
    if len(blurred):
        y[blurred] = functional.avg_pool2d(functional.pad(y[blurred], (1, 1, 1, 1), mode="replicate"), 3, 1)
    return y.clamp_((0.0 - MEAN) / STD, (1.0 - MEAN) / STD)


_noise: torch.Tensor | None = None


def _add_noise(y: torch.Tensor, strength: np.ndarray[Any, Any], rng: np.random.Generator) -> None:
    """Adds noise in place, cut from one long piece: to draw it anew each time would cost more than the encoder."""
    global _noise
    length = y[0].numel()
    if _noise is None or len(_noise) < 2 * length:
        _noise = torch.randn(max(_NOISE_LENGTH, 2 * length), generator=torch.Generator().manual_seed(0))
    for index in np.flatnonzero(strength):
        begin = int(rng.integers(len(_noise) - length))
        y[index].view(-1).add_(_noise[begin : begin + length], alpha=float(strength[index]))


def _through_jpeg(picture: np.ndarray[Any, np.dtype[np.uint8]], quality: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=quality)
    return np.asarray(Image.open(buffer))
