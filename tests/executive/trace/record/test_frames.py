"""How things moved is read back as it was written, to a tenth of a millimetre, and through kills and resumptions."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.trace.record.frames import FRAMES_FILE, FrameLog, read_movements
from executive.types import Atom, Camera, Condition, Event, Frame, Payload, Resumed, Scenery, Started, Task

CLOSE = 2.1e-4
"""What is not written, and rounding."""
TASK = Task("d", "p", {"cup": "item", "jug": "item"}, (Atom("on", ("cup",)),), Condition())
CAMERAS = (Camera("front", (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), 0.8, 64, 48),)
numbers = st.floats(-3.0, 3.0)


def vectors(size: int) -> st.SearchStrategy[np.ndarray]:
    return st.lists(numbers, min_size=size, max_size=size).map(np.array)


FRAMES = st.builds(
    Frame,
    st.dictionaries(st.sampled_from(["cup", "jug", "wrist"]), vectors(7)),
    vectors(3),
    st.floats(0.0, 0.1),
    st.none() | vectors(4),
    st.none() | vectors(2),
)


def write(run: Path, *payloads: tuple[float, Payload]) -> None:
    log = FrameLog(run)
    for time, payload in payloads:
        log.write(Event(0, time, 0.0, payload))
    log.close()


def still(time: float, x: float) -> tuple[float, Frame]:
    return time, Frame({"cup": np.array([x, 0, 0, 1, 0, 0, 0])}, np.full(3, x), 0.05)


START: tuple[tuple[float, Payload], ...] = (
    (0.0, Started("r", "d", TASK, "oracle", 0)),
    (0.0, Scenery((), CAMERAS, ("a", "b", "c"))),
)


@given(st.lists(FRAMES, max_size=6))
def test_what_is_written_is_read_back(frames: list[Frame]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), *START, *((0.1 * at, frame) for at, frame in enumerate(frames)))
        read = read_movements(folder)
    assert (read.cameras, read.joint_names) == (CAMERAS, ("a", "b", "c"))
    seen: dict[str, np.ndarray] = {}
    for at, frame in enumerate(frames):
        seen |= {name: pose for name, pose in frame.poses.items() if name != "wrist"}  # no object of the task
        found = [moment for moment in read.moments if moment.time <= 0.1 * at + 1e-6][-1].frame
        assert found.joints == pytest.approx(frame.joints, abs=CLOSE)
        assert found.gripper == pytest.approx(frame.gripper, abs=CLOSE)
        assert found.poses.keys() == seen.keys()
        assert all(found.poses[name] == pytest.approx(seen[name], abs=CLOSE) for name in seen)
        for mine, its in ((found.command, frame.command), (found.fingers, frame.fingers)):
            assert its is None or mine == pytest.approx(its, abs=CLOSE)


def test_what_stands_still_is_written_once(tmp_path: Path) -> None:
    write(tmp_path, *START, *(still(0.1 * at, 0.5) for at in range(50)))
    assert len((tmp_path / FRAMES_FILE).read_text().splitlines()) == 2


def test_a_resumed_run_goes_on_from_where_its_world_was_set_back_to(tmp_path: Path) -> None:
    write(tmp_path, *START, still(1.0, 0.1), still(2.0, 0.2), still(3.0, 0.3))
    with (tmp_path / FRAMES_FILE).open("a") as file:
        file.write('{"time": 4.0, "joi')  # killed here
    log = FrameLog(tmp_path)
    log.recall(Event(0, 0.0, 0.0, START[0][1]))
    for time, payload in [(1.5, Resumed(0, 0, 0, 0, 0)), (1.5, START[1][1]), still(2.5, 0.7)]:
        log.write(Event(0, time, 0.0, payload))
    log.close()
    moments = read_movements(tmp_path).moments
    assert [moment.time for moment in moments] == [1.0, 2.0, 2.5]
    assert moments[-1].frame.poses["cup"][0] == 0.7


def test_a_run_without_any_has_none(tmp_path: Path) -> None:
    assert read_movements(tmp_path).moments == ()


@pytest.mark.parametrize(
    "line",
    [
        "[]", "nothing", "{}", '{"v": 2}', '{"v": 1}', '{"time": "x"}', '{"time": 1.0, "poses": 3}',
        '{"time": 1.0, "poses": {"cup": [1, 2]}}', '{"time": 1.0, "joints": "a"}',
    ],
)  # fmt: skip
def test_what_is_no_such_line_is_told_by_its_number(tmp_path: Path, line: str) -> None:
    write(tmp_path, *START, still(1.0, 0.1))
    with (tmp_path / FRAMES_FILE).open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError) as refused:
        read_movements(tmp_path)
    assert (refused.value.file, refused.value.key) == (tmp_path / FRAMES_FILE, "line 3")
