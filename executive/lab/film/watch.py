"""Estimates a film frame by frame: from each frame alone, and with memory of the frames before."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from executive.errors import InputError
from executive.lab.evaluation.metrics import Answers, BoolArray
from executive.lab.film.frames import Frames
from executive.lab.film.memory import FilmMemory
from executive.protocols import Estimator
from executive.types import Atom, FloatArray, Image, Observation


class Seen(NamedTuple):
    """A frame with its estimate: `probability` (atoms,) from it alone, `remembered` (atoms,) with memory, NaN where
    there is none; `row` is that of the truth, `seconds` how long the estimate took."""

    time: float
    image: Image
    row: int
    probability: FloatArray
    remembered: FloatArray
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """The estimates of all frames of a film that were looked at.

    Attributes:
        name: the film's.
        probability, remembered: (frames, atoms), NaN where there is none.
        truth: (frames, atoms).
        mid_pose: (frames,).
        times, seconds: (frames,), of the film and of each estimate.
    """

    name: str
    atoms: tuple[Atom, ...]
    times: FloatArray
    probability: FloatArray
    remembered: FloatArray
    truth: BoolArray
    mid_pose: BoolArray
    seconds: FloatArray

    @classmethod
    def of(cls, name: str, frames: Frames, seen: Sequence[tuple[float, int, FloatArray, FloatArray, float]]) -> Watched:
        """Put together what was seen of a film: of each frame its time, row, both estimates and seconds."""
        times, rows, probability, remembered, seconds = zip(*seen, strict=True)
        at = np.array(rows)
        return cls(
            name, frames.atoms, np.array(times), np.array(probability), np.array(remembered), frames.truth[at],
            frames.mid_pose[at], np.array(seconds),
        )  # fmt: skip

    @property
    def alone(self) -> Answers:
        """What each frame was taken for by itself."""
        return Answers(self.atoms, self.probability, self.truth)

    @property
    def with_memory(self) -> Answers | None:
        """What each frame was taken for with memory; None without one."""
        return None if np.isnan(self.remembered).all() else Answers(self.atoms, self.remembered, self.truth)


def watch(
    estimator: Estimator,
    frames: Frames,
    camera: str,
    pictures: Iterable[tuple[float, Image]],
    memory: FilmMemory | None = None,
) -> Iterator[Seen]:
    """Yield the estimate of each frame, one after the other: nothing of the film is kept.

    Args:
        estimator: asked about all atoms of `frames`, with the film as the picture of a `camera`.
        pictures: of each frame its time in s and its picture, in order.

    Raises:
        InputError: the truth says nothing of a frame, or a video breaks off.
    """
    for number, (moment, image) in enumerate(pictures):
        try:
            row = frames.at(moment)
        except ValueError as error:
            raise InputError(f"the truth {error}") from None
        began = time.perf_counter()
        observation = Observation(number, moment, {camera: image}, np.empty(0))
        belief = estimator.estimate(observation, frames.atoms)
        seconds = time.perf_counter() - began
        remembered = {} if memory is None else memory.look(moment, belief)
        yield Seen(
            moment,
            image,
            row,
            np.array([belief.probability.get(atom, math.nan) for atom in frames.atoms]),
            np.array([remembered.get(atom, math.nan) for atom in frames.atoms]),
            seconds,
        )
