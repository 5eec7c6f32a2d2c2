"""Runs work with a time limit, and lets go of it when the time is up.

The work is done in a thread of its own, which nothing interrupts: an exception that is thrown into the middle of torch,
MuJoCo or a planner's bindings leaves them in no state to go on with. Work whose time is up is given up: the processes
that it has started are ended, whatever it does under `exclusive` from then on raises, and what it returns is dropped.
What has to be ended wherever it is has to be in a process.
"""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from contextvars import Context, copy_context
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeVar

_STACK = 16 << 20
"""Bytes of a worker's stack: other systems than Linux give a thread far less than the main thread has."""

_T = TypeVar("_T")


class TimeLimitError(Exception):
    """Work exceeded its time limit and was given up."""


def within(seconds: float, work: Callable[[], _T]) -> _T:
    """Call `work` in another thread and return its result.

    Raises:
        TimeLimitError: it took longer than so many wall seconds. It was given up, and every process that it had started
            has ended.
    """
    task, before = _Task(work, copy_context()), _children()
    worker = _idle.pop() if _idle else _Worker()
    worker.tasks.put(task)
    try:
        wait([task.result], None if math.isinf(seconds) else max(0.0, seconds))
        if task.result.done():
            result: _T = task.result.result()
            return result
        for child in _children() - before:
            _end(child)
    finally:
        if task.result.done():
            _idle.append(worker)
        else:
            task.give_up()
            worker.tasks.put(None)  # if it ever comes to an end, the thread does
    raise TimeLimitError(f"more than {round(seconds, 2):g} s")


@contextmanager
def exclusive() -> Iterator[None]:
    """Keep the block whole: work whose time is up is given up before it or after it.

    Raises:
        TimeLimitError: the work that this thread does has been given up.
    """
    task: _Task | None = getattr(_here, "task", None)
    if task is None:
        yield
        return
    with task.whole:
        if task.given_up:
            raise TimeLimitError("its time was up")
        yield


class _Task:
    """Work for a worker, and what has become of it."""

    def __init__(self, work: Callable[[], Any], context: Context) -> None:
        self._work, self._context = work, context
        self.result: Future[Any] = Future()
        self.whole, self.given_up = threading.RLock(), False

    def give_up(self) -> None:
        """Have the work do nothing more that counts. What it does under `exclusive` at the moment is waited for."""
        with self.whole:
            self.given_up = True

    def run(self) -> None:
        _here.task = self
        try:
            result = self._context.run(self._work)
        except BaseException as error:  # raised again in the thread that waits for it
            self.result.set_exception(error)
        else:
            self.result.set_result(result)
        finally:
            _here.task = None


class _Worker:
    """A thread that does one piece of work after the other. It is kept for the next one: for each thread that calls it,
    OpenMP makes threads of its own."""

    def __init__(self) -> None:
        self.tasks: SimpleQueue[_Task | None] = SimpleQueue()
        before = threading.stack_size(_STACK)
        try:
            threading.Thread(target=_serve, args=(self.tasks,), name="limited", daemon=True).start()
        finally:
            threading.stack_size(before)


def _serve(tasks: SimpleQueue[_Task | None]) -> None:
    while (task := tasks.get()) is not None:
        task.run()
        del task  # what it refers to is not kept between two


_idle: list[_Worker] = []
_here = threading.local()


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
