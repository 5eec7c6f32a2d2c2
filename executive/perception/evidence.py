"""What a pose would have the cameras see, against what they measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from executive.perception.clouds import View, tolerance
from executive.perception.models import ItemModel
from executive.types import FloatArray

_FACING = 0.25
"""Cosine of the angle to the line of sight from which on a surface is measured well."""

_EDGE_ON = 0.1
"""The same, up to which a surface is seen edge on: a camera that looks past it refutes nothing, since it would not if
the item were turned by so little. Of a box, a whole face may be seen so."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """For each of S poses, as shares of the surface, (S,): what a camera measured where it should be, what one looked
    through, and what is hidden behind something nearer, that nothing explains, in every camera that it faces; and which
    views confirm it, (S, V)."""

    confirmed: FloatArray
    refuted: FloatArray
    hidden: FloatArray
    by_view: FloatArray


def evidence(model: ItemModel, rotations: FloatArray, translations: FloatArray, views: Sequence[View]) -> Evidence:
    """The evidence of all views for poses of the model's centre, (S, 3, 3) and (S, 3)."""
    points = model.points @ rotations.transpose(0, 2, 1) + translations[:, None]
    normals = model.normals @ rotations.transpose(0, 2, 1)
    shape = points.shape[:2]
    confirmed, refuted, hidden = (np.zeros(shape, bool) for _ in range(3))
    by_view = np.zeros((len(rotations), len(views)))
    for number, view in enumerate(views):
        away, pixel, inside = view.project(points)
        measured = view.depth.reshape(-1)[pixel]
        told = inside & (measured > 0.0)
        sight = points - view.position
        cosine = np.einsum("sni,sni->sn", normals, sight) / np.linalg.norm(sight, axis=-1)
        facing = cosine < -_FACING
        slack = tolerance(away)
        around = view.nearest.reshape(-1)[pixel]  # at the rim, a pose that is a little beside is not refuted
        refuted |= told & np.isfinite(around) & (around > away + slack) & (np.abs(cosine) > _EDGE_ON)
        here = told & facing & (np.abs(measured - away) <= slack)
        by_view[:, number] = here.mean(axis=1)
        confirmed |= here
        nearer = told & facing & (measured < away - slack)
        hidden |= nearer if view.explained is None else nearer & ~view.explained[pixel]
    return Evidence(confirmed.mean(axis=1), refuted.mean(axis=1), (hidden & ~confirmed).mean(axis=1), by_view)
