"""Pictures with the truth about them, on disk: one Parquet file an episode, which Hugging Face's `datasets` reads too.

A row is a point: what the cameras saw after one completed action, and which atoms were true then. Pictures are JPEG
bytes under the feature `Image`, one column a camera, so that `datasets.load_dataset("parquet", ...)` decodes them.
`atoms` is a struct with one bool an atom: a row's `atoms` is the whole state as a dict, and `Dataset.flatten()` makes
a column of each. What is no row (attempts that failed, how an episode ended) is in the file's metadata.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from executive.errors import InputError, nearest
from executive.lab.collection import demonstrations as motions
from executive.lab.collection.demonstrations import Demonstration
from executive.trace.record.codec import decode
from executive.trace.record.pictures import from_jpeg, to_jpeg
from executive.types import Atom, Facts, FloatArray, Image, SkillStatus
from executive.util.files import parse_json, read_json

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 2
JPEG_QUALITY = 92
MANIFEST, CARD, SHARDS = "dataset.json", "README.md", "data"

IMAGE = "image_"
"""What the columns of pictures begin with; the camera's name follows."""

MASK = "mask_"
"""What the columns of masks begin with: PNG, a grey value for each item."""

Objects = Mapping[str, Sequence[str]]
"""The items of an episode, in the order that masks number them in, each with the values of its attributes."""

_METADATA = b"executive"


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """One completed action and what was there after it.

    `seed` is the collection's, `episode` counts from 0 and `step` from 1 within the episode. `action` is the step that
    was carried out, as text; `time` the simulated seconds since the reset; `joints` (6,) in rad; `qpos` (nq,) MuJoCo's
    positions of everything, from which the moment can be drawn anew; `images` camera -> (H, W, 3) uint8; `facts` the
    truth of every atom of the task; `masks` camera -> (H, W) uint8, which of the objects (from 1 on) each pixel shows;
    `objects` what there is with the values of its attributes, where that is not the same in all episodes;
    `surprises` those atoms whose truth is not what the action's effects, and nothing
    else, would have made of the state before it; `motion` how the arm moved, as columns of `demonstrations`.
    """

    seed: int
    episode: int
    step: int
    action: str
    time: float
    joints: FloatArray
    qpos: FloatArray
    images: Mapping[str, Image]
    facts: Facts
    surprises: tuple[Atom, ...] = ()
    masks: Mapping[str, Image] = field(default_factory=lambda: MappingProxyType({}))
    motion: Mapping[str, Any] | None = None
    objects: Objects = field(default_factory=lambda: MappingProxyType({}))


class Attempt(NamedTuple):
    """An action that was begun: the step as text, what its skill reported, and why."""

    action: str
    status: str
    reason: str

    @property
    def done(self) -> bool:
        return self.status == SkillStatus.DONE


class Ending(StrEnum):
    """Why an episode was over."""

    FULL = "enough actions done"
    FAILURES = "too many failures in a row"
    STUCK = "no action applies"
    CRASHED = "a skill crashed"
    CUT = "the collection had its points"


class Log(NamedTuple):
    """The outcome of an episode: the number of points, every attempt in order, and why it ended."""

    episode: int
    points: int
    attempts: tuple[Attempt, ...]
    ending: Ending


def shard(folder: Path, episode: int) -> Path:
    """The file of an episode."""
    return folder / SHARDS / f"episode-{episode:05d}.parquet"


def write_atomically(path: Path, content: bytes) -> None:
    """Have the file at `path` be the old one or the new one, whatever happens meanwhile."""
    passing = path.with_name(f".{path.name}.{os.getpid()}")
    with passing.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    passing.replace(path)


