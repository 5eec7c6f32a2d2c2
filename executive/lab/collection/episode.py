"""One episode of the paper's data collection (Appendix D): random actions, carried out in full and imperfectly.

An action counts as completed when its skill reports `done`: the arm got through all of its motions to where the action
ends, which is the paper's "target robot configuration achieved". It does not mean that the effects came about: what
was gripped off its centre may have tipped something over on the way, and the labels are what is true, not what was
intended. A skill that feels a miss or a drop breaks its motions off, which is a failure; what it left behind (an item
on its side, or on the floor) stays there and is in the picture of the next action that completes.

Imperfect are the grasp, which is off its mark by a little, and the grip: what a grasp beside the mark still holds is
hardly ever lost later, so now and then the fingers open on the way, and what they carried falls where it falls.
"""

from __future__ import annotations

import logging
from functools import partial
from typing import NamedTuple

import numpy as np

from executive.app.worlds import load_skills
from executive.domain.loader import Domain
from executive.domain.pddl import Schema
from executive.errors import ExecutiveError
from executive.faults import Fault, FaultInjector
from executive.lab.collection.dataset import Attempt, Ending, Log, Point
from executive.lab.collection.demonstrations import column
from executive.lab.collection.recorder import Recorder
from executive.lab.common.process_pool import ReportProgress
from executive.lab.config import MOST_POINTS
from executive.protocols import SkillContext
from executive.sim.initial_state import InitialState
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Facts, LookCause, News, Phase, SkillResult, SkillStatus, Step

MOST_FAILURES = 5
"""In a row (Appendix D, step 5)."""

log = logging.getLogger(__name__)


class Episode(NamedTuple):
    """What an episode was, and its points."""

    log: Log
    points: list[Point]


def instances(schema: Schema) -> tuple[Step, ...]:
    """Every step of a task that can ever be carried out."""
    found = []
    for name, action in schema.actions.items():
        for args in schema.typing.tuples([kind for _, kind in action.parameters]):
            try:
                found.append(schema.ground(name, args))
            except ValueError:  # this one contradicts itself
                continue
    return tuple(found)


class Collector:
    """Plays episodes of one domain. The same seed and number give the same episode, whatever was played before.

    Args:
        seed: the collection's.
        home_pose: whether each action ends at the home pose.
        grasp_noise: standard deviation in m of the horizontal error of a grasp.
        slips: the chance that the gripper lets go of what it carries, in each action that carries something.
        full: completed actions after which an episode is over.
        renderer: what draws the pictures, in place of what the scene says.
        masks: whether points have the cameras' masks.
        start: where items stand at a reset, as the problem declares it; without it, anywhere on tables.
        demonstrations: whether points have how the arm moved.
    """

    def __init__(
        self,
        domain: Domain,
        seed: int,
        home_pose: bool,
        grasp_noise: float,
        slips: float,
        full: int = MOST_POINTS,
        renderer: str | None = None,
        masks: bool = False,
        start: InitialState | None = None,
        demonstrations: bool = False,
    ) -> None:
        self._demonstrations = demonstrations
        self._renderer, self._masks, self._start = renderer, masks, start or InitialState()
        self.domain, self._seed, self._home_pose = domain, seed, home_pose
        self._grasp_noise, self._slips = grasp_noise, Fault("drop", chance=slips)
        self._full = full
        self._steps = instances(domain.parsed)
        self._skills = load_skills(domain)

    def play(self, number: int, most: int, tell: ReportProgress) -> Episode:
        """One episode from its reset on, cut after `most` points. `tell` receives their number at each.

        Unless there is a `start`, the items stand anywhere upright: what the problem declares of their places is for
        runs.
        """
        world = MujocoWorld(
            self.domain.scene,
            self.domain.task.objects,
            seed=self._derived(number, 2),
            grasp_noise=self._grasp_noise,
            home_pose=self._home_pose,
            placed=self._start.placed,
            stacked=self._start.stacked,
            regions=self._start.regions,
            renderer=self._renderer,
        )
        try:
            return self._play(number, most, world, tell)
        finally:
            world.close()

    def _play(self, number: int, most: int, world: MujocoWorld, tell: ReportProgress) -> Episode:
        truth, atoms = Truth(world, self.domain.relations, self.domain.task.parameters), self.domain.task.atoms
        chance, faults = self._chance(number, 0), FaultInjector([self._slips], world, self._derived(number, 3))
        recorder = Recorder(world) if self._demonstrations else None
        handle = world.handle if recorder is None else recorder.handle
        attempts: list[Attempt] = []
        points: list[Point] = []
        facts, failures = truth.of(atoms), 0
        while True:
            known = self.domain.task.derived.complete(facts)
            applicable = [step for step in self._steps if step.precondition.truth(known)]
            if not applicable:
                ending = Ending.STUCK
                break
            step = applicable[int(chance.integers(len(applicable)))]
            count = len(attempts) + 1
            faults.before_action(count, step)
            follow = partial(_follow, faults, count, step, recorder)
            if recorder is not None:
                recorder.begin()
            context = SkillContext(handle, self._chance(number, 1, count), follow, lambda: False)
            result = self._carry_out(step, context)
            faults.after_action(count, step)
            attempts.append(Attempt(str(step), str(result.status), result.reason))
            before, facts = facts, truth.of(atoms)
            if result.status is SkillStatus.CRASHED:
                ending = Ending.CRASHED
                break
            failures = 0 if result.done else failures + 1
            if result.done:
                points.append(self._point(number, len(points) + 1, step, world, before, facts, recorder))
                tell(len(points))
            if failures == MOST_FAILURES:
                ending = Ending.FAILURES
                break
            if len(points) == min(most, self._full):
                ending = Ending.FULL if len(points) == self._full else Ending.CUT
                break
        return Episode(Log(number, len(points), tuple(attempts), ending), points)

    def _chance(self, *key: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))

    def _derived(self, *key: int) -> int:
        return int(np.random.SeedSequence(self._seed, spawn_key=key).generate_state(1, np.uint64)[0])

    def _carry_out(self, step: Step, context: SkillContext) -> SkillResult:
        try:
            return self._skills[step.action](step, context)
        except ExecutiveError:
            raise
        except Exception as error:  # a bug of one skill does not cost a night's collection; the card counts it
            log.exception("the skill for %s raised", step)
            return SkillResult(step, SkillStatus.CRASHED, f"{type(error).__name__}: {error}")

    def _point(
        self,
        number: int,
        index: int,
        step: Step,
        world: MujocoWorld,
        before: Facts,
        facts: Facts,
        recorder: Recorder | None,
    ) -> Point:
        look = world.observe(LookCause.AFTER.about(step))
        changes = step.changes(self.domain.task.derived.complete(before))
        return Point(
            seed=self._seed,
            episode=number,
            step=index,
            action=str(step),
            time=look.time,
            joints=look.joints,
            qpos=world.data.qpos.copy(),
            images=look.images,
            masks=world.masks() if self._masks else {},
            facts=facts,
            surprises=tuple(a for a, value in facts.items() if changes.get(a, before[a]) not in (None, value)),
            motion=None if recorder is None else column(recorder.samples, recorder.located),
        )


def _follow(faults: FaultInjector, count: int, step: Step, recorder: Recorder | None, news: News) -> None:
    if recorder is not None:
        recorder.hear(news)
    if isinstance(news, Phase):
        faults.on_phase(count, step, news)
