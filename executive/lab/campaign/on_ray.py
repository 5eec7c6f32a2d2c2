"""A crew of Ray's: when one machine is not enough. The same episodes give the same rows.

Every machine of the cluster needs Executive, in the same version, and what a campaign names (domain folders, models) at
the same place.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from typing import Any

from executive.errors import ExecutiveError, MissingError
from executive.lab.campaign.design import Episode
from executive.lab.campaign.episode import Player, Row, failure
from executive.threads import cores, shared_by


class OnRay:
    """A crew of Ray actors, each with a core of its own.

    Args:
        prepare: called by each actor; makes what plays.
        jobs: how many actors; as many as the cluster has cores if not given.
        limit: wall seconds after which an episode is ended.
        address: of a running cluster ("auto": the one of this machine); without one, a cluster of this machine alone is
            started, and ended in the end.

    Raises:
        MissingError: Ray is not installed.
        ExecutiveError: there is no cluster at this address.
    """

    def __init__(
        self, prepare: Callable[[], Player], jobs: int | None, limit: float, address: str | None = None
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
        self._busy: dict[Any, tuple[Any, Episode, float]] = {}

    def __enter__(self) -> OnRay:
        return self

    def __exit__(self, *_: object) -> None:
        for actor in [*self._idle, *(actor for actor, _, _ in self._busy.values())]:
            self._ray.kill(actor)
        self._idle, self._busy = [], {}
        self._ray.shutdown()

    @property
    def free(self) -> int:
        return self._jobs - len(self._busy)

    def hand(self, episode: Episode) -> None:
        actor = self._idle.pop() if self._idle else self._actor.remote(self._prepare)
        self._busy[actor.play.remote(episode)] = actor, episode, time.monotonic()

    def gather(self, timeout: float) -> list[Row]:
        if not self._busy:
            return []
        first = min(since for _, _, since in self._busy.values()) + self._limit - time.monotonic()
        ready, _ = self._ray.wait(list(self._busy), num_returns=1, timeout=max(0.0, min(timeout, first)))
        rows = [self._row(reference) for reference in ready]
        for reference, (actor, episode, since) in list(self._busy.items()):
            if time.monotonic() - since > self._limit:
                self._ray.kill(actor)
                del self._busy[reference]
                rows.append(failure(episode, f"took longer than {self._limit:g} s and was ended", self._limit))
        return rows

    def _row(self, reference: Any) -> Row:
        actor, episode, since = self._busy.pop(reference)
        try:
            row: Row = self._ray.get(reference)
        except Exception as error:  # whatever became of the actor or of its machine
            self._ray.kill(actor)
            return failure(episode, f"its process died: {error}", time.monotonic() - since)
        self._idle.append(actor)
        return row


class _Member:
    """The actor."""

    def __init__(self, prepare: Callable[[], Player]) -> None:
        self._prepare = prepare
        self._player: Player | None = None

    def play(self, episode: Episode) -> Row:
        began = time.monotonic()
        try:
            self._player = self._player or self._prepare()
            return self._player(episode)
        except Exception as error:
            return failure(episode, error, time.monotonic() - began)
