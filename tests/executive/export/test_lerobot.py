"""Runs as a data set of LeRobot: rows that are what happened, pictures that are what the cameras saw, and, in the slow
test, all of it read by LeRobot."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from executive import RunConfig, run
from executive.app.redrawn import Redrawn
from executive.errors import InputError
from executive.export import export_lerobot
from executive.export.episodes import Episode
from executive.trace.record.log import read_events
from executive.trace.record.recording import Recording
from executive.types import Dispatched, Judged, Observation, SkillResult
from tests.conftest import ROOT

FPS, CAMERA = 2, "observation.images.front"


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in the simulator in which an item is dropped on the way."""
    runs = tmp_path_factory.mktemp("runs")
    config = RunConfig(
        "grocery", problem="one-item", estimator="oracle", faults=("drop@2",), runs=runs, name="dropped", viewer=False
    )
    assert run(config)["goal_true"]
    return runs / "dropped"


@pytest.fixture(scope="module")
def exported(played: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_lerobot([played, played], tmp_path_factory.mktemp("out") / "data", FPS, ["front"])


def rows(exported: Path, episode: int) -> list[dict[str, Any]]:
    table = pq.read_table(exported / f"data/chunk-000/file-{episode:03d}.parquet")
    found: list[dict[str, Any]] = table.to_pylist()
    return found


def test_rows_are_what_was_sensed_commanded_believed_and_done(played: Path, exported: Path) -> None:
    events = list(read_events(played, images=False))
    task = Recording(played).started.task
    moments = Recording(played).movements.moments
    first, second = rows(exported, 0), rows(exported, 1)
    assert len(first) == len(second) == int(events[-1].time * FPS) + 1
    assert [row["index"] for row in (*first, *second)] == [*range(2 * len(first))]
    for row in first:
        time = row["timestamp"]
        assert time == row["frame_index"] / FPS
        frame = [moment.frame for moment in moments if moment.time <= max(time, moments[0].time)][-1]
        assert row["observation.state"] == pytest.approx([*frame.joints, frame.gripper])
        assert frame.command is not None
        assert row["action"] == pytest.approx([*frame.command])
        judged = [event.payload for event in events if isinstance(event.payload, Judged) and event.time <= time][-1]
        assert row["loop.atoms"] == pytest.approx([judged.probability[atom] for atom in task.atoms])
        before = [event.payload for event in events if event.time <= time]
        done = [payload for payload in before if isinstance(payload, Dispatched | SkillResult)]
        doing = str(done[-1].step) if done and isinstance(done[-1], Dispatched) else ""
        assert row["loop.step"] == doing
    assert [row["next.success"] for row in first] == [False] * (len(first) - 1) + [True]
    assert {row["loop.step"].partition("(")[0] for row in first} >= {"pick", "place"}
    assert "dropped" not in {row["loop.decision"] for row in first} <= {
        "continue", "look again", "retry", "replan", "stop",
    }  # fmt: skip


def test_the_arm_follows_the_actions(played: Path) -> None:
    """What the servos are told is nearer to where the joints are a frame later than where they are now."""
    frames = [moment.frame for moment in Recording(played).movements.moments]
    joints = np.array([frame.joints for frame in frames])
    told = np.array([frame.command[:6] for frame in frames if frame.command is not None])
    moving = np.abs(np.diff(joints, axis=0)).max(axis=1) > 0.02
    assert moving.sum() > 20
    assert np.abs(told[:-1] - joints[1:])[moving].mean() < 0.5 * np.abs(np.diff(joints, axis=0))[moving].mean()


def test_pictures_are_what_the_cameras_saw(played: Path) -> None:
    """Drawn anew from the record, the last look's picture is the one that was taken, but for the sensor's noise."""
    recording = Recording(played)
    look = [event.payload for event in read_events(played) if isinstance(event.payload, Observation)][-1]
    assert look.time >= recording.movements.moments[-1].time
    with Redrawn(recording, ["front"]) as drawn:
        again = drawn.show(recording.movements.moments[-1].frame)["front"]
        before = drawn.show(recording.movements.moments[0].frame)["front"]

    def difference(picture: np.ndarray) -> float:
        return float(np.abs(picture.astype(float) - look.images["front"]).mean())

    assert difference(again) < 3.0
    assert difference(before) > 1.2 * difference(again)


def test_the_video_has_a_frame_for_each_row(exported: Path) -> None:
    for episode in (0, 1):
        with av.open(str(exported / f"videos/{CAMERA}/chunk-000/file-{episode:03d}.mp4")) as container:
            frames = list(container.decode(video=0))
        assert len(frames) == len(rows(exported, episode))
        assert [frame.time for frame in frames] == pytest.approx([at / FPS for at in range(len(frames))])


def test_the_list_of_features_fits_the_rows(played: Path, exported: Path) -> None:
    info = json.loads((exported / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    features: Mapping[str, Any] = info["features"]
    for name, value in rows(exported, 0)[0].items():
        size = len(value) if isinstance(value, list) else 1
        assert features[name]["shape"] == [size]
        assert features[name]["names"] is None or len(features[name]["names"]) == size
    assert features.keys() - rows(exported, 0)[0].keys() == {CAMERA}
    assert features["observation.state"]["names"][-1] == "gripper"
    assert features["loop.atoms"]["names"] == [str(atom) for atom in Episode(Recording(played), FPS).atoms]
    assert (info["total_episodes"], info["total_frames"]) == (2, 2 * len(rows(exported, 0)))
    stats = json.loads((exported / "meta/stats.json").read_text())
    states = np.array([row["observation.state"] for row in rows(exported, 0)])
    assert stats["observation.state"]["mean"] == pytest.approx(states.mean(axis=0), abs=1e-5)


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(played: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"frames\.jsonl"):
        export_lerobot([ROOT / "runs" / "example"], tmp_path / "data")
    with pytest.raises(InputError, match="did you mean 'front'"):
        export_lerobot([played], tmp_path / "data", cameras=["fron"])
    with pytest.raises(InputError, match="no such folder"):
        export_lerobot([played], tmp_path / "none" / "data")
    with pytest.raises(InputError, match="is there already"):
        export_lerobot([played], tmp_path)
    with pytest.raises(InputError, match="rows a second"):
        export_lerobot([played], tmp_path / "data", fps=0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif("LEROBOT_PYTHON" not in os.environ, reason="LEROBOT_PYTHON names no Python that has lerobot")
def test_lerobot_reads_it(exported: Path) -> None:
    """LeRobot's pins do not go with ours, so that it has an environment of its own: docs/how-to/export.md."""
    script = Path(__file__).with_name("read_lerobot.py")
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    command = [os.environ["LEROBOT_PYTHON"], str(script), str(exported)]
    read = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert read.returncode == 0, read.stderr
    found = json.loads(read.stdout.splitlines()[-1])
    mine = [*rows(exported, 0), *rows(exported, 1)]
    assert (found["episodes"], found["frames"], found["fps"]) == (2, len(mine), FPS)
    assert found["cameras"] == [CAMERA]
    for theirs, name in (("states", "observation.state"), ("actions", "action"), ("atoms", "loop.atoms")):
        assert np.allclose(found[theirs], [row[name] for row in mine])
    assert found["steps"] == [row["loop.step"] for row in mine]
    assert found["success"] == [row["next.success"] for row in mine]
    assert found["runs"] == ["dropped", "dropped"]
    assert found["picture"][-3:] == [3, 384, 384]
    assert np.ptp(found["brightness"]) > 0.0
    assert np.allclose(found["next_action"], [mine[0]["action"], mine[1]["action"]])


def test_the_command_names_what_it_wrote(
    played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from executive import cli

    monkeypatch.chdir(tmp_path)
    arguments = ["export", "lerobot", str(played), "--out", "data", "--fps", "1", "--cameras", "hand, front", "--json"]
    assert cli.exit_code([*arguments, "--task", "put it there"]) == 0
    assert json.loads(capsys.readouterr().out) == {"runs": [str(played)], "lerobot": "data"}
    assert {path.name for path in (tmp_path / "data" / "videos").iterdir()} == {CAMERA, "observation.images.hand"}
    assert pq.read_table(tmp_path / "data/meta/tasks.parquet").to_pylist() == [
        {"task_index": 0, "task": "put it there"}
    ]
    assert cli.exit_code(arguments) == 2
