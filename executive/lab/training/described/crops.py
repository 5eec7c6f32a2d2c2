"""Parts of pictures around objects: small ones fill little of a picture, and the rest teaches little."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]

CELLS = 5
"""Cells of the vision encoder's grid along the side of a part: a block, what it is on, and what is on it. Many small
steps teach more than few large ones: what a block is made of is found after some thousand, and not before."""

_OFF = 1
"""Cells by which an object may be off the middle."""


def around_objects(pictures: Array, masks: Array, stride: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Parts of pictures (B, S, S, 3), (B, P, P, 3), and of their masks (B, M, M), each around some pixel of an object,
    or anywhere where there is none.

    Args:
        stride: pixels of a picture that are a cell.
    """
    grid = pictures.shape[1] // stride
    if grid <= CELLS:
        return pictures, masks
    fine, parts, shown = masks.shape[1] // grid, [], []
    for picture, mask in zip(pictures, masks, strict=True):
        there = np.flatnonzero(mask)
        pixel = int(there[rng.integers(len(there))]) if len(there) else int(rng.integers(mask.size))
        middle = np.array(divmod(pixel, mask.shape[1])) // fine + rng.integers(-_OFF, _OFF + 1, 2)
        row, column = np.clip(middle - CELLS // 2, 0, grid - CELLS).tolist()
        parts.append(_part(picture, row * stride, column * stride, CELLS * stride))
        shown.append(_part(mask, row * fine, column * fine, CELLS * fine))
    return np.stack(parts), np.stack(shown)


def _part(whole: Array, row: int, column: int, side: int) -> Array:
    return whole[row : row + side, column : column + side]
