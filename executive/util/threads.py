"""Sets how many threads a process computes with, and that they sleep soon while they wait.

Importing `executive` or anything in it sets this, in every process: the command line, a notebook, spawned workers.
torch, OpenMP, BLAS, numba and Mesa's software renderer read what is decided from the environment as they are loaded.
What is set there already is the user's and stays; MKL and OpenBLAS go by `OMP_NUM_THREADS` where they have no variable
of their own.

OpenMP's threads spin while they wait for each other. On a busy machine they wait for one that has no core, and take the
cores away from the one they wait for: a look takes ten times as long and more. Threads that sleep at once are a quarter
slower on an idle machine, as much of a look is in short sums one after the other. Ten microseconds of spinning cost
next to nothing on a busy machine, and bridge those.

A program that imports torch before `executive` has torch spin, which nothing can change afterwards: it should import
`executive` first, or set `OMP_WAIT_POLICY=PASSIVE` itself. How many threads there are can be changed later: where numpy
or torch came first and took more than there are cores (they know of no quota), their number is lowered.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SUMS, DRAWING, COMPILED = "OMP_NUM_THREADS", "LP_NUM_THREADS", "NUMBA_NUM_THREADS"
WAITING, SPINNING = "OMP_WAIT_POLICY", "GOMP_SPINCOUNT"

_WAITING = {WAITING: "PASSIVE", SPINNING: "1000"}
"""What holds for any OpenMP, and what for GNU's, which torch's wheels have, goes before it: turns of a loop, about ten
microseconds."""

_ALL_WAITING = (*_WAITING, "KMP_BLOCKTIME")
"""The variables by which a user may have set how threads wait."""

_PROC, _CPUS = Path("/proc/self"), Path("/sys/devices/system/cpu")

_decided: dict[str, str] = {}
"""The variables that this module has set."""


def cores() -> int:
    """The cores that this process may use: those that it is not kept from, and no more than its share of their time
    (the quota of a control group, as containers have it) comes to, rounded up."""
    allowed = len(_allowed())
    time = quota(_PROC)
    return allowed if time is None else max(1, min(allowed, math.ceil(time)))


def quota(process: Path) -> float | None:
    """How many cores' time the control groups of a process grant it, or None where they set no limit.

    Args:
        process: its folder in /proc.
    """
    found: list[float] = []
    with suppress(OSError, ValueError, LookupError):  # another system, or one that hides them
        groups = [line.split(":", 2)[1:] for line in (process / "cgroup").read_text().splitlines()]
        for line in (process / "mountinfo").read_text().splitlines():
            fields = line.split()
            root, mount = fields[3:5]
            kind, _, options = fields[fields.index("-") + 1 :][:3]
            for controllers, path in groups:
                unified = kind == "cgroup2" and not controllers
                if unified or (kind == "cgroup" and "cpu" in controllers.split(",") and "cpu" in options.split(",")):
                    found += _limits(Path(mount), os.path.relpath(path, root))
    return min(found, default=None)


def settings() -> dict[str, tuple[str, bool]]:
    """The variables that hold in this process, each with its value and whether it is the user's own."""
    names = (SUMS, "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", *_ALL_WAITING, DRAWING, COMPILED)
    return {name: (os.environ[name], not _is_ours(name)) for name in names if name in os.environ}


@contextmanager
def shared_by(workers: int, alone: bool = False) -> Iterator[None]:
    """Have processes that are spawned meanwhile share the cores: each takes its part of them, one at least.

    Args:
        workers: how many there will be at the same time.
        alone: each does its sums on one thread, however many workers there are: then their number changes no sum.
    """
    before = {name: os.environ.get(name) for name in (SUMS, DRAWING, COMPILED, *_WAITING)}
    wanted = _wanted(workers) | ({SUMS: "1"} if alone else {})
    os.environ.update({name: value for name, value in wanted.items() if before[name] is None or _is_ours(name)})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _set_environment() -> None:
    """Set the variables that the user has not set."""
    for name, value in _wanted(1).items():
        loaded = name == COMPILED and "numba" in sys.modules  # which takes another number ill once it has begun
        if name not in os.environ and not loaded:
            os.environ[name] = _decided[name] = value
    if {"numpy", "torch"} & sys.modules.keys() and cores() < len(_allowed()) and _is_ours(SUMS):
        lower(cores())


def _wanted(workers: int) -> dict[str, str]:
    each = max(1, cores() // workers)
    sums = max(1, min(_full_cores(), cores()) // workers)
    wanted = {SUMS: str(sums), DRAWING: str(each), COMPILED: str(each)}
    users = any(name in os.environ and not _is_ours(name) for name in _ALL_WAITING)
    return wanted if users else wanted | _WAITING


def _is_ours(name: str) -> bool:
    return name in _decided and os.environ.get(name) == _decided[name]


def _allowed() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _full_cores() -> int:
    """The allowed cores, two that share their arithmetic (hyper-threads) counted as one, as MKL does."""
    siblings = []
    with suppress(OSError):
        siblings = [(_CPUS / f"cpu{each}/topology/thread_siblings_list").read_text() for each in _allowed()]
    return len(set(siblings)) or len(_allowed())


def _limits(mount: Path, path: str) -> Iterator[float]:
    """What each group from this one upwards is granted, in cores' time."""
    group = mount if path.startswith("..") else mount / path  # inside of a container, its group may be the mount
    for folder in (group, *group.parents):
        if not folder.is_relative_to(mount):
            return
        for files in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
            with suppress(OSError, ValueError):
                granted, period = " ".join((folder / file).read_text() for file in files).split()
                if granted not in ("max", "-1"):
                    yield int(granted) / int(period)


def lower(most: int) -> None:
    """Limit libraries that are already loaded to so many threads."""
    from threadpoolctl import ThreadpoolController

    for library in ThreadpoolController().lib_controllers:
        if library.num_threads > most:
            library.set_num_threads(most)
    torch = sys.modules.get("torch")
    if torch is not None and torch.get_num_threads() > most:
        torch.set_num_threads(most)  # for other threads than this one, too


_set_environment()
