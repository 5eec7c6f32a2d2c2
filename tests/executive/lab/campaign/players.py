"""Who plays episodes in tests: whole runs in the symbolic world, in milliseconds, and players that come to grief.

Here, so that a process of its own finds them by their names.
"""

from __future__ import annotations

import os
import random
import signal
import time
from dataclasses import replace
from types import MappingProxyType

from executive.belief import ThresholdMonitor, Thresholds
from executive.core.settings import Settings
from executive.faults import FaultInjector, parse_fault
from executive.lab.campaign.design import Campaign, Configuration, Episode, Place
from executive.lab.campaign.episode import Player, Row, out_of_reach, row
from executive.lab.campaign.scoring import Scorer, Tally
from executive.lab.common.process_pool import ReportProgress
from executive.protocols import Sink
from executive.trace.report.summary import Collector
from executive.types import Atom, Event, Facts
from tests.executive.lab.inline import Inline
from tests.fakes import Recorder, ScriptedEstimator, Stage, at

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
FAULTS = {"none": (), "drops": ("drop:p=0.3",), "all sorts": ("drop:p=0.2", "miss:p=0.2", "shove:p=0.2")}


def campaign(seeds: int = 4, **changes: object) -> Campaign:
    """Two configurations and three lists of faults, in the symbolic world."""
    what = {
        "title": "Things and places",
        "seeds": tuple(range(seeds)),
        "places": (Place("things", "fake", "things", files="1234"),),
        "configurations": (Configuration("none", kind="none"), Configuration("oracle", kind="oracle")),
        "faults": MappingProxyType(FAULTS),
    }
    return Campaign(**{**what, **changes})  # type: ignore[arg-type]


class Watchers(Recorder):
    """Hands on to several sinks."""

    def __init__(self, *sinks: Sink) -> None:
        super().__init__()
        self.sinks = sinks

    def write(self, event: Event) -> None:
        super().write(event)
        for sink in self.sinks:
            sink.write(event)


def staged(episode: Episode) -> Stage:
    """The stage of an episode. A configuration called `hasty` takes one answer in twenty the wrong way round."""
    seed, dice = episode.seed, random.Random(episode.seed)
    where = {"a": dice.choice("pr"), "b": dice.choice("pq")}
    stage = Stage(GOAL, where, settings=Settings(seed, max_replans=10), blind=episode.configuration.kind == "none")
    if episode.configuration.estimator == "hasty":

        def answer(look: int, atom: Atom, truth: bool) -> float:
            return float(truth is not (dice.random() < 0.05))

        stage.estimator = ScriptedEstimator(stage.world, scripted=answer)
    if episode.config.monitor.threshold is not None:
        threshold = episode.config.monitor.threshold
        stage.monitor = ThresholdMonitor(stage.task.atoms, Thresholds(threshold, threshold))
    stage.faults = FaultInjector([parse_fault(spec) for spec in episode.config.faults], stage.world, seed)
    return stage


def scored(stage: Stage) -> tuple[Collector, Tally]:
    """The stage, played, with what watched it."""
    collector = Collector()
    scorer = Scorer(lambda: stage.world.truth(stage.task.atoms), not stage.blind)
    stage.recorder = Watchers(collector, scorer)
    stage.play()
    return collector, scorer.tally


def symbolic() -> Player:
    return play


def play(episode: Episode, tell: ReportProgress = lambda done: None) -> Row:
    stage = staged(episode)
    collector, tally = scored(stage)
    truth = stage.world.truth(stage.task.atoms)
    return row(episode, collector.summary(stage.goal_true), tally, out_of_reach(truth, sorted(stage.world.where)))


RAISES, DIES, HANGS = 1, 2, 3
"""The seeds with which `troubled` comes to grief."""


def troubled() -> Player:
    def play_or_not(episode: Episode, tell: ReportProgress) -> Row:
        if episode.seed == RAISES:
            raise RuntimeError("a bug\nin two lines")
        if episode.seed == DIES:
            os.kill(os.getpid(), signal.SIGKILL)
        if episode.seed == HANGS:
            time.sleep(600)
        return play(episode)

    return play_or_not


class Here(Inline[Episode, Row]):
    """A pool that is this process."""

    def __init__(self) -> None:
        super().__init__(symbolic)


def lasting(made: Row) -> Row:
    """A row without what is another each time."""
    return replace(made, wall_seconds=0.0)
