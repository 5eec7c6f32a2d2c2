"""How many threads there are: from what the system grants, and before anything is loaded that would decide itself."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.util import threads

NAMES = (
    threads.OPENMP_THREADS,
    threads.WAIT_POLICY,
    threads.SPIN_COUNT,
    threads.RENDERING_THREADS,
    threads.NUMBA_THREADS,
)
V2 = "31 23 0:28 {root} {mount} rw,relatime shared:9 - cgroup2 cgroup2 rw,nsdelegate"
V1 = "32 31 0:29 {root} {mount} rw,relatime - cgroup cgroup rw,cpu,cpuacct"
OTHER = "33 31 0:30 / {mount}-memory rw,relatime - cgroup cgroup rw,memory"


def fresh(script: str, **environment: str) -> object:
    """What a script prints as JSON in a fresh interpreter, in whose environment nobody has said anything of threads."""
    clean = {name: value for name, value in os.environ.items() if name not in NAMES and "_NUM_THREADS" not in name}
    run = subprocess.run(
        [sys.executable, "-c", script], env={**clean, **environment}, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def process(folder: Path, groups: str, mounts: str, limits: Mapping[str, str]) -> Path:
    """A process's folder as in /proc, and the files of its groups."""
    (folder / "proc").mkdir()
    (folder / "proc" / "cgroup").write_text(groups)
    (folder / "proc" / "mountinfo").write_text(mounts)
    for file, text in limits.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(f"{text}\n")
    return folder / "proc"


# --- what the system grants -------------------------------------------------------------------------------------------


def test_the_least_of_all_groups_is_what_is_granted(tmp_path: Path) -> None:
    limits = {
        "mount/cpu.max": "max 100000",
        "mount/slice/cpu.max": "150000 100000",
        "mount/slice/job/cpu.max": "300000 100000",
    }
    mounts = V2.format(root="/", mount=tmp_path / "mount")
    assert threads.quota(process(tmp_path, "0::/slice/job\n", mounts, limits)) == 1.5


def test_the_older_control_groups_say_it_in_two_files(tmp_path: Path) -> None:
    mount = tmp_path / "mount"
    limits = {"mount/job/cpu.cfs_quota_us": "50000", "mount/job/cpu.cfs_period_us": "100000"}
    limits |= {"mount/cpu.cfs_quota_us": "-1", "mount/cpu.cfs_period_us": "100000"}
    mounts = "\n".join(each.format(root="/", mount=mount) for each in (OTHER, V1))
    assert threads.quota(process(tmp_path, "4:memory:/\n3:cpu,cpuacct:/job\n0::/\n", mounts, limits)) == 0.5


@pytest.mark.parametrize(("root", "path"), [("/docker/1f", "/docker/1f"), ("/", "/../.."), ("/docker/1f", "/")])
def test_in_a_container_its_group_is_what_is_mounted(root: str, path: str, tmp_path: Path) -> None:
    mounts = V2.format(root=root, mount=tmp_path / "mount")
    assert threads.quota(process(tmp_path, f"0::{path}\n", mounts, {"mount/cpu.max": "200000 100000"})) == 2.0


@pytest.mark.parametrize("text", ["max 100000", "", "many few", "1 2 3"])
def test_where_there_is_no_limit_none_is_made_up(text: str, tmp_path: Path) -> None:
    mounts = V2.format(root="/", mount=tmp_path / "mount")
    assert threads.quota(process(tmp_path, "0::/\n", mounts, {"mount/cpu.max": text})) is None


@pytest.mark.parametrize(("groups", "mounts"), [("", ""), ("nonsense\n", "nonsense\n"), ("0::/\n", "1 2 3 / /x -\n")])
def test_what_cannot_be_read_is_no_limit(groups: str, mounts: str, tmp_path: Path) -> None:
    assert threads.quota(process(tmp_path, groups, mounts, {})) is None
    assert threads.quota(tmp_path / "nobody") is None


@given(time=st.none() | st.floats(0.01, 300.0))
def test_there_is_a_core_at_least_and_no_more_than_are_allowed(time: float | None) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threads, "quota", lambda process: time)
        allowed = len(os.sched_getaffinity(0))
        assert threads.cores() == (allowed if time is None else min(allowed, math.ceil(time)))


# --- every way in -----------------------------------------------------------------------------------------------------

