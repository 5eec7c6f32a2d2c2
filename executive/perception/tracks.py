"""Which of several identical things is which: labels that follow them by where they are, and how certain that is.

Every thing has a track: where it was last seen, and when. Detections are assigned to tracks by how far a thing may have
come since: one that stands still is where it was, one that someone moves is not far from there after a fifth of a
second, and anywhere after some seconds. All assignments are weighed together; the most probable one says where the
tracks go on, and the others how probable it is that two were mistaken for one another. Two things that nobody watched
for long enough may have changed places, even though both places look as they did.

Labels are never found again by looks alone: what is lost of them stays lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from executive.perception.assignment import marginals
from executive.types import FloatArray

_RESTING = 0.005
"""Standard deviation in m of where a thing that stands still is found."""

_SPEED, _ROOM = 0.6, 0.5
"""m/s, and m at most: standard deviation of how far a thing that is moved comes in a second, and in any time."""

_ACCELERATION = 2.5
"""m/s^2: the same of how its velocity changes."""

_TOUCHED, _STILL_MOVING = 0.5, 0.9
"""1/s: how often a thing is moved that stood still; and the probability that one that was moving still does."""

_GOES_ON = 0.8
"""The probability that what is moving goes on as it did, but for that; else it may turn anywhere."""

_MOVING = 0.05
"""m/s from which on a thing moves."""

_MISSED = 1e-3
"""The probability that a thing moved otherwise than all this reckons with, and may be anywhere."""

_ANYWHERE = 0.5
"""1/m^3: the density of where a thing is of which nothing is known."""

_HIDDEN, _NOT_YET_SEEN = 0.1, 0.5
"""The probability that a thing is not found at one moment, if it was found before, and if it never was."""

_EXCHANGED = 1.0
"""1/s: how often two things are exchanged that nobody watches. Nothing is known about that; with this, three seconds
out of sight leave no label above 0.6."""

_HANDLING, _CARRYING = 0.4, 1.5
"""s and m/s: the time that it takes at least to exchange two things so far apart."""

_RENAMED = 0.02
"""By how much more probable another assignment of labels to tracks has to be to take the present one's place."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One thing over time: the position (3,) in m where it was last seen, its velocity (3,) in m/s then, and when that
    was (s of the world's clock). A track that is not born yet has none of these."""

    position: FloatArray | None = None
    velocity: FloatArray | None = None
    seen: float = -math.inf


Hint = Callable[[str, FloatArray], float]
"""How probable it is, up to a factor, that a label's thing is first seen at a position (3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """The labels of some detections, in their order; and by label, what was called by it so far."""

    labels: tuple[str, ...]
    formerly: Mapping[str, str]


class Tracks:
    """Follows identical things.

    Args:
        labels: their names; as many as there are things.
        hint: what is known beforehand of where each is. Without it, nobody knows which is which at first.
    """

    def __init__(self, labels: Sequence[str], hint: Hint | None = None) -> None:
        self.labels = tuple(labels)
        count = len(self.labels)
        self._tracks = [Track() for _ in self.labels]
        self._hint = hint
        self._belief = np.full((count, count), 1.0 / count)
        """The probability that each label (row) is of each track (column)."""
        self._label_of = list(range(count))
        """The label by which each track goes."""
        self._time = -math.inf

    @property
    def time(self) -> float:
        """When something was taken in last, in s."""
        return self._time

    def identity(self) -> dict[str, dict[str, float]]:
        """By label, how probable it is that its thing is where each label is said to be."""
        return {
            label: {self.labels[self._label_of[track]]: float(row[track]) for track in range(len(row))}
            for label, row in zip(self.labels, self._belief, strict=True)
        }

    def track(self, label: str) -> Track:
        """The track that goes by a label."""
        return self._tracks[self._label_of.index(self.labels.index(label))]

    def update(self, time: float, detections: FloatArray, held: Mapping[str, FloatArray] | None = None) -> Named:
        """Take in what is seen now.

        Args:
            time: of the world's clock, in s.
            detections: the positions (N, 3) in m of the things that are seen and not held.
            held: where the hand has what it holds, by the label that it goes by: that one is known by touch.
        """
        held = held or {}
        fixed = {self._label_of.index(self.labels.index(name)): position for name, position in held.items()}
        loose = [track for track in range(len(self._tracks)) if track not in fixed]
        self._exchange(time)
        chosen = self._assign(time, np.asarray(detections, dtype=float).reshape(-1, 3), loose)
        for track, position in (*fixed.items(), *((track, detections[at]) for track, at in chosen.items())):
            self._tracks[track] = self._seen_at(self._tracks[track], np.asarray(position, dtype=float), time)
        self._time = time
        formerly = self._rename(fixed)
        of = {at: self.labels[self._label_of[track]] for track, at in chosen.items()}
        return Named(tuple(of[at] for at in range(len(of))), formerly)

    def _exchange(self, time: float) -> None:
        """What nobody watches may be exchanged."""
        count = len(self._tracks)
        rates = np.zeros((count, count))
        for one in range(count):
            for other in range(one):
                rates[one, other] = rates[other, one] = _EXCHANGED * self._unwatched(one, other, time)
        if rates.any():
            self._belief = self._belief @ expm(rates - np.diag(rates.sum(axis=1)))

    def _unwatched(self, one: int, other: int, time: float) -> float:
        """For how many seconds since the last update two things may have been exchanged."""
        first, second = self._tracks[one], self._tracks[other]
        if first.position is None or second.position is None:
            return 0.0
        apart = float(np.linalg.norm(first.position - second.position))
        since = max(first.seen, second.seen) + _HANDLING + apart / _CARRYING
        return max(0.0, time - since) - max(0.0, self._time - since)

    def _assign(self, time: float, detections: FloatArray, loose: Sequence[int]) -> dict[int, int]:
        """The detection of each track that is seen, among those that nothing holds; the belief is changed by how
        probable the other assignments are."""
        count = len(detections)
        if count > len(loose):
            raise ValueError(f"{count} detections of {len(loose)} things")
        if not count:
            return {}
        likelihood = np.array([[self._density(self._tracks[track], at, time) for at in detections] for track in loose])
        absent = np.array([_NOT_YET_SEEN if self._tracks[track].position is None else _HIDDEN for track in loose])
        gain = np.log(np.maximum(likelihood, 1e-300)) - np.log(absent)[:, None]
        rows, columns = linear_sum_assignment(gain, maximize=True)
        chosen = {loose[row]: int(column) for row, column in zip(rows, columns, strict=True)}
        self._mistake(marginals(likelihood, absent), chosen, loose)
        born = [track for track in chosen if self._tracks[track].position is None]
        if born and self._hint is not None:
            self._christen({track: detections[chosen[track]] for track in born}, self._hint)
        return chosen

    def _mistake(self, probable: FloatArray, chosen: Mapping[int, int], loose: Sequence[int]) -> None:
        """Have the belief say what it amounts to that tracks go on where others may have gone."""
        change, hidden = np.eye(len(self._tracks)), [track for track in loose if track not in chosen]
        unseen = dict(zip(loose, probable[:, -1], strict=True))
        lacking = sum(1.0 - unseen[track] for track in hidden)
        for row, track in enumerate(loose):
            change[track] = 0.0
            for other in loose:
                if other in chosen:
                    change[track, other] = probable[row, chosen[other]]
                elif track == other:
                    change[track, other] = unseen[track]
                elif track in chosen and lacking > 0.0:  # it is hidden, and what is hidden is where it is taken to be
                    change[track, other] = unseen[track] * (1.0 - unseen[other]) / lacking
        self._belief = self._belief @ change

    def _christen(self, born: Mapping[int, FloatArray], hint: Hint) -> None:
        """Give labels to what is seen for the first time, by what is known beforehand."""
        weights = self._belief.copy()
        for track, position in born.items():
            weights[:, track] *= [hint(label, position) for label in self.labels]
        self._belief = marginals(weights, np.zeros(len(self.labels)))[:, :-1]

    def _density(self, track: Track, position: FloatArray, time: float) -> float:
        """How probable, in 1/m^3, a track's thing is found at a position."""
        if track.position is None or track.velocity is None:
            return _ANYWHERE
        passed, away = max(0.0, time - track.seen), position - track.position
        is_moving = float(np.linalg.norm(track.velocity)) > _MOVING
        moved = 1.0 - math.exp(-_TOUCHED * passed)
        moved = max(moved, _STILL_MOVING) if is_moving else moved
        begun = _gaussian(away, min(_ROOM, math.hypot(_RESTING, _SPEED * passed)))
        if is_moving:
            spread = math.hypot(_RESTING, 0.5 * _ACCELERATION * passed * passed)
            going_on = _gaussian(away - track.velocity * passed, min(_ROOM, spread))
            begun = (1.0 - _GOES_ON) * begun + _GOES_ON * going_on
        missed = _MISSED * _ANYWHERE * math.exp(-float(np.linalg.norm(away)) / _ROOM)
        return (1.0 - moved) * _gaussian(away, _RESTING) + moved * begun + missed

    @staticmethod
    def _seen_at(track: Track, position: FloatArray, time: float) -> Track:
        passed = time - track.seen
        if track.position is None or passed > 1.0:
            return Track(position, np.zeros(3), time)
        if passed <= 0.0:
            return replace(track, position=position)
        return Track(position, (position - track.position) / passed, time)

    def _rename(self, fixed: Mapping[int, FloatArray]) -> dict[str, str]:
        """Have each track go by the label that it most probably has; returns what each label's track went by so far.

        A label changes its track only for a good reason; what is held keeps its own while it is held."""
        label_of = list(self._label_of)
        tracks = [track for track in range(len(label_of)) if track not in fixed]
        labels = [label_of[track] for track in tracks]
        if tracks:
            among = self._belief[np.ix_(labels, tracks)]
            rows, columns = linear_sum_assignment(among, maximize=True)
            if among[rows, columns].sum() > np.trace(among) + _RENAMED:
                for row, column in zip(rows, columns, strict=True):
                    label_of[tracks[column]] = labels[row]
        formerly = {self.labels[now]: self.labels[before] for now, before in zip(label_of, self._label_of, strict=True)}
        self._label_of = label_of
        return formerly


def _gaussian(away: FloatArray, deviation: float) -> float:
    """The density of a round normal distribution in space."""
    variance = deviation * deviation
    return math.exp(-0.5 * float(away @ away) / variance) / math.pow(math.tau * variance, 1.5)
