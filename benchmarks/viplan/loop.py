"""The closed loop in the symbolic world, on problems whose first looks were recorded.

It is simulated: a model's answers are drawn from what it said at other problems, and what is asked again while nothing
has changed is answered as before as often as it was in the records.

The sensor model is fitted on the looks at half of the problems, and answers are drawn from the looks at the other half,
without those at the problem at hand. The plain threshold acts on each answer by itself, as in the published runs."""

from __future__ import annotations

import itertools
import json
import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from benchmarks.viplan.recorded import Look, Run, Tasks
from executive.app.assembly import make_executive
from executive.belief import ActionModel, BayesMonitor, Monitor, MutexNetwork, SensorModel, StateSpace, ThresholdMonitor
from executive.belief.action_model import process_noise
from executive.belief.packed_actions import Actions
from executive.belief.sensor_model import AnswerCounts, error_correlation
from executive.core.settings import Settings
from executive.domain.pddl import Schema
from executive.planning.state_listing import steps
from executive.symbolic import SymbolicSkill, SymbolicWorld
from executive.trace.report.summary import Collector
from executive.types import Atom, Belief, Condition, Facts, NoPlan, NoPlanReason, Observation, OutcomeKind, Plan, Step

PLAIN, WHOLE = MONITORS = ("plain threshold", "whole monitor")
CORRELATION = 0.8
MOST_KEPT = 20_000_000
"""How many numbers a planner keeps of distances, and of states that should not be, before it begins to forget."""

SETTINGS = {"max_cycles": 60, "max_actions": 40, "max_replans": 20, "max_looks": 150, "max_questions": 200}


@dataclass(frozen=True, slots=True)
class Row:
    """What a run came to."""

    model: str
    split: str
    problem: str
    seed: int
    monitor: str
    published: bool
    success: bool
    false_success: bool
    replans: int
    questions: int


Pairs: TypeAlias = "Counter[tuple[str, bool, bool]]"
"""How often an answer about a predicate was wrong or not, and the next one about the same atom."""


@dataclass(frozen=True, eq=False)
class Habits:
    """How a model answers: its answers by predicate and truth, and by atom, and how often an answer is repeated."""

    counts: AnswerCounts
    pairs: Pairs

    @cached_property
    def repeats(self) -> Mapping[str, float]:
        """The correlation of the errors of repeated questions, by predicate."""
        found: dict[str, Counter[tuple[bool, bool]]] = {}
        for (name, first, second), number in self.pairs.items():
            found.setdefault(name, Counter())[first, second] = number
        return {name: error_correlation(own, CORRELATION) for name, own in found.items()}

    def __sub__(self, other: Habits) -> Habits:
        return Habits(self.counts - other.counts, self.pairs - other.pairs)


def habits(looks: Sequence[Sequence[Look]]) -> Habits:
    """Count a model's answers along some runs."""
    counts = AnswerCounts.of(
        (atom, answer.yes, answer.truth)
        for run in looks
        for look in run[:1]
        for atom, answer in look.answers.items()
        if answer.yes is not None
    )
    pairs: Pairs = Counter()
    for run in looks:
        last: dict[Atom, tuple[bool, bool]] = {}
        for look in run:
            for atom, answer in look.answers.items():
                wrong = answer.yes is not answer.truth
                if atom in last and last[atom][1] is answer.truth:
                    pairs[atom.predicate, last[atom][0], wrong] += 1
                last[atom] = wrong, answer.truth
    return Habits(counts, pairs)


class DrawnAnswers:
    """An estimator that answers as a model does of whom some answers are known. It is part of the simulation: what is
    true is asked of the world."""

    name = "drawn answers"

    def __init__(self, world: SymbolicWorld, known: Habits, seed: int) -> None:
        self._world, self._known, self._rng = world, known, np.random.default_rng([seed, 7])
        self._last: dict[Atom, tuple[bool, bool]] = {}

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        state = self._world.state
        return Belief(
            observation.id, {atom: self._answer(atom, state[atom]) for atom in sorted(atoms)}, source=self.name
        )

    def _answer(self, atom: Atom, truth: bool) -> float:
        draw, again = self._rng.random(2)
        if atom in self._last and self._last[atom][1] is truth and again < self._known.repeats.get(atom.predicate, 0.0):
            return float(self._last[atom][0])
        said = {yes: self._known.counts.predicates[atom.predicate, truth, yes] for yes in (False, True)}
        model = self._known.counts.error_model(atom.predicate)  # where it was never asked
        rate = (
            said[True] / sum(said.values()) if sum(said.values()) else 1 - model.misses if truth else model.false_alarms
        )
        yes = bool(draw < rate)
        self._last[atom] = yes, truth
        return float(yes)


