"""Who plays a campaign's episodes: processes of this machine, one episode at a time each.

A process that dies takes its own episode with it and no other; one whose episode takes too long is ended, with all
that it has started. In both cases the episode gets a row that says so, and the next one gets a new process.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Protocol

from executive.lab.campaign.design import Episode
from executive.lab.campaign.episode import Player, Row, failure
from executive.spawned import deaf, leave_with_parent
from executive.threads import cores, shared_by


class Crew(Protocol):
    """Plays episodes, several at a time. A context manager; on the way out whoever still plays is ended, and that
    episode is lost."""

    def __enter__(self) -> Crew: ...

    def __exit__(self, *_: object) -> None: ...

    @property
    def free(self) -> int:
        """How many more episodes could be under way."""
        ...

    def hand(self, episode: Episode) -> None:
        """Have an episode played by someone who is free."""
        ...

    def gather(self, timeout: float) -> list[Row]:
        """The rows of the episodes that have come to an end since; wait at most `timeout` seconds for the first."""
        ...


@dataclass(slots=True)
class _Member:
    process: SpawnProcess
    connection: Connection
    episode: Episode | None = None
    since: float = 0.0


class Processes:
    """A crew of spawned processes.

    Args:
        prepare: called in each process; makes what plays. Importable there by its name.
        jobs: how many processes; as many as there are cores if not given.
        limit: wall seconds after which an episode is ended.
        before: called before an episode is handed out.
    """

    def __init__(
        self,
        prepare: Callable[[], Player],
        jobs: int | None,
        limit: float,
        before: Callable[[], None] = lambda: None,
    ) -> None:
        self._prepare, self._jobs, self._limit, self._before = prepare, jobs or cores(), limit, before
        self._context = multiprocessing.get_context("spawn")
        self._members: list[_Member] = []

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        while self._members:
            self._dismiss(self._members[-1])

    @property
    def free(self) -> int:
        return self._jobs - sum(member.episode is not None for member in self._members)

    def hand(self, episode: Episode) -> None:
        self._before()
        idle = next((member for member in self._members if member.episode is None), None)
        member = idle or self._hire()
        member.episode, member.since = episode, time.monotonic()
        with suppress(OSError):  # it has died meanwhile, which `gather` will find out
            member.connection.send(episode)

    def gather(self, timeout: float) -> list[Row]:
        busy = {member.connection: member for member in self._members if member.episode is not None}
        first = min((member.since for member in busy.values()), default=0.0) + self._limit - time.monotonic()
        ready = wait(list(busy), max(0.0, min(timeout, first)))
        rows = [self._row(busy[one]) for one in ready if isinstance(one, Connection)]
        for member in [member for member in self._members if member.episode is not None]:
            if time.monotonic() - member.since > self._limit:
                rows.append(self._lost(member, f"took longer than {self._limit:g} s and was ended"))
        return rows

    def _hire(self) -> _Member:
        ours, theirs = self._context.Pipe()
        with deaf(), shared_by(self._jobs, alone=True):
            process = self._context.Process(target=_work, args=(theirs, self._prepare))
            process.start()
        theirs.close()
        self._members.append(_Member(process, ours))
        return self._members[-1]

    def _row(self, member: _Member) -> Row:
        try:
            row: Row = member.connection.recv()
        except (EOFError, OSError):
            member.process.join(5.0)
            code = member.process.exitcode
            how = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            return self._lost(member, f"its process died {how} (was there enough memory? --jobs takes fewer of them)")
        member.episode = None
        return row

    def _lost(self, member: _Member, why: str) -> Row:
        assert member.episode is not None
        row = failure(member.episode, why, time.monotonic() - member.since)
        self._dismiss(member)
        return row

    def _dismiss(self, member: _Member) -> None:
        """End a process, and all that it has started."""
        self._members.remove(member)
        member.connection.close()
        pid = member.process.pid
        if pid is not None:
            with suppress(ProcessLookupError, PermissionError):  # it has made no group of its own yet
                os.killpg(pid, signal.SIGKILL)
        member.process.kill()
        member.process.join()


def _work(connection: Connection, prepare: Callable[[], Player]) -> None:
    """What a process does: play what it is handed until nobody hands it anything."""
    os.setsid()  # a group of its own: Ctrl-C in the terminal does not come here, and the group is ended as a whole
    threading.Thread(target=leave_with_parent, daemon=True).start()
    player: Player | None = None
    with suppress(EOFError, OSError):
        while True:
            episode: Episode = connection.recv()
            began = time.monotonic()
            try:
                player = player or prepare()
                row = player(episode)
            except Exception as error:
                row = failure(episode, error, time.monotonic() - began)
            connection.send(row)
