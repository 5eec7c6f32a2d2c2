"""The durable record: what is written is read back; nothing that was reported is lost; nothing foreign is believed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.errors import InputError
from executive.trace.phrases import why
from executive.trace.record.log import EVENTS_FILE, MOTION_POINTS, EventLog, read_events
from executive.trace.record.pictures import to_jpeg
from executive.types import (
    Cause,
    Decision,
    DecisionKind,
    Ended,
    Event,
    Frame,
    Motion,
    Observation,
    OutcomeKind,
    Phase,
    Reason,
    Scenery,
    Timing,
)
from tests.executive.trace.strategies import RECORDED, events, same
from tests.executive.trace.synthetic import synthetic_events


@contextmanager
def folder() -> Iterator[Path]:
    """A fresh folder per hypothesis example, which a fixture would not be."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def record(path: Path, some: list[Event]) -> Path:
    log = EventLog(path)
    for event in some:
        log.write(event)
    log.close()
    return path / EVENTS_FILE


@pytest.mark.parametrize("kind", RECORDED, ids=lambda kind: kind.__name__)
@settings(max_examples=40)
@given(data=st.data())
def test_what_is_written_is_read_back(kind: type, data: st.DataObject) -> None:
    payload = data.draw(RECORDED[kind])
    event = Event(3, 1.5, 0.1 + 0.2, payload)
    with folder() as run:
        record(run, [event])
        (back,) = read_events(run)
    assert same(back, event)


@given(st.lists(events, max_size=8))
def test_order_is_kept(some: list[Event]) -> None:
    with folder() as run:
        record(run, some)
        back = list(read_events(run))
    assert len(back) == len(some)
    assert all(same(a, b) for a, b in zip(back, some, strict=True))


def test_a_whole_run_comes_back(tmp_path: Path) -> None:
    written = synthetic_events()
    record(tmp_path, written)
    back = list(read_events(tmp_path))
    assert [type(event.payload) for event in back] == [
        type(event.payload) for event in written if not isinstance(event.payload, Scenery | Frame)
    ]
    looks = [event.payload for event in back if isinstance(event.payload, Observation)]
    pictures = [event.payload for event in written if isinstance(event.payload, Observation)]
    for look, picture in zip(looks, pictures, strict=True):
        for camera, image in picture.images.items():
            assert np.abs(look.images[camera].astype(float) - image).mean() < 4, "a JPEG of quality 90 is close"


def test_depth_is_kept_to_the_millimetre_in_files_of_its_own(tmp_path: Path) -> None:
    depth = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) * np.uint16(85)
    images = {"front": np.zeros((24, 32, 3), np.uint8)}
    with_depth = Observation(0, 0.0, images, np.zeros(6), depth={"front": depth})
    record(tmp_path, [Event(0, 0.0, 0.0, with_depth), Event(0, 0.0, 0.0, Observation(1, 0.0, images, np.zeros(6)))])
    assert [file.name for file in (tmp_path / "depth").iterdir()] == ["0000-front.png"]
    first, second = (event.payload for event in read_events(tmp_path))
    assert isinstance(first, Observation)
    assert isinstance(second, Observation)
    assert np.array_equal(first.depth["front"], depth)
    assert not second.depth
    plain = json.loads((tmp_path / EVENTS_FILE).read_text().splitlines()[1])
    assert "depth" not in plain["data"], "a record without depth is what it was before there was any"
    (tmp_path / "depth" / "0000-front.png").write_bytes(to_jpeg(images["front"]))
    with pytest.raises(InputError, match=r"0000-front\.png: not a readable picture \(not a PNG\)"):
        list(read_events(tmp_path))


@pytest.mark.parametrize("name", ["../secret", "images/0000-front.png", "depth/../x", 3])
def test_depth_is_read_from_its_folder_alone(tmp_path: Path, name: object) -> None:
    data = {"id": 0, "time": 0, "images": {}, "depth": {"front": name}, "joints": []}
    (tmp_path / EVENTS_FILE).write_text(line(type="Observation", data=data) + "\n")
    with pytest.raises(InputError, match=r"depth: front: .* is not a file in depth/"):
        list(read_events(tmp_path))


def test_without_pictures_none_is_opened(tmp_path: Path) -> None:
    record(tmp_path, synthetic_events())
    for picture in (tmp_path / "images").iterdir():
        picture.unlink()
    assert all(not e.payload.images for e in read_events(tmp_path, images=False) if isinstance(e.payload, Observation))
    with pytest.raises(InputError, match=r"0000-overview\.jpg"):
        list(read_events(tmp_path))


