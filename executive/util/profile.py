"""Where a program's wall time goes: by stage, and by what is imported.

At every moment the time counts for the innermost stage that is open, in whichever thread: a skill's thread has stages
of its own while the loop waits for it. Nothing is measured, and `stage` costs next to nothing, until `start`.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OTHER = "other"
START = "start the interpreter and read the command line"

IMPORT = "import "
"""What a stage's name begins with that is the import of a package."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Seconds of wall time: in all, by stage, and by the package that was imported, without what others brought in."""

    total: float
    stages: Mapping[str, float]
    imports: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON, rounded to milliseconds."""
        return {
            "seconds": round(self.total, 3),
            "stages": {name: round(seconds, 3) for name, seconds in self.stages.items()},
            "imports": {name: round(seconds, 3) for name, seconds in self.imports.items()},
        }


class _Clock:
    """Divides time among what is open."""

    def __init__(self) -> None:
        now = time.perf_counter()
        self._lock = threading.Lock()
        self._open: list[list[str]] = [[OTHER]]  # lists, as they are told apart by which they are
        self._spent: defaultdict[str, float] = defaultdict(float, {START: _since_start()})
        self._began, self._since = now - self._spent[START], now

    def enter(self, name: str) -> list[str]:
        entry = [name]
        with self._lock:
            self._charge()
            self._open.append(entry)
        return entry

    def leave(self, entry: list[str]) -> None:
        """Close what was entered, wherever it is: a thread that was given up may be late."""
        with self._lock:
            self._charge()
            self._open = [each for each in self._open if each is not entry]

    def read(self) -> Profile:
        with self._lock:
            self._charge()
            spent = sorted(self._spent.items(), key=lambda each: -each[1])
        imports = {name.removeprefix(IMPORT): seconds for name, seconds in spent if name.startswith(IMPORT)}
        stages = {name: seconds for name, seconds in spent if not name.startswith(IMPORT)}
        return Profile(self._since - self._began, stages, imports)

    def _charge(self) -> None:
        now = time.perf_counter()
        self._spent[self._open[-1][0]] += now - self._since
        self._since = now


_clock: _Clock | None = None


def start() -> None:
    """Begin to measure. The time since the process began counts as that of `START` (Linux)."""
    global _clock
    _clock = _Clock()
    _watch_imports()


def read() -> Profile:
    """Return what was measured since `start`.

    Raises:
        ValueError: nothing is measured.
    """
    if _clock is None:
        raise ValueError("nothing is measured: call start() first")
    return _clock.read()


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Count what happens inside as this stage, but for the stages within it."""
    clock = _clock
    if clock is None:
        yield
        return
    entry = clock.enter(name)
    try:
        yield
    finally:
        clock.leave(entry)


def _watch_imports() -> None:
    """Count the import of each module as a stage of its package. Other threads import while something else goes on."""
    bootstrap: Any = importlib._bootstrap
    load, main = bootstrap._load_unlocked, threading.main_thread()
    if getattr(load, "is_watched", False):
        return

    def watched(spec: Any) -> Any:
        if threading.current_thread() is not main:
            return load(spec)
        with stage(IMPORT + spec.name.partition(".")[0]):
            return load(spec)

    watched.is_watched = True  # type: ignore[attr-defined]
    bootstrap._load_unlocked = watched


def _since_start() -> float:
    """Return for how many seconds this process has lived; 0 where the system does not say."""
    if sys.platform != "linux":
        return 0.0
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(") ")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return 0.0
    return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK"))
