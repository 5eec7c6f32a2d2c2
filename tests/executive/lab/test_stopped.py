"""The four commands with long work, killed and interrupted for real: nobody stays behind, and the same command goes on
to the same end."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from executive.lab.collection import dataset
from tests.executive.lab.common.test_process_pool import gone
from tests.executive.sim.stage import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

TRAY = ROOT / "tests" / "domains" / "tray"
CAMPAIGN = f"""
title = "Tray"
seeds = 6
[[domains]]
domain = "{TRAY}"
[faults]
none = []
[estimators]
oracle = {{}}
"""


@pytest.fixture(scope="module")
def eye(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("eye") / "eye"
    finished(["train", str(TRAY), "--recipe", "smallest", "--jobs", "1", "--out", str(out)])
    return out


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "data"
    finished(["collect", str(TRAY), "--points", "40", "--jobs", "2", "--out", str(out)])
    return out


def begun(command: list[str]) -> subprocess.Popen[str]:
    """The command, at work: a process that it has started has used a second of the processor."""
    process = subprocess.Popen(
        [sys.executable, "-m", "executive", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while process.poll() is None and not any(used(child) > 1.0 for child in children(process.pid)):
        time.sleep(0.05)
    assert process.poll() is None, process.communicate()
    return process


def finished(command: list[str]) -> str:
    run = subprocess.run([sys.executable, "-m", "executive", *command], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


def children(pid: int) -> list[int]:
    found: list[int] = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += map(int, file.read_text().split())
        except OSError:
            continue
    return found


def used(pid: int) -> float:
    """Seconds of the processor."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


@pytest.fixture(params=["collect", "train", "eval", "bench"])
def work(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[list[str], Callable[[], object]]:
    """A command, and what it comes to in the end."""
    out = tmp_path / "out"
    if request.param == "collect":
        shards = out / dataset.SHARDS
        command = ["collect", str(TRAY), "--points", "40", "--jobs", "2", "--out", str(out)]
        return command, lambda: [each.read_bytes() for each in sorted(shards.iterdir())]
    if request.param == "train":
        command = ["train", str(TRAY), "--recipe", "smallest", "--jobs", "1", "--out", str(out)]
        return command, lambda: (out / "model" / "model.safetensors").stat().st_size
    if request.param == "eval":
        eye, data = request.getfixturevalue("eye"), request.getfixturevalue("data")
        command = ["eval", str(TRAY), str(data), "--vlm", str(eye / "model"), "--no-abstention", "--out", str(out)]
        return command, lambda: json.loads((out / "evaluation.json").read_text())["atoms"]
    file = tmp_path / "tray.toml"
    file.write_text(CAMPAIGN)
    return ["bench", str(file), "--jobs", "2", "--out", str(out)], lambda: rows(out)


def rows(out: Path) -> list[dict[str, object]]:
    made = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    return sorted(({**row, "wall_seconds": 0.0} for row in made), key=lambda row: int(row["seed"]))


def test_killed_it_leaves_nobody_behind_and_goes_on_to_the_same_end(
    work: tuple[list[str], Callable[[], object]], tmp_path: Path
) -> None:
    command, result = work
    process = begun(command)
    workers = children(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert all(map(gone, workers))
    finished(command)
    there = result()
    shutil.rmtree(tmp_path / "out")
    finished(command)
    assert result() == there


@pytest.mark.parametrize("order", [signal.SIGINT, signal.SIGTERM])
def test_told_to_end_it_says_so_ends_with_the_orders_code_and_goes_on(
    work: tuple[list[str], Callable[[], object]], order: signal.Signals
) -> None:
    command, _ = work
    process = begun(command)
    workers = children(process.pid)
    os.killpg(process.pid, order)
    printed, told = process.communicate()
    assert process.returncode == 128 + order
    assert printed == ""
    assert "stopping; what is finished is kept" in told
    assert "Traceback" not in told
    assert all(map(gone, workers))
    finished(command)


def test_two_at_once_in_one_folder_are_one_and_a_line(work: tuple[list[str], Callable[[], object]]) -> None:
    command, _ = work
    process = begun(command)
    second = subprocess.run([sys.executable, "-m", "executive", *command], capture_output=True, text=True, check=False)
    assert second.returncode == 2
    (line,) = second.stderr.splitlines()
    assert "another process is working in this folder" in line
    assert f"process {process.pid} on {os.uname().nodename}" in line
    process.kill()
    process.communicate()
