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

OPENMP_THREADS, RENDERING_THREADS, NUMBA_THREADS = "OMP_NUM_THREADS", "LP_NUM_THREADS", "NUMBA_NUM_THREADS"
WAIT_POLICY, SPIN_COUNT = "OMP_WAIT_POLICY", "GOMP_SPINCOUNT"

_WAIT_SETTINGS = {WAIT_POLICY: "PASSIVE", SPIN_COUNT: "1000"}
"""The policy for any OpenMP, and the spin count for GNU's, which torch's wheels have and which takes precedence there:
iterations of a loop, about ten microseconds."""

_WAIT_VARIABLES = (*_WAIT_SETTINGS, "KMP_BLOCKTIME")
"""The variables by which a user may set how threads wait."""

_PROC, _CPUS = Path("/proc/self"), Path("/sys/devices/system/cpu")

_decided: dict[str, str] = {}
"""The variables that this module has set."""


def cores() -> int:
    """Return how many cores this process may use: those of its affinity mask, and no more than its quota of CPU time
    (of its control group, as in a container), rounded up."""
    allowed = len(_allowed())
    time = quota(_PROC)
    return allowed if time is None else max(1, min(allowed, math.ceil(time)))


def quota(process: Path) -> float | None:
    """Return the CPU time quota of a process's control groups, in cores, or None where they set no limit.

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
    """Return the environment variables that apply to this process, each with its value and whether the user set it."""
    computing = (OPENMP_THREADS, "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    names = (*computing, *_WAIT_VARIABLES, RENDERING_THREADS, NUMBA_THREADS)
    return {name: (os.environ[name], not _is_ours(name)) for name in names if name in os.environ}


@contextmanager
def shared_by(workers: int, alone: bool = False) -> Iterator[None]:
    """Divide the cores among processes that are spawned meanwhile, at least one for each.

    Args:
        workers: how many there will be at the same time.
        alone: each does its arithmetic on one thread, however many workers there are, so that their number changes no
            rounding.
    """
    before = {
        name: os.environ.get(name) for name in (OPENMP_THREADS, RENDERING_THREADS, NUMBA_THREADS, *_WAIT_SETTINGS)
    }
    wanted = _wanted(workers) | ({OPENMP_THREADS: "1"} if alone else {})
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
        loaded = name == NUMBA_THREADS and "numba" in sys.modules  # which refuses another number once it has begun
        if name not in os.environ and not loaded:
            os.environ[name] = _decided[name] = value
    if {"numpy", "torch"} & sys.modules.keys() and cores() < len(_allowed()) and _is_ours(OPENMP_THREADS):
        limit_loaded(cores())


def _wanted(workers: int) -> dict[str, str]:
    each = max(1, cores() // workers)
    arithmetic = max(1, min(_full_cores(), cores()) // workers)
    wanted = {OPENMP_THREADS: str(arithmetic), RENDERING_THREADS: str(each), NUMBA_THREADS: str(each)}
    users = any(name in os.environ and not _is_ours(name) for name in _WAIT_VARIABLES)
    return wanted if users else wanted | _WAIT_SETTINGS


def _is_ours(name: str) -> bool:
    return name in _decided and os.environ.get(name) == _decided[name]


def _allowed() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _full_cores() -> int:
    """Return the number of allowed physical cores: hyper-threads of one core count once, as in MKL."""
    siblings = []
    with suppress(OSError):
        siblings = [(_CPUS / f"cpu{each}/topology/thread_siblings_list").read_text() for each in _allowed()]
    return len(set(siblings)) or len(_allowed())


def _limits(mount: Path, path: str) -> Iterator[float]:
    """Yield the quotas of this control group and of those above it, in cores."""
    group = mount if path.startswith("..") else mount / path  # inside of a container, its group may be the mount
    for folder in (group, *group.parents):
        if not folder.is_relative_to(mount):
            return
        for files in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
            with suppress(OSError, ValueError):
                granted, period = " ".join((folder / file).read_text() for file in files).split()
                if granted not in ("max", "-1"):
                    yield int(granted) / int(period)


def limit_loaded(most: int) -> None:
    """Limit libraries that are already loaded to so many threads."""
    from threadpoolctl import ThreadpoolController

    for library in ThreadpoolController().lib_controllers:
        if library.num_threads > most:
            library.set_num_threads(most)
    torch = sys.modules.get("torch")
    if torch is not None and torch.get_num_threads() > most:
        torch.set_num_threads(most)  # for other threads than this one, too


_set_environment()