def shard_bytes(
    collection: str,
    log: Log,
    points: Sequence[Point],
    atoms: Sequence[Atom],
    cameras: Sequence[str],
    objects: Objects | None = None,
    masks: bool = False,
    varying: bool = False,
    demonstrations: bool = False,
) -> bytes:
    """An episode's file. `collection` names what it belongs to.

    Args:
        objects: what is there, for a column of its own.
        masks: whether there are columns of masks.
        varying: whether other episodes have other atoms: they are a map then, not a struct.
        demonstrations: whether there are columns with how the arm moved.
    """
    import pyarrow as pa

    rows = [
        {
            "seed": point.seed,
            "episode": point.episode,
            "step": point.step,
            "action": point.action,
            **{
                f"{IMAGE}{camera}": {
                    "bytes": to_jpeg(point.images[camera], JPEG_QUALITY),
                    "path": f"{point.episode:05d}-{point.step:02d}-{camera}.jpg",
                }
                for camera in cameras
            },
            **{
                f"{MASK}{camera}": {
                    "bytes": _png(point.masks[camera]),
                    "path": f"{point.episode:05d}-{point.step:02d}-{camera}-mask.png",
                }
                for camera in cameras
                if masks
            },
            "objects": [{"name": name, "attributes": list(values)} for name, values in (objects or {}).items()],
            "atoms": [{"atom": str(atom), "value": point.facts[atom]} for atom in atoms]
            if varying
            else {str(atom): point.facts[atom] for atom in atoms},
            "surprises": [str(atom) for atom in point.surprises],
            "joints": point.joints.tolist(),
            "qpos": point.qpos.tolist(),
            "time": point.time,
            **(point.motion or {}),
        }
        for point in points
    ]
    schema = _schema(atoms, cameras, objects is not None, masks, varying, demonstrations)
    return _bytes(collection, log, pa.Table.from_pylist(rows, schema=schema))


def truth_of(row: Mapping[str, Any]) -> dict[str, bool]:
    """The truth of every atom (as text) of a row's moment."""
    told = row["atoms"]
    return {each["atom"]: each["value"] for each in told} if isinstance(told, list) else dict(told)


def _png(mask: Image) -> bytes:
    from PIL import Image as Picture

    buffer = io.BytesIO()
    Picture.fromarray(mask).save(buffer, "PNG")
    return buffer.getvalue()


def cut_shard(folder: Path, collection: str, log: Log, points: int) -> Log:
    """Leave the first `points` rows of an episode's file, as if the episode had been stopped there."""
    done, attempts = 0, []
    for attempt in log.attempts:
        attempts.append(attempt)
        done += attempt.done
        if done == points:
            break
    cut = Log(log.episode, points, tuple(attempts), Ending.CUT)
    table = _table(shard(folder, log.episode)).slice(0, points)
    write_atomically(shard(folder, log.episode), _bytes(collection, cut, table))
    return cut


def digest(described: Mapping[str, Any]) -> str:
    """What each file of a collection says that it belongs to, made from the manifest's description of it."""
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def read_log(folder: Path, collection: str, episode: int) -> Log:
    """What an episode's file says of it, after every byte of the file has been checked.

    Raises:
        InputError: the file is damaged, or belongs to another collection.
    """
    path = shard(folder, episode)
    table = _table(path)
    try:
        said = parse_json(table.schema.metadata[_METADATA])
        attempts = tuple(Attempt(*entry) for entry in said["attempts"])
        log, belongs = Log(said["episode"], table.num_rows, attempts, Ending(said["ending"])), said["collection"]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"is damaged (its metadata: {error!r})", file=path) from None
    if belongs != collection or log.episode != episode:
        raise InputError("belongs to another collection", file=path)
    if log.points != sum(attempt.done for attempt in attempts):
        raise InputError("is damaged (rows are missing)", file=path)
    return log


