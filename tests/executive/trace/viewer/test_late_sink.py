"""The viewer's file that is begun with the first motion has all that happened before, too."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from executive.errors import InputError
from executive.trace.viewer.late_sink import LateSink
from executive.trace.viewer.process import TRACE_FILE
from executive.trace.viewer.sink import RerunSink
from executive.types import Dispatched, Event, Frame, Payload, Phase, SkillResult, SkillStatus, Step

STEP = Step("pick", ("lemon",))
BEFORE: list[Payload] = [Phase("look"), Dispatched(STEP, 1, 1, 0)]
AFTER: list[Payload] = [Phase("reach"), SkillResult(STEP, SkillStatus.DONE)]


def frame() -> Frame:
    return Frame({"lemon": np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])}, np.zeros(6), 0.08)


def events(*payloads: Payload) -> list[Event]:
    return [Event(0, 0.1 * number, 0.1 * number, payload) for number, payload in enumerate(payloads)]


def rows(file: Path) -> dict[str, int]:
    found: dict[str, int] = {}
    for chunk in RrdReader(file).stream():
        found[chunk.entity_path] = found.get(chunk.entity_path, 0) + chunk.num_rows
    return found


def test_it_leaves_what_a_sink_leaves_that_was_there_from_the_start(tmp_path: Path) -> None:
    told = events(*BEFORE, frame(), frame(), *AFTER)
    late, early = LateSink(tmp_path / "late", {}), RerunSink(tmp_path / "early")
    for sink in (late, early):
        for event in told:
            sink.write(event)
        sink.close()
    assert rows(tmp_path / "late" / TRACE_FILE) == rows(tmp_path / "early" / TRACE_FILE)


def test_it_begins_once_the_arm_has_moved_and_not_in_the_middle_of_a_motion(tmp_path: Path) -> None:
    sink, file = LateSink(tmp_path, {}), tmp_path / TRACE_FILE
    told = events(*BEFORE, frame(), frame(), *AFTER)
    for event in told[:3]:
        sink.write(event)
    assert sink._loading is not None
    sink._loading.join()
    sink.write(told[3])
    assert not file.exists()
    sink.write(told[4])
    assert file.exists()
    sink.close()


def test_a_run_without_a_motion_has_its_file_at_the_end(tmp_path: Path) -> None:
    sink = LateSink(tmp_path, {})
    for event in events(*BEFORE):
        sink.write(event)
    assert sink._loading is None
    sink.close()
    assert rows(tmp_path / TRACE_FILE)


def test_a_file_that_cannot_be_written_is_said_at_once(tmp_path: Path) -> None:
    (tmp_path / TRACE_FILE).mkdir()
    with pytest.raises(InputError):
        LateSink(tmp_path, {})


def test_rerun_is_not_imported_before(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from executive.trace.viewer.late_sink import LateSink\n"
        "LateSink(Path(sys.argv[1]), {}); sys.exit('rerun' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False).returncode == 0
