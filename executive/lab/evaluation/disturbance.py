"""Looks made harder: the moments of a collection under other lights, through moved cameras, or badly compressed."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from executive.errors import OptionError, nearest
from executive.faults.image_noise import SPOILED, most, spoiled
from executive.lab.collection.dataset import JPEG_QUALITY, Point
from executive.trace.record.pictures import from_jpeg, to_jpeg
from executive.types import Image

if TYPE_CHECKING:
    from executive.domain.loader import Domain
    from executive.sim.relighting import Relighting

_NUMBER = re.compile(r"[0-9]{1,4}(?:\.[0-9]{1,6})?")

METRES, RADIANS = 0.03, math.radians(3.0)
"""How far a camera is moved and turned at most."""

KINDS = ("lights", "cameras", "jpeg=40", "blurred=3", "noisy=40", "dark=0.7")


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What is done to every look.

    `lights`: seeded random ones (`executive.sim.relighting.Lights.drawn`). `cameras`: each is moved by up to `METRES`
    and turned by up to `RADIANS`. `jpeg`: the quality, from 1 to 95, with which pictures are compressed once more.
    `spoiled`: after that, how and how much (see `executive.faults.image_noise`)."""

    lights: bool = False
    cameras: bool = False
    jpeg: int | None = None
    spoiled: tuple[tuple[str, float], ...] = ()

    @classmethod
    def parse(cls, specs: Sequence[str]) -> Disturbance:
        """Read what the command line says: `lights`, `cameras`, `jpeg=40`, `blurred=3`, `noisy=40`, `dark=0.7`.

        Raises:
            InputError: something is none of these, or comes twice.
        """
        told: dict[str, str] = {}
        for spec in specs:
            kind, equals, value = spec.partition("=")
            if kind not in ("lights", "cameras", "jpeg", *SPOILED) or bool(equals) is (kind in ("lights", "cameras")):
                raise OptionError(f"no disturbance {spec!r}; {nearest(spec, KINDS)}", option="disturb")
            if kind in told:
                raise OptionError(f"{kind} comes twice", option="disturb")
            told[kind] = value
        jpeg = told.get("jpeg")
        if jpeg is not None and not (jpeg.isascii() and jpeg.isdigit() and len(jpeg) < 3 and 1 <= int(jpeg) <= 95):
            raise OptionError(f"jpeg={jpeg} is not a quality from 1 to 95", option="disturb")
        worse = tuple((way, _amount(way, told[way])) for way in SPOILED if way in told)
        return cls("lights" in told, "cameras" in told, None if jpeg is None else int(jpeg), worse)

    @property
    def redraws(self) -> bool:
        """Whether pictures are drawn anew, so that those of the collection are not needed."""
        return self.lights or self.cameras


class Disturber:
    """Makes looks harder. A context manager that frees what draws.

    Args:
        domain: what the points were collected in.
        cameras: whose pictures are wanted; all when None.
        seed: with a point's own seed, episode and step, fixes what is done to it.

    Raises:
        DomainError: the scene file is wrong.
        MissingError: the machine cannot draw.
    """

    def __init__(self, what: Disturbance, domain: Domain | None, cameras: Sequence[str] | None, seed: int) -> None:
        self._what, self._cameras, self._seed = what, cameras, seed
        self._studio: Relighting | None = None
        if what.redraws:
            if domain is None:
                raise ValueError("a domain is needed to draw its moments anew")
            from executive.sim.relighting import Relighting

            self._studio = Relighting.of(domain.scene, domain.task.objects)

    def __enter__(self) -> Disturber:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._studio is not None:
            self._studio.close()

    def pictures(self, point: Point) -> Mapping[str, Image]:
        """What the cameras see of a point.

        Raises:
            InputError: the point is of another scene.
        """
        images = point.images if self._studio is None else self._drawn(self._studio, point)
        # Pictures that are drawn anew are kept as those of a collection are, so that this makes no difference.
        quality = self._what.jpeg if self._what.jpeg is not None else JPEG_QUALITY if self._studio is not None else None
        if quality is not None:
            images = {camera: from_jpeg(to_jpeg(image, quality)) for camera, image in images.items()}
        for kind, (way, amount) in enumerate(self._what.spoiled, start=2):
            images = {
                camera: spoiled(image, way, amount, self._chance(point, kind, zlib.crc32(camera.encode())))
                for camera, image in images.items()
            }
        return images

    def _drawn(self, studio: Relighting, point: Point) -> Mapping[str, Image]:
        from executive.sim.relighting import Lights, Shift

        light, move = (self._chance(point, kind) for kind in range(2))
        lights = Lights.drawn(light) if self._what.lights else None
        shifts = {}
        if self._what.cameras:  # drawn for all of them, so that a camera's does not depend on which others are shown
            shifts = {camera.name: Shift.drawn(move, METRES, RADIANS) for camera in studio.spec.cameras}
        return studio.pictures(point.qpos, lights, shifts, self._cameras)

    def _chance(self, point: Point, *kind: int) -> np.random.Generator:
        key = (self._seed, point.seed, point.episode, point.step)
        return np.random.default_rng(np.random.SeedSequence(key, spawn_key=kind))


def _amount(way: str, text: str) -> float:
    if not (_NUMBER.fullmatch(text) and float(text) <= most(way)):
        raise OptionError(f"{way}={text} is no number up to {most(way):g} ({SPOILED[way]})", option="disturb")
    return float(text)
