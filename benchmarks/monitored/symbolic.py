"""The symbolic world: 25 atoms, six things, three places, and whole runs in a few milliseconds. What comes of an action
and of a fault is simpler there than in the simulator; the executive is the same."""

from __future__ import annotations

import math
from pathlib import Path

from executive.app import sensor_fit
from executive.app.assembly import make_executive
from executive.belief import EXACT, ActionModel, BayesMonitor, Monitor, MutexNetwork, ThresholdMonitor
from executive.faults import FaultInjector, faulty_estimator, parse_fault
from executive.lab.campaign.design import Episode, Place
from executive.lab.campaign.episode import Player, Row, out_of_reach, row
from executive.lab.campaign.scoring import Scorer
from executive.lab.common.process_pool import ReportProgress
from executive.trace.report.summary import Collector
from executive.types import Condition, Facts, NoPlan, NoPlanReason, Plan, Step, Task
from tests.fakes import FREE, WATCHED, FakeSkill, FakeWorld, ScriptedEstimator, at, groups, held, pick, put, task

PLACE = Place("things", "six", "things")
THINGS, PLACES = ("a", "b", "c", "d", "e", "f"), ("p", "q", "r")
GOAL = Facts({at(thing, PLACES[index // 2]): True for index, thing in enumerate(THINGS)})


def player(work: Path) -> Player:
    """Needs no folder to work in."""
    return play


def play(episode: Episode, tell: ReportProgress = lambda done: None) -> Row:
    """One run in the symbolic world."""
    config, seed = episode.config, episode.seed
    some = task(THINGS, PLACES, GOAL)
    start = {thing: PLACES[(index // 2 + 1 + (seed + index) % 2) % 3] for index, thing in enumerate(THINGS)}
    world, skill, collector = FakeWorld(start, PLACES), FakeSkill(), Collector()
    own = [str(parse_fault(spec)) for spec in episode.configuration.faults]
    scorer = Scorer(lambda: world.truth(some.atoms), True, own)
    faults = FaultInjector([parse_fault(spec) for spec in config.faults], world, seed)
    make_executive(
        some,
        Courier(some),
        world,
        {"pick": skill, "place": skill},
        faulty_estimator(ScriptedEstimator(world), faults),
        [collector, scorer],
        config.settings(),
        faults,
        monitor=_monitor(episode, some),
        attention=WATCHED,
    ).run()
    truth = world.truth(some.atoms)
    return row(episode, collector.summary(truth.entails(GOAL)), scorer.tally, out_of_reach(truth, sorted(world.where)))


class Courier:
    """Plans for the symbolic world, goal by goal: what is held is put down, what is elsewhere is fetched."""

    def __init__(self, some: Task) -> None:
        self._things = sorted(name for name, kind in some.objects.items() if kind == "thing")
        self._places = sorted(name for name, kind in some.objects.items() if kind == "place")

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        true, steps = set(state.true), list[Step]()

        def do(step: Step) -> None:
            true.difference_update(step.unconditional.false)
            true.update(step.unconditional.true)
            steps.append(step)

        for atom in goal.facts:
            thing, place = atom.args
            if atom in true:
                continue
            if held(thing) not in true:
                where = [place for place in self._places if at(thing, place) in true]
                if FREE not in true:
                    full = [other for other in self._things if held(other) in true]
                    if not full:
                        return NoPlan(NoPlanReason.UNSOLVABLE)
                    homes = [a.args[1] for a in goal.facts if a.args[0] == full[0]]
                    downs = (put(full[0], place) for place in (*homes[:1], *self._places))
                    down = next((step for step in downs if step not in avoid), None)
                    if down is None:
                        return NoPlan(NoPlanReason.UNSOLVABLE)
                    do(down)
                if not where:
                    return NoPlan(NoPlanReason.UNSOLVABLE)
                do(pick(thing, where[0]))
            do(put(thing, place))
        if not true.issuperset(goal.facts.true) or not avoid.isdisjoint(steps):
            return NoPlan(NoPlanReason.UNSOLVABLE)
        return Plan(tuple(steps), float(len(steps)), "courier", 0.0)


def _monitor(episode: Episode, some: Task) -> Monitor:
    judge = episode.config.monitor
    if judge.threshold is not None:
        return ThresholdMonitor(some.atoms)
    eye = EXACT if judge.trust is None else sensor_fit.load(judge.trust, "things").sensor_model
    return BayesMonitor(MutexNetwork(some.atoms, groups(some)), eye, ActionModel() if judge.memory else None)
