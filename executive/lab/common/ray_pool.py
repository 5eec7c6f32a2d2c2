"""A crew of Ray's: when one machine is not enough. The same jobs come to the same.

Every machine of the cluster needs Executive, in the same version, and what the jobs name (domain folders, models,
collections) at the same place.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from typing import Any, Generic

from executive.errors import ExecutiveError, MissingError
from executive.lab.common.process_pool import Ended, J, LostError, V, Work, outcome, too_long
from executive.util.threads import cores, shared_by


class OnRay(Generic[J, V]):
    """A crew of Ray actors, each with a core of its own. How far a job is, it does not tell.

    Args:
        prepare: called by each actor; makes what works.
        jobs: how many actors; as many as the cluster has cores if not given.
        limit: wall seconds after which a job is ended.
        address: of a running cluster ("auto": the one of this machine); without one, a cluster of this machine alone is
            started, and ended in the end.

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
        except Exception as error:  # Ray raises that very class where a node does not start in time
            raise ExecutiveError(f"Ray cannot be used: {' '.join(str(error).split())}") from None
        self._prepare, self._limit = prepare, limit
        self._jobs = jobs or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._actor = self._ray.remote(num_cpus=1, max_restarts=0)(_Member)
        self._idle: list[Any] = []
        self._busy: dict[Any, tuple[Any, J, float]] = {}

    def __enter__(self) -> OnRay[J, V]:
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
    def under_way(self) -> float:
        return 0.0

    def hand(self, job: J) -> None:
        actor = self._idle.pop() if self._idle else self._actor.remote(self._prepare)
        self._busy[actor.do.remote(job)] = actor, job, time.monotonic()

    def gather(self, timeout: float) -> list[Ended[J, V]]:
        if not self._busy:
            return []
        first = min(since for _, _, since in self._busy.values()) + self._limit - time.monotonic()
        ready, _ = self._ray.wait(list(self._busy), num_returns=1, timeout=max(0.0, min(timeout, first)))
        ended = [self._ended(reference) for reference in ready]
        for reference, (actor, job, since) in list(self._busy.items()):
            if time.monotonic() - since > self._limit:
                self._ray.kill(actor)
                del self._busy[reference]
                ended.append(Ended(job, too_long(self._limit), self._limit))
        return ended

    def _ended(self, reference: Any) -> Ended[J, V]:
        actor, job, since = self._busy.pop(reference)
        try:
            came: V | Exception = self._ray.get(reference)
        except Exception as error:  # whatever became of the actor or of its machine
            self._ray.kill(actor)
            came = LostError(f"its process died: {error}")
        else:
            self._idle.append(actor)
        return Ended(job, came, time.monotonic() - since)


class _Member(Generic[J, V]):
    """The actor."""

    def __init__(self, prepare: Callable[[], Work[J, V]]) -> None:
        self._prepare = prepare
        self._work: Work[J, V] | None = None

    def do(self, job: J) -> V | Exception:
        return outcome(lambda: self._done(job))

    def _done(self, job: J) -> V:
        self._work = self._work or self._prepare()
        return self._work(job, lambda done: None)
