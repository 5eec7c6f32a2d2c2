"""Runs work with a time limit, and ends it and the processes that it has started when the time is up.

The main thread is interrupted by a signal, which also ends a system call that waits. Other threads cannot be: work in
them is left to end by itself.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TypeVar

_AGAIN = 0.5
"""Wall seconds after which work that continues nevertheless is interrupted again."""

_SIGNAL = signal.SIGUSR2
_T = TypeVar("_T")


class TimeLimitError(Exception):
    """Work exceeded its time limit and was ended."""


def within(seconds: float, work: Callable[[], _T]) -> _T:
    """Call `work` and return its result.

    Raises:
        TimeLimitError: it took longer than so many wall seconds. What it was doing was ended, and so was every process
            that it had started.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    alarm, before = _Alarm(seconds), _children()
    try:
        try:
            alarm.start()
            return work()
        finally:
            alarm.silence()
    except _Interrupt as interrupt:
        if interrupt.alarm is not alarm:
            raise
        for child in _children() - before:
            _end(child)
        raise TimeLimitError(f"more than {round(seconds, 2):g} s") from None


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Keep the block from being interrupted: it is short and must not be left half done."""
    global _busy
    _busy += 1
    try:
        yield
    finally:
        _busy -= 1


class _Interrupt(BaseException):
    """Raised in the middle of work whose time is up; no `except Exception` in it keeps it."""

    def __init__(self, alarm: _Alarm) -> None:
        super().__init__()
        self.alarm = alarm


class _Alarm:
    """Interrupts the main thread when the time is up, and again until the work ends."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._over, self.rings = seconds, threading.Event(), False

    def start(self) -> None:
        # Once installed, the handler stays: a signal that comes late finds it, and no alarm that rings.
        if signal.getsignal(_SIGNAL) is not _heard:
            signal.signal(_SIGNAL, _heard)
        _alarms.append(self)
        threading.Thread(target=self._watch, name="alarm", daemon=True).start()

    def silence(self) -> None:
        self._over.set()
        self.rings = False
        if self in _alarms:
            _alarms.remove(self)

    def _watch(self) -> None:
        wait = self._seconds
        while not self._over.wait(wait):
            self.rings, wait = True, _AGAIN
            signal.pthread_kill(threading.main_thread().ident or 0, _SIGNAL)


_alarms: list[_Alarm] = []
"""Those that are set, the outermost first. Only the main thread changes it."""
_busy = 0


def _heard(number: int, frame: FrameType | None) -> None:
    for alarm in _alarms:
        if alarm.rings and not _busy:
            raise _Interrupt(alarm)


def _children() -> frozenset[int]:
    """Return the processes that descend from this one; none where the system does not tell."""
    found: set[int] = set()
    waiting = [os.getpid()]
    while waiting:
        for file in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            try:
                new = set(map(int, file.read_text().split())) - found
            except OSError:  # it has ended meanwhile
                continue
            found |= new
            waiting += new
    return frozenset(found)


def _end(process: int) -> None:
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        return