def test_a_long_motion_keeps_its_ends_and_its_shape(tmp_path: Path) -> None:
    path = np.cumsum(np.ones((1000, 6)), axis=0)
    record(tmp_path, [Event(0, 0.0, 0.0, Motion(path, path[:, :3], 4.0, "RRT*", 0.1))])
    (event,) = read_events(tmp_path)
    motion = event.payload
    assert isinstance(motion, Motion)
    assert motion.configurations.shape == (MOTION_POINTS, 6)
    assert motion.end_effector.shape == (MOTION_POINTS, 3)
    assert np.array_equal(motion.configurations[[0, -1]], path[[0, -1]])


@given(some=st.lists(events, min_size=1, max_size=4), data=st.data())
def test_a_record_cut_anywhere_is_read_up_to_its_last_whole_line(some: list[Event], data: st.DataObject) -> None:
    with folder() as run:
        path = record(run, some)
        whole = path.read_bytes()
        kept = data.draw(st.integers(0, len(whole)))
        path.write_bytes(whole[:kept])
        back = list(read_events(run))
        assert len(back) == whole[:kept].count(b"\n")
        assert all(same(a, b) for a, b in zip(back, some, strict=False))

        more = Event(9, 9.0, 9.0, Phase("resumed"))
        record(run, [more])
        assert [type(e.payload) for e in read_events(run)] == [type(e.payload) for e in (*back, more)]


