"""Training images on disk: pictures of sampled scenes, with the item that each pixel shows.

A shard is four arrays of the same length N: `pictures` (N, C, S, S, 3) uint8, `items` (N, C, M, M) uint8 (the item of
each pixel, from 1; 0 for none), `facts` (N, A) bool, and `kinds` (N,). They are not compressed, so that training
maps them from disk without decoding, and holds no picture in memory.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from executive.domain.loader import Domain, load_domain
from executive.errors import InputError
from executive.lab.common.process_pool import ReportProgress
from executive.lab.training.scene_sampler import Moment, SceneSampler
from executive.sim import scene
from executive.sim.initial_state import InitialState
from executive.sim.relighting import Lights, Relighting, Shift
from executive.sim.spec import CameraSpec, ItemSpec
from executive.types import FloatArray

_PLAIN_SHARE = 0.35
"""The share of samples that is drawn without randomised lights, cameras and colours, as in runs."""

_OTHER_TABLES = 0.5
"""Where objects are described, the share of the recoloured samples in which tables have any colour: else what has
nearly the colour of the tables, as a brown block on wood, is seen against them alone."""


class Shard(NamedTuple):
    """The arrays of a shard, mapped from disk."""

    pictures: np.ndarray[Any, np.dtype[np.uint8]]
    items: np.ndarray[Any, np.dtype[np.uint8]]
    facts: np.ndarray[Any, np.dtype[np.bool_]]


class ImageSampler:
    """Renders sampled scenes as training pictures of `side` x `side` pixels, resized as the model's processor does.

    Args:
        start: what stands on what at first; see `SceneSampler`.
        mask: the side of a mask in pixels.
    """

    def __init__(
        self,
        domain: Domain,
        seed: Sequence[int],
        side: int,
        cameras: Sequence[str] | None = None,
        start: InitialState | None = None,
        mask: int = 48,
    ) -> None:
        self._sampler = SceneSampler(domain, [*seed, 0], start)
        self._rng = np.random.default_rng(np.random.SeedSequence([*seed, 1]))
        world = self._sampler.world
        self._relighting = Relighting(world.model, world.spec)
        self.cameras = [camera for camera in world.spec.cameras if cameras is None or camera.name in cameras]
        self._side = side
        self._mask = mask
        items = sorted([*world.shapes, *world.drawers.specs])  # as in `LabelSpace`
        roots = {world.model.body(item).id: index + 1 for index, item in enumerate(items)}
        owner = [roots.get(int(world.model.body_rootid[body]), 0) for body in world.model.geom_bodyid]
        self._owner = np.array([*owner, 0], dtype=np.uint8)  # the last entry stands for pixels without a geom
        self._atoms = domain.task.atoms
        # Those of objects with fixed looks may be called by them.
        self._tables = () if start is None else tuple(table.name for table in world.spec.tables)

    def shard(self, count: int, tell: ReportProgress = lambda done: None) -> dict[str, np.ndarray[Any, Any]]:
        """Draws the next `count` samples. `tell` receives the share that is done, after each."""
        moments: list[Moment] = []
        while len(moments) < count:
            moments += self._sampler.draw()
        moments = moments[:count]
        drawn = []
        for number, moment in enumerate(moments, start=1):
            drawn.append(self._draw(moment.qpos))
            tell(number / count)
        return {
            "pictures": np.stack([pictures for pictures, _ in drawn]),
            "items": np.stack([items for _, items in drawn]),
            "facts": np.array([[moment.facts[atom] for atom in self._atoms] for moment in moments]),
            "kinds": np.array([moment.kind for moment in moments]),
        }

    def paint(self, item: ItemSpec) -> None:
        """Gives an item its colour and its material for the next samples; see `executive.sim.scene.paint`."""
        scene.paint(self._relighting.model, item)

    def close(self) -> None:
        self._relighting.close()
        self._sampler.close()

    def _draw(self, qpos: FloatArray) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        from PIL import Image

        rng, varied = self._rng, self._rng.random() >= _PLAIN_SHARE
        lights = Lights.drawn(rng) if varied and rng.random() < 0.8 else None
        shifts = {camera.name: Shift.drawn(rng, 0.045, 0.08) for camera in self.cameras} if varied else {}
        pictures, items = [], []
        changes = varied and rng.random() < 0.6
        recoloured = _recoloured(self._relighting.model, rng, self._tables) if changes else _nothing()
        with recoloured, self._relighting.set_up(qpos, lights, shifts):
            for camera in self.cameras:
                whole = self._relighting.drawing.picture(self._relighting.data, camera)
                size = (self._side, self._side)
                pictures.append(np.asarray(Image.fromarray(whole).resize(size, Image.Resampling.BILINEAR)))
                items.append(self._items(camera))
        return np.stack(pictures), np.stack(items)

    def _items(self, camera: CameraSpec) -> np.ndarray[Any, Any]:
        """Which item each pixel of a camera's mask shows; it is squeezed into a square as its picture is."""
        geoms = self._relighting.drawing.geoms(self._relighting.data, camera)
        rows, columns = (((np.arange(self._mask) + 0.5) * side / self._mask).astype(int) for side in geoms.shape)
        return np.asarray(self._owner[geoms[np.ix_(rows, columns)]])


