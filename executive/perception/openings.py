"""How far drawers are open, by the bars of their handles among the measured points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from executive.types import FloatArray

_STEP = 0.002
"""m between two openings that are tried."""

_LEVEL, _INSET = 0.008, 0.015
"""m above and below the middle of a bar within which points may be of it, and from its ends, where its posts are."""

_FEW = 20
"""Points that it takes to tell a bar."""

_HALF = 0.5
"""The share of the most points in one place that makes another place a bar, too: behind it, the front has as many."""

_HAND = 0.11
"""m from a bar's way within which the hand may be taken for it."""


@dataclass(frozen=True, slots=True, eq=False)
class Bar:
    """The bar of a drawer's handle: its middle (3,) when the drawer is closed, the unit vector (3,) along which it
    opens, half its width, its thickness and how far it slides; all in m, world frame."""

    drawer: str
    closed: FloatArray
    axis: FloatArray
    half_width: float
    thickness: float
    stroke: float


def openings(
    bars: Sequence[Bar], points: FloatArray, hand: FloatArray, before: Mapping[str, float]
) -> dict[str, float]:
    """How far each drawer is open, in m. What is not seen, or where the hand is, is as it was before; closed at first.

    Args:
        points: everything that was measured, (N, 3) in m, world frame.
        hand: where the grip point is, (3,).
        before: what was told before.
    """
    found = {}
    for bar in bars:
        measured = None if _is_beside(bar, hand) else _measured(bar, points)
        found[bar.drawer] = before.get(bar.drawer, 0.0) if measured is None else measured
    return found


def _is_beside(bar: Bar, hand: FloatArray) -> bool:
    along = float(np.clip((hand - bar.closed) @ bar.axis, 0.0, bar.stroke))
    return float(np.linalg.norm(hand - bar.closed - along * bar.axis)) < _HAND


def _measured(bar: Bar, points: FloatArray) -> float | None:
    """Where the bar is: of all places with many points, the farthest out, for what is behind it may look like it."""
    across = np.array([-bar.axis[1], bar.axis[0], 0.0])
    local = points - bar.closed
    out = local @ bar.axis
    near = (np.abs(local[:, 2]) < _LEVEL) & (np.abs(local @ across) < bar.half_width - _INSET)
    out = out[near & (out > -bar.thickness) & (out < bar.stroke + bar.thickness)]
    places = np.arange(0.0, bar.stroke + _STEP, _STEP)
    counts = (np.abs(out[:, None] - places) < 0.5 * bar.thickness + _STEP).sum(axis=0)
    if not len(out) or counts.max() < _FEW:
        return None
    farthest = float(places[np.flatnonzero(counts >= max(_FEW, _HALF * counts.max()))[-1]])
    best = out[np.abs(out - farthest) < bar.thickness]
    return float(np.clip(np.median(best), 0.0, bar.stroke))