def test_killed_in_the_middle_no_reported_event_is_lost(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from executive.trace.record.log import EventLog\n"
        "from executive.types import Event, Phase\n"
        "log = EventLog(sys.argv[1])\n"
        "for count in range(1000):\n"
        "    log.write(Event(count, 0.0, 0.0, Phase('x' * count)))\n"
        "    print(count, flush=True)\n"
        "    if count == 300:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    run = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=False)
    assert run.returncode == -signal.SIGKILL
    reported = len(run.stdout.splitlines())
    assert [event.cycle for event in read_events(tmp_path)] == list(range(reported))


def test_a_disk_that_fills_up_leaves_whole_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = EventLog(tmp_path)
    log.write(Event(1, 0.0, 0.0, Phase("before")))
    real = os.write
    monkeypatch.setattr(os, "write", lambda file, data: real(file, data[: len(data) // 2]))
    with pytest.raises(OSError, match="bytes of an event"):
        log.write(Event(2, 0.0, 0.0, Phase("while the disk is full")))
    monkeypatch.setattr(os, "write", real)
    log.write(Event(3, 0.0, 0.0, Phase("after")))
    log.close()
    assert [event.cycle for event in read_events(tmp_path)] == [1, 3]


def test_a_decision_is_recorded_in_codes_for_programs_and_in_words_for_people(tmp_path: Path) -> None:
    causes = (Cause(Reason.BUDGET_SPENT, what="looks", total=3), Cause(Reason.RECORDED, detail="\ud800"))
    decision = Decision(DecisionKind.STOP, causes, outcome=OutcomeKind.GAVE_UP)
    log = EventLog(tmp_path)
    log.write(Event(1, 0.0, 0.0, decision))
    log.close()
    data = json.loads((tmp_path / EVENTS_FILE).read_text())["data"]
    assert data["causes"][0] == {"code": "budget-spent", "what": "looks", "total": 3}
    assert data["reason"] == why(decision).replace("\ud800", "?")
    (read,) = read_events(tmp_path)
    assert isinstance(read.payload, Decision)
    assert read.payload.causes[0] == causes[0]


@pytest.mark.parametrize("kind", [Decision, Ended])
@pytest.mark.parametrize("causes", [{}, {"causes": [{"code": "goal-seen"}, {"code": "of-a-later-release", "mood": 3}]}])
def test_a_record_without_codes_that_are_known_keeps_its_words(
    tmp_path: Path, kind: type, causes: dict[str, object]
) -> None:
    words = "nothing is left to do, but cannot tell at(a,p)"
    rest = {"goal_seen": False, "unreached": [], "cycles": 1, "actions": 1, "replans": 0, "looks": 3}
    data = {"kind": "stop", "outcome": "gave-up", "reason": words, **causes, **rest}
    (tmp_path / EVENTS_FILE).write_text(line(type=kind.__name__, data=data) + "\n")
    (read,) = read_events(tmp_path)
    assert isinstance(read.payload, Decision | Ended)
    assert (read.payload.codes, why(read.payload)) == ((Reason.RECORDED,), words)


def line(**changes: object) -> str:
    base = {"v": 1, "type": "Phase", "cycle": 1, "time": 0.5, "wall": 0.5, "data": {"name": "grip"}}
    return json.dumps({key: value for key, value in {**base, **changes}.items() if value is not ...})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hello", "line 2: not a JSON object"),
        ("[1, 2]", "line 2: no format version"),
        (line(v=...), "line 2: no format version"),
        (line(v=2), r"line 2: written by a newer Executive \(format 2, this one reads 1\)"),
        (line(v=0), "line 2: there is no format 0"),
        (line(type="Phrase"), "line 2: unknown event type 'Phrase'; did you mean 'Phase'"),
        (line(type="Frame"), "line 2: unknown event type 'Frame'"),
        (line(cycle="one"), "line 2: should be a valid integer, got 'one'"),
        (line(cycle=...), "line 2: should be a valid integer, got None"),
        (line(data=None), "line 2: should be a table, got None"),
        (line(data={}), "line 2: name: is missing"),
        (line(data={"name": 3}), "line 2: name: should be a valid string, got 3"),
        (
            line(type="Belief", data={"observation_id": 1, "probability": {"a(": 0.5}}),
            r"probability: .*'a\(' is not an",
        ),
        (line(type="Belief", data={"observation_id": 1, "probability": {"a()": 7}}), r"P\(a\(\)\) = 7"),
        (
            line(type="Belief", data={"observation_id": 1, "probability": {"a()": int("9" * 400)}}),
            "probability: .* should be a valid number",
        ),
        (line(time="inf"), "no run has events at inf s"),
        (line(wall="nan"), "or after nan s"),
        (line(time=-1e300), "no run has events at -1e"),
        (line(type="Ended", data={"outcome": "partial", "reason": "\ud800"}), "reason: should be a valid string"),
        (line(type="Ended", data={"outcome": "partial"}), "reason: should be a valid string"),
        (line(type="Ended", data={"outcome": "partial", "causes": [{"code": "mood"}]}), "reason: should be a valid"),
        (line(type="Ended", data={"outcome": "partial", "causes": [{"code": [3]}]}), "reason: should be a valid"),
        (line(type="Ended", data={"outcome": "partial", "causes": 3}), "causes: "),
        (line(type="Decision", data={"kind": "retry", "causes": []}), "a decision has a cause"),
        (line(type="Decision", data={"kind": "dance", "reason": ""}), "kind: 'dance' is not a valid DecisionKind"),
        (line(type="Observation", data={"id": 0, "time": 0, "images": [], "joints": []}), "images: expected an object"),
        (
            line(type="Observation", data={"id": 0, "time": 0, "images": {"front": "../../secret"}, "joints": []}),
            r"images: front: '../../secret' is not a file in images/",
        ),
        (
            line(type="Observation", data={"id": 0, "time": 0, "images": {"front": "images/../x"}, "joints": []}),
            r"is not a file in images/",
        ),
        ("[" * 100_000, "line 2: not a JSON object"),
    ],
)
def test_what_is_foreign_is_named_with_file_and_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / EVENTS_FILE
    path.write_text(f"{line()}\n{text}\n{line()}\n")
    with pytest.raises(InputError, match=complaint) as caught:
        list(read_events(path))
    assert caught.value.file == path


@given(st.binary(max_size=200))
def test_no_bytes_raise_anything_but_an_input_error(garbage: bytes) -> None:
    with folder() as run:
        (run / EVENTS_FILE).write_bytes(line().encode() + b"\n" + garbage + b"\n")
        with suppress(InputError):
            list(read_events(run))


def test_fields_that_a_later_release_added_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / EVENTS_FILE).write_text(line(data={"name": "grip", "force": 3.0}) + "\n")
    (event,) = read_events(tmp_path)
    assert event.payload == Phase("grip")


def test_no_record_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no record of a run"):
        list(read_events(tmp_path))


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        EventLog(tmp_path / "file" / "run")


def test_closing_twice_is_harmless(tmp_path: Path) -> None:
    log = EventLog(tmp_path)
    log.write(Event(0, 0.0, 0.0, Timing("plan", 0.1)))
    log.close()
    log.close()
