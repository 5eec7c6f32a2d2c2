"""Worker processes that ignore termination signals and exit with their parent process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import FrameType

TERMINATION_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a process to end. Only the parent handles them, and ends its workers."""

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG, of Linux's prctl."""


def exit_with_parent(last: Callable[[], object] | None = None, parent_ends: Callable[[], object] | None = None) -> None:
    """Have this process, which was spawned under `block_signals`, ignore termination signals and exit when its parent
    ends, however that happens: a worker whose parent was killed would wait for work for ever, or go on writing. It has
    to be called first of all.

    Args:
        last: called before the process exits. Without it, the kernel kills the process at once where it can (Linux).
        parent_ends: returns when the parent has ended; by default, the parent is the one that multiprocessing knows.
    """
    # Handlers that do nothing, unlike ignored signals, are not inherited by programs that are started from here.
    for each in TERMINATION_SIGNALS:
        signal.signal(each, _ignore)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, TERMINATION_SIGNALS)
    if last is None:
        _die_with_parent()
    waiting = (last, parent_ends or _parent_ends)
    threading.Thread(target=_exit_afterwards, args=waiting, name="parent", daemon=True).start()


@contextmanager
def block_signals() -> Iterator[None]:
    """Block termination signals, so that a process spawned meanwhile never receives one. Signals to this process are
    delivered afterwards."""
    # The first process that is spawned would start it, and it unblocks SIGINT and SIGTERM in this process as it does.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, TERMINATION_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ignore(number: int, frame: FrameType | None) -> None:
    """Nothing."""


def _die_with_parent() -> None:
    if not sys.platform.startswith("linux"):
        return
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, int(signal.SIGKILL), 0, 0, 0)
    parent = multiprocessing.parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it was gone before
        os._exit(1)


def _parent_ends() -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        threading.Event().wait()
    else:
        parent.join()


def _exit_afterwards(last: Callable[[], object] | None, parent_ends: Callable[[], object]) -> None:
    parent_ends()
    if last is not None:
        last()
    os._exit(1)
