"""A run as an MCAP file with ROS 2 messages, for Foxglove, Rerun, ROS 2 and whatever else reads robot logs."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from executive.errors import InputError
from executive.export import ros_messages as ros
from executive.trace import phrases
from executive.trace.record.codec import encode
from executive.trace.record.recording import Recording
from executive.types import (
    Blinded,
    Camera,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    NoPlan,
    Observation,
    PosesEstimated,
    SkillResult,
)
from executive.util.extras import needed
from executive.util.files import check_writable, read_bytes, reason

EXTRA = "mcap"
EVENTS_TOPIC, EVENT_SCHEMA = "/executive/events", "executive.Event"
_LARGEST_PICTURE = 200_000_000

SCHEMA: Mapping[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": EVENT_SCHEMA,
    "description": "An event of a run: a line of events.jsonl, and the same in words where there are some.",
    "type": "object",
    "required": ["type", "cycle", "time", "wall", "data"],
    "properties": {
        "type": {"type": "string", "description": "the payload's type, such as Decision"},
        "cycle": {"type": "integer", "description": "the turn of the loop"},
        "time": {"type": "number", "description": "the world's clock in s"},
        "wall": {"type": "number", "description": "wall seconds since the run began"},
        "text": {"type": "string", "description": "the event in words"},
        "data": {"type": "object", "description": "the payload's fields"},
    },
}
"""The JSON schema of our events."""

Add = Callable[[str, str, ros.Message, int], None]


def export_mcap(run: Path | str, out: Path | str) -> Path:
    """Write a run as an MCAP file, whole or not at all, and return its path.

    Topics: `/camera/NAME/image/compressed`, `/camera/NAME/depth/compressed` and `/camera/NAME/camera_info`,
    `/joint_states` and `/joint_commands`, `/tf` (objects: as they were under their names, as they were estimated under
    `estimated/NAME`) and `/tf_static` (cameras, `NAME_optical_frame`), `/diagnostics` (what skills reported and what
    was decided), `/executive/events`. Times are the world's clock; a run begins at 0.

    Raises:
        InputError: the run has no record, or the file cannot be written.
        MissingError: the extra `mcap` is not installed.
    """
    writer = needed("mcap_ros2.writer", EXTRA, "to write MCAP")
    file, recording = Path(out), Recording(Path(run))
    if file.is_dir():
        raise InputError("is a folder; a file is to be written", file=file)
    if not file.parent.is_dir():
        raise InputError("there is no such folder", file=file.parent)
    check_writable(file.parent, "out")
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with draft.open("wb") as stream:
            _write(writer, stream, recording)
        draft.replace(file)
    except OSError as error:
        raise InputError(f"cannot be written ({reason(error)})", file=file) from None
    finally:
        draft.unlink(missing_ok=True)
    return file


def _write(writer: Any, stream: IO[bytes], recording: Recording) -> None:
    mcap = needed("mcap.writer", EXTRA, "to write MCAP")
    with writer.Writer(stream) as messages:
        raw: Any = messages._writer  # ROS and JSON share a file, which the ROS writer alone does not offer
        assert isinstance(raw, mcap.Writer)
        schema = raw.register_schema(EVENT_SCHEMA, "jsonschema", json.dumps(SCHEMA).encode())
        channel = raw.register_channel(EVENTS_TOPIC, "json", schema)
        kinds = {kind: messages.register_msgdef(kind, text) for kind, text in ros.DEFINITIONS.items()}
        for nanoseconds, topic, content in sorted(_messages(recording), key=lambda each: each[0]):
            if topic == EVENTS_TOPIC:
                data = json.dumps(content, allow_nan=False).encode()
                raw.add_message(channel, nanoseconds, data, nanoseconds)
            else:
                kind, message = content
                messages.write_message(topic, kinds[kind], message() if callable(message) else message, nanoseconds)
        started = recording.started
        told = {"run": started.run, "domain": started.domain, "problem": started.task.problem}
        messages.add_metadata("executive", {**told, "seed": str(started.seed), "estimator": started.estimator})


def _messages(recording: Recording) -> Iterator[tuple[int, str, Any]]:
    """Yield time in ns, topic and content of every message: JSON for events, type and message for the others. Pictures
    are read when they are written."""
    names, cameras = recording.movements.joint_names, {each.name: each for each in recording.movements.cameras}
    if cameras:
        where = [ros.transform(0, f"{name}_optical_frame", _optical(camera)) for name, camera in cameras.items()]
        yield 0, "/tf_static", (ros.TRANSFORMS, {"transforms": where})
    before: Any = None
    for moment in recording.movements.moments:
        at, frame = _ns(moment.time), moment.frame
        yield at, "/joint_states", (ros.JOINTS, ros.joint_state(at, *_joints(names, frame.joints, frame.gripper)))
        if frame.command is not None:
            *arm, closed = frame.command
            yield at, "/joint_commands", (ros.JOINTS, ros.joint_state(at, *_joints(names, arm, closed)))
        if moved := [name for name, pose in frame.poses.items() if before is None or pose is not before.get(name)]:
            there = [ros.transform(at, name, frame.poses[name]) for name in moved]
            yield at, "/tf", (ros.TRANSFORMS, {"transforms": there})
        before = frame.poses
    for event in recording.events:
        yield _ns(event.time), EVENTS_TOPIC, _event(event)
        yield from _of_event(event, recording, cameras)


def _of_event(event: Event, recording: Recording, cameras: Mapping[str, Camera]) -> Iterator[tuple[int, str, Any]]:
    at, payload = _ns(event.time), event.payload
    if isinstance(payload, Observation):
        at = _ns(payload.time)
        for camera, path in recording.pictures(payload.id):
            yield at, f"/camera/{camera}/image/compressed", (ros.IMAGE, _picture(at, camera, "jpeg", path))
            if camera in cameras:
                yield at, f"/camera/{camera}/camera_info", (ros.CAMERA, _calibration(at, cameras[camera]))
        for camera, path in recording.depth_pictures(payload.id):
            yield at, f"/camera/{camera}/depth/compressed", (ros.IMAGE, _picture(at, camera, "16UC1; png", path))
        if not recording.movements.moments:
            yield at, "/joint_states", (ros.JOINTS, ros.joint_state(at, *_joints((), payload.joints, None)))
    elif isinstance(payload, PosesEstimated):
        there = [ros.transform(at, f"estimated/{name}", each.pose) for name, each in payload.poses.items()]
        yield at, "/tf", (ros.TRANSFORMS, {"transforms": there})
    elif (status := _status(event)) is not None:
        yield at, "/diagnostics", (ros.DIAGNOSTICS, {"header": ros.header(at), "status": [status]})


def _ns(seconds: float) -> int:
    return max(0, round(1e9 * seconds))


def _event(event: Event) -> dict[str, Any]:
    payload = event.payload
    told = {"text": phrases.event(payload)} if type(payload) in phrases.EVENTS else {}
    stamps = {"cycle": event.cycle, "time": event.time, "wall": event.wall}
    return {"type": type(payload).__name__, **stamps, **told, "data": encode(payload)}


def _joints(names: tuple[str, ...], arm: Any, fingers: float | None) -> tuple[list[str], list[float]]:
    """Names and positions of the joints; last the fingers, where there are some."""
    known = [*names] if len(names) == len(arm) else [f"joint_{number}" for number in range(1, len(arm) + 1)]
    return (known, [*arm]) if fingers is None else ([*known, "gripper"], [*arm, fingers])


def _picture(at: int, camera: str, encoding: str, path: Path) -> Callable[[], ros.Message]:
    head = ros.header(at, f"{camera}_optical_frame")
    return lambda: {"header": head, "format": encoding, "data": read_bytes(path, largest=_LARGEST_PICTURE)}


def _optical(camera: Camera) -> tuple[float, ...]:
    """The camera's pose (7,) as ROS has it: looking along +z, with y down; half a turn about its own x axis."""
    x, y, z, w, i, j, k = camera.pose
    return x, y, z, -i, w, k, -j


