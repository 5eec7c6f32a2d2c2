"""A pool of worker processes on this machine, each with one job at a time, for collections, trainings, evaluations and
campaigns. `executive.lab.common.ray_pool` has the same interface over Ray; results do not depend on which is used.

A worker that dies loses its own job and no other. A worker whose job exceeds the time limit is killed with its process
group. The next job gets a new process. An exception that a job raises arrives with its own type.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import pickle
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Generic, Protocol, TypeVar

from executive.errors import ExecutiveError
from executive.util.processes import block_signals, exit_with_parent
from executive.util.threads import cores, shared_by

TRIES = 3
"""How many times a job is started, at most, whose worker was lost each time."""

TICK = 0.2
"""Seconds for which `run_jobs` waits for results at a time."""

J = TypeVar("J")
V = TypeVar("V")

ReportProgress = Callable[[float], None]
"""Reports how much of a job is done, in the unit in which its work is counted."""

Work = Callable[[J, ReportProgress], V]
"""Computes the result of a job. It may raise any exception."""


class WorkerLostError(ExecutiveError):
    """The worker of a job died, or was killed at the time limit."""


@dataclass(frozen=True, slots=True)
class JobResult(Generic[J, V]):
    """The result of a job: the value it returned or the exception it raised, and how many wall `seconds` it took."""

    job: J
    outcome: V | Exception
    seconds: float

    def value(self) -> V:
        """Returns the value, or raises the exception of the job."""
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


class WorkerPool(Protocol[J, V]):
    """Runs several jobs at a time. A context manager: at its exit running workers are killed, and their jobs are
    lost."""

    def __enter__(self) -> WorkerPool[J, V]: ...

    def __exit__(self, *_: object) -> None: ...

    @property
    def free(self) -> int:
        """The number of jobs that could be submitted now."""
        ...

    @property
    def running_progress(self) -> float:
        """The sum of the progress that running jobs have reported."""
        ...

    def submit(self, job: J) -> None:
        """Starts a job on an idle worker."""
        ...

    def gather(self, timeout: float) -> list[JobResult[J, V]]:
        """Returns the results that have arrived, after waiting at most `timeout` seconds for one."""
        ...


def run_jobs(
    pool: WorkerPool[J, V], next_job: Callable[[], J | None], stopped: Callable[[], bool], tries: int = TRIES
) -> Iterator[list[JobResult[J, V]]]:
    """Runs jobs until none is left or `stopped` returns true; yields the results of each interval, several times a
    second.

    Args:
        next_job: returns the next job, or None while there is none; None with no running job ends the iteration.
        tries: how many times a job is started, at most, whose worker was lost each time.
    """
    retries: list[J] = []
    lost: list[J] = []
    busy = 0
    while not stopped():
        while pool.free and (job := retries.pop() if retries else next_job()) is not None:
            pool.submit(job)
            busy += 1
        if not busy:
            return
        results = []
        for each in pool.gather(TICK):
            busy -= 1
            if isinstance(each.outcome, WorkerLostError):
                lost.append(each.job)
                if lost.count(each.job) < tries:
                    retries.append(each.job)
                    continue
            results.append(each)
        yield results


def run_captured(work: Callable[[], V]) -> V | Exception:
    """Runs a job and returns its value or its exception in a form that can be pickled. An exception that cannot be
    pickled becomes a RuntimeError with the same text; each carries the worker's traceback as a note."""
    try:
        return work()
    except Exception as error:  # whatever the job raised is its result, and raised again where it was asked for
        error.add_note(f"In the process that did the job:\n{traceback.format_exc()}")
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # an exception may refuse to be pickled in any way
            return RuntimeError(f"{type(error).__name__}: {error}")
        return error


def time_limit_error(limit: float) -> WorkerLostError:
    """The error of a job that exceeded its time limit in seconds."""
    return WorkerLostError(f"took longer than {limit:g} s and was ended")


@dataclass(slots=True)
class _Worker(Generic[J]):
    process: SpawnProcess
    connection: Connection
    job: J | None = None
    since: float = 0.0
    done: float = 0.0


