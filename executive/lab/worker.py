"""The processes that play a collection's episodes. They write the episodes' files themselves."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from executive.errors import InputError
from executive.lab import dataset
from executive.lab.dataset import Log
from executive.lab.episode import Collector
from executive.spawned import deaf, leave_with_parent
from executive.threads import cores, shared_by


class Pool:
    """Processes to play episodes with, spawned as they are needed. A context manager; on the way out whoever still
    plays comes to rest within a moment, and that episode is lost.

    Args:
        prepare: called in each process.
        collection: what the files belong to.
        jobs: how many; as many as there are cores when not given.
    """

    def __init__(
        self,
        prepare: Callable[[], Collector],
        out: Path,
        collection: str,
        cameras: tuple[str, ...],
        jobs: int | None,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self.jobs = jobs or cores()
        self._stop, self._made = context.Event(), context.Value("q", 0)
        arguments = (prepare, out, collection, cameras, self._stop, self._made)
        self._executor = ProcessPoolExecutor(self.jobs, mp_context=context, initializer=_begin, initargs=arguments)

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._executor.shutdown()

    @property
    def made(self) -> int:
        """The points of all episodes so far, finished or not."""
        return int(self._made.value)

    def submit(self, number: int, most: int) -> Future[Log | None]:
        """Have an episode played and written, cut after `most` points."""
        with deaf(), shared_by(self.jobs):
            return self._executor.submit(_work, number, most)


class _Post(NamedTuple):
    """What a process works with, and what it shares with the one that spawned it."""

    collector: Collector
    out: Path
    collection: str
    cameras: tuple[str, ...]
    stop: Any
    made: Any


_post: _Post | None = None


def _begin(prepare: Callable[[], Collector], *rest: Any) -> None:
    global _post
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is heard by the first process, which says when to stop
    threading.Thread(target=leave_with_parent, daemon=True).start()
    _post = _Post(prepare(), *rest)


def _work(number: int, most: int) -> Log | None:
    assert _post is not None
    post = _post

    def tell() -> None:
        with post.made.get_lock():
            post.made.value += 1

    episode = post.collector.play(number, most, post.stop.is_set, tell)
    if episode is None:
        return None
    try:
        atoms = post.collector.domain.task.atoms
        dataset.write_shard(post.out, post.collection, episode.log, episode.points, atoms, post.cameras)
    except OSError as error:
        raise InputError(f"cannot be written to ({error.strerror})", file=post.out) from None
    return episode.log
