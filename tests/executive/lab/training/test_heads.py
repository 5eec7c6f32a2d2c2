"""Dense labels of described objects: what an object is counts by all cells that show it together."""

from __future__ import annotations

import numpy as np
import torch

from executive.domain.loader import load_domain
from executive.lab.training.described import heads
from executive.lab.training.described.space import DescribedSpace
from executive.lab.training.presets import SMALLEST

SPACE = DescribedSpace.of(load_domain("blocksworld"), 6)
WHAT = ("small", "red", "metal", "sphere")
GRID = 4
CELL = heads.MASK // GRID


def named(said: dict[tuple[int, int], str]) -> float:
    """The loss where cells say shapes, all else being right: the block fills the cell (1, 1), and a sixth of (1, 2)."""
    dense = heads.Dense(SMALLEST, SPACE)
    count = len(SPACE.values)
    own = SPACE.empty(1)
    own.own[0, 0, [SPACE.values.index(value) for value in WHAT]] = True
    masks = torch.zeros(1, heads.MASK, heads.MASK, dtype=torch.uint8)
    masks[:, CELL : 2 * CELL, CELL : 2 * CELL + CELL // 6] = 1
    read = torch.zeros(1, SPACE.size, GRID, GRID)
    read[:, [SPACE.values.index(value) for value in WHAT[:3]]] = 30.0
    for (row, column), value in said.items():
        read[0, SPACE.values.index(value), row, column] = 12.0
    dense.cells = torch.nn.Identity()  # type: ignore[assignment]
    halves = read[:, :count].repeat_interleave(2, 2).repeat_interleave(2, 3)
    dense.halves = torch.nn.Identity()  # type: ignore[assignment]
    channels = torch.from_numpy(own.channels().astype(np.float32))
    return float(dense(read, halves, masks, channels)[1]["named"])


def test_what_a_sliver_of_an_object_says_counts_little_and_what_most_of_it_says_counts_most() -> None:
    silent, right = named({}), named({(1, 1): "sphere"})
    assert right < 0.01 < silent
    assert named({(1, 1): "sphere", (1, 2): "cube"}) < 0.01
    assert named({(1, 1): "cube", (1, 2): "sphere"}) > 2.0 * silent


def test_what_other_cells_say_does_not_count() -> None:
    assert named({(0, 0): "cube", (3, 3): "cylinder"}) == named({})


def test_an_object_of_which_hardly_anything_is_seen_is_not_asked_about() -> None:
    dense = heads.Dense(SMALLEST, SPACE)
    last, before = torch.randn(1, SMALLEST.widths[-1], GRID, GRID), torch.randn(1, SMALLEST.widths[-2], 8, 8)
    own = SPACE.empty(1)
    own.own[0, 0, [SPACE.values.index(value) for value in WHAT]] = True
    channels = torch.from_numpy(own.channels().astype(np.float32))
    masks = torch.zeros(1, heads.MASK, heads.MASK, dtype=torch.uint8)
    masks[0, 0, :10] = 1
    assert dense(last, before, masks, channels)[1]["named"] == 0.0
    masks[0, :6, :10] = 1
    assert dense(last, before, masks, channels)[1]["named"] > 0.0


def related(first: int) -> float:
    """The loss of what is on what, with one block on another, both from this row of the mask on."""
    torch.manual_seed(0)
    dense = heads.Dense(SMALLEST, SPACE)
    scene = SPACE.empty(1)
    for number, what in enumerate((WHAT, ("large", "blue", "rubber", "cube"))):
        scene.own[0, number, [SPACE.values.index(value) for value in what]] = True
    scene.binary[0, SPACE.binary.index("on"), 0, 1] = 1
    masks = torch.zeros(1, heads.MASK, heads.MASK, dtype=torch.uint8)
    masks[0, first : first + 20, 30:50] = 1
    masks[0, first + 20 : first + 40, 30:50] = 2
    last, before = torch.zeros(1, SMALLEST.widths[-1], GRID, GRID), torch.zeros(1, SMALLEST.widths[-2], 8, 8)
    channels = torch.from_numpy(scene.channels().astype(np.float32))
    return float(dense(last, before, masks, channels)[1]["related"])


def test_what_a_block_is_on_is_asked_about_unless_it_may_be_out_of_view() -> None:
    both, lower = related(20), related(0)
    assert 0.0 < lower < both
    assert torch.equal(
        heads.at_edge(torch.tensor([[[1] * 96] + [[0] * 96] * 47 + [[2] * 96] * 48]), 3),
        torch.tensor([[True, True, False]]),
    )
