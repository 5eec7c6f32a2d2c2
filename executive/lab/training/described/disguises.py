"""Pictures in which a part of what describes an object cannot be told, so that what can is learned without it.

In the training, colours and shapes do not come together as they may later: a model that never saw a brown cube tells
cubes by their colours, too, and takes a brown one for a cylinder. So colours are learned from pictures as they are, and
from coarse ones, which have no shapes; all else is learned from pictures in colours that mean nothing. Where a picture
has both, a network finds out which, and tells shapes by colours there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from executive.lab.training.described.space import DescribedSpace

RECOLOURED, COARSE = 0.55, 0.15
"""The shares of pictures in other colours, and of those in which only colours are left."""

_COARSEST = (5, 9)
"""Pixels of a picture's side of 256 that are one: a small block is little wider than two or three of these."""

Pictures = np.ndarray[Any, np.dtype[np.uint8]]


class Disguised(NamedTuple):
    """Pictures (B, S, S, 3), some of them disguised; which channels are learned from each, (B, H), 1 or 0; and which
    are as they were, (B,)."""

    pictures: Pictures
    told: np.ndarray[Any, np.dtype[np.float32]]
    plain: np.ndarray[Any, np.dtype[np.bool_]]


def disguised(pictures: Pictures, space: DescribedSpace, rng: np.random.Generator) -> Disguised:
    """Disguises some of the pictures (B, S, S, 3) of a space's scenes."""
    if not space.hues:
        return Disguised(pictures, np.ones((len(pictures), space.size), np.float32), np.ones(len(pictures), np.bool_))
    hues = [value for name in space.hues for value in space.attributes[name]]
    pictures, luck, colours = pictures.copy(), rng.random(len(pictures)), told_by_colour(space)
    told = np.tile(colours, (len(pictures), 1))
    is_recoloured, is_coarse = luck < RECOLOURED, luck > 1.0 - COARSE
    told[is_recoloured] = 1.0 - colours
    for index in np.flatnonzero(is_recoloured):
        pictures[index] = recoloured(pictures[index], rng)
    told[is_coarse] = np.isin(np.arange(space.size), [space.values.index(value) for value in hues])
    for index in np.flatnonzero(is_coarse):
        pictures[index] = coarse(pictures[index], int(rng.integers(*_COARSEST)))
    return Disguised(pictures, told, ~(is_recoloured | is_coarse))


def told_by_colour(space: DescribedSpace) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Which channels (H,) are learned from pictures as they are, 1 or 0: all, where no attribute is a colour."""
    told = np.zeros(space.size, np.float32)
    told[space.channels_of([value for name in space.hues for value in space.attributes[name]])] = 1.0
    return told if space.hues else np.ones_like(told)


def recoloured(picture: Pictures, rng: np.random.Generator) -> Pictures:
    """A picture in which each colour is another one, by one linear map: light and shadow stay what they are."""
    mixed = rng.normal(0.0, 1.0, (3, 3))
    mixed *= rng.uniform(1.2, 2.2, (3, 1)) / np.abs(mixed).sum(axis=1, keepdims=True)
    middle = rng.uniform(80.0, 175.0, 3) - mixed @ picture.mean(axis=(0, 1))
    changed = picture @ mixed.T.astype(np.float32) + middle.astype(np.float32)
    return np.asarray(np.clip(changed, 0.0, 255.0).astype(np.uint8))


def coarse(picture: Pictures, size: int) -> Pictures:
    """A picture of squares of `size` pixels, each in its mean colour."""
    side = len(picture)
    starts = np.arange(0, side, size)
    counts = np.diff(np.append(starts, side))
    sums = np.add.reduceat(np.add.reduceat(picture.astype(np.float32), starts, axis=0), starts, axis=1)
    means = (sums / (counts[:, None, None] * counts[None, :, None])).astype(np.uint8)
    return np.asarray(means.repeat(counts, axis=0).repeat(counts, axis=1))
