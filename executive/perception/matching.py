"""Which cluster of points is which known item, and where: every pair is tried roughly, the best are fitted well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from executive.perception.clouds import Cloud, View
from executive.perception.evidence import evidence
from executive.perception.models import ItemModel
from executive.perception.registration import LARGEST, Poses, joined, local, refined, starts
from executive.types import FloatArray

_ROUGH, _FINE, _FULL = 120, 400, 1500
"""Points that a pose is fitted to: from all starts, from the best of them, and in the end."""

_BEST = 5
"""Starts that are fitted finely."""

_REFUTED = 4.0
"""How much worse a share of the surface that a camera looks through is than one that none confirms."""

_OF_ONE = 0.3
"""The share of the points of a cluster of several things that is looked for an item in, those of its colour first."""

_COLOUR = 0.15
"""The weight of a colour that is not the item's: light changes colours, and some items share them."""

_DETAIL = 5.0
"""How much more the distance of the points counts between poses of one item: what is nearly as wide as it is long lies
on its points nearly as well when it is turned by a quarter."""

ACCEPTED = 0.55
"""The largest cost of a pose that is believed."""

_STILL, _STILL_TURNED, _ENOUGH = 0.003, 0.06, 60
"""m and rad within which an item is where it was, and the points on it that tell so."""

CLEAR = 0.35
"""The cost below which no other item needs to be tried."""

LEAST_EXPLAINED = 0.15
"""The smallest share of the points of several things that one of them may have."""

MOST_REFUTED = 0.08
"""The largest share of a surface that cameras may look through."""

