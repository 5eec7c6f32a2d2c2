"""Pictures in which a part of what describes an object cannot be told, so that what can is learned without it.

In the training, colours and shapes do not come together as they may later: a model that never saw a brown cube tells
cubes by their colours, too, and takes a brown one for a cylinder. So some pictures are drawn in colours that mean
nothing, and the rest of the labels holds; in others only colours are left.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from executive.lab.training.described.space import DescribedSpace

RECOLOURED, COARSE = 0.45, 0.15
"""The shares of pictures in other colours, and of those in which only colours are left."""

_COARSEST = (5, 9)
"""Pixels of a picture's side of 256 that are one: a block is 14 to 25 wide."""

Pictures = np.ndarray[Any, np.dtype[np.uint8]]


def disguised(
    pictures: Pictures, space: DescribedSpace, rng: np.random.Generator
) -> tuple[Pictures, np.ndarray[Any, np.dtype[np.float32]]]:
    """Pictures (B, S, S, 3), some of them disguised, and which channels can be told of each, (B, H), 1 or 0."""
    told = np.ones((len(pictures), space.size), np.float32)
    if not space.hues:
        return pictures, told
    pictures, luck = pictures.copy(), rng.random(len(pictures))
    hues = [value for name in space.hues for value in space.attributes[name]]
    for index in np.flatnonzero(luck < RECOLOURED):
        pictures[index] = recoloured(pictures[index], rng)
        told[index, space.channels_of(hues)] = 0.0
    for index in np.flatnonzero(luck > 1.0 - COARSE):
        pictures[index] = coarse(pictures[index], int(rng.integers(*_COARSEST)))
        told[index] = 0.0
        told[index, [space.values.index(value) for value in hues]] = 1.0
    return pictures, told


def recoloured(picture: Pictures, rng: np.random.Generator) -> Pictures:
    """A picture with all hues turned by one angle, and tinted."""
    angle = rng.uniform(np.pi / 4, 7 * np.pi / 4)
    along = np.full((3, 3), (1.0 - np.cos(angle)) / 3.0)  # about the axis of greys (Rodrigues)
    across = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / np.sqrt(3.0)
    turn = np.cos(angle) * np.eye(3) + along + np.sin(angle) * across
    matrix = (rng.uniform(0.65, 1.2, 3)[:, None] * turn).astype(np.float32)
    return np.asarray(np.clip(picture @ matrix.T, 0.0, 255.0).astype(np.uint8))


def coarse(picture: Pictures, size: int) -> Pictures:
    """A picture of squares of `size` pixels, each in its mean colour."""
    side = len(picture)
    starts = np.arange(0, side, size)
    counts = np.diff(np.append(starts, side))
    sums = np.add.reduceat(np.add.reduceat(picture.astype(np.float32), starts, axis=0), starts, axis=1)
    means = (sums / (counts[:, None, None] * counts[None, :, None])).astype(np.uint8)
    return np.asarray(means.repeat(counts, axis=0).repeat(counts, axis=1))
