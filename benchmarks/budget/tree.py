"""What a program and all processes that it starts take: processor time, and memory by what each has for itself."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

MEBIBYTE = 1 << 20
_EVERY = 0.1
"""Seconds between two looks at the processes. On a very busy machine they become many more, and short peaks are missed:
memory is to be measured on a quiet one."""


@dataclass(frozen=True, slots=True)
class Spent:
    """What a program took. `mebibytes` is the peak of its process tree (proportional set sizes: what several share is
    counted once), `parts` what each process had of that, by its command; `cpu` the processor time of all of it."""

    wall: float
    cpu: float
    mebibytes: float
    parts: Mapping[str, float] = field(default_factory=dict)
    said: str = ""


def run_watched(
    command: Sequence[str], until: str | None = None, environment: Mapping[str, str] | None = None
) -> Spent:
    """Run a program and watch it and its processes (Linux), to its end or until it prints a line that begins with
    `until`; then it is ended.

    Raises:
        RuntimeError: it failed.
    """
    _adopt()
    began = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env={**os.environ, **(environment or {})}
    )
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    cpu: dict[int, float] = {}
    peak, parts, said, wall = 0.0, dict[str, float](), b"", None
    while process.poll() is None:
        said += process.stdout.read() or b""
        if until is not None and f"\n{until}".encode() in b"\n" + said:
            wall = time.perf_counter() - began
        now = {pid: memory for pid in tree(process.pid) if (memory := proportional(pid)) is not None}
        for pid in tree(process.pid):
            cpu[pid] = max(cpu.get(pid, 0.0), processor_time(pid))
        if sum(now.values()) > peak:
            peak = sum(now.values())
            parts = {f"{_command(pid)} [{pid}]": round(memory) for pid, memory in now.items() if memory >= 1.0}
        if wall is not None:
            for pid in reversed(tree(process.pid)):
                with suppress(ProcessLookupError):
                    os.kill(pid, 9)
        time.sleep(_EVERY)
    said += process.stdout.read() or b""
    process.stdout.close()
    with suppress(ChildProcessError):  # what it left behind has been killed, and counts as ours once it is waited for
        while os.waitpid(-1, os.WNOHANG if wall is None else 0)[0]:
            pass
    if wall is None and process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return Spent(wall or time.perf_counter() - began, sum(cpu.values()), peak, parts, said.decode())


def _adopt() -> None:
    """Have what a child leaves behind become a child of this process, so that its time is counted."""
    become_subreaper = 36  # PR_SET_CHILD_SUBREAPER
    ctypes.CDLL(None).prctl(become_subreaper, 1, 0, 0, 0)


def tree(root: int) -> list[int]:
    """Return a process and all that it has started, as far as they live."""
    found, waiting = [], [root]
    while waiting:
        pid = waiting.pop()
        found.append(pid)
        for task in Path(f"/proc/{pid}/task").glob("*/children"):
            with suppress(OSError):
                waiting += map(int, task.read_text().split())
    return found


def processor_time(pid: int) -> float:
    """Return the seconds of processor time of a process and of those of its children that have ended."""
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def proportional(pid: int) -> float | None:
    """Return the proportional set size of a process in MiB; None once it has gone."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024 / MEBIBYTE
    return None


def _command(pid: int) -> str:
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        told = (word for word in words if not word.startswith("/"))  # folders tell of the machine alone
        return " ".join(" ".join(told).split())[-40:].strip()
    return sys.executable
