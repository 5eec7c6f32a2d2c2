"""How the robot and the objects moved: `frames.jsonl`, beside the events.

The first line of each process has the cameras and the names of the joints; every other one has a moment of the world's
clock in seconds, and of the frame at that moment what is not as it was in the line before: `joints` (rad), `command`
(what the servos were told: rad, and last how far the fingers shall close, 0 to 1), `fingers` (rad), `gripper` (m) and
the `poses` of the task's objects (m and quaternion w, x, y, z). What moves by less than `_STEP` is not written.

Nothing that decides reads this file, and no decision can be replayed from it; it is for exporting a run.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from executive.errors import InputError
from executive.trace.record.codec import decode, encode
from executive.trace.record.lines import whole_lines
from executive.types import Camera, Event, FloatArray, Frame, Scenery, Started
from executive.util.files import parse_json, reason

FRAMES_FILE = "frames.jsonl"
FORMAT = 1
_STEP = 2e-4
"""rad, m, or a share of a quaternion."""
_DIGITS = 5
_PARTS = ("joints", "command", "fingers")


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A frame, and when it was: `time` is the world's clock in seconds."""

    time: float
    frame: Frame


@dataclass(frozen=True, slots=True, eq=False)
class Movements:
    """All that is recorded of how things moved, in order of time."""

    moments: tuple[Moment, ...] = ()
    cameras: tuple[Camera, ...] = ()
    joint_names: tuple[str, ...] = ()


@dataclass(slots=True)
class _Last:
    parts: dict[str, FloatArray] = field(default_factory=dict)
    poses: dict[str, FloatArray] = field(default_factory=dict)
    gripper: float = -1.0


class FrameLog:
    """A sink that writes how things moved into a run's folder, which is there. Opened on a folder that has such a file
    already, it goes on at its end, after cutting off a half-written last line.

    Raises:
        InputError: the folder cannot be written to.
    """

    def __init__(self, run: Path | str) -> None:
        path = Path(run) / FRAMES_FILE
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            os.ftruncate(self._file, whole_lines(self._file))
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None
        self._objects: Collection[str] = ()
        self._last, self._closed = _Last(), False

    def recall(self, event: Event) -> None:
        """Learn the names of the objects, in a run that is resumed."""
        if isinstance(event.payload, Started):
            self._objects = event.payload.task.objects

    def write(self, event: Event) -> None:
        """Append what has changed, in one piece.

        Raises:
            OSError: the disk is full or gone.
        """
        payload = event.payload
        if isinstance(payload, Frame):
            if changed := self._changed(payload):
                self._append({"time": round(event.time, 6), **changed})
        elif isinstance(payload, Scenery):
            self._append({"v": FORMAT, "joint_names": payload.joints, "cameras": encode(payload.cameras)})
        else:
            self.recall(event)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            os.close(self._file)

    def _append(self, line: dict[str, Any]) -> None:
        os.write(self._file, (json.dumps(line, allow_nan=False, separators=(",", ":")) + "\n").encode())

    def _changed(self, frame: Frame) -> dict[str, Any]:
        changed: dict[str, Any] = {}
        for name in _PARTS:
            value = getattr(frame, name)
            if value is not None and _moved(self._last.parts.get(name), value):
                self._last.parts[name] = value
                changed[name] = value.round(_DIGITS).tolist()
        if abs(frame.gripper - self._last.gripper) > _STEP:
            self._last.gripper = frame.gripper
            changed["gripper"] = round(frame.gripper, _DIGITS)
        poses = {}
        for name in self._objects:
            if name in frame.poses and _moved(self._last.poses.get(name), frame.poses[name]):
                self._last.poses[name] = frame.poses[name]
                poses[name] = frame.poses[name].round(_DIGITS).tolist()
        return {**changed, **({"poses": poses} if poses else {})}


def _moved(before: FloatArray | None, now: FloatArray) -> bool:
    return before is None or before.shape != now.shape or bool(np.abs(now - before).max(initial=0.0) > _STEP)


def read_movements(run: Path | str) -> Movements:
    """Return how things moved in a run; nothing, where that was not recorded. Where the run was resumed, what the world
    was set back to takes the place of what came after that moment before.

    Raises:
        InputError: a line is none of this format; file and line are named.
    """
    path = Path(run) / FRAMES_FILE
    moments: list[Moment] = []
    cameras: tuple[Camera, ...] = ()
    names: tuple[str, ...] = ()
    frame = Frame({}, np.empty(0), 0.0)
    for number, line in _lines(path):
        try:
            if "v" in line:
                if line["v"] != FORMAT:
                    raise ValueError(f"format {line['v']!r}, and this Executive reads {FORMAT}")
                cameras = decode(tuple[Camera, ...], line.get("cameras"))
                names = decode(tuple[str, ...], line.get("joint_names"))
                continue
            time = decode(float, line.get("time"))
            frame = _next(frame, line)
        except ValueError as error:
            raise InputError(str(error), file=path, key=f"line {number}") from None
        while moments and moments[-1].time >= time:
            moments.pop()
        moments.append(Moment(time, frame))
    return Movements(tuple(moments), cameras, names)


def _lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    try:
        file = path.open("rb")
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"cannot be read ({reason(error)})", file=path) from None
    with file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                return
            try:
                found = parse_json(line)
            except ValueError:
                found = None
            if not isinstance(found, dict):
                raise InputError("not a JSON object", file=path, key=f"line {number}")
            yield number, found


def _next(before: Frame, line: dict[str, Any]) -> Frame:
    """The frame before, with what a line says has changed."""
    parts = {name: decode(FloatArray, line[name]) if name in line else getattr(before, name) for name in _PARTS}
    poses = line.get("poses", {})
    if not isinstance(poses, dict):
        raise ValueError("poses: expected an object")
    moved = {str(name): decode(FloatArray, pose) for name, pose in poses.items()}
    if wrong := [name for name, pose in moved.items() if pose.shape != (7,)]:
        raise ValueError(f"poses: {wrong[0]}: expected seven numbers")
    gripper = decode(float, line["gripper"]) if "gripper" in line else before.gripper
    return Frame({**before.poses, **moved}, gripper=gripper, **parts)
