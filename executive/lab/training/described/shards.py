"""Training images of described objects: drawn by the sampler, other objects in each few, or those of collections.

A shard is arrays of the same length N: `pictures` (N, C, S, S, 3) uint8, `items` (N, C, MASK, MASK) uint8 (the object
of each pixel, from 1; 0 for none), and the parts of `Scenes`.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from executive.app.worlds import checked_stage
from executive.domain.loader import Domain, load_domain
from executive.errors import DomainError, InputError
from executive.lab.collection import dataset
from executive.lab.common.process_pool import ReportProgress
from executive.lab.problems import Combinations, ProblemMaker
from executive.lab.training import image_shards
from executive.lab.training.described.heads import MASK
from executive.lab.training.described.space import Described, DescribedSpace, Scenes, gathered
from executive.lab.training.image_shards import ImageSampler
from executive.lab.training.scene_sampler import VARIANTS
from executive.sim.described import Attributes, keys_of
from executive.sim.spec import ItemSpec, SceneSpec, read_scene
from executive.types import Atom

PER_PROBLEM = 12
"""Samples of the same objects."""

EPISODES = 8
"""Episodes of a collection in a shard."""

_PROBLEMS = 10_000
"""More problems than any shard has: each shard has numbers of its own."""

_TRIES = 5
"""Problems in a row that leave no room for their objects, after which something is wrong."""

_PAINT = {"rgba", "material"}
"""The keys of an item that can be changed in a world that is there."""

Arrays = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True, slots=True)
class Drawn:
    """The job of a worker process: draws the shard of a number and writes it into `folder`.

    Raises:
        DomainError: problem after problem leaves no room for its objects.
        InputError: the folder cannot be written to.
    """

    domain: str
    objects: tuple[int, int]
    seed: int
    side: int
    count: int
    folder: Path

    def __call__(self, number: int, tell: ReportProgress) -> None:
        space = DescribedSpace.of(load_domain(self.domain), self.objects[1])
        maker = ProblemMaker(self.domain, *self.objects, self.seed, combinations=Combinations.SEEN if space.held_out
                             else Combinations.ALL)  # fmt: skip
        parts: list[Arrays] = []
        done = failures = 0
        problem = number * _PROBLEMS
        while done < self.count:
            problem += 1
            wanted = min(PER_PROBLEM, self.count - done)
            try:
                with maker.domain(problem) as domain:
                    parts.append(self._sampled(domain, space, problem, wanted))
            except DomainError:  # no room for these objects
                failures += 1
                if failures == _TRIES:
                    raise
                continue
            failures, done = 0, done + wanted
            tell(done / self.count)
        _write(self.folder, number, parts)

    def _sampled(self, domain: Domain, space: DescribedSpace, problem: int, count: int) -> Arrays:
        sampler = ImageSampler(domain, [self.seed, problem], self.side, start=checked_stage(domain), mask=MASK)
        rng, spec = np.random.default_rng([self.seed, problem, 2]), read_scene(domain.scene)
        # Masks number the items by name.
        items = {item.name: item for item in sorted(_items(domain), key=lambda item: item.name)}
        paints = _paints(spec) if all(item.shape is not None for item in items.values()) else {}
        atoms, parts = domain.task.atoms, list[Arrays]()
        try:
            for first in range(0, count, VARIANTS):
                objects: Described = {name: item.attributes for name, item in items.items()}
                if first and paints:  # other shapes and sizes cost another world, and colours nothing
                    objects = space.painted_anew(objects, paints, rng)
                    for name, described in objects.items():
                        keys = keys_of({each: described[each] for each in paints}, paints)
                        sampler.paint(items[name].model_copy(update=keys))
                arrays = sampler.shard(min(VARIANTS, count - first))
                facts = [dict(zip(atoms, row.tolist(), strict=True)) for row in arrays["facts"]]
                scenes = gathered([space.encode(objects, each) for each in facts])
                parts.append({"pictures": arrays["pictures"], "items": arrays["items"], **scenes._asdict()})
        finally:
            sampler.close()
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _paints(spec: SceneSpec) -> Attributes:
    """The attributes whose values are colours and materials and nothing else."""
    said = {name: {value: part.keys_said() for value, part in of.items()} for name, of in spec.attributes.items()}
    return {
        name: values
        for name, values in said.items()
        if len({frozenset(keys) for keys in values.values()}) == 1 and set().union(*values.values()) <= _PAINT
    }


@dataclass(frozen=True, slots=True)
class Collected:
    """The job of a worker process: makes a shard of some episodes of a collection, and writes it into `folder`. The
    numbers of the shards count through all `collections`.

    Raises:
        InputError: a collection is damaged, has no masks, or objects that are held out of training.
    """

    domain: str
    objects: tuple[int, int]
    collections: tuple[Path, ...]
    side: int
    folder: Path

    def __call__(self, number: int, tell: ReportProgress) -> None:
        domain = load_domain(self.domain)
        space, attributes = DescribedSpace.of(domain, self.objects[1]), read_scene(domain.scene).attributes
        collection, episodes = parts_of(self.collections)[number]
        cameras = list(dataset.read_manifest(collection)["cameras"])
        parts: list[Arrays] = []
        for done, episode in enumerate(episodes, start=1):
            columns = [f"{kind}{camera}" for kind in (dataset.IMAGE, dataset.MASK) for camera in cameras]
            file = dataset.shard(collection, episode)
            for row in dataset.columns(collection, episode, "objects", "atoms", *columns):
                objects = {
                    each["name"]: dict(zip(attributes, each["attributes"], strict=True)) for each in row["objects"]
                }
                for name, described in objects.items():
                    if space.is_held_out(described):
                        message = f"has a {name}, which is held out of training: collect with --combinations seen"
                        raise InputError(message, file=file)
                facts = {Atom.parse(atom): value for atom, value in dataset.truth_of(row).items()}
                scene = space.encode(objects, facts, file)
                shown = [_picture(row[f"{dataset.IMAGE}{camera}"]["bytes"], self.side) for camera in cameras]
                masks = [_mask(row[f"{dataset.MASK}{camera}"]["bytes"]) for camera in cameras]
                parts.append({"pictures": np.stack(shown)[None], "items": np.stack(masks)[None], **scene._asdict()})
            tell(done / len(episodes))
        _write(self.folder, number, parts)


def parts_of(collections: Sequence[Path]) -> list[tuple[Path, range]]:
    """The shards that collections make: each its collection and its episodes."""
    found = []
    for folder in collections:
        episodes = dataset.read_manifest(folder)["statistics"]["episodes"]
        found += [(folder, range(first, min(first + EPISODES, episodes))) for first in range(0, episodes, EPISODES)]
    return found


def check_collection(folder: Path, domain: Domain, space: DescribedSpace) -> None:
    """Check that training may use a collection.

    Raises:
        InputError: it may not, and why.
    """
    manifest = dataset.read_manifest(folder)
    told = manifest["collection"]
    if not manifest["finished"]:
        raise InputError(f"is not finished; resume with: {manifest['command']}", file=folder)
    if told.get("domain") != domain.name:
        raise InputError(f"is of the domain {told.get('domain')!r}, and not of {domain.name!r}", file=folder)
    if not told.get("objects") or not told.get("masks"):
        raise InputError("has to be collected with --objects and --masks to be trained on", file=folder)
    if space.held_out and told.get("combinations") != Combinations.SEEN:
        message = "may have what is held out of training: collect with --combinations seen"
        raise InputError(message, file=folder)
    here, there = [camera.name for camera in read_scene(domain.scene).cameras], list(manifest["cameras"])
    if here != there:
        raise InputError(f"has the cameras {', '.join(there)}, and the scene {', '.join(here)}", file=folder)


class DescribedPool:
    """Random access to the shards of a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: dict[int, dict[str, np.ndarray[Any, Any]]] = {}
        self._numbers: list[int] = []

    def scenes(self, count: int, rng: np.random.Generator) -> tuple[Any, Any, Scenes]:
        """Pictures (B, C, S, S, 3), masks (B, C, M, M) and the truth of random samples."""
        drawn = [self._one(rng) for _ in range(count)]
        pictures, masks = (np.stack([shard[name][at] for shard, at in drawn]) for name in ("pictures", "items"))
        return pictures, masks, _scenes(drawn)

    def single(self, count: int, rng: np.random.Generator) -> tuple[Any, Any, Scenes]:
        """Single random pictures (B, S, S, 3), masks (B, M, M) and the truth."""
        drawn = [self._one(rng) for _ in range(count)]
        cameras = [int(rng.integers(shard["pictures"].shape[1])) for shard, _ in drawn]
        pictures, masks = (
            np.stack([shard[name][at, camera] for (shard, at), camera in zip(drawn, cameras, strict=True)])
            for name in ("pictures", "items")
        )
        return pictures, masks, _scenes(drawn)

    def states(self) -> Scenes:
        """The truth of all samples."""
        shards = [self._shard(number) for number in image_shards.shards(self._folder)]
        return gathered([Scenes(*(shard[name] for name in Scenes._fields)) for shard in shards])

    def _one(self, rng: np.random.Generator) -> tuple[dict[str, np.ndarray[Any, Any]], int]:
        self._numbers = self._numbers or image_shards.shards(self._folder)
        shard = self._shard(self._numbers[int(rng.integers(len(self._numbers)))])
        return shard, int(rng.integers(len(shard["own"])))

    def _shard(self, number: int) -> dict[str, np.ndarray[Any, Any]]:
        if number not in self._open:
            folder = image_shards.shard_folder(self._folder, number)
            names = ("pictures", "items", *Scenes._fields)
            self._open[number] = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in names}
        return self._open[number]


def _scenes(drawn: Sequence[tuple[Arrays, int]]) -> Scenes:
    return Scenes(*(np.stack([shard[name][at] for shard, at in drawn]) for name in Scenes._fields))


def _write(folder: Path, number: int, parts: Sequence[Arrays]) -> None:
    try:
        image_shards.write_shard(folder, number, {name: np.concatenate([each[name] for each in parts])
                                                  for name in parts[0]})  # fmt: skip
    except OSError as error:
        raise InputError(f"cannot be written to ({error.strerror})", file=folder) from None


def _items(domain: Domain) -> tuple[ItemSpec, ...]:
    return read_scene(domain.scene).restricted_to(domain.task.objects, domain.scene).items


def _picture(encoded: bytes, side: int) -> np.ndarray[Any, Any]:
    from PIL import Image

    with Image.open(io.BytesIO(encoded)) as picture:
        return np.asarray(picture.convert("RGB").resize((side, side), Image.Resampling.BILINEAR))


def _mask(encoded: bytes) -> np.ndarray[Any, Any]:
    from PIL import Image

    with Image.open(io.BytesIO(encoded)) as mask:
        return np.asarray(mask.resize((MASK, MASK), Image.Resampling.NEAREST))
