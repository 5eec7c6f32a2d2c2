"""A pool that runs jobs in this process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

from executive.lab.common.process_pool import J, JobResult, V, Work, run_captured


class Inline(Generic[J, V]):
    """Runs jobs here, and not in the order in which they were submitted."""

    running_progress = 0.0

    def __init__(self, prepare: Callable[[], Work[J, V]], jobs: int = 3) -> None:
        self.prepare, self.jobs, self.waiting, self.done = prepare, jobs, list[J](), list[J]()
        self.work: Work[J, V] | None = None

    def __enter__(self) -> Inline[J, V]:
        return self

    def __exit__(self, *_: object) -> None:
        self.waiting.clear()

    @property
    def free(self) -> int:
        return self.jobs - len(self.waiting)

    def submit(self, job: J) -> None:
        assert self.free > 0
        self.waiting.append(job)

    def gather(self, timeout: float) -> list[JobResult[J, V]]:
        job = self.waiting.pop()
        self.done.append(job)
        return [JobResult(job, run_captured(lambda: self.do(job)), 0.0)]

    def do(self, job: J) -> V:
        self.work = self.work or self.prepare()
        return self.work(job, lambda done: None)
