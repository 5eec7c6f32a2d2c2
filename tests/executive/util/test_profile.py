"""Where time goes is told without gap or overlap, whatever lies in what."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time

import pytest

from executive.util import profile
from executive.util.profile import OTHER, START, Profile, stage


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(profile, "_clock", profile._Clock())


@pytest.mark.usefixtures("measured")
def test_all_parts_add_up_to_the_whole() -> None:
    with stage("outer"):
        time.sleep(0.02)
        with stage("inner"):
            time.sleep(0.05)
    found = profile.read()
    assert sum(found.stages.values()) + sum(found.imports.values()) == pytest.approx(found.total)
    assert found.stages["inner"] >= 0.05
    assert found.stages["outer"] >= 0.02
    assert found.stages.keys() == {"outer", "inner", OTHER, START}


@pytest.mark.usefixtures("measured")
def test_a_stage_that_ends_by_an_error_is_over() -> None:
    with pytest.raises(ValueError, match="why"), stage("one"):
        raise ValueError("why")
    before = profile.read().stages["one"]
    time.sleep(0.01)
    assert profile.read().stages["one"] == before


@pytest.mark.usefixtures("measured")
def test_a_thread_that_is_left_behind_takes_nothing_from_what_goes_on() -> None:
    go, began = threading.Event(), threading.Event()

    def late() -> None:
        with stage("given up"):
            began.set()
            go.wait(60.0)

    thread = threading.Thread(target=late)
    thread.start()
    assert began.wait(60.0)
    with stage("next"):
        go.set()
        thread.join()
        before = profile.read().stages
        time.sleep(0.01)
    after = profile.read().stages
    assert after["given up"] == before["given up"]
    assert after["next"] > before["next"]


@pytest.mark.usefixtures("measured")
def test_imports_count_as_those_of_their_package() -> None:
    with stage(profile.IMPORT + "numpy"):
        pass
    assert "numpy" in profile.read().imports


def test_without_start_nothing_is_measured() -> None:
    with stage("one"):
        pass
    with pytest.raises(ValueError, match="start"):
        profile.read()


def test_a_run_ends_with_where_its_time_went(tmp_path: object) -> None:
    command = [sys.executable, "-m", "executive", "run", "grocery", "--world", "symbolic", "--no-trace-viewer"]
    done = subprocess.run(
        [*command, "--profile", "--quiet", "--json", "--runs", str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)["profile"]
    told = Profile(found["seconds"], found["stages"], found["imports"])
    assert sum(told.stages.values()) + sum(told.imports.values()) == pytest.approx(told.total, abs=0.1)
    assert told.stages[OTHER] <= 0.15 * told.total  # 0.05 of a run of the usual length; this one is short
    assert {"plan", "estimate", "believe and decide", "record (EventLog)", START} <= told.stages.keys()
    assert "executive" in told.imports
