"""Demonstrations: what is recorded is what the robot sensed and was told, and it goes to LeRobot as it is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from executive.errors import InputError
from executive.export import export_lerobot
from executive.lab.collection.collect import Collection
from executive.lab.collection.dataset import MANIFEST, read, read_demonstrations
from executive.lab.collection.demonstrations import Demonstration
from executive.lab.config import CollectConfig
from tests.executive.lab.inline import Inline
from tests.executive.sim.stage import ROOT

FPS, CAMERA = 2, "observation.images.front"
GROCERY = str(ROOT / "domains" / "grocery")


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pick and a place, with a grasp that is known to a centimetre."""
    out = tmp_path_factory.mktemp("demonstrations") / "data"
    config = CollectConfig(GROCERY, out, 2, "one-item", seed=1, slips=0.0, demonstrations=True)
    with Collection(config) as collection:
        assert collection.run(make_pool=lambda: Inline(collection.player, 1)) is not None
    return out


@pytest.fixture(scope="module")
def shown(collected: Path) -> list[Demonstration]:
    return list(read_demonstrations(collected))


@pytest.fixture(scope="module")
def exported(collected: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_lerobot([collected], tmp_path_factory.mktemp("out") / "data", FPS, ["front"])


def rows(exported: Path, episode: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = pq.read_table(exported / f"data/chunk-000/file-{episode:03d}.parquet").to_pylist()
    return found


def test_each_completed_action_has_one_and_the_points_are_as_ever(collected: Path, shown: list[Demonstration]) -> None:
    points = list(read(collected))
    assert [each.action for each in shown] == [point.action for point in points]
    assert [each.name for each in shown] == ["pick", "place"]
    assert all(len(each.samples) > 20 for each in shown)


def test_the_arm_does_what_it_is_told(shown: list[Demonstration]) -> None:
    for each in shown:
        times = np.array([sample.time for sample in each.samples])
        assert np.diff(times) == pytest.approx(0.096)
        joints, told = (np.array([getattr(s, name) for s in each.samples]) for name in ("joints", "command"))
        assert np.abs(joints - told[:, :6]).max() < 0.2
    pick, place = shown
    assert {sample.command[6] for sample in pick.samples if sample.phase == "approach"} == {0.0}
    assert pick.samples[-1].command[6] == place.samples[0].command[6] == 1.0
    assert place.samples[-1].command[6] == 0.0
    assert {"approach", "grip", "lift"} <= {sample.phase for sample in pick.samples}


def test_the_hand_is_where_the_item_was_said_to_be_when_the_fingers_close(shown: list[Demonstration]) -> None:
    """And it was not said to be where it is: the error of that, which the skill did not know of, is in it."""
    pick = shown[0]
    (seen,) = {located.item: located for located in pick.located}.values()
    assert seen.item == pick.args[0]
    gripped = next(sample for sample in pick.samples if sample.phase == "grip")
    assert np.hypot(*(gripped.hand[:2] - seen.pose[:2])) < 0.02
    truth = pick.samples[0].qpos
    nearest = min(float(np.hypot(*(truth[at : at + 2] - seen.pose[:2]))) for at in range(len(truth) - 1))
    assert 0.001 < nearest < 0.05


def test_what_was_collected_without_is_refused(collected: Path, tmp_path: Path) -> None:
    without = tmp_path / "without"
    shutil.copytree(collected, without)
    manifest = json.loads((without / MANIFEST).read_text())
    del manifest["collection"]["demonstrations"]
    (without / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="--demonstrations"):
        list(read_demonstrations(without))
    with pytest.raises(InputError, match="--demonstrations"):
        export_lerobot([without], tmp_path / "out", FPS)
    assert not (tmp_path / "out").exists()


def test_rows_are_what_was_recorded(shown: list[Demonstration], exported: Path) -> None:
    for number, each in enumerate(shown):
        found, start = rows(exported, number), each.samples[0].time
        assert len(found) == int((each.samples[-1].time - start) * FPS) + 1
        for row in found:
            now = [s for s in each.samples if s.time - start <= row["timestamp"] + 1e-6][-1]
            assert row["observation.state"] == pytest.approx([*now.joints, now.gripper], abs=1e-6)
            assert row["action"] == pytest.approx(now.command, abs=1e-6)
            assert (row["skill.action"], row["skill.phase"]) == (each.action, now.phase)
        assert [row["next.success"] for row in found] == [False] * (len(found) - 1) + [True]
        with av.open(str(exported / f"videos/{CAMERA}/chunk-000/file-{number:03d}.mp4")) as container:
            frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]
        assert len(frames) == len(found)
        assert np.abs(frames[0] - frames[len(frames) // 2]).mean() > 0.5  # the arm moves in it
    tasks = pq.read_table(exported / "meta/tasks.parquet").to_pylist()
    assert {each["task"] for each in tasks} == {each.action for each in shown}


@pytest.mark.slow
@pytest.mark.skipif("LEROBOT_PYTHON" not in os.environ, reason="LEROBOT_PYTHON names no Python that has lerobot")
def test_lerobot_reads_it(exported: Path) -> None:
    script = Path(__file__).with_name("read_lerobot.py")
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    command = [os.environ["LEROBOT_PYTHON"], str(script), str(exported)]
    read = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert read.returncode == 0, read.stderr
    found = json.loads(read.stdout.splitlines()[-1])
    mine = [*rows(exported, 0), *rows(exported, 1)]
    assert (found["episodes"], found["frames"], found["fps"], found["cameras"]) == (2, len(mine), FPS, [CAMERA])
    for theirs, name in (("states", "observation.state"), ("actions", "action")):
        assert np.allclose(found[theirs], [row[name] for row in mine])
    assert found["steps"] == found["tasks"] == [row["skill.action"] for row in mine]
    assert found["success"] == [row["next.success"] for row in mine]