class ProcessPool(Generic[J, V]):
    """A pool of spawned processes. They end with this process, however it ends.

    Args:
        prepare: called once in each worker; returns the function that runs jobs. It has to be importable by name.
        jobs: the number of workers; the number of cores if not given.
        limit: wall seconds after which a job's worker is killed.
        before: called before each job is submitted.
        single_threaded: whether each worker computes on one thread, so that results do not depend on their number.
    """

    def __init__(
        self,
        prepare: Callable[[], Work[J, V]],
        jobs: int | None,
        limit: float = math.inf,
        before: Callable[[], None] = lambda: None,
        single_threaded: bool = False,
    ) -> None:
        self._prepare, self._jobs, self._limit, self._before = prepare, jobs or cores(), limit, before
        self._single_threaded = single_threaded
        self._context = multiprocessing.get_context("spawn")
        self._workers: list[_Worker[J]] = []

    def __enter__(self) -> ProcessPool[J, V]:
        return self

    def __exit__(self, *_: object) -> None:
        while self._workers:
            self._stop(self._workers[-1])

    @property
    def free(self) -> int:
        return self._jobs - len(self._busy())

    @property
    def running_progress(self) -> float:
        return sum(worker.done for worker in self._busy())

    def submit(self, job: J) -> None:
        self._before()
        idle = next((worker for worker in self._workers if worker.job is None), None)
        worker = idle or self._start_worker()
        worker.job, worker.since, worker.done = job, time.monotonic(), 0.0
        with suppress(OSError):  # the worker has died meanwhile; `gather` notices that
            worker.connection.send(job)

    def gather(self, timeout: float) -> list[JobResult[J, V]]:
        busy = {worker.connection: worker for worker in self._busy()}
        first = min((worker.since for worker in busy.values()), default=0.0) + self._limit - time.monotonic()
        ready = wait(list(busy), max(0.0, min(timeout, first)))
        received = [self._receive(busy[one]) for one in ready if isinstance(one, Connection)]
        results = [each for each in received if each is not None]
        for worker in self._busy():
            if time.monotonic() - worker.since > self._limit:
                results.append(self._lost(worker, time_limit_error(self._limit)))
        return results

    def _busy(self) -> list[_Worker[J]]:
        return [worker for worker in self._workers if worker.job is not None]

    def _start_worker(self) -> _Worker[J]:
        ours, theirs = self._context.Pipe()
        arguments = (theirs, pickle.dumps(self._prepare))
        with block_signals(), shared_by(self._jobs, self._single_threaded):
            process = self._context.Process(target=_work, args=arguments)
            process.start()
        theirs.close()
        self._workers.append(_Worker(process, ours))
        return self._workers[-1]

    def _receive(self, worker: _Worker[J]) -> JobResult[J, V] | None:
        """Reads a worker's message: the result of its job, or None if it reports progress."""
        assert worker.job is not None
        try:
            message: float | tuple[V | Exception] = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join(5.0)
            code = worker.process.exitcode
            how = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            why = f"its process died {how} (was there enough memory? --jobs takes fewer of them)"
            return self._lost(worker, WorkerLostError(why))
        if isinstance(message, float):
            worker.done = message
            return None
        result = JobResult(worker.job, message[0], time.monotonic() - worker.since)
        worker.job = None
        return result

    def _lost(self, worker: _Worker[J], why: WorkerLostError) -> JobResult[J, V]:
        assert worker.job is not None
        result: JobResult[J, V] = JobResult(worker.job, why, time.monotonic() - worker.since)
        self._stop(worker)
        return result

    def _stop(self, worker: _Worker[J]) -> None:
        """Kills a worker and its process group."""
        self._workers.remove(worker)
        worker.connection.close()
        pid = worker.process.pid
        if pid is not None:
            with suppress(ProcessLookupError, PermissionError):  # it has not made its own process group yet
                os.killpg(pid, signal.SIGKILL)
        worker.process.kill()
        worker.process.join()


def _work(connection: Connection, prepare: bytes) -> None:
    """The main function of a worker: runs jobs until the connection is closed.

    Args:
        prepare: pickled, because unpickling may import much, and this process has to end with its parent before that.
    """
    os.setsid()  # its own process group, which is killed as a whole
    exit_with_parent()
    works: list[Work[object, object]] = []

    def once(job: object) -> object:
        if not works:
            works.append(pickle.loads(prepare)())
        return works[0](job, lambda done: connection.send(float(done)))

    with suppress(EOFError, OSError):
        while True:
            job = connection.recv()
            result = run_captured(lambda job=job: once(job))  # type: ignore[misc]
            try:
                connection.send((result,))
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                connection.send((RuntimeError(f"the result of a job cannot be pickled: {error}"),))
