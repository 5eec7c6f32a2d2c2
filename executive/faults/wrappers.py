"""Faults of the executive's own parts: each of these stands between it and a world's cameras, an estimator, a planner
or a skill, keeps the same shape (`executive.protocols`), and lets through what its part says unless a fault has it
otherwise."""

from __future__ import annotations

import contextlib
import math
import time
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from executive.faults.grammar import Fault
from executive.faults.image_noise import SPOILED, spoiled
from executive.faults.injector import FaultInjector
from executive.protocols import Asking, Estimator, Planner, Skill, SkillContext, World
from executive.types import (
    Atom,
    Belief,
    Condition,
    DepthImage,
    Evidence,
    Facts,
    FloatArray,
    Image,
    NoPlan,
    NoPlanReason,
    Observation,
    Phase,
    Plan,
    Questions,
    Scenery,
    SkillResult,
    SkillStatus,
    Step,
    Watched,
)

Pixels = TypeVar("Pixels", Image, DepthImage)
Draw = Callable[[Observation], Observation]

NO_DEPTH = "no-depth"
"""The way in which a camera fails to measure depth, and shows its picture all the same."""

MOVED = "moved"
"""The way in which a camera stands elsewhere than it is taken to stand."""

_MOVE = (0.01, 0.03)
"""m by which it does."""

DELAY = 2.0
"""The default delay of a slow estimator, in wall seconds."""

_SHIFT = (0.08, 0.15)
"""The shift of the pictures of a knocked camera, as a share of their width."""

_POLL = 0.01
"""Wall seconds between two checks of a hanging skill for cancellation."""


@runtime_checkable
class MovesCameras(Protocol):
    """A world whose cameras can be moved."""

    def move_camera(self, camera: str, by: FloatArray) -> None:
        """Have a camera stand `by` (3,) m, in the world's frame, from where everybody believes it stands."""
        ...


def faulty_world(world: World, faults: FaultInjector, draw: Draw | None = None) -> World:
    """A world whose cameras fail as the faults demand.

    Args:
        draw: draws something into the pictures of working cameras.
    """
    return _World(world, faults, draw or (lambda observation: observation))


def faulty_sensing(world: World, sense: Callable[[], Observation], faults: FaultInjector) -> Callable[[], Observation]:
    """What `sense` senses for estimating poses, through cameras of the world that fail as the faults demand."""
    cameras = _Cameras(world, faults)
    return lambda: cameras.through(sense)


def faulty_estimator(estimator: Estimator, faults: FaultInjector) -> Estimator:
    """An estimator that is silent, wrong or slow as the faults demand."""
    asking: object = estimator  # whether it asks in words is for the running program to find out
    return (_AskingEstimator if isinstance(asking, Asking) else _Estimator)(estimator, faults)


def faulty_planner(planner: Planner, faults: FaultInjector) -> Planner:
    """A planner that runs out of time or crashes as the faults demand."""
    return _Planner(planner, faults)


def faulty_skills(skills: Mapping[str, Skill], faults: FaultInjector) -> dict[str, Skill]:
    """Skills that find no motion, hang or raise as the faults demand."""
    return {action: _Skill(skill, faults) for action, skill in skills.items()}


class _World:
    def __init__(self, world: World, faults: FaultInjector, draw: Draw) -> None:
        self._world, self._cameras, self._draw = world, _Cameras(world, faults), draw

    @property
    def time(self) -> float:
        return self._world.time

    @property
    def handle(self) -> Any:
        return self._world.handle

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        return self._cameras.through(lambda: self._draw(self._world.observe(cause, cameras)))

    def stop(self) -> None:
        self._world.stop()

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        self._world.schedule(delay, action)

    def scenery(self) -> Scenery:
        return self._world.scenery()

    def watch(self, listener: Callable[[Watched], None] | None) -> None:
        self._world.watch(listener)