class ListedPlanner:
    """The shortest plan, by search backwards from the goal among listed states: those that the actions lead to, or else
    those that the state to plan from leads to, as where each answer was thresholded. What was worked out is kept, as
    models see the same impossible states again and again."""

    def __init__(self, space: StateSpace, moves: Sequence[Step], actions: Actions | None = None) -> None:
        self._space = space
        self._actions = Actions(space.atoms, moves, space.rules) if actions is None else actions
        leads = [after.astype(np.int32) for after in space.transitions(self._actions)]
        self._moves = list(zip(self._actions.steps, leads, strict=True))
        self._distances: dict[tuple[Condition, frozenset[Step]], np.ndarray[Any, Any]] = {}
        self._elsewhere: dict[frozenset[Atom], ListedPlanner | None] = {}

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = 10.0
    ) -> Plan | NoPlan:
        number = self._space.number(state.true)
        if number is None:
            other = self._for(state.true)
            return NoPlan(NoPlanReason.TIMED_OUT) if other is None else other.plan(state, goal, avoid)
        moves = [(step, after) for step, after in self._moves if step not in avoid]
        key = goal, avoid
        if key not in self._distances:
            if len(self._distances) * len(self._space) > MOST_KEPT:
                del self._distances[next(iter(self._distances))]
            self._distances[key] = self._measured(goal, [after for _, after in moves])
        distance = self._distances[key]
        if distance[number] < 0:
            return NoPlan(NoPlanReason.UNSOLVABLE)
        found = []
        while distance[number] > 0:
            step, number = next(
                (step, int(after[number]))
                for step, after in moves
                if after[number] >= 0 and distance[after[number]] == distance[number] - 1
            )
            found.append(step)
        return Plan(tuple(found), float(len(found)), "listed", 0.0)

    def _for(self, true: frozenset[Atom]) -> ListedPlanner | None:
        """Return a planner for the states that this one leads to; None if there are too many."""
        if true not in self._elsewhere:
            known = [each for each in dict.fromkeys(self._elsewhere.values()) if each is not None]
            planner = next((each for each in known if each._space.number(true) is not None), None)
            if planner is None:
                space = StateSpace.reachable(self._space.atoms, self._actions, true, most_work=1_000_000)
                planner = None if space is None else ListedPlanner(space, (), self._actions)
                if sum(len(each._space) for each in known) * len(self._moves) > MOST_KEPT:
                    self._elsewhere.clear()
            self._elsewhere[true] = planner
        return self._elsewhere[true]

    def _measured(self, goal: Condition, moves: Sequence[np.ndarray[Any, Any]]) -> np.ndarray[Any, Any]:
        holds = self._space.holds(goal)
        distance = np.where(holds, 0, -1).astype(np.int16)
        reached, steps_away = holds, 0
        while reached.any():
            steps_away += 1
            before = np.zeros(len(distance), dtype=np.bool_)
            for after in moves:
                before |= (after >= 0) & reached[after]
            reached = before & (distance < 0)
            distance[reached] = steps_away
        return distance


class Problem(NamedTuple):
    """A task with what is worked out of its PDDL once, for all runs."""

    schema: Schema
    network: MutexNetwork
    space: StateSpace
    planner: ListedPlanner


class Problems:
    """Works problems out, each when it is asked for. Those with the same states share them, with all that is known of
    where actions lead from these."""

    def __init__(self, tasks: Tasks) -> None:
        self._tasks, self._known = tasks, dict[tuple[str, str], Problem]()
        self._shared: dict[bytes, tuple[StateSpace, MutexNetwork, ListedPlanner]] = {}

    def of(self, run: Run) -> Problem:
        if run.unit not in self._known:
            schema = self._tasks.schema(run)
            task, moves = schema.task, tuple(steps(schema))
            space = StateSpace.reachable(task.atoms, moves, task.declared, task.derived)
            assert space is not None, "problems of this benchmark have few states"
            key = repr((space.atoms, moves)).encode() + space.packed.tobytes()
            if key not in self._shared:
                network = MutexNetwork(task.atoms, space.mutex_groups())
                self._shared[key] = space, network, ListedPlanner(space, moves)
            space, network, planner = self._shared[key]
            self._known[run.unit] = Problem(schema, network, space, planner)
        return self._known[run.unit]


