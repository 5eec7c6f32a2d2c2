"""The durable record of a run: `events.jsonl`, one line an event, and the pictures beside it.

A line is `{"v": 1, "type": "Belief", "cycle": 3, "time": 12.3, "wall": 4.5, "data": {...}}`: format version, payload
type, the event's stamps, the payload's fields. A line is written in one piece and handed to the operating system
before the next event is looked at, so that killing the process (even with SIGKILL) loses no event that was reported;
lines that a decision hangs on also survive a power cut. A last line without its newline was cut off by a kill and is
not part of the record.

A decision and the end have their reasons as codes with parameters (`causes`) and in words (`reason`). Records from
before there were codes have the words alone, and are read with the code `recorded`; so is one with a code of a later
release.

What is for display alone (`Scenery`, `Frame`, `PointCloud`) is not recorded here, and of a motion at most
`MOTION_POINTS` points.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

import numpy as np

from executive.errors import InputError, nearest
from executive.trace import phrases
from executive.trace.record.codec import RECORDED, JsonValue, decode, encode
from executive.trace.record.lines import whole_lines
from executive.trace.record.pictures import depth_to_png, jpegs, read_depth, read_picture
from executive.types import (
    Decision,
    DepthImage,
    Ended,
    Event,
    Image,
    Motion,
    Observation,
    OutcomeKind,
    Reason,
    Resumed,
    Started,
)
from executive.util.files import legible, parse_json, reason

FORMAT = 1
EVENTS_FILE = "events.jsonl"
IMAGES_FOLDER = "images"
DEPTH_FOLDER = "depth"
MOTION_POINTS = 64
_ROOM, _LAST_EVENTS = ".room", 1 << 18
"""The file that keeps room, and its bytes."""
_DECISIVE = (Started, Resumed, Decision, Ended)
Picture = TypeVar("Picture", Image, DepthImage)
_CODES = frozenset(Reason)
_AGES = 1e9
"""Seconds: thirty years."""
_STAMPS = {"cycle": int, "time": float, "wall": float}


class EventLog:
    """A sink that writes a run's events into its folder, which it makes when it is missing.

    Opened on a folder that has a record already, it goes on at its end, after cutting off a half-written last line. A
    record has one writer at a time. Room is kept for the last events of a run whose disk is full: they are recorded
    without their pictures.

    Args:
        failed: is told, once, why events can no longer be recorded as they should be.

    Raises:
        InputError: the folder cannot be written to, or another process writes this record.
    """

    def __init__(self, run: Path | str, failed: Callable[[str], None] | None = None) -> None:
        self._run, self._failed, self._complained = Path(run), failed, False
        path = self._run / EVENTS_FILE
        try:
            (self._run / IMAGES_FOLDER).mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # gone with the process, however that ends
        except BlockingIOError:
            os.close(self._file)
            raise InputError("another process is at work on this run", file=self._run) from None
        self._size = whole_lines(self._file)
        os.ftruncate(self._file, self._size)
        self._closed = False
        try:
            self._keep_room()
        except OSError as error:
            self.close()
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None

    def write(self, event: Event) -> None:
        """Append one event; a picture is on disk before the line that names it.

        Raises:
            OSError: the disk is full or gone; what was recorded before stays readable.
        """
        if type(event.payload).__name__ not in RECORDED:
            return
        try:
            self._record(event)
        except OSError as error:
            if not self._complained and self._failed is not None:
                self._failed(f"the record cannot be written: {error.strerror or error}")
            self._complained = True
            (self._run / _ROOM).unlink(missing_ok=True)
            self._record(event)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            with contextlib.suppress(OSError):
                (self._run / _ROOM).unlink(missing_ok=True)
            os.close(self._file)

    def _record(self, event: Event) -> None:
        payload = event.payload
        if isinstance(payload, Motion):
            data = encode(_thinned(payload))
        elif isinstance(payload, Observation):
            data = self._without_pictures(payload)
        else:
            data = encode(payload)
        if isinstance(payload, Decision | Ended):
            data["reason"] = legible(phrases.why(payload))  # for who reads the file; a reader goes by the causes
        stamps = {stamp: encode(getattr(event, stamp)) for stamp in _STAMPS}
        record = {"v": FORMAT, "type": type(payload).__name__, **stamps, "data": data}
        self._append(json.dumps(record, allow_nan=False) + "\n")
        if isinstance(payload, _DECISIVE):
            os.fdatasync(self._file)

    def _without_pictures(self, look: Observation) -> dict[str, JsonValue]:
        """An observation with the names of the files, which are written, in place of its pictures."""
        pictures = {} if self._complained else jpegs(look)
        depth = {} if self._complained else look.depth
        data: dict[str, JsonValue] = encode(replace(look, images={}, depth={}))
        data["images"] = {
            camera: self._save(picture_name(look.id, camera), picture) for camera, picture in pictures.items()
        }
        data["depth"] = {
            camera: self._save(depth_name(look.id, camera), depth_to_png(image)) for camera, image in depth.items()
        }
        if not data["depth"]:
            del data["depth"]  # most runs measure none
        return data

    def _keep_room(self) -> None:
        """Take up what the last events need, to have it when nothing else is left."""
        file = os.open(self._run / _ROOM, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(file, 0, _LAST_EVENTS)
        finally:
            os.close(file)

    def _append(self, line: str) -> None:
        data = line.encode()
        try:
            written = os.write(self._file, data)
            while written < len(data):  # there is no room for more, and only the next try says why
                more = os.write(self._file, data[written:])
                if not more:
                    raise OSError(errno.ENOSPC, f"only {written} of {len(data)} bytes of an event could be written")
                written += more
        except OSError:
            os.ftruncate(self._file, self._size)  # half a line would make the next one unreadable, too
            raise
        self._size += len(data)

    def _save(self, name: str, data: bytes) -> str:
        file = self._run / name
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(data)
        return name


def picture_name(observation: int, camera: str) -> str:
    """Return where in a run's folder a camera's picture of an observation lies."""
    return f"{IMAGES_FOLDER}/{observation:04d}-{quote(camera, safe='')}.jpg"


def depth_name(observation: int, camera: str) -> str:
    """Return where in a run's folder a camera's depth picture of an observation lies."""
    return f"{DEPTH_FOLDER}/{observation:04d}-{quote(camera, safe='')}.png"


def read_events(run: Path | str, images: bool = True) -> Iterator[Event]:
    """Yield the events of a run, in the order in which they happened.

    Args:
        run: a run's folder, or its `events.jsonl`.
        images: also read the pictures of each look; without them, an observation has none.

    Raises:
        InputError: no such file, or a line that is not an event of this format; file and line are named.
    """
    path = Path(run)
    path = path / EVENTS_FILE if os.path.isdir(path) else path
    try:
        file = path.open("rb")
    except (OSError, ValueError) as error:
        raise InputError(f"no record of a run ({reason(error)})", file=path) from None
    is_blind = False
    with file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                return
            try:
                event = _event(line, path.parent, images)
            except ValueError as error:
                raise InputError(str(error), file=path, key=f"line {number}") from None
            if isinstance(event.payload, Started):
                is_blind = event.payload.is_blind
            yield _renamed(event) if is_blind else event


def _event(line: bytes, folder: Path, images: bool) -> Event:
    record = _record(line)
    kind = RECORDED.get(str(record.get("type")))
    if kind is None:
        raise ValueError(f"unknown event type {record.get('type')!r}; {nearest(str(record.get('type')), RECORDED)}")
    data = record.get("data")
    pictures: Mapping[str, Image] = {}
    depth: Mapping[str, DepthImage] = {}
    if kind is Observation and isinstance(data, dict):
        if images:
            pictures = _pictures("images", data.get("images", {}), IMAGES_FOLDER, folder, read_picture)
            depth = _pictures("depth", data.get("depth", {}), DEPTH_FOLDER, folder, read_depth)
        data = {**data, "images": {}, "depth": {}}
    if kind in (Decision, Ended) and isinstance(data, dict) and not _has_codes(data.get("causes")):
        data = {**data, "causes": _in_words(data)}
    payload = decode(kind, data)
    if pictures or depth:
        payload = replace(payload, images=pictures, depth=depth)
    cycle, time, wall = (decode(hint, record.get(stamp)) for stamp, hint in _STAMPS.items())
    if not (abs(time) < _AGES and abs(wall) < _AGES):
        raise ValueError(f"no run has events at {time} s, or after {wall} s")
    return Event(cycle, time, wall, payload)


def _renamed(event: Event) -> Event:
    """Return an event of a run in which nobody looked. In records made before `plan-completed` had its name, such a run
    ended as if the goal had been seen."""
    payload = event.payload
    if isinstance(payload, Decision | Ended) and payload.outcome is OutcomeKind.GOAL_REACHED:
        return replace(event, payload=replace(payload, outcome=OutcomeKind.PLAN_COMPLETED))
    return event


def _has_codes(causes: JsonValue) -> bool:
    """Return whether causes are recorded, with codes that are known: a later release may have more."""
    if not isinstance(causes, list):
        return causes is not None
    codes = (each.get("code") for each in causes if isinstance(each, dict))
    return all(isinstance(code, str) and code in _CODES for code in codes)


def _in_words(data: Mapping[str, JsonValue]) -> JsonValue:
    """The causes where there are no codes."""
    try:
        return [{"code": Reason.RECORDED.value, "detail": decode(str, data.get("reason"))}]
    except ValueError as error:
        raise ValueError(f"reason: {error}") from None


def _record(line: bytes) -> dict[str, Any]:
    try:
        record = parse_json(line)
    except ValueError:
        raise ValueError("not a JSON object; is this a record of a run?") from None
    version = record.get("v") if isinstance(record, dict) else None
    if not isinstance(version, int) or isinstance(version, bool):
        raise ValueError("no format version; is this a record of a run?")
    if version > FORMAT:
        raise ValueError(f"written by a newer Executive (format {version}, this one reads {FORMAT}): update it")
    if version < 1:
        raise ValueError(f"there is no format {version}")
    return dict(record)


def _pictures(
    field: str, stored: JsonValue, pictures: str, folder: Path, read: Callable[[Path], Picture]
) -> dict[str, Picture]:
    if not isinstance(stored, dict):
        raise ValueError(f"{field}: expected an object")
    found = {}
    for camera, name in stored.items():
        # A record comes from anywhere; it may name pictures in its own folder and no other file.
        if not isinstance(name, str) or not name.startswith(f"{pictures}/") or name.count("/") != 1:
            raise ValueError(f"{field}: {camera}: {str(name)[:60]!r} is not a file in {pictures}/")
        found[camera] = read(folder / name)
    return found


def _thinned(motion: Motion) -> Motion:
    """At most `MOTION_POINTS` of a motion's points, the first and the last among them, to 0.1 mrad and 0.1 mm."""
    count = len(motion.configurations)
    kept = np.unique(np.linspace(0, count - 1, min(count, MOTION_POINTS)).round().astype(int))
    path = motion.end_effector
    return replace(
        motion,
        configurations=motion.configurations[kept].round(4),
        end_effector=(path[kept] if len(path) == count else path[:MOTION_POINTS]).round(4),
    )
