"""Which of several identical things is which of those before: all one-to-one assignments, weighed together."""

from __future__ import annotations

import numpy as np

from executive.types import FloatArray

LARGEST = 12
"""How many things can be told apart by where they are; the effort doubles with each."""

_LEAST = 1e-12
"""What is added to a weight relative to the largest of its row, so that some assignment is always possible."""


def marginals(weights: FloatArray, absent: FloatArray) -> FloatArray:
    """The probability that each row is assigned each column, over all assignments that give every column to another
    row and leave the other rows without one.

    An assignment is as probable as the product of its weights: the joint probabilistic data association of tracking
    (Bar-Shalom and Fortmann, 1988), summed exactly over sets of columns.

    Args:
        weights: (K, N), N at most K.
        absent: (K,), the weight of a row that is left without a column.

    Returns:
        (K, N + 1): rows add up to 1, and columns but the last, which is that of rows without one, too.
    """
    rows, columns = weights.shape
    if columns > rows or rows > LARGEST:
        raise ValueError(f"{columns} columns do not go to {rows} rows, of {LARGEST} at most")
    every = np.concatenate([weights, absent[:, None]], axis=1)
    scale = every.max(axis=1, keepdims=True)
    every = np.where(scale > 0.0, every / np.where(scale > 0.0, scale, 1.0), 1.0) + _LEAST
    if columns == rows:
        every[:, columns] = 0.0
    sets, full = np.arange(1 << columns), (1 << columns) - 1
    before = np.zeros((rows + 1, len(sets)))  # the first rows have taken this set of columns
    after = np.zeros((rows + 1, len(sets)))  # the other rows take all the others
    before[0, 0] = after[rows, full] = 1.0
    free = [sets[(sets >> column) & 1 == 0] for column in range(columns)]
    for row in range(rows):
        before[row + 1] += before[row] * every[row, columns]
        for column, without in enumerate(free):
            before[row + 1, without | 1 << column] += before[row, without] * every[row, column]
    for row in reversed(range(rows)):
        after[row] += after[row + 1] * every[row, columns]
        for column, without in enumerate(free):
            after[row, without] += after[row + 1, without | 1 << column] * every[row, column]
    found = np.zeros_like(every)
    for row in range(rows):
        found[row, columns] = (before[row] * after[row + 1]).sum() * every[row, columns]
        for column, without in enumerate(free):
            found[row, column] = (before[row, without] * after[row + 1, without | 1 << column]).sum()
            found[row, column] *= every[row, column]
    return np.asarray(found / found.sum(axis=1, keepdims=True))