class Reader:
    """The points of a finished collection, in order of episode and step or one by one, read as they are asked for.

    Args:
        cameras: whose pictures to decode; all when not given.

    Raises:
        InputError: there is no finished collection, a camera that it has not, or (while reading) a damaged file.
    """

    def __init__(self, folder: Path, cameras: Collection[str] | None = None) -> None:
        self._folder, self.manifest = folder, read_manifest(folder)
        known = list(self.manifest["cameras"])
        for camera in cameras or ():
            if camera not in known:
                raise InputError(f"has no camera {camera!r}; {nearest(camera, known)}", file=folder)
        if not self.manifest["finished"]:
            raise InputError(f"is not finished; resume with: {self.manifest['command']}", file=folder)
        self._cameras = [camera for camera in known if cameras is None or camera in cameras]
        self._episode, self._rows = -1, list[dict[str, Any]]()

    def __iter__(self) -> Iterator[Point]:
        for episode in range(self.manifest["statistics"]["episodes"]):
            index = 0
            while (point := self.point(episode, index)) is not None:
                yield point
                index += 1

    def point(self, episode: int, index: int) -> Point | None:
        """A point of an episode, counted from 0; None after the last one."""
        names = ["seed", "episode", "step", "action", "time", "joints", "qpos", "atoms", "surprises"]
        again = f"collect it again with: {self.manifest['command']}"
        names += ["objects"] if self.manifest["collection"].get("objects") else []
        try:
            if episode != self._episode:
                pictures = (f"{IMAGE}{camera}" for camera in self._cameras)
                self._episode, self._rows = -1, columns(self._folder, episode, *names, *pictures)
                self._episode = episode
            return _point(self._rows[index], self._cameras) if index < len(self._rows) else None
        except InputError as error:
            raise InputError(f"{error}; {again}") from None
        except (OSError, ValueError, SyntaxError, LookupError, TypeError, AttributeError) as error:  # no such columns
            raise InputError(f"is damaged ({error!r}); {again}", file=shard(self._folder, episode)) from None


def read(folder: Path, cameras: Collection[str] | None = None) -> Iterator[Point]:
    """All points of a finished collection; see `Reader`."""
    return iter(Reader(folder, cameras))


def read_demonstrations(folder: Path) -> Iterator[Demonstration]:
    """How the arm moved in each action of a finished collection, in order.

    Raises:
        InputError: it is not finished, damaged, or was collected without demonstrations.
    """
    manifest = Reader(folder, cameras=()).manifest
    if not manifest["collection"].get("demonstrations"):
        raise InputError("has no demonstrations; collect with --demonstrations into another folder", file=folder)
    for episode in range(manifest["statistics"]["episodes"]):
        for row in columns(folder, episode, "step", "action", "surprises", motions.COLUMN, motions.LOCATED):
            yield motions.parsed(episode, row)


def read_manifest(folder: Path) -> dict[str, Any]:
    """What `dataset.json` says.

    Raises:
        InputError: the folder has none, or it is damaged or of another format.
    """
    path = folder / MANIFEST
    if not os.path.exists(path):
        raise InputError(f"is no collection: it has no {MANIFEST}", file=folder)
    manifest = read_json(path)
    told = manifest.get("format") if isinstance(manifest, dict) else None
    if told != FORMAT:
        raise InputError(f"is of format {told!r:.40}; this Executive reads {FORMAT}", file=path)
    try:
        if decode(_Manifest, manifest).statistics is None and manifest["finished"]:
            raise ValueError("statistics is missing")
    except ValueError as error:
        raise InputError(str(error), file=path) from None
    return dict(manifest)


@dataclass(frozen=True, slots=True)
class _Statistics:
    episodes: int


@dataclass(frozen=True, slots=True)
class _Manifest:
    """What a manifest has at least."""

    collection: Mapping[str, Any]
    command: str
    points: int
    finished: bool
    cameras: Mapping[str, Any]
    atoms: tuple[str, ...]
    statistics: _Statistics | None


def columns(folder: Path, episode: int, *names: str) -> list[dict[str, Any]]:
    """Some columns of an episode, row by row, as plain Python values."""
    rows: list[dict[str, Any]] = _table(shard(folder, episode), names).to_pylist()
    return rows