class _Cameras:
    """Cameras as the faults demand them."""

    def __init__(self, world: World, faults: FaultInjector) -> None:
        self._world, self._faults = world, faults
        self._last: dict[str, Image] = {}
        self._last_depth: dict[str, DepthImage] = {}

    def through(self, take: Callable[[], Observation]) -> Observation:
        """What `take` observes, as these cameras show it."""
        with self._moved():
            observation = take()
        images, depth = dict(observation.images), dict(observation.depth)
        for place, fault in self._faults.felt("camera"):
            hit = [camera for camera in (depth if fault.way == NO_DEPTH else images) if fault.camera in (None, camera)]
            for camera in hit:
                images[camera], measured = self._changed(place, fault, camera, images[camera], depth.pop(camera, None))
                if measured is not None:
                    depth[camera] = measured
            if hit:
                self._faults.bite(place, f"{', '.join(hit)}: {fault.way}")
        self._last.update(images)
        self._last_depth.update(depth)
        return replace(observation, images=images, depth=depth)

    @contextlib.contextmanager
    def _moved(self) -> Iterator[None]:
        """While it lasts, cameras stand elsewhere, in a world that can have them do so."""
        world: object = self._world
        moved: list[str] = []
        if isinstance(world, MovesCameras):
            for place, fault in self._faults.felt("camera"):
                if fault.way == MOVED:
                    named = [camera.name for camera in self._world.scenery().cameras]
                    for camera in [name for name in named if fault.camera in (None, name)]:
                        chance = self._faults.chance(place, zlib.crc32(camera.encode()))
                        way = chance.normal(size=3)
                        world.move_camera(camera, chance.uniform(*_MOVE) * way / np.linalg.norm(way))
                        moved.append(camera)
        yield
        if isinstance(world, MovesCameras):
            for camera in moved:
                world.move_camera(camera, np.zeros(3))

    def _changed(
        self, place: int, fault: Fault, camera: str, image: Image, depth: DepthImage | None
    ) -> tuple[Image, DepthImage | None]:
        """What a camera shows and measures with a fault; None is no depth."""
        match fault.way:
            case "black":
                return np.zeros_like(image), None
            case "frozen":
                return self._last.get(camera, image), None if depth is None else self._last_depth.get(camera, depth)
            case "shifted":
                chance = self._faults.chance(place)
                length, angle = image.shape[1] * chance.uniform(*_SHIFT), chance.uniform(-np.pi, np.pi)
                by = round(length * np.sin(angle)), round(length * np.cos(angle))
                return _shifted(image, *by), None if depth is None else _shifted(depth, *by)
            case way if way == NO_DEPTH:
                return image, None
            case way if way == MOVED:
                return image, depth
            case way if way in SPOILED:
                chance = self._faults.drawn(place, zlib.crc32(camera.encode()))
                return spoiled(image, way, fault.amount, chance), depth
            case way:
                raise NotImplementedError(
                    f"the catalogue has camera faults of the way {way!r}, and nothing here does them"
                )


def _shifted(image: Pixels, down: int, right: int) -> Pixels:
    """Shifts a picture, with black at the border."""
    moved = np.zeros_like(image)
    height, width = image.shape[:2]
    moved[max(0, down) : height + min(0, down), max(0, right) : width + min(0, right)] = image[
        max(0, -down) : height + min(0, -down), max(0, -right) : width + min(0, -right)
    ]
    return moved


class _Estimator:
    def __init__(self, estimator: Estimator, faults: FaultInjector) -> None:
        self._estimator, self._faults = estimator, faults

    @property
    def name(self) -> str:
        return self._estimator.name

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        belief = self._estimator.estimate(observation, atoms)
        for place, fault in self._faults.felt("estimator"):
            about = [atom for atom in sorted(atoms) if fault.item is None or fault.item in atom.args]
            if fault.way == "wrong" and fault.share is not None:
                about = [atom for atom in about if self._drawn(place, atom) < fault.share]
            if not about:
                continue
            match fault.way:
                case "slow":
                    seconds = DELAY if fault.seconds is None else fault.seconds
                    self._faults.bite(place, f"answers come {seconds:g} s late")
                    time.sleep(seconds)
                case "silent":
                    self._faults.bite(place, f"no answer about {_listed(about)}")
                    belief = belief.without(about)
                case _:
                    self._faults.bite(place, f"the opposite is answered about {_listed(about)}")
                    belief = _turned_round(belief, about)
        return belief

    def _drawn(self, place: int, atom: Atom) -> float:
        """Draws for each atom separately, so that the other atoms of a query do not matter."""
        return float(self._faults.drawn(place, zlib.crc32(str(atom).encode())).random())


class _AskingEstimator(_Estimator):
    @property
    def questions(self) -> Questions:
        asking: Any = self._estimator
        questions: Questions = asking.questions
        return questions


def _turned_round(belief: Belief, about: Collection[Atom]) -> Belief:
    probability = {atom: 1.0 - value if atom in about else value for atom, value in belief.probability.items()}
    evidence = {
        atom: tuple(map(_swapped, answers)) if atom in about else answers for atom, answers in belief.evidence.items()
    }
    return replace(belief, probability=probability, evidence=evidence)


def _swapped(answer: Evidence) -> Evidence:
    return replace(answer, yes_mass=answer.no_mass, no_mass=answer.yes_mass)


def _listed(atoms: Sequence[Atom]) -> str:
    return f"{len(atoms)} atoms" if len(atoms) > 3 else ", ".join(map(str, atoms))


class _Planner:
    def __init__(self, planner: Planner, faults: FaultInjector) -> None:
        self._planner, self._faults = planner, faults

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        for place, fault in self._faults.felt("planner"):
            crashed = fault.way == "crash"
            self._faults.bite(place, "the planner crashes" if crashed else "the planner runs out of time")
            return NoPlan(NoPlanReason.CRASHED if crashed else NoPlanReason.TIMED_OUT, f"the fault {fault}", "fault")
        return self._planner.plan(state, goal, avoid, seconds)


class _Skill:
    def __init__(self, skill: Skill, faults: FaultInjector) -> None:
        self._skill, self._faults = skill, faults

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        for place, _ in self._faults.felt("motion", step):
            self._faults.bite(place, "no motion is found")
            context.announce(Phase("plan"))
            return SkillResult(step, SkillStatus.NO_PATH, "no collision-free motion")
        for place, fault in self._faults.felt("skill", step):
            if fault.way == "raise":
                self._faults.bite(place, "the skill raises an exception")
                raise RuntimeError(f"the fault {fault}")
            self._faults.bite(place, "the skill hangs")
            while not context.cancelled():
                time.sleep(_POLL)
            return SkillResult(step, SkillStatus.CANCELLED, "cancelled")
        return self._skill(step, context)
