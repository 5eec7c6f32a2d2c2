"""What a parser may do with what it is given: return something, or say in one line what is wrong with it. It does not
hang, write outside the scratch folder, start a process or call anybody."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from executive.errors import ExecutiveError

PATIENCE = 10.0
"""Seconds of this process's own time that one input may take. Honest files take milliseconds."""

LONGEST = 2_000
"""Characters of an error message. Some list all the names that would have been valid, and quote what is wrong."""

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_PATHS = {"os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod",
          "shutil.rmtree", "shutil.move"}  # fmt: skip
_DEEDS = {"subprocess.Popen", "os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "socket.connect",
          "socket.getaddrinfo", "os.putenv", "pickle.find_class"}  # fmt: skip


class MisdeedError(AssertionError):
    """A parser did what none may do, or said badly what is wrong."""


class Hang(BaseException):
    """An input takes too long. No `except Exception` on the way keeps it."""


class _Watchman:
    """Looks at every audited event of the interpreter, while there is a scratch folder to keep to."""

    def __init__(self) -> None:
        self.scratch: str | None = None
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.scratch is None:
            return
        if (
            event == "open"
            and isinstance(arguments[2], int)
            and arguments[2] & _WRITING
            and not _is_cache(arguments[0])
        ):
            self._check("open", arguments[0])
        elif event in _PATHS:
            for path in arguments[:2]:
                self._check(event, path)
        elif event in _DEEDS:
            self._report(f"{event}: {arguments!r:.200}")

    def _check(self, event: str, path: object) -> None:
        if not isinstance(path, str | bytes | os.PathLike):
            return  # a file that is open already, or a mode
        real = os.path.realpath(os.fsdecode(path))
        if real not in (self.scratch, os.devnull) and not real.startswith(f"{self.scratch}{os.sep}"):
            self._report(f"{event}: {real}")

    def _report(self, what: str) -> None:
        scratch, self.scratch = self.scratch, None  # the report itself may open and write
        try:
            raise MisdeedError(what)
        finally:
            self.scratch = scratch


def _is_cache(path: object) -> bool:
    """Whether it is Python's own, of a module that is imported on the way."""
    return isinstance(path, str) and f"{os.sep}__pycache__{os.sep}" in path


_watchman: _Watchman | None = None


@contextmanager
def watched(scratch: Path) -> Iterator[None]:
    """What happens inside may write in `scratch` alone, and take no longer than `PATIENCE`. In the main thread only."""
    global _watchman
    if _watchman is None:
        _watchman = _Watchman()  # an audit hook stays for good

    def late(number: int, frame: FrameType | None) -> None:
        raise Hang(f"more than {PATIENCE:g} s")

    before = signal.signal(signal.SIGVTALRM, late)
    _watchman.scratch = str(scratch.resolve())
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        _watchman.scratch = None
        signal.signal(signal.SIGVTALRM, before)


def judged(read: Callable[[bytes, Path], object], data: bytes, scratch: Path) -> bool:
    """Whether a parser takes the input, or else says in one line what is wrong with it.

    Raises:
        MisdeedError: it says so badly, or does what none may do.
        Hang: it takes too long.
        Exception: whatever else it raises.
    """
    try:
        with watched(scratch):
            read(data, scratch)
    except ExecutiveError as error:
        said = str(error)
        if "\n" in said or not said.isprintable() or not said.strip() or len(said) > LONGEST:
            raise MisdeedError(f"no line that anybody wants to read: {said!r:.300}") from error
        return False
    return True
