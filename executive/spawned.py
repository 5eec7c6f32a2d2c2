"""Processes that are spawned to work for this one: they hear no Ctrl-C, and they leave with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def leave_with_parent(last: Callable[[], object] = lambda: None) -> None:
    """Wait until the parent is gone, do one thing more, and end this process: one whose parent was killed would wait
    for work for ever. For a thread of its own."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        last()
        os._exit(1)


@contextmanager
def deaf() -> Iterator[None]:
    """Have a process that is spawned meanwhile ignore Ctrl-C from its first moment on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