def _point(row: Mapping[str, Any], cameras: Sequence[str]) -> Point:
    return Point(
        seed=row["seed"],
        episode=row["episode"],
        step=row["step"],
        action=row["action"],
        time=row["time"],
        joints=np.array(row["joints"]),
        qpos=np.array(row["qpos"]),
        images={camera: from_jpeg(row[f"{IMAGE}{camera}"]["bytes"]) for camera in cameras},
        facts=Facts({Atom.parse(atom): value for atom, value in truth_of(row).items()}),
        surprises=tuple(map(Atom.parse, row["surprises"])),
        objects={each["name"]: tuple(each["attributes"]) for each in row.get("objects", ())},
    )


def _table(path: Path, names: Sequence[str] | None = None) -> pa.Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as opened, pq.ParquetFile(opened, page_checksum_verification=True) as file:
            return file.read(None if names is None else list(names))
    except FileNotFoundError:
        raise InputError("there is no such file", file=path) from None
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InputError(f"is damaged ({str(error).splitlines()[0].rstrip('.')})", file=path) from None


def _bytes(collection: str, log: Log, table: pa.Table) -> bytes:
    import pyarrow.parquet as pq

    said = {
        "format": FORMAT,
        "collection": collection,
        "episode": log.episode,
        "ending": log.ending,
        "attempts": log.attempts,
    }
    metadata = {**table.schema.metadata, _METADATA: json.dumps(said).encode()}
    buffer = io.BytesIO()
    # JPEG does not compress any further; checksums find a damaged page where the file as a whole still opens.
    pq.write_table(
        table.replace_schema_metadata(metadata), buffer, compression="NONE", write_page_checksum=True, version="2.6"
    )
    return buffer.getvalue()


def _schema(
    atoms: Sequence[Atom], cameras: Sequence[str], objects: bool, masks: bool, varying: bool, demonstrations: bool
) -> pa.Schema:
    """The columns, and in the key `huggingface` what they mean to the package `datasets`."""
    import pyarrow as pa

    picture = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    item = pa.struct([("name", pa.string()), ("attributes", pa.list_(pa.string()))])
    one_by_one = pa.list_(pa.struct([("atom", pa.string()), ("value", pa.bool_())]))
    schema = pa.schema(
        [
            ("seed", pa.int64()),
            ("episode", pa.int32()),
            ("step", pa.int32()),
            ("action", pa.string()),
            *((f"{IMAGE}{camera}", picture) for camera in cameras),
            *((f"{MASK}{camera}", picture) for camera in cameras if masks),
            *([("objects", pa.list_(item))] if objects else []),
            ("atoms", one_by_one if varying else pa.struct([(str(atom), pa.bool_()) for atom in atoms])),
            ("surprises", pa.list_(pa.string())),
            ("joints", pa.list_(pa.float64())),
            ("qpos", pa.list_(pa.float64())),
            ("time", pa.float64()),
            *(motions.schema() if demonstrations else []),
        ]
    )
    values = {"feature": _value("string"), "_type": "Sequence"}
    each = {"atom": _value("string"), "value": _value("bool")}
    features = {
        "seed": _value("int64"),
        "episode": _value("int32"),
        "step": _value("int32"),
        "action": _value("string"),
        **{f"{IMAGE}{camera}": {"_type": "Image"} for camera in cameras},
        **{f"{MASK}{camera}": {"_type": "Image"} for camera in cameras if masks},
        **({"objects": [{"name": _value("string"), "attributes": values}]} if objects else {}),
        "atoms": [each] if varying else {str(atom): _value("bool") for atom in atoms},
        "surprises": values,
        "joints": {"feature": _value("float64"), "_type": "Sequence"},
        "qpos": {"feature": _value("float64"), "_type": "Sequence"},
        "time": _value("float64"),
        **(motions.features() if demonstrations else {}),
    }
    return schema.with_metadata({b"huggingface": json.dumps({"info": {"features": features}}).encode()})


def _value(dtype: str) -> dict[str, str]:
    return {"dtype": dtype, "_type": "Value"}