def _calibration(at: int, camera: Camera) -> ros.Message:
    """A pinhole without distortion, its principal point in the middle of the picture."""
    focal = camera.height / 2 / math.tan(camera.fovy / 2)
    middle = camera.width / 2, camera.height / 2
    return {
        "header": ros.header(at, f"{camera.name}_optical_frame"),
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [focal, 0.0, middle[0], 0.0, 0.0, focal, middle[1], 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def _status(event: Event) -> ros.Message | None:
    """What a diagnostic tool is told of an event; most are none of its business."""
    payload, at = event.payload, {"cycle": str(event.cycle)}
    match payload:
        case Decision():
            calm = payload.kind is DecisionKind.CONTINUE or (
                payload.outcome is not None and payload.outcome.claims_goal
            )
            worst = ros.ERROR if payload.kind in (DecisionKind.STOP, DecisionKind.GIVE_UP_GOAL) else ros.WARN
            codes = {"kind": payload.kind.value, "codes": ", ".join(payload.codes)}
            return ros.status(ros.OK if calm else worst, "executive: decision", phrases.event(payload), {**at, **codes})
        case SkillResult():
            told = {**at, "step": str(payload.step), "status": payload.status.value}
            level = ros.OK if payload.done else ros.WARN
            return ros.status(level, "executive: skill", phrases.event(payload), told)
        case Ended():
            level = ros.OK if payload.outcome.claims_goal else ros.ERROR
            told = {**at, "outcome": payload.outcome.value, "goal_seen": str(payload.goal_seen).lower()}
            return ros.status(level, "executive: run", phrases.event(payload), told)
        case Dispatched():
            return ros.status(ros.OK, "executive: skill", phrases.event(payload), {**at, "step": str(payload.step)})
        case Blinded() | FaultInjected() | NoPlan():
            name = {Blinded: "cameras", FaultInjected: "faults", NoPlan: "planner"}[type(payload)]
            return ros.status(ros.WARN, f"executive: {name}", phrases.event(payload), at)
    return None
