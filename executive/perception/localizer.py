"""Where everything is, by depth and over time: what is seen, held, remembered, missing, or there and unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from executive.perception import clouds, matching, registration
from executive.perception.clouds import Cloud, View
from executive.perception.evidence import evidence
from executive.perception.hiding import beside, hiders
from executive.perception.matching import Match
from executive.perception.models import ItemModel, identical
from executive.perception.openings import Bar, openings
from executive.perception.registration import Poses
from executive.perception.tracks import Hint, Tracks
from executive.types import Camera, DepthImage, EstimatedPose, FloatArray, Image, Lump, PointCloud, PosesEstimated

_EXPLAINED = 0.009
"""m from an item's surface within which points are of it."""

_ROUNDS = 3
"""How often what is left of the clusters is matched with what is left of the items: things that touch are one cluster
until one of them is known."""

HOLDING = (0.004, 0.080)
"""m between the pads when something is held."""

_SHOWN = 1000
"""Points that those who watch are shown."""

_OVERLAPPING = 0.9
"""The share of their width within which the middles of two identical items cannot be."""

_AT_GRIP = 0.02
"""m of the grip point from an item that the fingers are around."""

_SLIPS = (0.0, 0.35, -0.35, 0.7, -0.7)
"""rad by which what is held may have turned about the line between the pads since it was last seen."""

_HELD_MOVES = 0.06
"""m by which it may have moved."""

_NEAR_ITEM = 0.025
"""m around what is held or hidden within which points are taken to be of it, or of the fingers on it."""

_AS_WELL, _AS_WELL_BY = 1.2, 0.0002
"""The points may be that many times, and that many m, farther from the surface of an item that is where it was than
they were: their noise differs."""

_HALF_HIDDEN, _SHARP = 0.15, 0.005
"""Of what is mostly hidden, the share of the surface that is seen at least, and the standard deviation in m up to which
that tells where it is: it may be that it could as well be farther behind what hides it."""

_GONE = 0.2
"""The share of an item's surface that a camera looks through where it was, from which on it is not there any more."""

_UNSEEN_TILT, _UNSEEN_SHIFT = 0.05, 0.005
"""Standard deviations, rad and m, that are added to the pose of what is held and not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """What the robot senses at one moment: pictures and depth by camera, joint positions of arm and fingers (rad), and
    the opening between the pads (m)."""

    time: float
    images: Mapping[str, Image]
    depth: Mapping[str, DepthImage]
    joints: FloatArray
    fingers: FloatArray
    width: float


class Known(Protocol):
    """What the robot knows of itself and its room without looking."""

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """The cameras by name, where they are taken to stand."""
        ...

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Two corners (3,) of the space in which things are looked for."""
        ...

    def slide(self, openings: Mapping[str, float]) -> None:
        """Have drawers (name -> m) be as far open from now on."""
        ...

    def expected(self, joints: FloatArray, fingers: FloatArray, cameras: Sequence[str]) -> Mapping[str, FloatArray]:
        """The distances (H, W) in m that cameras would measure if there were nothing but furniture and robot."""
        ...

    def hand(self, joints: FloatArray) -> FloatArray:
        """The transform (4, 4) of the grip point; its x axis points from pad to pad."""
        ...


