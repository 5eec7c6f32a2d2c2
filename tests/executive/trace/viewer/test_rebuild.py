"""A run without the viewer's file gets one from its record, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import InputError
from executive.trace.record.log import EventLog
from executive.trace.viewer.process import TRACE_FILE
from executive.trace.viewer.rebuild import ensure_trace
from executive.trace.viewer.sink import RerunSink
from executive.types import Ended, Event
from tests.executive.trace.synthetic import synthetic_events


def record(run: Path, events: list[Event]) -> Path:
    log = EventLog(run)
    for event in events:
        log.write(event)
    log.close()
    return run


def entities(run: Path) -> set[str]:
    """What the viewer's file of a run tells of."""
    from rerun.chunk import RrdReader

    return {chunk.entity_path for chunk in RrdReader(run / TRACE_FILE).stream().to_chunks()}


def test_it_tells_what_the_sink_told_but_for_the_scene(tmp_path: Path) -> None:
    events = synthetic_events()
    run = record(tmp_path / "run", events)
    ensure_trace(run)
    sink = RerunSink(tmp_path / "live")
    for event in events:
        sink.write(event)
    sink.close()
    missing = entities(tmp_path / "live") - entities(run)
    assert all("world" in path for path in missing), missing
    assert sorted(path.name for path in run.iterdir()) == ["events.jsonl", "images", TRACE_FILE]


def test_a_trace_that_is_there_is_left_alone(tmp_path: Path) -> None:
    run = record(tmp_path / "run", synthetic_events())
    (run / TRACE_FILE).write_bytes(b"as it was")
    ensure_trace(run)
    assert (run / TRACE_FILE).read_bytes() == b"as it was"


def test_a_folder_without_a_record_gets_none(tmp_path: Path) -> None:
    ensure_trace(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_goes_on_gets_none_yet(tmp_path: Path) -> None:
    unfinished = [event for event in synthetic_events() if not isinstance(event.payload, Ended)]
    run = record(tmp_path / "run", unfinished)
    with pytest.raises(InputError, match="executive explain"):
        ensure_trace(run)
    assert not (run / TRACE_FILE).exists()


def test_a_disk_that_is_full_leaves_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = record(tmp_path / "run", synthetic_events())

    def full(self: RerunSink, event: Event) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RerunSink, "write", full)
    with pytest.raises(InputError, match="No space left on device"):
        ensure_trace(run)
    assert sorted(path.name for path in run.iterdir()) == ["events.jsonl", "images"]
