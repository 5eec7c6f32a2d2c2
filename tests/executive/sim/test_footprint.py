"""Outlines keep the distances that their shapes have, and fit where these fit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.sim.footprint import Outline, Placed, resting, standing, too_large
from executive.sim.scene import ItemShape
from executive.sim.spec import TableSpec

HALVES = st.floats(0.01, 0.2)
OUTLINES = st.one_of(
    st.builds(Outline, HALVES, HALVES), HALVES.map(lambda radius: Outline(radius, radius, is_round=True))
)
POINTS = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(np.array)
TURNS = st.floats(-np.pi, np.pi)
PLACED = st.builds(Placed, OUTLINES, POINTS, TURNS)


def edge(placed: Placed, count: int = 400) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Points all along the edge of an outline."""
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    around = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    if not placed.outline.is_round:
        around /= np.abs(around).max(axis=-1, keepdims=True)
    cos, sin = np.cos(placed.turn), np.sin(placed.turn)
    local = around * [placed.outline.x, placed.outline.y]
    return np.asarray(placed.centre + local @ np.array([[cos, sin], [-sin, cos]]))


def inside(placed: Placed, points: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> bool:
    cos, sin = np.cos(placed.turn), np.sin(placed.turn)
    local = (points - placed.centre) @ np.array([[cos, -sin], [sin, cos]])
    if placed.outline.is_round:
        return bool((np.hypot(*local.T) < placed.outline.x).any())
    return bool((np.abs(local) < [placed.outline.x, placed.outline.y]).all(axis=-1).any())


@given(PLACED, PLACED)
def test_distances_are_those_of_the_edges(one: Placed, other: Placed) -> None:
    told = one.apart(other)
    assert np.isclose(told, other.apart(one), atol=1e-9)
    mine, its = edge(one), edge(other)
    sampled = float(np.linalg.norm(mine[:, None] - its[None], axis=-1).min())
    if inside(one, its) or inside(other, mine):
        assert told < 0.01
    else:
        assert told <= sampled + 1e-9
        assert sampled - told < 0.01, "the points along an edge are less than 7 mm apart"


@given(OUTLINES, TURNS)
def test_an_extent_is_as_far_as_the_edge_reaches(outline: Outline, turn: float) -> None:
    reaches = np.abs(edge(Placed(outline, np.zeros(2), turn), 4000)).max(axis=0)
    assert np.allclose(outline.extent(turn), reaches, atol=2e-3)


@given(HALVES, HALVES, st.floats(0.02, 0.6), st.floats(0.02, 0.6), TURNS)
def test_what_fits_on_a_table_fits_on_a_larger_one_and_however_that_is_turned(
    x: float, y: float, wide: float, deep: float, yaw: float
) -> None:
    def table(more: float, turn: float) -> TableSpec:
        return TableSpec(name="t", centre=(0.0, 0.0, 0.5), size=(wide + more, deep + more, 0.04), yaw=turn)

    fits = Outline(x, y).fits(table(0.0, 0.0), 0.0)
    assert fits == Outline(x, y).fits(table(0.0, yaw), 0.0)
    if fits:
        assert Outline(x, y).fits(table(0.01, yaw), 0.0)
        assert 4.0 * x * y <= wide * deep + 1e-6
    if 2 * min(x, y) > min(wide, deep) + 1e-6:
        assert not fits, "its narrow side is wider than the table's"


def test_an_item_is_too_large_only_if_no_side_of_it_fits() -> None:
    plank = ItemShape("plank", np.zeros(3), np.array([0.05, 0.02, 0.15]))
    assert standing(plank) == resting(plank)[0] == Outline(0.05, 0.02)

    def table(wide: float, deep: float) -> TableSpec:
        return TableSpec(name="t", centre=(0.0, 0.0, 0.5), size=(wide, deep, 0.04))

    assert not too_large(plank, table(0.08, 0.14)), "it stands there"
    assert not too_large(plank, table(0.34, 0.08)), "it lies there on its narrow side"
    assert too_large(plank, table(0.08, 0.08))
    tin = ItemShape("tin", np.zeros(3), np.array([0.03, 0.03, 0.08]), 2)
    assert standing(tin).is_round
    assert not too_large(tin, table(0.10, 0.10))
    assert too_large(tin, table(0.05, 0.30))