class Localizer:
    """Estimates the poses of known items.

    Args:
        models: the items that there may be.
        known: what is known of robot and room.
        capture: senses everything now.
        clock: tells the time of the world in s; as long as it stands still, nothing is sensed anew.
        hint: what is known beforehand of where each of several identical items is first seen.
        bars: those of the handles of all drawers.

    Attributes:
        known: as given.
        identical: the names of items that nothing tells apart, in groups.
    """

    def __init__(
        self,
        models: Sequence[ItemModel],
        known: Known,
        capture: Callable[[], Capture],
        clock: Callable[[], float],
        hint: Hint | None = None,
        bars: Sequence[Bar] = (),
    ) -> None:
        self._models = {model.name: model for model in models}
        self.identical = tuple(identical(models))
        self._tracks = {names: Tracks(names, hint) for names in self.identical}
        self.known, self._clock = known, clock
        self.capture = capture
        self._estimate: PosesEstimated | None = None
        self._measured = clouds.cloud([], [], [])
        self._views: list[View] = []
        self._pixels: dict[str, npt.NDArray[np.int64]] = {}
        """By view, those that measured something in front of room and robot."""
        self._time = float("nan")
        self._bars, self._openings = tuple(bars), dict[str, float]()
        self._held: tuple[str, FloatArray] | None = None
        """The item in the hand, and the transform (4, 4) of its body in the frame of the grip point."""

    def now(self) -> PosesEstimated:
        """The poses at this moment: estimated anew unless no time has passed."""
        time = self._clock()
        if self._estimate is None or time != self._time:
            self._estimate, self._time = self.estimate(self.capture()), time
        return self._estimate

    def cloud(self) -> PointCloud:
        """Some of the points that the last poses were estimated from, for those who watch."""
        low, high = self.known.bounds
        inside = np.flatnonzero(((self._measured.points > low) & (self._measured.points < high)).all(axis=1))
        some = inside[:: max(1, len(inside) // _SHOWN)]
        colours = np.round(255.0 * self._measured.colours[some]).astype(np.uint8)
        return PointCloud(self._measured.points[some].astype(np.float32), colours)

    def hiders(self, item: str, spots: FloatArray) -> tuple[str, ...]:
        """The items that may hide one that is seen nowhere (`executive.perception.hiding`): at spots (N, 3) in m."""
        now, model = self.now(), self._models[item]
        found = {n: (self._models[n], matrix(pose.pose)) for n, pose in now.poses.items() if n != item}
        spots = np.concatenate([spots, beside(now.lumps, spots, float(model.half.max()))])
        return hiders(model, spots, found, self._views)

    def estimate(self, sensed: Capture) -> PosesEstimated:
        """The poses by one capture and what is remembered of those before."""
        views, cloud, left_out = self._cloud(sensed)
        self._measured, self._views = cloud, views
        before = {} if self._estimate is None else self._estimate.poses
        found: dict[str, EstimatedPose] = {}
        hand = self.known.hand(sensed.joints)
        if not HOLDING[0] < sensed.width < HOLDING[1]:
            self._held = None
        elif self._held is None:
            self._take_hold(hand, before)
        held = self._held
        if held is not None:
            cloud = self._follow(*held, hand, cloud, views, found, sensed.time)
        cloud = self._keep(before, cloud, views, found, sensed.time)
        cloud = self._find(cloud, views, found, sensed.time)
        cloud = self._find_half_hidden(cloud, views, found, sensed.time)
        found, before = self._tell_apart(found, before, sensed.time)
        if held is None and HOLDING[0] < sensed.width < HOLDING[1] and (name := self._take_hold(hand, found)):
            found[name] = replace(found[name], source="held")
        for name, pose in before.items():
            if name not in found and not self._is_refuted(name, pose, views):
                found[name] = replace(pose, source="remembered")
        for name, pose in found.items():
            if pose.source != "seen":  # what is seen of what is hidden or held, and is not enough to tell by
                cloud = self._apart(name, pose, cloud)
        missing = tuple(sorted(self._models.keys() - found.keys()))
        lumps = tuple(_lump(cloud.points[group]) for group in clouds.clusters(cloud.points, *self.known.bounds))
        identity = {name: row for tracks in self._tracks.values() for name, row in tracks.identity().items()}
        poses = {name: found[name] for name in sorted(found)}
        return PosesEstimated(poses, missing, lumps, left_out, identity, dict(self._openings))

    def _cloud(self, sensed: Capture) -> tuple[list[View], Cloud, dict[str, str]]:
        """The views that are used, the points of what is neither robot nor room, and why other views are not used."""
        every = {name: View.of(self.known.cameras[name], depth) for name, depth in sensed.depth.items()}
        if self._bars:
            measured = [view.points(np.flatnonzero(view.depth > 0.0)) for view in every.values()]
            points, hand = np.concatenate([np.empty((0, 3)), *measured]), self.known.hand(sensed.joints)[:3, 3]
            self._openings = openings(self._bars, points, hand, self._openings)
            self.known.slide(self._openings)
        expected = self.known.expected(sensed.joints, sensed.fingers, list(sensed.depth))
        left_out = {name: "no depth" for name in self.known.cameras if name not in sensed.depth}
        views, pixels, images = [], [], []
        for name, view in every.items():
            if why := clouds.misplaced(view, expected[name]):
                left_out[name] = why
                continue
            views.append(view)
            pixels.append(clouds.foreground(view, expected[name]))
            images.append(sensed.images[name])
        self._pixels = {view.name: chosen for view, chosen in zip(views, pixels, strict=True)}
        return views, clouds.cloud(views, pixels, images), left_out

    def _keep(
        self,
        before: Mapping[str, EstimatedPose],
        cloud: Cloud,
        views: list[View],
        found: dict[str, EstimatedPose],
        time: float,
    ) -> Cloud:
        """Adds the items that were seen and are clearly still where they were to `found`, so that nothing else is
        tried for them; returns the points that are of none. Identical ones are told apart, and searched for, together.
        """
        twins = {name for names in self.identical for name in names}
        for name, pose in before.items():
            if pose.source != "seen" or name in found or name in twins:
                continue
            model, body = self._models[name], matrix(pose.pose)
            match = matching.kept_match(model, body[:3, :3], self.centre(name, pose), cloud, views)
            if match is not None and match.misfit < _AS_WELL * pose.misfit + _AS_WELL_BY:
                found[name] = _estimated(match, cloud, views, "seen", time)
                cloud = _without(cloud, match)
        return cloud

    def _find(self, cloud: Cloud, views: list[View], found: dict[str, EstimatedPose], time: float) -> Cloud:
        """Adds the items that are among the points to `found`; returns the points that are of none."""
        for merged in (False, *[True] * _ROUNDS):
            models = [model for name, model in self._models.items() if name not in found]
            groups = [cloud.of(group) for group in clouds.clusters(cloud.points, *self.known.bounds)]
            matches = matching.match(models, groups[: 2 * len(self._models)], cloud, views, merged)
            for match, group in sorted(matches, key=lambda each: each[0].cost):
                if not self._overlaps_twin(match, found):
                    found[match.model.name] = _estimated(match, group, views, "seen", time)
                cloud = _without(cloud, match)
            if merged and not matches:
                break
        return cloud

    def _find_half_hidden(self, cloud: Cloud, views: list[View], found: dict[str, EstimatedPose], time: float) -> Cloud:
        """Adds the items to `found` that what is left of the points is of though most of them is not seen, because it
        is behind what was found or behind the robot; returns the points that are of none."""
        models = [model for name, model in self._models.items() if name not in found]
        groups = [cloud.of(group) for group in clouds.clusters(cloud.points, *self.known.bounds)] if models else []
        if not groups:
            return cloud
        behind = [replace(view, explained=self._explained(view, found)) for view in views]
        for match, group in matching.match(models, groups[: 2 * len(self._models)], cloud, behind):
            pose = _estimated(match, group, views, "seen", time)
            spread = float(np.linalg.eigvalsh(pose.covariance[:3, :3]).max()) ** 0.5
            clear = match.cost < matching.CLEAR and match.confirmed >= _HALF_HIDDEN and spread < _SHARP
            if clear and not self._overlaps_twin(match, found):
                found[match.model.name] = pose
                cloud = _without(cloud, match)
        return cloud

    def _explained(self, view: View, found: Mapping[str, EstimatedPose]) -> npt.NDArray[np.bool_]:
        """Which pixels (H * W,) of a view measured the room, the robot, or an item that was found."""
        pixels = self._pixels[view.name]
        points = view.points(pixels)
        mine = np.zeros(len(points), np.bool_)
        for name, pose in found.items():
            model, body = self._models[name], matrix(pose.pose)
            distance, _ = model.distances((points - body[:3, 3]) @ body[:3, :3] - model.centre)
            mine |= distance < _EXPLAINED
        explained = np.ones(view.depth.size, np.bool_)
        explained[pixels] = mine
        return explained

    def _overlaps_twin(self, match: Match, found: Mapping[str, EstimatedPose]) -> bool:
        """Whether an identical item is there already: something cuts it in two clusters, and each was taken for one."""
        twins = next((names for names in self.identical if match.model.name in names), ())
        width = _OVERLAPPING * 2.0 * float(match.model.half.min())
        centres = [self.centre(name, found[name]) for name in twins if name in found]
        return any(float(np.linalg.norm(match.translation - centre)) < width for centre in centres)

    def _tell_apart(
        self, found: Mapping[str, EstimatedPose], before: Mapping[str, EstimatedPose], time: float
    ) -> tuple[dict[str, EstimatedPose], dict[str, EstimatedPose]]:
        """What is found, and what was found before, by the labels that identical items go by now."""
        found, before = dict(found), dict(before)
        for names, tracks in self._tracks.items():
            mine = {name: found.pop(name) for name in names if name in found}
            held = {name: pose for name, pose in mine.items() if pose.source == "held"}
            loose = [pose for name, pose in mine.items() if name not in held]
            at = np.array([self.centre(names[0], pose) for pose in loose]).reshape(-1, 3)
            named = tracks.update(time, at, {name: self.centre(name, pose) for name, pose in held.items()})
            found |= held | dict(zip(named.labels, loose, strict=True))
            earlier = {name: before.pop(name, None) for name in names}
            before |= {now: pose for now, then in named.formerly.items() if (pose := earlier[then]) is not None}
        return found, before

    def centre(self, name: str, pose: EstimatedPose) -> FloatArray:
        """The middle (3,) of an item in this pose, in m, world frame."""
        body = matrix(pose.pose)
        return np.asarray(body[:3, :3] @ self._models[name].centre + body[:3, 3])

    def _follow(
        self,
        name: str,
        in_hand: FloatArray,
        hand: FloatArray,
        cloud: Cloud,
        views: list[View],
        found: dict[str, EstimatedPose],
        time: float,
    ) -> Cloud:
        """Adds what is held to `found`: by what is measured of it, or else by where the hand is; returns the points of
        everything else."""
        model = self._models[name]
        predicted = hand @ in_hand
        centre = predicted[:3, :3] @ model.centre + predicted[:3, 3]
        reach = float(np.linalg.norm(model.half)) + 0.02
        near = cloud.of(np.linalg.norm(cloud.points - centre, axis=1) < reach)
        if len(near) >= 60:
            turns = [hand[:3, :3] @ _about_pads(slip) @ hand[:3, :3].T for slip in _SLIPS]
            starts = Poses(
                np.stack([turn @ predicted[:3, :3] for turn in turns]),
                np.stack([hand[:3, 3] + turn @ (centre - hand[:3, 3]) for turn in turns]),
                np.full(len(turns), np.inf),
            )
            match = matching.tracked_match(model, starts, near, views)
            if match.accepted and float(np.linalg.norm(match.translation - centre)) < _HELD_MOVES:
                found[name] = _estimated(match, near, views, "held", time)
                self._held = name, np.linalg.inv(hand) @ _body(match)
                return _without(cloud, match)
        covariance = np.diag([_UNSEEN_SHIFT**2] * 3 + [_UNSEEN_TILT**2] * 3)
        found[name] = EstimatedPose(_pose(predicted), covariance, 0.0, (), "held", time)
        here = Match(model, predicted[:3, :3], centre, 0.0, 0.0, np.zeros(len(views)))
        return _without(cloud, here)

    def _take_hold(self, hand: FloatArray, poses: Mapping[str, EstimatedPose]) -> str:
        """Have what the fingers are around, by these poses, be what is held; returns its name, or nothing."""
        away = {}
        for name, pose in poses.items():
            body, model = matrix(pose.pose), self._models[name]
            grip = (hand[:3, 3] - body[:3, 3]) @ body[:3, :3] - model.centre
            away[name] = float(np.linalg.norm(np.maximum(np.abs(grip) - model.half, 0.0)))
        nearest = min(away, key=away.__getitem__, default="")
        if not nearest or away[nearest] > _AT_GRIP:
            return ""
        self._held = nearest, np.linalg.inv(hand) @ matrix(poses[nearest].pose)
        return nearest

    def _apart(self, name: str, pose: EstimatedPose, cloud: Cloud) -> Cloud:
        """The points that are not near an item."""
        model, body = self._models[name], matrix(pose.pose)
        at = (cloud.points - body[:3, 3]) @ body[:3, :3] - model.centre
        return cloud.of(np.linalg.norm(np.maximum(np.abs(at) - model.half, 0.0), axis=1) > _NEAR_ITEM)

    def _is_refuted(self, name: str, pose: EstimatedPose, views: Sequence[View]) -> bool:
        """Whether an item is not where it was: cameras look through it, or measure what is not it and see all of it."""
        model, body = self._models[name], matrix(pose.pose)
        centre = body[:3, :3] @ model.centre + body[:3, 3]
        told = evidence(model, body[None, :3, :3], centre[None], views)
        return bool(told.refuted[0] > _GONE) or pose.source == "held"


def _estimated(match: Match, group: Cloud, views: Sequence[View], source: str, time: float) -> EstimatedPose:
    distance, _ = match.model.distances((group.points - match.translation) @ match.rotation)
    mine = group.points[np.abs(distance) < _EXPLAINED]
    mine = mine[:: max(1, len(mine) // 1500)]
    seen = tuple(view.name for view, share in zip(views, match.by_view, strict=True) if share > 0.02)
    covariance = registration.covariance(match.model, match.rotation, match.translation, mine)
    return EstimatedPose(_pose(_body(match)), covariance, match.misfit, seen, source, time)


def _without(cloud: Cloud, match: Match) -> Cloud:
    """The points that are not of a matched item."""
    distance, _ = match.model.distances((cloud.points - match.translation) @ match.rotation)
    return cloud.of(distance > _EXPLAINED)


def _body(match: Match) -> FloatArray:
    """The transform (4, 4) of the item's body."""
    body = np.eye(4)
    body[:3, :3] = match.rotation
    body[:3, 3] = match.translation - match.rotation @ match.model.centre
    return body


def _about_pads(angle: float) -> FloatArray:
    """A turn (3, 3) about the line from pad to pad, in the frame of the grip point."""
    return np.asarray(Rotation.from_euler("x", angle).as_matrix())


def _lump(points: FloatArray) -> Lump:
    low, high = points.min(axis=0), points.max(axis=0)
    return Lump(0.5 * (low + high), 0.5 * (high - low))


def matrix(pose: FloatArray) -> FloatArray:
    """The (4, 4) transform of a (7,) pose."""
    body = np.eye(4)
    body[:3, :3] = Rotation.from_quat(pose[[4, 5, 6, 3]]).as_matrix()
    body[:3, 3] = pose[:3]
    return body


def _pose(body: FloatArray) -> FloatArray:
    x, y, z, w = Rotation.from_matrix(body[:3, :3]).as_quat()
    return np.array([*body[:3, 3], w, x, y, z])