def play(run: Run, problem: Problem, fitted: Habits, drawn: Habits, monitor: str, seed: int) -> Row:
    """Play one problem with answers like those of the run's model."""
    schema, network, space, planner = problem
    task = schema.task
    world = SymbolicWorld(task.atoms, task.declared, lambda state, rng, names: None, seed=seed, rules=task.derived)
    collector = Collector()
    used: Monitor = ThresholdMonitor(task.atoms)
    if monitor == WHOLE:
        sensor = SensorModel(
            {name: fitted.counts.error_model(name) for name in {atom.predicate for atom in task.atoms}},
            atoms={atom: fitted.counts.error_model(atom) for atom in task.atoms},
            correlations=fitted.repeats,
        )
        used = BayesMonitor(network, sensor, ActionModel(process_noise=process_noise(len(task.atoms))), space=space)
    skills = dict.fromkeys(schema.actions, SymbolicSkill())
    settings = Settings(seed=seed, **SETTINGS)
    estimator = DrawnAnswers(world, drawn, seed)
    make_executive(task, planner, world, skills, estimator, [collector], settings, monitor=used).run()
    is_true = task.goal.truth(task.derived.complete(world.state)) is True
    summary = collector.summary(is_true)
    claimed = summary["outcome"] == OutcomeKind.GOAL_REACHED
    return Row(
        run.model, run.split, run.problem, seed, monitor, run.reached, claimed and is_true, claimed and not is_true,
        summary["replans"], summary["looking"]["questions"],
    )  # fmt: skip


def rows(runs: Sequence[Run], tasks: Tasks, seeds: int, kept: Path | None, most: int | None = None) -> Iterator[Row]:
    """Yield a row for each problem, monitor and seed of each model; those in the file are not played again.

    Args:
        most: so many problems are played, drawn once and for all; all of them by default.
    """
    done: dict[tuple[Any, ...], Row] = {}
    if kept is not None and kept.exists():
        for line in kept.read_text(encoding="utf-8").splitlines():
            row = Row(**json.loads(line))
            done[row.model, row.split, row.problem, row.seed, row.monitor] = row
    problems = Problems(tasks)
    played: dict[str, list[Run]] = {}
    for run in runs:
        if run.looks:
            played.setdefault(run.model, []).append(run)
    known = {model: _halves(own) for model, own in played.items()}
    units = sorted({run.unit for run in runs})
    random.Random(0).shuffle(units)
    of = {(run.model, run.unit): run for own in played.values() for run in own}
    # Each problem is played with all models before the next one, so that what was played so far says something.
    for seed, unit, model, monitor in itertools.product(range(seeds), units[:most], played, (WHOLE, PLAIN)):
        if (model, unit) not in of:  # not every model was asked about every problem
            continue
        run = of[model, unit]
        key = (model, run.split, run.problem, seed, monitor)
        if key not in done:
            fitted, drawn = (half - habits([run.looks] if run in own else []) for half, own in known[model])
            done[key] = play(run, problems.of(run), fitted, drawn, monitor, seed)
            if kept is not None:
                with kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(done[key])) + "\n")
        yield done[key]


def _halves(runs: Sequence[Run]) -> list[tuple[Habits, Sequence[Run]]]:
    """Return how a model answered on every second problem, and on the others."""
    own = sorted(runs, key=lambda run: run.unit)
    return [(habits([run.looks for run in half]), half) for half in (own[::2], own[1::2])]


def measure(
    runs: Sequence[Run], tasks: Tasks, seeds: int, kept: Path | None, most: int | None = None
) -> list[dict[str, Any]]:
    """Return a row for each model, with the shares of its runs of either monitor."""
    found: dict[str, list[Row]] = {}
    for row in rows(runs, tasks, seeds, kept, most):
        found.setdefault(row.model, []).append(row)
    return [_scores(model, members) for model, members in sorted(found.items())]


def _scores(model: str, members: Sequence[Row]) -> dict[str, Any]:
    scores: dict[str, Any] = {"model": model, "simulated": True}
    problems = {(row.split, row.problem): row.published for row in members}
    scores |= {"problems": len(problems), "published": sum(problems.values()) / len(problems)}
    for monitor in MONITORS:
        own = [row for row in members if row.monitor == monitor]
        names = ("success", "false_success", "replans", "questions")
        means = {name: sum(float(getattr(row, name)) for row in own) / len(own) for name in names}
        scores[monitor] = {"runs": len(own), **means}
    return scores


def printed(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as text."""
    lines = [
        f"{'model':<36}{'published':>10} | {'plain: success':>15}{'false':>7}{'replans':>9}{'questions':>11}"
        f" | {'whole: success':>15}{'false':>7}{'replans':>9}{'questions':>11}"
    ]
    for row in found:
        parts = [
            f"{own['success']:>15.3f}{own['false_success']:>7.3f}{own['replans']:>9.1f}{own['questions']:>11.0f}"
            for own in (row[PLAIN], row[WHOLE])
        ]
        lines.append(f"{row['model']:<36}{row['published']:>10.2f} | {' | '.join(parts)}")
    return "\n".join(lines)
