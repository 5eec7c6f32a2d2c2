"""Disguised pictures: what they do not tell is learned from none of them."""

from __future__ import annotations

import colorsys

import numpy as np
import torch

from executive.domain.loader import load_domain
from executive.lab.training.described import disguises, heads
from executive.lab.training.described.space import DescribedSpace
from executive.lab.training.presets import SMALLEST

SPACE = DescribedSpace.of(load_domain("blocksworld"), 6)
COLOURS = list(SPACE.attributes["colour"])


def pictures(count: int = 64) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, 64, 64, 3)).astype(np.uint8)


def test_colours_are_what_the_scene_says_by_colour_alone() -> None:
    assert SPACE.hues == ("colour",)


def test_channels_of_values_are_theirs_wherever_they_are_said() -> None:
    empty = SPACE.empty(1)
    empty.own[0, 0, [SPACE.values.index(v) for v in ("red", "small", "rubber", "cube")]] = True
    empty.own[0, 1, [SPACE.values.index(v) for v in ("blue", "large", "metal", "cube")]] = True
    empty.binary[0, 0, 0, 1] = 1
    told = empty.channels()[0]
    of_colours = SPACE.channels_of(COLOURS)
    assert told[0, of_colours].sum() == 2  # its own, and that of what it is on
    assert told[0].sum() == 8
    assert len(of_colours) == len(set(of_colours)) == len(COLOURS) * (1 + 2 * len(SPACE.binary))


def test_colours_are_learned_from_plain_pictures_and_all_else_from_recoloured_ones() -> None:
    plain = pictures()
    found = disguises.disguised(plain, SPACE, np.random.default_rng(1))
    colours = SPACE.channels_of(COLOURS)
    own = [SPACE.values.index(colour) for colour in COLOURS]
    others = np.setdiff1d(np.arange(SPACE.size), colours)
    changed = (found.pictures != plain).any(axis=(1, 2, 3))
    assert (found.plain == ~changed).all()
    kinds = {"plain": 0, "recoloured": 0, "coarse": 0}
    for row, moved in zip(found.told, changed, strict=True):
        told = set(np.flatnonzero(row))
        if not moved:
            assert told == set(colours)
            kinds["plain"] += 1
        elif told == set(others):
            kinds["recoloured"] += 1
        else:
            assert told == set(own)
            kinds["coarse"] += 1
    assert min(kinds.values()) > 3
    assert (plain == pictures()).all()  # what is given stays as it was


def test_nothing_is_disguised_where_no_attribute_is_a_colour() -> None:
    space = DescribedSpace(SPACE.attributes, SPACE.type, (), SPACE.nullary, SPACE.unary, SPACE.binary, 6)
    plain = pictures(8)
    found = disguises.disguised(plain, space, np.random.default_rng(1))
    assert (found.pictures == plain).all()
    assert found.told.all()
    assert found.plain.all()
    assert disguises.told_by_colour(space).all()


def test_recoloured_pictures_have_any_hues_and_what_was_alike_stays_alike() -> None:
    picture = np.full((8, 8, 3), (150, 60, 60), np.uint8)
    picture[:, 4:] = (110, 110, 110)
    hues, greys = [], []
    for seed in range(40):
        other = disguises.recoloured(picture, np.random.default_rng(seed))
        assert (other[:, :4] == other[0, 0]).all()
        assert (other[:, 4:] == other[0, 7]).all()
        hues.append(colorsys.rgb_to_hsv(*(other[0, 0] / 255.0))[0])
        greys.append(int(np.ptp(other[0, 7].astype(int))))
    assert np.histogram(hues, bins=6, range=(0.0, 1.0))[0].min() >= 1
    assert np.median(greys) > 20  # grey is no colour of its own


def test_a_coarse_picture_keeps_mean_colours() -> None:
    picture = pictures(1)[0]
    coarse = disguises.coarse(picture, 7)
    assert coarse.shape == picture.shape
    assert (coarse[:7, :7] == coarse[0, 0]).all()
    assert np.abs(coarse[0, 0] - picture[:7, :7].mean(axis=(0, 1))).max() < 1.0
    assert (coarse[63, 63] == picture[63, 63]).all()  # the last square is one pixel


def test_channels_that_are_not_told_are_not_learned() -> None:
    torch.manual_seed(0)
    dense = heads.Dense(SMALLEST, SPACE)
    last = torch.randn(2, SMALLEST.widths[-1], 4, 4)
    before = torch.randn(2, SMALLEST.widths[-2], 8, 8)
    masks = torch.zeros(2, heads.MASK, heads.MASK, dtype=torch.uint8)
    masks[:, 10:60, 10:60] = 1
    own = SPACE.empty(2)
    own.own[:, 0, :4] = True
    channels = torch.from_numpy(own.channels().astype(np.float32))
    told = torch.ones(2, SPACE.size)
    told[:, SPACE.channels_of(COLOURS)] = 0.0
    loss, _ = dense(last, before, masks, channels, told)
    loss.backward()
    hidden = np.zeros(SPACE.size, bool)
    hidden[SPACE.channels_of(COLOURS)] = True
    assert dense.cells.weight.grad is not None
    learned = dense.cells.weight.grad.abs().sum((1, 2, 3)).numpy() > 0
    assert not learned[hidden].any()
    assert learned[~hidden].all()
    everything, _ = dense(last, before, masks, channels, torch.ones(2, SPACE.size))
    assert torch.equal(everything, dense(last, before, masks, channels)[0])
