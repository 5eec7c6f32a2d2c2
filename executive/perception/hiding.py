"""What may hide an item that is seen nowhere: what stands between the cameras and the places where it would not be
seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from executive.perception.clouds import View
from executive.perception.evidence import evidence
from executive.perception.matching import LEAST_CONFIRMED, MOST_REFUTED
from executive.perception.models import ItemModel, cube_rotations
from executive.types import FloatArray, Lump

_INSIDE = 0.003
"""m that a surface may reach into another: more, and the item cannot be there."""

_OF = 0.01
"""m from an item's surface within which a measurement is of it."""

_LEAST = 0.1
"""The share of the hidden surface that something has to hide to be named."""

_FINE = 0.01
"""m between spots beside something unknown: what shows a part of itself fits there and hardly anywhere else."""


def beside(lumps: Sequence[Lump], spots: FloatArray, reach: float) -> FloatArray:
    """Return spots (N, 3) in m among those given, close to each other, within `reach` of something unknown, along x and
    y: it may be the part that is seen of an item that is hidden otherwise."""
    if not lumps:
        return np.empty((0, 3))
    steps = np.arange(-reach, reach + 0.5 * _FINE, _FINE)
    around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    apart = np.linalg.norm(spots[:, None] - spots, axis=-1)
    spacing = float(np.where(apart > 0.0, apart, np.inf).min(axis=1).max()) if len(spots) > 1 else 0.0
    found = []
    for lump in lumps:
        places = lump.centre[:2] + around
        away = np.linalg.norm(places[:, None] - spots[:, :2], axis=-1)
        among = away.min(axis=1) <= spacing
        found.append(np.column_stack([places, spots[away.argmin(axis=1), 2]])[among])
    return np.concatenate(found)


def hiders(
    model: ItemModel,
    spots: FloatArray,
    others: Mapping[str, tuple[ItemModel, FloatArray]],
    views: Sequence[View],
) -> tuple[str, ...]:
    """Return the names of the items that would hide an item, the one that hides the most first.

    Args:
        spots: where its lowest point may be, (N, 3) in m, world frame.
        others: the items that are seen, each with its shape and the transform (4, 4) of its body.
        views: what the cameras measured.
    """
    turns = np.stack(_ways_up(model))
    half = np.abs(turns) @ model.half
    rotations = np.repeat(turns, len(spots), axis=0)
    translations = np.tile(spots, (len(turns), 1))
    translations[:, 2] += np.repeat(half[:, 2], len(spots))
    told = evidence(model, rotations, translations, views)
    could_be = (told.refuted <= MOST_REFUTED) & (told.confirmed < LEAST_CONFIRMED)
    rotations, translations = rotations[could_be], translations[could_be]
    points = model.points @ rotations.transpose(0, 2, 1) + translations[:, None]
    free = np.ones(len(points), bool)
    for other, body in others.values():
        free &= (_distances(other, body, points) > -_INSIDE).all(axis=1)
    points = points[free].reshape(-1, 3)
    count: Counter[str] = Counter()
    total = 0
    for view in views:
        away, pixel, inside = view.project(points)
        measured = view.depth.reshape(-1)[pixel]
        hidden = np.unique(pixel[inside & (measured > 0.0) & (measured < away - _OF)])
        total += len(hidden)
        before = view.points(hidden)
        for name, (other, body) in others.items():
            count[name] += int((_distances(other, body, before) < _OF).sum())
    return tuple(name for name, hidden in count.most_common() if hidden >= max(1.0, _LEAST * total))


def _ways_up(model: ItemModel) -> list[FloatArray]:
    """The rotations (3, 3) of a cube that put another side of the item up."""
    found: list[FloatArray] = []
    for turn in cube_rotations():
        if all(model.angle(turn, other) > 0.1 for other in found):
            found.append(turn)
    return found


def _distances(model: ItemModel, body: FloatArray, points: FloatArray) -> FloatArray:
    """The signed distances (...) in m of points (..., 3) to an item's surface."""
    return model.distances((points - body[:3, 3]) @ body[:3, :3] - model.centre)[0]