LEAST_CONFIRMED = 0.10
"""The smallest share of a surface that has to be measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """An item's pose by a cluster: of its model's centre, (3, 3) and (3,), its cost, and what speaks for it: the share
    of the surface that each view confirms, and that any of them does."""

    model: ItemModel
    rotation: FloatArray
    translation: FloatArray
    misfit: float
    cost: float
    by_view: FloatArray
    confirmed: float = 0.0

    @property
    def accepted(self) -> bool:
        return self.cost < ACCEPTED


def match(
    models: Sequence[ItemModel], clusters: Sequence[Cloud], cloud: Cloud, views: Sequence[View], merged: bool = False
) -> list[tuple[Match, Cloud]]:
    """The accepted poses of the items that are among the clusters, at most one an item and a cluster.

    Args:
        cloud: all points.
        merged: a cluster may be of several things that touch.
    """
    if not models or not clusters:
        return []
    rough = [_rough_matches(models, cluster, views, merged) for cluster in clusters]
    cost = np.array([[one.cost for one in row] for row in rough])
    found = []
    # An item in no cluster costs as much as the worst that is accepted.
    for row, column in zip(*linear_sum_assignment(np.minimum(cost, 2.0 * ACCEPTED)), strict=True):
        if cost[row, column] < 2.0 * ACCEPTED:
            final = fine_match(rough[row][column], clusters[row], cloud, views, merged)
            if final.accepted:
                found.append((final, clusters[row]))
    return found


def _rough_matches(models: Sequence[ItemModel], cluster: Cloud, views: Sequence[View], merged: bool) -> list[Match]:
    """A rough match of each model, those of its colour first, and none of the others once one clearly is it."""
    found: dict[str, Match] = {}
    for model in sorted(models, key=lambda model: _colour_distance(model, cluster)):
        twin = next((one for one in found.values() if one.model.looks_like(model)), None)
        if twin is not None:
            found[model.name] = replace(twin, model=model)
        elif any(one.cost < CLEAR for one in found.values()):
            found[model.name] = _no_match(model, cluster, views)
        else:
            found[model.name] = _rough_match(model, cluster, views, merged)
    return [found[model.name] for model in models]


def _rough_match(model: ItemModel, cluster: Cloud, views: Sequence[View], merged: bool) -> Match:
    """The best pose of an item by few points of a cluster."""
    points = _thinned(cluster.points, _ROUGH)
    if not _could_be(model, points):
        return _no_match(model, cluster, views)
    first = starts(model, points)
    if merged:
        alike = _of_colour(model, cluster)
        first = joined([first, *(starts(model, part) for part in (*_ends(model, points), alike))])
    poses = refined(model, first, points, 6).best(_BEST * (3 if merged else 1))
    poses = refined(model, poses, _thinned(cluster.points, _FINE), 8 if merged else 4)
    return _judged(model, poses, cluster, views, merged)


def _no_match(model: ItemModel, cluster: Cloud, views: Sequence[View]) -> Match:
    return Match(model, np.eye(3), cluster.points[0], LARGEST, np.inf, np.zeros(len(views)))


def fine_match(rough: Match, cluster: Cloud, cloud: Cloud, views: Sequence[View], merged: bool = False) -> Match:
    """The pose by more points, from where it is and from those that are hard to tell from it.

    Args:
        cloud: all points: what hides a part of an item may have cut it in two clusters.
    """
    model, points = rough.model, cluster.points
    if merged:  # those of its neighbours would draw it towards them
        points = points[_near(rough, points)]
    turns = np.stack([rough.rotation, *(rough.rotation @ turn for turn in model.lookalikes)])
    poses = Poses(turns, np.tile(rough.translation, (len(turns), 1)), np.full(len(turns), np.inf))
    poses = refined(model, poses, _thinned(points, _FINE), 8)
    poses = refined(model, poses, _thinned(points, _FULL), 6)
    final = _judged(model, poses, cluster, views, merged)
    for _ in range(2):
        near = cloud.of(_near(final, cloud.points))
        if not final.accepted or len(near) <= 1.05 * len(points):
            break
        points = near.points
        pose = Poses(final.rotation[None], final.translation[None], np.array([np.inf]))
        final = _judged(model, refined(model, pose, _thinned(points, _FULL), 6), near, views, merged)
    return final


def _near(match: Match, points: FloatArray) -> npt.NDArray[np.bool_]:
    """Which points are near the surface of a matched item."""
    distance, _ = match.model.distances((points - match.translation) @ match.rotation)
    return np.asarray(np.abs(distance) < LARGEST)


def kept_match(
    model: ItemModel, rotation: FloatArray, translation: FloatArray, cloud: Cloud, views: Sequence[View]
) -> Match | None:
    """The pose of an item that is clearly still where it was, by the points on it; None where that is not clear.

    Args:
        rotation, translation: where its centre was, (3, 3) and (3,).
        cloud: all points.
    """
    here = np.linalg.norm(cloud.points - translation, axis=1) < float(np.linalg.norm(model.half)) + LARGEST
    near = cloud.of(here)
    near = near.of(_near(Match(model, rotation, translation, 0.0, 0.0, np.zeros(len(views))), near.points))
    if len(near) < _ENOUGH:
        return None
    turns = np.stack([rotation, *(rotation @ turn for turn in model.lookalikes)])
    poses = Poses(turns, np.tile(translation, (len(turns), 1)), np.full(len(turns), np.inf))
    poses = refined(model, poses, _thinned(near.points, _FINE), 4)
    found = _judged(model, refined(model, poses, _thinned(near.points, _FULL), 4), near, views)
    turned = float(np.arccos(np.clip(0.5 * (np.trace(rotation.T @ found.rotation) - 1.0), -1.0, 1.0)))
    moved = float(np.linalg.norm(found.translation - translation))
    return found if found.cost < CLEAR and moved < _STILL and turned < _STILL_TURNED else None


def tracked_match(model: ItemModel, poses: Poses, cluster: Cloud, views: Sequence[View]) -> Match:
    """The best pose near given ones."""
    return _judged(model, refined(model, poses, _thinned(cluster.points, _FINE), 10), cluster, views)


def _judged(model: ItemModel, poses: Poses, cluster: Cloud, views: Sequence[View], merged: bool = False) -> Match:
    """The best of some poses, by points and cameras. Of a cluster that may be of several things, only the points near
    the item have to lie on it."""
    told = evidence(model, poses.rotations, poses.translations, views)
    seen = told.confirmed / np.maximum(told.confirmed + _REFUTED * told.refuted + told.hidden, 1e-9)
    misfit = poses.misfit
    if merged:
        points = _thinned(cluster.points, _FULL)
        distance = np.abs(model.distances(local(poses.rotations, poses.translations, points))[0])
        near = distance < LARGEST
        share = near.mean(axis=1)
        misfit = np.where(near, distance, 0.0).sum(axis=1) / np.maximum(near.sum(axis=1), 1)
        misfit = np.where(share < LEAST_EXPLAINED, np.inf, misfit)
    cost = 1.0 - seen + misfit / LARGEST
    best = int(np.argmin(cost + _DETAIL * poses.misfit / LARGEST))
    is_told = told.confirmed[best] >= LEAST_CONFIRMED and told.refuted[best] <= MOST_REFUTED
    return Match(
        model,
        poses.rotations[best],
        poses.translations[best],
        float(misfit[best]),
        float(cost[best]) + _COLOUR * min(1.0, 3.0 * _colour_distance(model, cluster)) if is_told else np.inf,
        told.by_view[best],
        float(told.confirmed[best]),
    )


def _colour_distance(model: ItemModel, cluster: Cloud) -> float:
    return float(np.linalg.norm(_chroma(cluster.colours.mean(axis=0)) - _chroma(model.rgb)))


def _ends(model: ItemModel, points: FloatArray) -> list[FloatArray]:
    """The parts of points (N, 3) at either end of their longest horizontal extent, as long as the item is in one of
    its ways to lie."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    along = flat @ np.linalg.svd(flat, full_matrices=False)[2][0]
    low, high = np.quantile(along, 0.02), np.quantile(along, 0.98)
    parts = [points[side] for length in 2.0 * model.half for side in (along < low + length, along > high - length)]
    return [part for part in parts if 10 <= len(part) < len(points)]


def _of_colour(model: ItemModel, cluster: Cloud) -> FloatArray:
    """Some of the points of a cluster of several things that have most nearly the item's colour, (N, 3)."""
    brightness = np.maximum(cluster.colours.sum(axis=1, keepdims=True), 1e-6)
    away = np.linalg.norm(cluster.colours / brightness - _chroma(model.rgb), axis=1)
    return _thinned(cluster.points[away <= np.quantile(away, _OF_ONE)], _ROUGH)


def _could_be(model: ItemModel, points: FloatArray) -> bool:
    """Whether a cluster is not much smaller than the item; larger it may be, where several things touch."""
    seen = np.sort(np.quantile(points, 0.98, axis=0) - np.quantile(points, 0.02, axis=0))
    return float(np.linalg.norm(seen)) > 0.8 * float(np.linalg.norm(np.sort(2.0 * model.half)[:2]))


def _chroma(rgb: FloatArray) -> FloatArray:
    """A colour without its brightness, (3,)."""
    return np.asarray(rgb / max(1e-6, float(rgb.sum())))


def _thinned(points: FloatArray, count: int) -> FloatArray:
    """Some of the points, spread over all of them."""
    return np.asarray(points[np.linspace(0, len(points) - 1, min(count, len(points))).astype(int)])
