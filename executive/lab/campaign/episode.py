"""Playing and scoring one episode, whose result is a row of the campaign's record."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executive.app.options import command_words
from executive.app.run import Run, RunConfig
from executive.errors import ExecutiveError
from executive.faults import parse_fault
from executive.lab.campaign.design import KEYS, Episode
from executive.lab.campaign.scoring import Scorer, Strike, Tally
from executive.lab.common.process_pool import JobResult, ReportProgress
from executive.trace.report.summary import Summary
from executive.types import Facts
from executive.util.files import legible

if TYPE_CHECKING:
    from executive.app.config import EstimatorConfig
    from executive.s3e.backends.shared_client import Address
    from executive.s3e.estimator import S3E

FAILED = "failed"
"""The outcome of an episode that could not be played to its end: a bug, a wrong set-up, a process that died."""


@dataclass(frozen=True, slots=True)
class Row:
    """The result of an episode, as its line in the record.

    The first six say which episode it is. `outcome` is the run's or `FAILED`, and then `error` says why. `strikes` and
    the counts from `quiet` to `needless` are those of `executive.lab.campaign.scoring`. `lost` are the items of
    which no atom is true at the end: they are out of reach. `sim_seconds` is the simulated time; `wall_seconds` alone
    is not reproducible. `command` repeats the run.
    """

    domain: str
    problem: str
    faults: str
    estimator: str
    monitor: str
    seed: int
    outcome: str
    command: str
    error: str = ""
    goal_seen: bool = False
    goal_true: bool = False
    actions: int = 0
    replans: int = 0
    looks: int = 0
    questions: int = 0
    strikes: tuple[Strike, ...] = ()
    quiet: int = 0
    alarms: int = 0
    failed: int = 0
    missed: int = 0
    needless: int | None = None
    lost: tuple[str, ...] = ()
    sim_seconds: float = 0.0
    wall_seconds: float = 0.0

    @property
    def key(self) -> tuple[str, ...]:
        """See `executive.lab.campaign.design.Episode.key`."""
        return tuple(str(getattr(self, name)) for name in KEYS)


Player = Callable[[Episode, ReportProgress], Row]
"""Plays an episode. It may raise any exception; `row_of` makes a row of that, too."""


class Simulated:
    """Plays episodes in the world of their configuration. Models stay loaded from one episode to the next.

    Args:
        work: the parent folder of running episodes; the system's temporary folder if not given.
        models: the address of the process that holds the models; without it, this process loads them.

    Raises:
        ExecutiveError: of an episode, whatever keeps it from being played; and where the process that holds the models
            has ended meanwhile, for then what the robot did not see says nothing.
    """

    def __init__(self, work: Path | None = None, models: Address | None = None) -> None:
        self._work, self._models = work, models
        self._estimators: dict[tuple[str, str, EstimatorConfig], S3E] = {}

    def __call__(self, episode: Episode, tell: ReportProgress = lambda done: None) -> Row:
        with tempfile.TemporaryDirectory(dir=self._work, prefix="episode-") as runs:
            config = replace(episode.config, runs=Path(runs))
            own = [str(parse_fault(spec)) for spec in episode.configuration.faults]
            scorer = Scorer(lambda: run.truth.of(run.domain.task.atoms), config.estimator != "none", own)
            estimator = self._open(episode)
            with Run(config, [scorer], estimator) as run:
                summary = run.execute()
                truth, items = run.truth.of(run.domain.task.atoms), run.world.items
            self._check(estimator)
        return row(episode, summary, scorer.tally, out_of_reach(truth, items))

    def _open(self, episode: Episode) -> S3E | None:
        """The vision-language estimator of an episode that has one; it replaces the open one if that is another."""
        config = episode.config
        if config.estimator != "vlm":
            return None
        from executive.app.config import EstimatorConfig
        from executive.app.estimators import open_estimator
        from executive.domain.loader import load_domain
        from executive.s3e.backends.shared_client import SharedBackend

        key = (config.domain, episode.place.problem, config.eye or EstimatorConfig())
        with suppress(ExecutiveError):  # a process that has ended may have a successor by now
            self._check(self._estimators.get(key))
        if key not in self._estimators:
            self._estimators.clear()
            load = None if self._models is None else partial(SharedBackend, self._models)
            self._estimators[key] = open_estimator(key[2], load_domain(config.domain, config.problem).subject, load)
        return self._estimators[key]

    def _check(self, estimator: S3E | None) -> None:
        """Checks that the estimator's model is still available.

        Raises:
            ExecutiveError: it is not; the estimators are closed.
        """
        from executive.s3e.backends.shared_client import SharedBackend

        if estimator is not None and isinstance(estimator.backend, SharedBackend):
            try:
                estimator.backend.check()
            except ExecutiveError:
                self._estimators.clear()
                raise


def loads_model(episode: Episode) -> bool:
    """Whether the episode needs a vision-language model on this machine."""
    config = episode.config
    return config.estimator == "vlm" and (config.eye is None or config.eye.server is None)


def row(episode: Episode, summary: Summary, tally: Tally, lost: Sequence[str]) -> Row:
    """The row of an episode that was played to its end."""
    return Row(
        **_which(episode),
        outcome=summary["outcome"],
        goal_seen=summary["goal_seen"],
        goal_true=bool(summary["goal_true"]),
        actions=summary["actions"],
        replans=summary["replans"],
        looks=summary["looks"],
        questions=summary["looking"]["questions"],
        strikes=tuple(tally.strikes),
        quiet=tally.quiet,
        alarms=tally.alarms,
        failed=tally.failed,
        missed=tally.missed,
        needless=tally.needless,
        lost=tuple(lost),
        sim_seconds=summary["sim_seconds"],
        wall_seconds=summary["wall_seconds"]["total"],
    )


def row_of(ended: JobResult[Episode, Row]) -> Row:
    """The row of an episode, whether or not it was played to its end."""
    why = ended.outcome
    if isinstance(why, Row):
        return why
    told = " ".join((str(why) if isinstance(why, ExecutiveError) else f"{type(why).__name__}: {why}").split())
    return Row(**_which(ended.job), outcome=FAILED, error=told, wall_seconds=round(ended.seconds, 3))


def out_of_reach(truth: Facts, items: Sequence[str]) -> tuple[str, ...]:
    """The items of which no atom is true."""
    told = {name for atom in truth.true for name in atom.args}
    return tuple(item for item in items if item not in told)


def command(config: RunConfig) -> str:
    """The command that repeats a run."""
    words = command_words(config, without=("runs", "name", "viewer", "tree"))
    return legible(shlex.join(["executive", "run", *words]))


def _which(episode: Episode) -> dict[str, Any]:
    domain, problem, faults, estimator, monitor, _ = episode.key
    named = {"domain": domain, "problem": problem, "faults": faults, "estimator": estimator, "monitor": monitor}
    return {**named, "seed": episode.seed, "command": command(episode.config)}
