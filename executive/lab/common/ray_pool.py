"""A pool of Ray actors, for work that needs more than one machine. The results are those of the process pool.

Every machine of the cluster needs the same version of Executive, and the files that jobs name (domain folders, models,
collections) at the same paths.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from typing import Any, Generic

from executive.errors import ExecutiveError, MissingError
from executive.lab.common.process_pool import J, JobResult, V, Work, WorkerLostError, run_captured, time_limit_error
from executive.util.threads import cores, shared_by


class RayPool(Generic[J, V]):
    """A pool of Ray actors with one core each. It does not report the progress of running jobs.

    Args:
        prepare: called once by each actor; returns the function that runs jobs.
        jobs: the number of actors; the number of the cluster's cores if not given.
        limit: wall seconds after which a job's actor is killed.
        address: of a running cluster ("auto" for that of this machine); without it, a cluster of this machine alone is
            started, and shut down at exit.

    Raises:
        MissingError: Ray is not installed.
        ExecutiveError: there is no cluster at this address.
    """

    def __init__(
        self,
        prepare: Callable[[], Work[J, V]],
        jobs: int | None,
        limit: float = math.inf,
        address: str | None = None,
    ) -> None:
        try:
            self._ray: Any = importlib.import_module("ray")
        except ModuleNotFoundError:
            command = "pip install 'executive[ray]'"
            raise MissingError(
                "Ray is not installed; it comes with the extra executive[ray]", command=command
            ) from None
        try:
            if address is None:
                with shared_by(jobs or cores(), alone=True):
                    self._ray.init(num_cpus=jobs, include_dashboard=False, log_to_driver=False, configure_logging=False)
            else:
                self._ray.init(address=address, log_to_driver=False, configure_logging=False)
        except Exception as error:  # Ray raises Exception itself where a node does not start in time
            raise ExecutiveError(f"Ray cannot be used: {' '.join(str(error).split())}") from None
        self._prepare, self._limit = prepare, limit
        self._jobs = jobs or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._actor = self._ray.remote(num_cpus=1, max_restarts=0)(_Actor)
        self._idle: list[Any] = []
        self._busy: dict[Any, tuple[Any, J, float]] = {}

    def __enter__(self) -> RayPool[J, V]:
        return self

    def __exit__(self, *_: object) -> None:
        for actor in [*self._idle, *(actor for actor, _, _ in self._busy.values())]:
            self._ray.kill(actor)
        self._idle, self._busy = [], {}
        self._ray.shutdown()

    @property
    def free(self) -> int:
        return self._jobs - len(self._busy)

    @property
    def running_progress(self) -> float:
        return 0.0

    def submit(self, job: J) -> None:
        actor = self._idle.pop() if self._idle else self._actor.remote(self._prepare)
        self._busy[actor.do.remote(job)] = actor, job, time.monotonic()

    def gather(self, timeout: float) -> list[JobResult[J, V]]:
        if not self._busy:
            return []
        first = min(since for _, _, since in self._busy.values()) + self._limit - time.monotonic()
        ready, _ = self._ray.wait(list(self._busy), num_returns=1, timeout=max(0.0, min(timeout, first)))
        ended = [self._ended(reference) for reference in ready]
        for reference, (actor, job, since) in list(self._busy.items()):
            if time.monotonic() - since > self._limit:
                self._ray.kill(actor)
                del self._busy[reference]
                ended.append(JobResult(job, time_limit_error(self._limit), self._limit))
        return ended

    def _ended(self, reference: Any) -> JobResult[J, V]:
        actor, job, since = self._busy.pop(reference)
        try:
            outcome: V | Exception = self._ray.get(reference)
        except Exception as error:  # the actor or its machine is lost
            self._ray.kill(actor)
            outcome = WorkerLostError(f"its process died: {error}")
        else:
            self._idle.append(actor)
        return JobResult(job, outcome, time.monotonic() - since)


class _Actor(Generic[J, V]):
    """The actor: runs one job at a time."""

    def __init__(self, prepare: Callable[[], Work[J, V]]) -> None:
        self._prepare = prepare
        self._work: Work[J, V] | None = None

    def do(self, job: J) -> V | Exception:
        return run_captured(lambda: self._done(job))

    def _done(self, job: J) -> V:
        self._work = self._work or self._prepare()
        return self._work(job, lambda done: None)
