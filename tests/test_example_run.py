"""The run that is kept in git can be read, is whole and small, and says of itself what its events say."""

from __future__ import annotations

import json
import re
from pathlib import Path

from executive.trace.record.log import read_events
from executive.trace.report.summary import summarise
from executive.types import Observation

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "runs" / "example"
KEPT = [file for file in RUN.rglob("*") if file.is_file() and file.name != "trace.rrd"]


def test_its_summary_is_that_of_its_events() -> None:
    written = json.loads((RUN / "summary.json").read_text(encoding="utf-8"))
    assert summarise(read_events(RUN, images=False), written["goal_true"]) == written


def test_it_shows_a_recovery() -> None:
    """`make example` makes it anew, should what a run writes have changed."""
    summary = json.loads((RUN / "summary.json").read_text(encoding="utf-8"))
    assert (summary["outcome"], summary["goal_true"]) == ("goal-reached", True)
    assert summary["replans"] >= 1
    assert [fault["spec"] for fault in summary["faults"]] == ["drop@4"]


def test_every_picture_that_it_names_is_there_and_no_other() -> None:
    looks = [event.payload for event in read_events(RUN) if isinstance(event.payload, Observation)]
    assert sum(len(look.images) for look in looks) == len(list((RUN / "images").iterdir()))
    assert all(image.size for look in looks for image in look.images.values())


def test_it_is_small_and_names_no_machine() -> None:
    assert sum(file.stat().st_size for file in KEPT) < 500_000
    for file in (RUN / "config.toml", RUN / "events.jsonl", RUN / "summary.json"):
        assert re.search(r'"/\w|/home/|/root|/tmp|C:\\', file.read_text(encoding="utf-8")) is None
