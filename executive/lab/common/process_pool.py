"""Who does long work: processes of this machine, one job at a time each. Collections, trainings, evaluations and
campaigns have theirs done here, or by Ray (`executive.lab.common.ray_pool`); who does it makes no difference to what
comes out.

A process that dies takes its own job with it and no other; one whose job takes too long is ended, with all that it has
started. The next job gets a new process. What a job raises arrives as itself.
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
from executive.util.processes import deaf, settle
from executive.util.threads import cores, shared_by

TRIES = 3
"""How often a job is begun whose process was lost each time."""

TICK = 0.2
"""Seconds between two looks at how far the work is."""

J = TypeVar("J")
V = TypeVar("V")

Tell = Callable[[float], None]
"""Says how far a job is, in whatever its work is counted in."""

Work = Callable[[J, Tell], V]
"""Does a job. It may raise anything."""


class LostError(ExecutiveError):
    """Whoever did a job died, or was ended because it took too long."""


@dataclass(frozen=True, slots=True)
class Ended(Generic[J, V]):
    """A job that has come to an end, after so many wall `seconds`: with a value, or with what was raised."""

    job: J
    outcome: V | Exception
    seconds: float

    def value(self) -> V:
        """What came of it; raises what was raised."""
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


class Crew(Protocol[J, V]):
    """Does jobs, several at a time. A context manager; on the way out whoever still works is ended, and that job is
    lost."""

    def __enter__(self) -> Crew[J, V]: ...

    def __exit__(self, *_: object) -> None: ...

    @property
    def free(self) -> int:
        """How many more jobs could be under way."""
        ...

    @property
    def under_way(self) -> float:
        """How much of the jobs that are under way is done, as far as that is told."""
        ...

    def hand(self, job: J) -> None:
        """Have a job done by someone who is free."""
        ...

    def gather(self, timeout: float) -> list[Ended[J, V]]:
        """The jobs that have come to an end since; wait at most `timeout` seconds for news."""
        ...


def done_by(
    crew: Crew[J, V], following: Callable[[], J | None], stopped: Callable[[], bool], tries: int = TRIES
) -> Iterator[list[Ended[J, V]]]:
    """Have jobs done until there are none left, or `stopped` says so: several times a second, those that have come to
    an end.

    Args:
        following: the next job; None while there is none, and for good once nothing is under way.
        tries: how often a job is begun, at most, whose worker was lost each time.
    """
    again: list[J] = []
    lost: list[J] = []
    busy = 0
    while not stopped():
        while crew.free and (job := again.pop() if again else following()) is not None:
            crew.hand(job)
            busy += 1
        if not busy:
            return
        ended = []
        for each in crew.gather(TICK):
            busy -= 1
            if isinstance(each.outcome, LostError):
                lost.append(each.job)
                if lost.count(each.job) < tries:
                    again.append(each.job)
                    continue
            ended.append(each)
        yield ended


def outcome(work: Callable[[], V]) -> V | Exception:
    """What comes of a job, in a form that reaches another process: an exception that cannot be sent as itself becomes
    one that says the same, and where it was raised is told with each."""
    try:
        return work()
    except Exception as error:
        error.add_note(f"In the process that did the job:\n{traceback.format_exc()}")
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return RuntimeError(f"{type(error).__name__}: {error}")
        return error


def too_long(limit: float) -> LostError:
    """What is said of a job that took longer than so many seconds."""
    return LostError(f"took longer than {limit:g} s and was ended")


@dataclass(slots=True)
class _Member(Generic[J]):
    process: SpawnProcess
    connection: Connection
    job: J | None = None
    since: float = 0.0
    done: float = 0.0


class Processes(Generic[J, V]):
    """A crew of spawned processes. They end with this one, however it ends.

    Args:
        prepare: called in each process; makes what works. Importable there by its name.
        jobs: how many processes; as many as there are cores if not given.
        limit: wall seconds after which a job is ended.
        before: called before a job is handed out.
        alone: whether each process does its sums on one thread, so that the number of processes changes none of them.
    """

    def __init__(
        self,
        prepare: Callable[[], Work[J, V]],
        jobs: int | None,
        limit: float = math.inf,
        before: Callable[[], None] = lambda: None,
        alone: bool = False,
    ) -> None:
        self._prepare, self._jobs, self._limit, self._before = prepare, jobs or cores(), limit, before
        self._alone = alone
        self._context = multiprocessing.get_context("spawn")
        self._members: list[_Member[J]] = []

    def __enter__(self) -> Processes[J, V]:
        return self

    def __exit__(self, *_: object) -> None:
        while self._members:
            self._dismiss(self._members[-1])

    @property
    def free(self) -> int:
        return self._jobs - len(self._busy())

    @property
    def under_way(self) -> float:
        return sum(member.done for member in self._busy())

    def hand(self, job: J) -> None:
        self._before()
        idle = next((member for member in self._members if member.job is None), None)
        member = idle or self._hire()
        member.job, member.since, member.done = job, time.monotonic(), 0.0
        with suppress(OSError):  # it has died meanwhile, which `gather` will find out
            member.connection.send(job)

    def gather(self, timeout: float) -> list[Ended[J, V]]:
        busy = {member.connection: member for member in self._busy()}
        first = min((member.since for member in busy.values()), default=0.0) + self._limit - time.monotonic()
        ready = wait(list(busy), max(0.0, min(timeout, first)))
        heard = [self._heard(busy[one]) for one in ready if isinstance(one, Connection)]
        ended = [each for each in heard if each is not None]
        for member in self._busy():
            if time.monotonic() - member.since > self._limit:
                ended.append(self._lost(member, too_long(self._limit)))
        return ended

    def _busy(self) -> list[_Member[J]]:
        return [member for member in self._members if member.job is not None]

    def _hire(self) -> _Member[J]:
        ours, theirs = self._context.Pipe()
        arguments = (theirs, pickle.dumps(self._prepare))
        with deaf(), shared_by(self._jobs, self._alone):
            process = self._context.Process(target=_work, args=arguments)
            process.start()
        theirs.close()
        self._members.append(_Member(process, ours))
        return self._members[-1]

    def _heard(self, member: _Member[J]) -> Ended[J, V] | None:
        """The end of a job, if that is what a process tells of."""
        assert member.job is not None
        try:
            news: float | tuple[V | Exception] = member.connection.recv()
        except (EOFError, OSError):
            member.process.join(5.0)
            code = member.process.exitcode
            how = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            why = f"its process died {how} (was there enough memory? --jobs takes fewer of them)"
            return self._lost(member, LostError(why))
        if isinstance(news, float):
            member.done = news
            return None
        ended = Ended(member.job, news[0], time.monotonic() - member.since)
        member.job = None
        return ended

    def _lost(self, member: _Member[J], why: LostError) -> Ended[J, V]:
        assert member.job is not None
        ended: Ended[J, V] = Ended(member.job, why, time.monotonic() - member.since)
        self._dismiss(member)
        return ended

    def _dismiss(self, member: _Member[J]) -> None:
        """End a process, and all that it has started."""
        self._members.remove(member)
        member.connection.close()
        pid = member.process.pid
        if pid is not None:
            with suppress(ProcessLookupError, PermissionError):  # it has made no group of its own yet
                os.killpg(pid, signal.SIGKILL)
        member.process.kill()
        member.process.join()


def _work(connection: Connection, prepare: bytes) -> None:
    """What a process does: the jobs that it is handed, until nobody hands it any.

    Args:
        prepare: pickled, for reading it may import much, and by then this process has to leave with its parent.
    """
    os.setsid()  # a group of its own, which is ended as a whole
    settle()
    works: list[Work[object, object]] = []

    def once(job: object) -> object:
        if not works:
            works.append(pickle.loads(prepare)())
        return works[0](job, lambda done: connection.send(float(done)))

    with suppress(EOFError, OSError):
        while True:
            job = connection.recv()
            came = outcome(lambda job=job: once(job))  # type: ignore[misc]
            try:
                connection.send((came,))
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                connection.send((RuntimeError(f"what came of a job cannot be sent: {error}"),))
