"""The interfaces between the loop and its parts. Whatever has these methods can take part: a real robot, another
planner, another estimator."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from executive.types import (
    Atom,
    Belief,
    Condition,
    Event,
    Facts,
    FaultInjected,
    News,
    NoPlan,
    Observation,
    Phase,
    Plan,
    Questions,
    Scenery,
    SearchOrder,
    SkillResult,
    Step,
    Testimony,
    Watched,
)


@runtime_checkable
class Planner(Protocol):
    """Finds a plan for one task from any of its states."""

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        """A plan from `state` (atoms not mentioned are false) to `goal`; an empty plan when the goal holds already.

        None of the steps in `avoid` is part of it: to this question the task is one that does not have them, and
        unsolvable means that there is no plan without them. It takes about so many wall `seconds` at most, and less
        where the planner has a limit of its own.

        Never raises for a task that has no plan, takes too long or crashes the planner: that is a `NoPlan`.
        """
        ...


Supposing: TypeAlias = Callable[[Facts], "tuple[Mapping[Atom, float], Facts]"]
"""Returns what would be believed if these literals held, too: each atom's probability, and the state that is planned
from. Without literals, what is believed."""


@runtime_checkable
class PlaceSearch(Protocol):
    """Finds where to look first for what a goal needs and nobody can see."""

    def order(self, supposing: Supposing, goal: Condition, hidden: frozenset[Atom]) -> SearchOrder:
        """The places where one of the `hidden` atoms can be seen, from the one to look at first on; none, where there
        is nothing to choose."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """Judges how probable each atom is, given one observation. It receives nothing else of the run."""

    @property
    def name(self) -> str: ...

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """Return a belief over exactly `atoms`; those that it cannot judge are `unanswered`."""
        ...


@runtime_checkable
class Witness(Protocol):
    """Tells of atoms at a look by other means than the estimator, with errors of its own."""

    @property
    def name(self) -> str: ...

    def testify(self, observation: Observation, atoms: Sequence[Atom]) -> Testimony:
        """Return the probability of each of the atoms that it can tell of at this moment, and which of them it alone
        can tell."""
        ...


@runtime_checkable
class Asking(Protocol):
    """An estimator that asks a model in words. The words go into the trace, so that others can ask the same again."""

    @property
    def questions(self) -> Questions: ...


@runtime_checkable
class World(Protocol):
    """The robot and its surroundings: all that the loop needs of them, and that a real robot can offer."""

    @property
    def time(self) -> float:
        """Seconds on the world's own clock."""
        ...

    @property
    def handle(self) -> Any:
        """What skills drive. Its type is a matter between this world and the skills made for it."""
        ...

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        """Take a picture with every camera, or with those named that there are, and read the joints."""
        ...

    def stop(self) -> None:
        """Have the robot stand still. The loop calls it once a run is over, whatever ended it; a robot that stands
        still already goes on doing so."""
        ...

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        """Call `action` once, `delay` seconds of the world's time from now, in the middle of whatever goes on then."""
        ...

    def scenery(self) -> Scenery:
        """Shapes and cameras, once, for the people who watch."""
        ...

    def watch(self, listener: Callable[[Watched], None] | None) -> None:
        """Tell `listener` where things are, some times a second of the world's time, while it moves: as they are, for
        people alone, and as they are estimated, where the robot films."""
        ...


@runtime_checkable
class Simulator(World, Protocol):
    """A world that can be saved, restored and disturbed, which only a simulated one can: asked for by faults, by the
    snapshots that a run is resumed from, and by the lab."""

    def snapshot(self) -> bytes:
        """The complete state, so that `restore` continues as if nothing had happened in between."""
        ...

    def restore(self, snapshot: bytes) -> None:
        """Continue from a snapshot. What was scheduled for later is forgotten.

        Raises:
            InputError: the bytes are no snapshot of this world.
        """
        ...

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        """Break something now, as a fault demands, and say in plain words what was done.

        Raises:
            InputError: this world does not know the kind or an argument.
        """
        ...


class Disturbable(Protocol):
    """What faults ask of a world: that things happen to it, at a moment of its own time. It need not be one that can be
    saved; on a real robot, a person may do it."""

    def schedule(self, delay: float, action: Callable[[], None]) -> None: ...

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str: ...


@dataclass(frozen=True, slots=True)
class SkillContext:
    """What a skill is given beside its step.

    `handle` is `World.handle`; `rng` is the skill's own seeded generator (fresh for each dispatch); `announce` puts a
    phase, a motion or estimated poses into the trace; `cancelled` is to be asked often, and answered with the status
    CANCELLED once the robot stands still. `lost` is to be asked as often while something is carried: it says why what
    is carried is taken to be lost by those who look on, and nothing as long as it is not. They may be mistaken. A skill
    whose hand feels it firmly carries on; another answers with the status DROPPED by the sense SEEN, and leaves the
    hand as it is.
    """

    handle: Any
    rng: np.random.Generator
    announce: Callable[[News], None]
    cancelled: Callable[[], bool]
    lost: Callable[[], str] = str


@runtime_checkable
class Skill(Protocol):
    """Carries out one kind of step, and reports what it did, not what it was asked to do."""

    def __call__(self, step: Step, context: SkillContext) -> SkillResult: ...


Tell = Callable[[str], None]
"""Receives, in a few words, what is waited for."""


@runtime_checkable
class Preparing(Protocol):
    """A skill that has to be made ready once on a machine, which may take a minute: before a run's first look."""

    def prepare(self, tell: Tell) -> None:
        """Make it ready, and return at once where it is. `tell` receives what takes time, as soon as that is known."""
        ...


@runtime_checkable
class Warming(Protocol):
    """A skill or a world that has something to build at its first use, which can be built before: while a run waits for
    its model. Nothing that can be observed changes by it."""

    def warm_up(self, handle: Any) -> None:
        """Build it, unless that takes as long as what `Preparing` announces. `handle` is what skills are given."""
        ...


@runtime_checkable
class Sink(Protocol):
    """Receives every event of a run and feeds nothing back: an exception in it never changes what the robot does."""

    def write(self, event: Event) -> None: ...

    def close(self) -> None: ...


@runtime_checkable
class Recalling(Protocol):
    """A sink that needs the events of a run's earlier processes before the run is resumed in this one."""

    def recall(self, event: Event) -> None: ...


class FaultSource(Protocol):
    """Breaks things on purpose, at the moments that the loop announces. `action` counts dispatched actions from 1."""

    def begin(self, report: Callable[[FaultInjected], None], action: int = 0) -> None:
        """The run begins, or goes on after `action` dispatched ones. What is broken goes to `report` at the moment it
        breaks, which may be in the middle of a skill, long after the call that scheduled it."""
        ...

    def before_action(self, action: int, step: Step) -> None: ...

    def on_phase(self, action: int, step: Step, phase: Phase) -> None: ...

    def after_action(self, action: int, step: Step) -> None: ...
