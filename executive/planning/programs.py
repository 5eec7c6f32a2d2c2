"""A planner's programs, each run in a process of its own: with limits on time and memory, and nothing of it runs on.

Fast Downward is GPL-3. Nothing of it is imported: its translator and its search are programs that read and write files.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from executive.errors import MissingError

PACKAGE, ENGINE = "up_fast_downward", "downward/builds/release/bin/downward"
"""The package that brings Fast Downward's search, and where the program is in it."""

TRANSLATOR = "fast_downward.translate"
"""Fast Downward's translator, a module to be run."""

_INSTALL = "pip install up-fast-downward"

_WATCH = """while read -r sign pid; do
    rest=; for each in $all; do [ "$each" = "$pid" ] || rest="$rest $each"; done; all=$rest
    [ "$sign" = - ] || all="$all $pid"
done
for pid in $all; do kill -9 "-$pid"; done"""
"""Is told which programs run (`+ 12`) and which have ended (`- 12`), and kills those that run once nobody can tell it
any more: that is when this process has ended, however that happened."""

_BOOKKEEPING = re.compile(
    r"(?i)^\[t=|^INFO\b|exit ?code|^peak memory|^\w+ time:|^remove intermediate|^driver aborting|^usage error occurred"
)
"""Lines that Fast Downward prints however it ended."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a program ended: its exit code (negative where it was killed), what it printed, and whether it was ended
    because its time was up."""

    code: int
    said: str
    expired: bool

    @property
    def last_words(self) -> str:
        """The line that says most about how it ended."""
        return last_words(self.said.splitlines())


def run_program(
    command: Sequence[str], folder: Path, seconds: float, stdin: Path | None = None, processor: float | None = None
) -> Ended:
    """Run a program in a folder for at most so many wall seconds, and about as many of the processor's unless
    `processor` says how many of these. Nothing of it runs on afterwards, whatever happens.

    Raises:
        OSError: it cannot be started.
    """
    with open(os.devnull if stdin is None else stdin, "rb") as source:
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=source,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            env={**os.environ, "PYTHONHASHSEED": "0"},  # so that it writes the same whenever it is asked the same
        )
    expired, said = False, ""
    try:
        _limit(process.pid, math.ceil(seconds if processor is None else processor) + 1)
        _watch("+", process.pid)
        said, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        expired = True
    finally:
        _end(process)
        _watch("-", process.pid)
    return Ended(process.returncode, said, expired)


def last_words(lines: Sequence[str]) -> str:
    """Of what a program printed, the line that says most about how it ended: the last one that it does not print
    however it ends, or else the last."""
    said = [line.strip() for line in lines if line.strip()]
    telling = [line for line in said if not _BOOKKEEPING.search(line)]
    return (telling or said or ["it said nothing"])[-1]


def find_search() -> Path:
    """Where Fast Downward's search is.

    Raises:
        MissingError: it is not installed.
    """
    package = importlib.util.find_spec(PACKAGE)
    for place in () if package is None else package.submodule_search_locations or ():
        if (Path(place) / ENGINE).exists():
            return Path(place) / ENGINE
    raise MissingError("Fast Downward is not installed", command=_INSTALL)


def translator_command(module: str = TRANSLATOR) -> list[str]:
    """What runs a module of Fast Downward's translator.

    Raises:
        MissingError: it is not installed.
    """
    try:
        found = importlib.util.find_spec(TRANSLATOR)
    except ModuleNotFoundError:
        found = None
    if found is None:
        raise MissingError("Fast Downward's translator is not installed", command=_INSTALL)
    return [sys.executable, "-m", module]


@cache
def memory_limit() -> int:
    """The bytes of address space that a program may take: three quarters of the machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * 3 // 4


def _limit(pid: int, seconds: int) -> None:
    """Limit a program's processor time and memory, where the system can (Linux): that ends it even where this process
    cannot any more."""
    if sys.platform == "linux":
        with contextlib.suppress(ProcessLookupError):
            resource.prlimit(pid, resource.RLIMIT_CPU, (seconds, seconds + 1))  # first it is told, then it is killed
            resource.prlimit(pid, resource.RLIMIT_AS, (memory_limit(), memory_limit()))


_watching: int | None = None
"""Where to tell the watching process what runs."""


def _watch(sign: str, pid: int) -> None:
    """Tell the watching process of a program; it is started with the first one."""
    global _watching
    if _watching is None:
        read, _watching = os.pipe()
        quiet = [(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_WRONLY, 0) for number in (1, 2)]
        files = [(os.POSIX_SPAWN_DUP2, read, 0), *quiet]
        os.posix_spawn("/bin/sh", ["sh", "-c", _WATCH], {}, file_actions=files, setsid=True)
        os.close(read)
    try:
        os.write(_watching, f"{sign} {pid}\n".encode())
    except BrokenPipeError:  # somebody has killed it
        os.close(_watching)
        _watching = None


def _end(process: subprocess.Popen[str]) -> None:
    """Kill a process and the group that it leads. There is nothing in it worth a farewell."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


@dataclass(frozen=True, slots=True)
class Answer:
    """How a search ended, and the names of its plan's operators where it found one."""

    ended: Ended
    plan: tuple[str, ...]


class SasFile:
    """A task written down for Fast Downward's search, to be searched in several ways. A context manager: the file is
    there within it."""

    def __init__(self, program: Path, text: str) -> None:
        self._program, self._text = program, text

    def __enter__(self) -> SasFile:
        self._folder = tempfile.TemporaryDirectory(prefix="executive-plan-")
        self._path = Path(self._folder.name)
        (self._path / "task.sas").write_text(self._text, encoding="ascii")
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def search(self, search: str, seconds: float) -> Answer:
        """What a search finds within so many seconds of wall time.

        Raises:
            OSError: the engine cannot be started.
        """
        plan = self._path / "plan"
        plan.unlink(missing_ok=True)
        command = [str(self._program), "--search", search, "--internal-plan-file", "plan"]
        ended = run_program(command, self._path, seconds, self._path / "task.sas")
        lines = plan.read_text(encoding="ascii").splitlines() if plan.exists() else []
        return Answer(ended, tuple(line[1:-1] for line in lines if line.startswith("(")))
