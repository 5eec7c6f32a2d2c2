"""Parts of pictures around objects, and the masks that go with them."""

from __future__ import annotations

import numpy as np

from executive.lab.training.described.crops import CELLS, around_objects


def test_a_part_shows_an_object_and_its_mask_is_of_the_same_place() -> None:
    rng = np.random.default_rng(0)
    pictures = np.zeros((40, 256, 256, 3), np.uint8)
    masks = np.zeros((40, 96, 96), np.uint8)
    for index in range(40):
        row, column = rng.integers(0, 90, 2)
        masks[index, row : row + 6, column : column + 6] = 1 + index % 3
        scale = (np.arange(256) * 96) // 256
        pictures[index] = masks[index][np.ix_(scale, scale)][..., None]
    parts, shown = around_objects(pictures, masks, 16, rng)
    assert parts.shape == (40, 16 * CELLS, 16 * CELLS, 3)
    assert shown.shape == (40, 6 * CELLS, 6 * CELLS)
    scale = (np.arange(16 * CELLS) * 6) // 16
    for part, mask in zip(parts, shown, strict=True):
        assert mask.any()
        assert (part[..., 0] == mask[np.ix_(scale, scale)]).all()


def test_without_objects_there_are_parts_all_the_same_and_small_pictures_stay_whole() -> None:
    rng = np.random.default_rng(0)
    parts, shown = around_objects(np.zeros((2, 256, 256, 3), np.uint8), np.zeros((2, 96, 96), np.uint8), 16, rng)
    assert (parts.shape[1], shown.shape[1]) == (16 * CELLS, 6 * CELLS)
    small = np.zeros((2, 64, 64, 3), np.uint8)
    assert around_objects(small, np.zeros((2, 96, 96), np.uint8), 32, rng)[0] is small
