"""Processes that are spawned to work for this one: they hear no order to end, and they leave with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

ORDERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What asks a process to end. The first process hears it, and ends those that work for it."""

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG, of Linux's prctl."""


def settle(last: Callable[[], object] | None = None) -> None:
    """Have this process, which was spawned under `deaf`, hear no order to end, and leave with its parent however that
    ends: one whose parent was killed would wait for work for ever, or go on writing. To be called first of all.

    Args:
        last: done before it leaves. Without it, the system ends it at once where it can (Linux).
    """
    # Handlers that do nothing, unlike signals that are ignored, are not handed down to programs started from here.
    for each in ORDERS:
        signal.signal(each, _unheard)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ORDERS)
    if last is None:
        _die_with_parent()
    threading.Thread(target=_leave_with_parent, args=(last,), name="parent", daemon=True).start()


@contextmanager
def deaf() -> Iterator[None]:
    """Have a process that is spawned meanwhile hear no order to end from its first moment on. What comes to this
    process in the meantime is heard afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ORDERS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _unheard(number: int, frame: FrameType | None) -> None:
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


def _leave_with_parent(last: Callable[[], object] | None) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        if last is not None:
            last()
        os._exit(1)
