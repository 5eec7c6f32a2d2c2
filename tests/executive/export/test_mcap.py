"""A run as MCAP, read by the format's own reader: what was recorded, at the times of the world's clock."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.errors import InputError
from executive.export import export_mcap
from executive.trace.record.frames import FRAMES_FILE, FrameLog
from executive.trace.record.log import EventLog, read_events
from executive.types import (
    Decision,
    Ended,
    Event,
    FloatArray,
    Frame,
    Observation,
    Resumed,
    Scenery,
    SkillResult,
    Timing,
)
from tests.conftest import ROOT
from tests.executive.trace.synthetic import synthetic_events

EXAMPLE = ROOT / "runs" / "example"


def messages(file: Path, *topics: str) -> Iterator[tuple[str, int, Any]]:
    """The topic, the time in ns and the content of each message, as MCAP's own reader and ROS 2's decoder have them."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages(topics or None):
            assert schema is not None
            if channel.message_encoding == "json":
                assert schema.encoding == "jsonschema"
                yield channel.topic, message.log_time, json.loads(message.data)
            else:
                decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
                assert decode is not None
                yield channel.topic, message.log_time, decode(message.data)


def recorded(run: Path, events: list[Event]) -> Path:
    """A run's folder with these events, and the movements among them."""
    logs = EventLog(run), FrameLog(run)
    for event in events:
        for log in logs:
            log.write(event)
    for log in logs:
        log.close()
    return run


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("run"), list(synthetic_events()))


def test_events_and_pictures_of_a_recorded_run(tmp_path: Path) -> None:
    file = export_mcap(EXAMPLE, tmp_path / "run.mcap")
    events = list(read_events(EXAMPLE, images=False))
    told = [(at, content) for _, at, content in messages(file, "/executive/events")]
    assert [(content["type"], content["cycle"], content["time"]) for _, content in told] == [
        (type(event.payload).__name__, event.cycle, event.time) for event in events
    ]
    assert all(at == round(1e9 * content["time"]) for at, content in told)
    looks = {event.payload.id: event.payload.time for event in events if isinstance(event.payload, Observation)}
    files = {path: path.read_bytes() for path in (EXAMPLE / "images").iterdir()}
    shown = [each for each in messages(file) if each[0].endswith("image/compressed")]
    assert sorted(bytes(content.data) for _, _, content in shown) == sorted(files.values())
    for topic, at, content in shown:
        camera = topic.split("/")[2]
        (number,) = [
            int(path.name[:4])
            for path, data in files.items()
            if data == bytes(content.data) and path.stem[5:] == camera and round(1e9 * looks[int(path.name[:4])]) == at
        ]
        stamp = content.header.stamp
        assert (stamp.sec * 10**9 + stamp.nanosec, content.format) == (at, "jpeg")
        assert content.header.frame_id == f"{camera}_optical_frame"
        assert number in looks


def test_decisions_skills_and_the_end_are_diagnostics(tmp_path: Path) -> None:
    file = export_mcap(EXAMPLE, tmp_path / "run.mcap")
    levels = {(status.name, status.level) for _, _, array in messages(file, "/diagnostics") for status in array.status}
    assert {("executive: decision", 0), ("executive: run", 0), ("executive: skill", 0)} <= levels
    events = [event.payload for event in read_events(EXAMPLE, images=False)]
    for kind, name in ((Decision, "decision"), (Ended, "run")):
        found = [s for _, _, array in messages(file, "/diagnostics") for s in array.status if s.name.endswith(name)]
        assert len(found) == sum(isinstance(payload, kind) for payload in events)
    failed = [payload for payload in events if isinstance(payload, SkillResult) and not payload.done]
    warned = [s for _, _, a in messages(file, "/diagnostics") for s in a.status if s.name.endswith("skill") and s.level]
    assert len(warned) == len(failed)


def test_joints_objects_and_cameras_are_where_they_were(synthetic: Path, tmp_path: Path) -> None:
    file = export_mcap(synthetic, tmp_path / "run.mcap")
    events = list(synthetic_events())
    frames = {1000 * round(1e6 * event.time): event.payload for event in events if isinstance(event.payload, Frame)}
    states = {at: state for _, at, state in messages(file, "/joint_states")}
    assert states
    for at, state in states.items():
        assert [*state.position][:-1] == pytest.approx(frames[at].joints, abs=2.1e-4)
        assert state.name[-1] == "gripper"
        assert state.position[-1] == pytest.approx(frames[at].gripper, abs=2.1e-4)
    for _, at, moved in messages(file, "/tf"):
        for each in moved.transforms:
            there, pose = each.transform, frames[at].poses[each.child_frame_id]
            assert [there.translation.x, there.translation.y, there.translation.z] == pytest.approx(pose[:3], abs=1e-4)
            assert [there.rotation.w, there.rotation.x] == pytest.approx(pose[3:5], abs=1e-4)
            assert each.header.frame_id == "world"
    scenery = next(event.payload for event in events if isinstance(event.payload, Scenery))
    ((_, _, static),) = messages(file, "/tf_static")
    assert len(static.transforms) == len(scenery.cameras) > 0
    for camera, each in zip(scenery.cameras, static.transforms, strict=True):
        ours, theirs = camera.pose[3:], each.transform.rotation
        # Ours looks along -z with y up; a ROS camera along +z with y down.
        their_axes = rotation(theirs.w, theirs.x, theirs.y, theirs.z)
        assert their_axes == pytest.approx(rotation(*ours) @ np.diag([1.0, -1.0, -1.0]), abs=1e-9)


def rotation(w: float, x: float, y: float, z: float) -> FloatArray:
    scaled = np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z])
    s, v = scaled[0], scaled[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) + 2 * s * cross + 2 * cross @ cross)


def test_what_a_world_that_was_set_back_saw_is_left_out(tmp_path: Path) -> None:
    first = next(event for event in synthetic_events())
    kept, gone, later = (
        Event(1, time, 0.0, Timing(stage, 0.1)) for time, stage in ((1.0, "a"), (3.0, "b"), (4.0, "c"))
    )
    back = Event(1, 2.0, 0.0, Resumed(0, 1, 0, 0, 0))
    run = recorded(tmp_path / "run", [first, kept, gone, back, later])
    told = [content for _, _, content in messages(export_mcap(run, tmp_path / "o.mcap"), "/executive/events")]
    assert [each["data"].get("stage") for each in told[1:]] == ["a", None, "c"]


def test_a_file_is_there_whole_or_not_at_all(synthetic: Path, tmp_path: Path) -> None:
    broken = shutil.copytree(synthetic, tmp_path / "run")
    with (broken / FRAMES_FILE).open("a") as file:
        file.write("[]\n")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=FRAMES_FILE):
        export_mcap(broken, tmp_path / "out" / "run.mcap")
    assert list((tmp_path / "out").iterdir()) == []
    for wrong in (tmp_path / "out", tmp_path / "none" / "run.mcap"):
        with pytest.raises(InputError):
            export_mcap(synthetic, wrong)
    with pytest.raises(InputError):
        export_mcap(tmp_path / "out", tmp_path / "run.mcap")
