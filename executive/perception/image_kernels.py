"""What is done to each pixel of a depth picture and those around it, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from executive.util.compiled import compiled


@compiled
def least_around(picture: npt.NDArray[np.floating], found: npt.NDArray[np.floating]) -> None:
    """Fill `found` (H, W) with the least value of `picture` (H, W) in each pixel and the eight around it."""
    height, width = picture.shape
    rows = np.empty(width, picture.dtype)
    for row in range(height):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        for column in range(width):
            rows[column] = min(picture[above, column], picture[row, column], picture[below, column])
        for column in range(width):
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            found[row, column] = min(rows[left], rows[column], rows[right])
