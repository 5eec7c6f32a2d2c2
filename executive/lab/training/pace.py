"""How fast this machine trains, measured by a few pictures and a few steps of each stage before a training begins."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from executive.lab.common.process_pool import ProcessPool, ReportProgress, run_jobs
from executive.lab.training.described.shards import PER_PROBLEM
from executive.lab.training.presets import Pace

if TYPE_CHECKING:
    import torch

    from executive.lab.training.optimiser import Metrics
    from executive.lab.training.stages import Trainer

_VARIED = 20
"""Steps of the first stage that are timed: they may take times that are far apart."""

Writer = Callable[[int, ReportProgress], None]
"""Writes the shard of a number."""

_FIRST, _FEW, _MORE = 1, PER_PROBLEM, 3 * PER_PROBLEM
"""Moments of three shards. With the first one, libraries are loaded. The difference of the times of the other two is
what moments cost, without what comes once per shard, and with what comes once for the same objects."""


class WritingTimer:
    """The job of a worker process: writes three shards, and returns the seconds that it took for each moment more.

    Args:
        writer: makes the writer of shards of so many moments into a folder.
    """

    def __init__(self, writer: Callable[[int, Path], Writer], folder: Path) -> None:
        self._writer, self._folder = writer, folder

    def __call__(self, number: int, tell: ReportProgress) -> float:
        taken = []
        for at, count in enumerate((_FIRST, _FEW, _MORE)):
            began = time.perf_counter()
            self._writer(count, self._folder)(3 * number + at, tell)
            taken.append(time.perf_counter() - began)
        _, few, more = taken
        return max((more - few) / (_MORE - _FEW), 0.5 * more / _MORE)  # objects may be fewer in the larger one


def measure(
    writer: Callable[[int, Path], Writer] | None,
    trainer: Callable[[], Trainer],
    jobs: int | None,
    stopped: Callable[[], bool],
    folder: Path | None = None,
) -> Pace | None:
    """Time a few steps of each stage; None when stopped. The training is not influenced by it.

    Args:
        writer: as of `WritingTimer`; None where no pictures are drawn, but those in `folder` are used.
        trainer: makes a trainer for the steps, which is used for nothing else.
    """
    with tempfile.TemporaryDirectory() as temporary:
        moment = 0.0
        if writer is not None:
            folder = Path(temporary)
            pool: ProcessPool[int, float] = ProcessPool(_Made(writer, folder), jobs)
            with pool:
                workers = pool.free
                waiting = iter(range(workers))
                ended = [each for found in run_jobs(pool, lambda: next(waiting, None), stopped) for each in found]
            if stopped():
                return None
            moment = float(np.mean([each.value() for each in ended])) / workers
        assert folder is not None
        made = trainer()
        pictures, rng = made.pool(folder), np.random.default_rng(0)
        states = pictures.states()
        return Pace(
            moment,
            tower=_seconds(lambda: made.vision_loss(pictures, rng), _VARIED),
            language=_seconds(lambda: made.language_loss(states, rng, 0.3)),
            together=_seconds(lambda: made.answer_loss(pictures, rng, 0.1)),
            fewer=_seconds(lambda: made.answer_loss(pictures, rng, 0.0, fewer=True)),
        )


class _Made:
    """Makes the job of each worker; a class, so that it can be pickled."""

    def __init__(self, writer: Callable[[int, Path], Writer], folder: Path) -> None:
        self._writer, self._folder = writer, folder

    def __call__(self) -> WritingTimer:
        return WritingTimer(self._writer, self._folder)


def _seconds(step: Callable[[], tuple[torch.Tensor, Metrics]], count: int = 3) -> float:
    import torch

    taken = []
    for _ in range(count):
        began = time.perf_counter()
        loss, _ = step()
        torch.autograd.backward(loss)
        taken.append(time.perf_counter() - began)
    return float(np.mean(taken[1:]))  # the first one allocates
