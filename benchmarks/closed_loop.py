"""What a monitor is worth in the closed loop, with an eye that errs at a known rate.

    python -m benchmarks.closed_loop                       # a symbolic world: 25 atoms, six things, three places
    python -m benchmarks.closed_loop --world mujoco        # the simulator and its oracle, with answers turned around
    python -m benchmarks.closed_loop --world mujoco --eye vlm,blur=3 --flips 0      # the model, on bad pictures

Each answer of the oracle is turned around with some probability. The settings build on each other: the plain threshold
of the paper; mutex groups; memory; looking again. All meet the same faults. What counts as what:

- `success`: the goal holds in truth and the run says so; `false`: it says so and it does not hold.
- `missed`: of the actions whose effects did not come about, the share whose cycle ends with none of that noticed.
- `alarms`: of the actions after which all is as expected, the share whose cycle ends with a surprise.
- `needless`: replans a run after which the plan before would have led to the goal from the true state.
- `delay`: simulated seconds from a drop to the first event that tells of it (for drops that any event tells of).
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import fmean

from executive.compare import remaining
from executive.faults import FaultInjector, parse_fault
from executive.lab.noisy import Noisy
from executive.loop import Executive
from executive.monitor import Monitor
from executive.monitor.actions import ActionModel
from executive.monitor.eye import EXACT, Eye, Reading
from executive.monitor.fused import FusedMonitor
from executive.monitor.groups import Group, Network
from executive.monitor.plain import PlainMonitor
from executive.policy import Settings
from executive.protocols import Estimator
from executive.types import (
    Atom,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    FaultInjected,
    Guarded,
    Looked,
    LookKind,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Plan,
    SkillResult,
    Step,
    Task,
)
from tests.fakes import FREE, WATCHED, FakeSkill, FakeWorld, ScriptedEstimator, at, groups, held, pick, put, task

FLIPS = (0.0, 0.02, 0.05, 0.1)
SETTINGS = ("plain threshold", "+ consistency", "+ memory", "+ looking again")
THINGS, PLACES = ("a", "b", "c", "d", "e", "f"), ("p", "q", "r")
GOAL = Facts({at(thing, PLACES[index // 2]): True for index, thing in enumerate(THINGS)})
FAULTS = ("drop:p=0.15", "miss:p=0.1", "shove:p=0.05")


@dataclass
class Score:
    """What became of one run."""

    success: bool
    false_success: bool
    actions: int
    replans: int
    needless: int = 0
    failed: int = 0
    missed: int = 0
    calm: int = 0
    alarms: int = 0
    looks: int = 0
    questions: int = 0
    delays: list[float] = field(default_factory=list)


class Scorer:
    """A sink that holds what the executive decides against the truth; `truth` is asked at each observation."""

    def __init__(self, truth: Callable[[], Facts], goal: Facts) -> None:
        self._truth, self._goal = truth, goal
        self._plan: tuple[Step, ...] = ()
        self._index = -1
        self._step: Step | None = None
        self._before = self._now = Facts()
        self._verdict: Compared | None = None
        self._dropped: float | None = None
        self.score = Score(False, False, 0, 0)

    def write(self, event: Event) -> None:
        score = self.score
        match event.payload:
            case Observation():
                self._now = self._truth()
            case Plan(steps=steps):
                self._plan, self._index = steps, -1
            case Dispatched(step=step, index=index):
                self._step, self._index, self._before, self._verdict = step, index, self._now, None
            case FaultInjected(kind="drop"):
                self._dropped = event.time
            case Guarded(lost=True):
                self._notice(event)
            case SkillResult() as result if not result.done:
                self._notice(event)
            case Compared(what="effects") as compared:
                self._verdict = compared
                if compared.verdict.violated:
                    self._notice(event)
            case Looked(kind=kind, questions=questions) if kind is not LookKind.GUARD:
                score.looks += 1
                score.questions += questions
            case Decision() as decision:
                self._decided(decision)
            case Ended() as ended:
                score.actions, score.replans = ended.actions, ended.replans
                claimed, holds = ended.outcome is OutcomeKind.GOAL_REACHED, self._truth().entails(self._goal)
                score.success, score.false_success = claimed and holds, claimed and not holds

    def close(self) -> None:
        pass

    def _notice(self, event: Event) -> None:
        if self._dropped is not None:
            self.score.delays.append(event.time - self._dropped)
            self._dropped = None

    def _decided(self, decision: Decision) -> None:
        if decision.kind is DecisionKind.LOOK_AGAIN:
            return
        if self._verdict is not None and self._step is not None:
            self._count(self._step, self._verdict)
        self._verdict = None
        if decision.kind is DecisionKind.REPLAN and self._plan:
            left = self._plan[self._index + 1 :]
            self.score.needless += remaining(left, self._now, self._goal) is not None

    def _count(self, step: Step, compared: Compared) -> None:
        """One action, at the end of its cycle."""
        score, violated = self.score, compared.verdict.violated
        if not self._now.entails(step.effects):
            score.failed += 1
            score.missed += not violated & step.effects.keys()
        elif self._now.entails(self._before | step.effects):
            score.calm += 1
            score.alarms += bool(violated)


class Courier:
    """Plans for the symbolic world, goal by goal: what is held is put down, what is elsewhere is fetched."""

    def __init__(self, some: Task) -> None:
        self._things = sorted(name for name, kind in some.objects.items() if kind == "thing")
        self._places = sorted(name for name, kind in some.objects.items() if kind == "place")

    def plan(self, state: Facts, goal: Facts) -> Plan | NoPlan:
        true, steps = set(state.true), list[Step]()

        def do(step: Step) -> None:
            true.difference_update(step.effects.false)
            true.update(step.effects.true)
            steps.append(step)

        for atom in goal:
            thing, place = atom.args
            if atom in true:
                continue
            if held(thing) not in true:
                where = [place for place in self._places if at(thing, place) in true]
                if FREE not in true:
                    full = [other for other in self._things if held(other) in true]
                    if not full:
                        return NoPlan(NoPlanReason.UNSOLVABLE)
                    homes = [a.args[1] for a in goal if a.args[0] == full[0]]
                    do(put(full[0], homes[0] if homes else self._places[0]))
                if not where:
                    return NoPlan(NoPlanReason.UNSOLVABLE)
                do(pick(thing, where[0]))
            do(put(thing, place))
        if not true.issuperset(goal.true):
            return NoPlan(NoPlanReason.UNSOLVABLE)
        return Plan(tuple(steps), float(len(steps)), "courier", 0.0)


def monitor(setting: str, atoms: tuple[Atom, ...], mutex: tuple[Group, ...], flips: float) -> Monitor:
    """The monitor of a setting, told how often the eye errs."""
    if setting == SETTINGS[0]:
        return PlainMonitor(atoms)
    eye = Eye(other=Reading(flips, flips), alike=0.0) if flips else EXACT
    actions = None if setting == SETTINGS[1] else ActionModel()
    return FusedMonitor(Network(atoms, mutex), eye, actions)


def settings(setting: str, seed: int) -> Settings:
    patient = setting == SETTINGS[3]
    return Settings(seed, max_looks_again=3 if patient else 0, precondition_wait=2 if patient else 0, max_replans=200)


def symbolic(
    setting: str, flips: float, seed: int, faults: Sequence[str], numb: bool = False, watched: bool = True
) -> Score:
    """One run in the symbolic world, with a hand that feels or a `numb` one, and with the guard or without it."""
    some = task(THINGS, PLACES, GOAL)
    start = {thing: PLACES[(index // 2 + 1 + (seed + index) % 2) % 3] for index, thing in enumerate(THINGS)}
    world, skill = FakeWorld(start, PLACES), FakeSkill()
    skill.numb = numb
    scorer = Scorer(lambda: world.truth(some.atoms), GOAL)
    Executive(
        some,
        Courier(some),
        world,
        {"pick": skill, "place": skill},
        Noisy(ScriptedEstimator(world), flips, seed),
        [scorer],
        settings(setting, seed),
        FaultInjector([parse_fault(spec) for spec in faults], world, seed),
        monitor=monitor(setting, some.atoms, groups(some), flips),
        attention=WATCHED if watched else None,
    ).run()
    return scorer.score


def simulated(setting: str, flips: float, seed: int, faults: Sequence[str], problem: str | None, eye: str) -> Score:
    """One run in the simulator. `eye` is "oracle" or "vlm" (the domain's model), or "vlm,blur=3" on bad pictures."""
    from executive.assemble import Run, RunConfig, load_attention, load_moves, load_skills
    from executive.eye import EyeConfig, open_eye
    from executive.lab.noisy import Worse
    from executive.mutex import find_mutexes
    from executive.planning import FastDownwardPlanner
    from executive.sim.truth import Oracle

    with tempfile.TemporaryDirectory() as runs:
        config = RunConfig("grocery", problem, seed, "oracle", tuple(faults), runs=Path(runs), viewer=False)
        with Run(config) as run:
            domain, world, kind = run.domain, run.world, eye.partition(",")
            estimator: Estimator = Oracle(run.truth)
            if kind[0] == "vlm":
                estimator = open_eye(EyeConfig(), domain.subject)
            if kind[2]:
                name, _, amount = kind[2].partition("=")
                estimator = Worse(estimator, name, float(amount), seed)
            scorer = Scorer(lambda: run.truth.of(domain.task.atoms), domain.task.goal)
            Executive(
                domain.task,
                FastDownwardPlanner(domain.parsed),
                world,
                load_skills(domain),
                Noisy(estimator, flips, seed) if flips else estimator,
                [scorer],
                settings(setting, seed),
                FaultInjector([parse_fault(spec) for spec in faults], world, seed),
                monitor=monitor(setting, domain.task.atoms, find_mutexes(domain.parsed).groups, flips),
                attention=load_attention(domain, world),
                moves=load_moves(domain),
            ).run()
            return scorer.score


HEAD = (
    "success", "false", "missed", "alarms", "needless", "replans", "actions", "looks/action",
    "questions/look", "delay s",
)  # fmt: skip


def figures(scores: Sequence[Score]) -> tuple[str, ...]:
    """The figures of many runs, in the order of `HEAD`."""

    def total(name: str) -> int:
        return sum(getattr(score, name) for score in scores)

    runs, delays = len(scores), [delay for score in scores for delay in score.delays]
    return (
        f"{total('success') / runs:.1%}",
        f"{total('false_success') / runs:.1%}",
        f"{total('missed') / max(1, total('failed')):.1%}",
        f"{total('alarms') / max(1, total('calm')):.1%}",
        f"{total('needless') / runs:.2f}",
        f"{total('replans') / runs:.2f}",
        f"{total('actions') / runs:.1f}",
        f"{total('looks') / max(1, total('actions')):.2f}",
        f"{total('questions') / max(1, total('looks')):.1f}",
        f"{fmean(delays):.2f}" if delays else "-",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", choices=("symbolic", "mujoco"), default="symbolic")
    parser.add_argument("--seeds", type=int, help="runs of each kind; 100 in the symbolic world, else 5")
    parser.add_argument("--flips", type=float, nargs="*", help=f"{FLIPS} in the symbolic world, else 0.05")
    parser.add_argument("--problem", help="of the grocery domain")
    parser.add_argument("--eye", default="oracle", help="in the simulator: oracle, vlm, or such as vlm,blur=3")
    parser.add_argument("--fault", action="append", help=f"{', '.join(FAULTS)} if not given")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    symbolically, faults = arguments.world == "symbolic", tuple(arguments.fault or FAULTS)
    seeds = range(arguments.seeds or (100 if symbolically else 5))
    began = time.perf_counter()
    print(f"{arguments.world} world, {len(seeds)} seeds each, faults {', '.join(faults)}")
    print(f"{'flipped':>8}  {'setting':<24}" + "".join(f"{name:>15}" for name in HEAD))
    flips = arguments.flips if arguments.flips else FLIPS if symbolically else (0.05,)
    rows: list[tuple[str, str, partial[Score]]] = []
    for share in flips:
        for setting in SETTINGS:
            one = partial(_symbolic, setting, share, faults, False, True) if symbolically else partial(
                _simulated, setting, share, faults, arguments.problem, arguments.eye
            )  # fmt: skip
            rows.append((f"{share:.0%}", setting, one))
    if symbolically:  # what the guard is for: a hand that does not feel what it loses
        for watched in (False, True):
            name = f"numb hand, {'' if watched else 'no '}guard"
            rows.append(("5%", name, partial(_symbolic, SETTINGS[-1], 0.05, faults, True, watched)))
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for share, name, one in rows:
            scores = list(pool.map(one, seeds))
            print(f"{share:>8}  {name:<24}" + "".join(f"{figure:>15}" for figure in figures(scores)), flush=True)
    print(f"{time.perf_counter() - began:.0f} s")


def _symbolic(setting: str, flips: float, faults: Sequence[str], numb: bool, watched: bool, seed: int) -> Score:
    return symbolic(setting, flips, seed, faults, numb, watched)


def _simulated(setting: str, flips: float, faults: Sequence[str], problem: str | None, eye: str, seed: int) -> Score:
    return simulated(setting, flips, seed, faults, problem, eye)


if __name__ == "__main__":
    main()
