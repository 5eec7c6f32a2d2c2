"""Eyes that err on purpose: answers turned around at a known rate, and pictures made bad before they are looked at."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from PIL import Image as Pictures
from PIL import ImageFilter

from executive.errors import InputError, nearest
from executive.protocols import Asking, Estimator
from executive.types import Atom, Belief, Image, Observation, Questions

WORSE: Mapping[str, str] = MappingProxyType(
    {
        "blur": "the radius of a Gaussian blur, in pixels",
        "noise": "the standard deviation of noise on every value, in grey levels",
        "dark": "the share of the light that is gone, from 0 to 1",
    }
)
"""What can be done to a picture, and what the amount of it means."""


class Noisy:
    """Turns each answer of an estimator around with the same chance, each time it is asked.

    Chance is drawn from the seed, the number of the observation and the atom, so that the same question about the same
    look has the same answer, whatever else is asked.

    Args:
        eye: whose answers they are.
        flips: the chance that one is turned around (P becomes 1 - P).
    """

    def __init__(self, eye: Estimator, flips: float, seed: int) -> None:
        if not 0.0 <= flips <= 1.0:
            raise ValueError(f"flips: a chance from 0 to 1 is expected, got {flips}")
        self._eye, self._flips, self._seed = eye, flips, seed

    @property
    def name(self) -> str:
        return f"{self._eye.name}, {self._flips:g} flipped"

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        belief = self._eye.estimate(observation, atoms)
        told = {atom: 1.0 - p if self._errs(observation, atom) else p for atom, p in belief.probability.items()}
        return replace(belief, probability=told, source=self.name)

    def _errs(self, observation: Observation, atom: Atom) -> bool:
        key = (observation.id, zlib.crc32(str(atom).encode()))
        chance = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
        return bool(chance.random() < self._flips)


class Worse:
    """Makes pictures bad, each in the same way, before an estimator looks at them.

    Args:
        eye: who looks.
        kind: one of `WORSE`.
        amount: how much of it.

    Raises:
        InputError: no such kind, or no such amount of it.
    """

    def __init__(self, eye: Estimator, kind: str, amount: float, seed: int) -> None:
        if kind not in WORSE:
            raise InputError(f"no way {kind!r} to make a picture bad; {nearest(kind, WORSE)}")
        if not 0.0 <= amount <= (1.0 if kind == "dark" else 255.0):
            raise InputError(f"{kind} {amount:g}: expected {WORSE[kind]}")
        self._eye, self._kind, self._amount, self._seed = eye, kind, amount, seed

    @property
    def name(self) -> str:
        return f"{self._eye.name}, {self._kind} {self._amount:g}"

    @property
    def questions(self) -> Questions:
        """What the eye asks, if it asks in words (see `executive.protocols.Asking`)."""
        if not isinstance(self._eye, Asking):
            raise AttributeError("questions")
        return self._eye.questions

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        images = {camera: self._worse(image, observation.id, camera) for camera, image in observation.images.items()}
        return replace(self._eye.estimate(replace(observation, images=images), atoms), source=self.name)

    def _worse(self, image: Image, number: int, camera: str) -> Image:
        if self._kind == "blur":
            return np.asarray(Pictures.fromarray(image).filter(ImageFilter.GaussianBlur(self._amount)))
        if self._kind == "dark":
            return (image * (1.0 - self._amount)).round().astype(np.uint8)
        key = (number, zlib.crc32(camera.encode()))
        chance = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
        return np.clip(image + chance.normal(0.0, self._amount, image.shape), 0, 255).round().astype(np.uint8)