WATCH = f"""
import json, os, sys
class Watch:
    def find_spec(self, name, path=None, target=None):
        if name in ("numpy", "torch", "numba", "sklearn", "mujoco"):
            seen[name] = {{key: os.environ.get(key) for key in {NAMES!r}}}
seen = {{}}
sys.meta_path.insert(0, Watch())
"""


@pytest.mark.parametrize(
    "way_in",
    [
        "from executive.__main__ import main; import executive.types",
        "from executive.app.run import run",
        "from executive.app.estimate import *",
        "from executive.s3e import S3E",
        "from executive.cli import exit_code; exit_code(['faults'])",
        "import executive.sim.world",
    ],
)
def test_all_is_decided_before_anything_is_loaded_that_computes(way_in: str) -> None:
    seen = fresh(f"{WATCH}\n{way_in}\nprint(json.dumps(seen))")
    assert isinstance(seen, dict)
    assert "numpy" in seen
    for name, environment in seen.items():
        assert None not in environment.values(), name
        assert environment[threads.WAIT_POLICY] == "PASSIVE"


def test_one_core_has_one_thread_whatever_the_machine_has() -> None:
    """torch, BLAS and OpenMP are asked, as they are after a run's imports."""
    found = fresh(
        "import json, os\n"
        "os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "import executive.s3e.backends.loading, torch, sklearn.utils._openmp_helpers as openmp\n"
        "from threadpoolctl import threadpool_info\n"
        "print(json.dumps([torch.get_num_threads(), *(each['num_threads'] for each in threadpool_info())]))"
    )
    assert isinstance(found, list)
    assert set(found) == {1}


@pytest.mark.parametrize(
    ("own", "kept"),
    [
        ({"OMP_NUM_THREADS": "3"}, {"OMP_NUM_THREADS": "3", "OMP_WAIT_POLICY": "PASSIVE"}),
        ({"OMP_WAIT_POLICY": "ACTIVE"}, {"OMP_WAIT_POLICY": "ACTIVE", "GOMP_SPINCOUNT": None}),
        ({"GOMP_SPINCOUNT": "100"}, {"GOMP_SPINCOUNT": "100", "OMP_WAIT_POLICY": None}),
        ({"KMP_BLOCKTIME": "1"}, {"OMP_WAIT_POLICY": None}),
        ({"LP_NUM_THREADS": "0", "NUMBA_NUM_THREADS": "1"}, {"LP_NUM_THREADS": "0", "NUMBA_NUM_THREADS": "1"}),
    ],
)
def test_what_the_user_has_said_stays_in_workers_too(own: dict[str, str], kept: dict[str, str | None]) -> None:
    told = f"{{name: os.environ.get(name) for name in {tuple(kept)!r}}}"
    script = f"import json, os\nfrom executive import threads\nhere = {told}\n"
    script += f"with threads.shared_by(4, alone=True): there = {told}\n"
    script += f"assert {told} == here\nprint(json.dumps([here, there, threads.settings()]))"
    found = fresh(script, **own)
    assert isinstance(found, list)
    here, there, settings = found
    assert here == kept
    assert {name: there[name] for name in own if name in kept} == {name: own[name] for name in own if name in kept}
    assert {name for name, (_, is_own) in settings.items() if is_own} == set(own)


def test_what_was_loaded_first_is_told_of_fewer_threads() -> None:
    found = fresh(
        "import json, torch, numpy\n"
        "from threadpoolctl import threadpool_info\n"
        "torch.set_num_threads(3)\n"
        "from executive.util import threads\n"
        "threads.limit_loaded(2)\n"
        "print(json.dumps([torch.get_num_threads(), *(each['num_threads'] for each in threadpool_info())]))"
    )
    assert isinstance(found, list)
    assert found[0] == 2
    assert max(found) <= 2


# --- those that work for it -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("workers", "alone", "sums"), [(1, True, "1"), (64, False, "1"), (1, False, None)])
def test_workers_share_the_cores(workers: int, alone: bool, sums: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    with multiprocessing.get_context("spawn").Pool(1) as pool:  # as it is without
        usual = pool.apply(threads.settings)
    with threads.shared_by(workers, alone=alone), multiprocessing.get_context("spawn").Pool(1) as pool:
        there = pool.apply(threads.settings)
    assert there[threads.OPENMP_THREADS][0] == (sums or usual[threads.OPENMP_THREADS][0])
    assert there[threads.RENDERING_THREADS][0] == str(max(1, threads.cores() // workers))
    assert there[threads.WAIT_POLICY][0] == "PASSIVE"
    assert not any(name in os.environ for name in NAMES)