def write_shard(folder: Path, number: int, arrays: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Writes a shard atomically."""
    temporary, final = folder / f".shard-{number:04d}.{os.getpid()}", shard_folder(folder, number)
    temporary.mkdir(parents=True)
    try:
        for name, array in arrays.items():
            np.save(temporary / f"{name}.npy", array)
        try:
            temporary.rename(final)
        except OSError as error:
            if error.errno not in (
                errno.ENOTEMPTY,
                errno.EEXIST,
            ):  # another process has written the same one
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class ShardWriter:
    """The job of a worker process: draws the shard of a number and writes it into `folder`.

    Raises:
        InputError: the folder cannot be written to.
    """

    domain: str
    problem: str | None
    seed: int
    side: int
    count: int
    folder: Path
    mask: int = 48

    def __call__(self, number: int, tell: ReportProgress) -> None:
        domain = load_domain(self.domain, self.problem)
        sampler = ImageSampler(domain, [self.seed, number], self.side, mask=self.mask)
        try:
            write_shard(self.folder, number, sampler.shard(self.count, tell))
        except OSError as error:
            raise InputError(f"cannot be written to ({error.strerror})", file=self.folder) from None
        finally:
            sampler.close()


def read_shard(folder: Path, number: int) -> Shard:
    parts = (np.load(shard_folder(folder, number) / f"{name}.npy", mmap_mode="r") for name in Shard._fields)
    return Shard(*parts)


def shards(folder: Path) -> list[int]:
    """The numbers of the shards in a folder."""
    return sorted(int(path.name.removeprefix("shard-")) for path in folder.glob("shard-*"))


def shard_folder(folder: Path, number: int) -> Path:
    return folder / f"shard-{number:04d}"


@contextmanager
def _recoloured(model: mujoco.MjModel, rng: np.random.Generator, tables: Sequence[str]) -> Iterator[None]:
    """Randomises the colour of each material and each geom a little within the context, and at times those of `tables`
    altogether."""
    before = model.mat_rgba.copy(), model.geom_rgba.copy()
    try:
        for table in tables if rng.random() < _OTHER_TABLES else ():
            tint = rng.uniform(0.15, 1.0, 3)
            geoms = np.flatnonzero(model.geom_bodyid == model.body(table).id)
            model.geom_rgba[geoms, :3] *= tint
            model.mat_rgba[np.unique(model.geom_matid[geoms][model.geom_matid[geoms] >= 0]), :3] *= tint
        for colours in (model.mat_rgba, model.geom_rgba):
            shade = rng.uniform(0.8, 1.15, (len(colours), 1)) * rng.uniform(0.93, 1.07, (len(colours), 3))
            colours[:, :3] = np.clip(colours[:, :3] * shade + rng.uniform(0.0, 0.03), 0.0, 1.0)
        yield
    finally:
        model.mat_rgba[:], model.geom_rgba[:] = before


@contextmanager
def _nothing() -> Iterator[None]:
    yield
