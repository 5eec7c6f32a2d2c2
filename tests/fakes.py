"""A symbolic world with everything around it: things in places, one hand, and whatever can go wrong.

The smallest domain that still picks, carries and drops, so that a whole run takes milliseconds: atoms
`at(thing,place)`, `held(thing)`, `free()`, actions `pick(thing,place)` and `place(thing,place)`. No part of it knows
the executive's mind: the world moves on its own clock, the estimator sees an observation, the skills drive the world.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from executive.app.assembly import make_executive
from executive.belief import BayesMonitor, Monitor, MutexNetwork, ThresholdMonitor, Thresholds
from executive.belief.mutex_inference import Group
from executive.core.attention import Attention
from executive.core.loop import Executive
from executive.core.settings import Settings
from executive.errors import InputError, nearest
from executive.protocols import FaultSource, Preparing, Skill, SkillContext, Witness
from executive.types import (
    ALWAYS,
    Atom,
    Belief,
    Cause,
    Condition,
    Decision,
    DepthImage,
    DerivedRules,
    Ended,
    Event,
    Facts,
    Frame,
    Image,
    NoPlan,
    NoPlanReason,
    Observation,
    Phase,
    Plan,
    Reason,
    Scenery,
    Sense,
    SkillResult,
    SkillStatus,
    Step,
    Task,
)

FREE = Atom("free")
_T = TypeVar("_T")
WATCHED = Attention(carried={"pick": ("held", (0,)), "place": ("held", (0,))})
"""What is carried is watched."""
FLOOR = "floor"
"""Where a thing can be, but out of the hand's reach and of every atom."""


def at(thing: str, place: str) -> Atom:
    return Atom("at", (thing, place))


def held(thing: str) -> Atom:
    return Atom("held", (thing,))


def pick(thing: str, place: str) -> Step:
    return Step.strips(
        "pick",
        (thing, place),
        Facts({at(thing, place): True, FREE: True}),
        Facts({held(thing): True, at(thing, place): False, FREE: False}),
    )


def put(thing: str, place: str) -> Step:
    return Step.strips(
        "place",
        (thing, place),
        Facts({held(thing): True}),
        Facts({at(thing, place): True, FREE: True, held(thing): False}),
    )


def task(things: Sequence[str], places: Sequence[str], goal: Facts) -> Task:
    atoms = [*(at(thing, place) for thing in things for place in places), *map(held, things), FREE]
    kinds = {**dict.fromkeys(things, "thing"), **dict.fromkeys(places, "place")}
    return Task("things", "fake", kinds, tuple(sorted(atoms)), Condition.of(goal))


def steps_of(some: Task) -> list[Step]:
    """Every grounded step of a task of this domain."""
    things = [name for name, kind in some.objects.items() if kind == "thing"]
    places = [name for name, kind in some.objects.items() if kind == "place"]
    return [make(thing, place) for make in (pick, put) for thing in things for place in places]


def groups(some: Task) -> tuple[Group, ...]:
    """What excludes what in this domain: a thing is in one place at most, and the hand holds one thing or is free."""
    things = sorted(name for name, kind in some.objects.items() if kind == "thing")
    own = [Group(tuple(atom for atom in some.atoms if thing in atom.args)) for thing in things]
    return (*own, Group((FREE, *map(held, things)), exact=True))


def budget(what: str, total: float) -> Cause:
    """The cause of an end for want of a budget."""
    return Cause(Reason.BUDGET_SPENT, what=what, total=total)


def recorded(text: str) -> tuple[Cause, ...]:
    """The causes of a decision in a record that has no codes."""
    return (Cause(Reason.RECORDED, detail=text),)


def decided(stage: Stage, code: Reason) -> list[Decision]:
    """The decisions of a run that have this cause."""
    return [decision for decision in stage.recorder.of(Decision) if code in decision.codes]


class FakePlanner:
    """Breadth-first search over grounded steps.

    `answers` are given first: a `NoPlan` or plan to return, an exception to raise, or None to search after all.
    `asked` keeps every state and goal that a plan was asked for, `avoided` the steps that it was to do without.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        answers: Iterable[Plan | NoPlan | Exception | None] = (),
        most: int = 5000,
        rules: DerivedRules | None = None,
    ) -> None:
        self._steps, self._answers, self._most = tuple(steps), deque(answers), most
        self._rules = rules or DerivedRules()
        self._atoms = frozenset(atom for step in steps for atom in self._rules.support(step.atoms))
        self.asked: list[tuple[Facts, Condition]] = []
        self.avoided: list[frozenset[Step]] = []

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        self.asked.append((state, goal))
        self.avoided.append(avoid)
        answer = self._answers.popleft() if self._answers else None
        if isinstance(answer, Exception):
            raise answer
        return answer or self._search(state, goal, avoid)

    def _known(self, here: frozenset[Atom], about: Iterable[Atom]) -> Mapping[Atom, bool]:
        return self._rules.complete({atom: atom in here for atom in self._atoms.union(self._rules.support(about))})

    def _holds(self, condition: Condition, here: frozenset[Atom]) -> bool:
        if not condition.choices and not self._rules:
            return all((atom in here) is value for atom, value in condition.facts.items())
        return condition.truth(self._known(here, condition.atoms)) is True

    def _after(self, step: Step, here: frozenset[Atom]) -> frozenset[Atom]:
        if len(step.effects) == 1 and step.effects[0].condition == ALWAYS:
            return (here - step.unconditional.false) | step.unconditional.true
        changes = step.changes(self._known(here, step.atoms))
        return (here - changes.keys()) | {atom for atom, value in changes.items() if value}

    def _search(self, state: Facts, goal: Condition, avoid: frozenset[Step]) -> Plan | NoPlan:
        start = state.true
        reached: dict[frozenset[Atom], tuple[Step, ...]] = {start: ()}
        queue = deque([start])
        while queue:
            here = queue.popleft()
            if self._holds(goal, here):
                steps = reached[here]
                return Plan(steps, float(len(steps)), "breadth-first", 0.0)
            for step in (step for step in self._steps if step not in avoid):
                if self._holds(step.precondition, here):
                    there = self._after(step, here)
                    if there not in reached:
                        reached[there] = (*reached[here], step)
                        queue.append(there)
            if len(reached) > self._most:
                return NoPlan(NoPlanReason.TIMED_OUT, f"more than {self._most} states", "breadth-first")
        return NoPlan(NoPlanReason.UNSOLVABLE, "", "breadth-first")


class FakeWorld:
    """Where each thing is (`where`: a place, "hand" or the floor), and a clock that moves when a skill lets it."""

    def __init__(self, where: Mapping[str, str], places: Sequence[str]) -> None:
        self.where, self.places = dict(where), tuple(places)
        self.now = 0.0
        self.stopped = 0  # how often it was told to stand still
        self.missing = False  # the next grasp closes beside its thing
        self.past: dict[int, dict[str, str]] = {}  # what each observation could have shown
        self.cameras: dict[str, Callable[[FakeWorld], Image]] = {}
        self.measured: dict[str, Callable[[FakeWorld], DepthImage]] = {}  # by those cameras that measure depth
        self.noisy = False  # whether these draw noise, as sensors do
        self._scheduled: list[tuple[float, Callable[[], None]]] = []
        self._listener: Callable[[Frame], None] | None = None

    @property
    def time(self) -> float:
        return self.now

    @property
    def handle(self) -> Any:
        return self

    @property
    def held(self) -> str | None:
        return next((thing for thing, place in sorted(self.where.items()) if place == "hand"), None)

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        number = len(self.past)
        self.past[number] = dict(self.where)
        images = {name: draw(self) for name, draw in self.cameras.items() if cameras is None or name in cameras}
        depth = {name: measure(self) for name, measure in self.measured.items() if name in images}
        return Observation(number, self.now, images, np.zeros(1), cause, self.noisy, depth)

    def stop(self) -> None:
        self.stopped += 1

    def snapshot(self) -> bytes:
        return json.dumps([self.where, self.now, self.missing]).encode()

    def restore(self, snapshot: bytes) -> None:
        self.where, self.now, self.missing = json.loads(snapshot)
        self._scheduled.clear()

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        if kind == "miss":
            self.missing = True
            return "the next grasp goes beside"
        if kind == "drop":
            dropped = self.held
            return "nothing is held" if dropped is None else self._move(dropped, str(rng.choice(self.places)))
        if kind == "shove":
            thing = arguments.get("item") or str(rng.choice(sorted(self.where)))
            if thing not in self.where:
                raise InputError(f"no thing {thing!r} to shove; {nearest(thing, self.where)}")
            return self._move(thing, str(rng.choice([place for place in self.places if place != self.where[thing]])))
        raise InputError(f"this world cannot be disturbed by {kind!r}; {nearest(kind, ('drop', 'miss', 'shove'))}")

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        self._scheduled.append((self.now + delay, action))
        self._scheduled.sort(key=lambda entry: entry[0])

    def scenery(self) -> Scenery:
        return Scenery()

    def watch(self, listener: Callable[[Frame], None] | None) -> None:
        self._listener = listener

    def advance(self, seconds: float) -> None:
        """Let time pass, with all that is scheduled for it."""
        until = self.now + seconds
        while self._scheduled and self._scheduled[0][0] <= until:
            self.now, action = self._scheduled.pop(0)
            action()
        self.now = until
        if self._listener is not None:
            self._listener(Frame({}, np.zeros(1), 0.0))

    def truth(self, atoms: Iterable[Atom], observation: int | None = None) -> Facts:
        """What holds now, or held when an observation was made."""
        where = self.where if observation is None else self.past[observation]
        true = {FREE} if "hand" not in where.values() else set()
        for thing, place in where.items():
            true.add(held(thing) if place == "hand" else at(thing, place))
        return Facts({atom: atom in true for atom in atoms})

    def _move(self, thing: str, place: str) -> str:
        self.where[thing] = place
        return f"{thing} went to {place}"


class FakeSkill:
    """Picks or places, through its phases; the outcome is what the world makes of it.

    `script` maps an action's number to what happens in it instead:
        "fail" or a `SkillStatus` word     reports that status and does nothing
        "lie"                             does nothing and reports that it is done
        "humble"                          does it and reports a missed grasp
        "land PLACE"                      the thing lands there and is reported as dropped (early)
        "land quietly PLACE"              the thing lands there, reported as done
        "hang"                            goes on until it is cancelled
        "raise", "interrupt", "nonsense"  raises RuntimeError or KeyboardInterrupt, returns no result
    An entry may be a callable instead, which is called with the world before the skill goes about its usual work.
    `numb` is a hand that does not feel when what it carries is gone.
    """

    def __init__(self, script: Mapping[int, str | Callable[[FakeWorld], None]] | None = None, *, patience: int = 10**6):
        self.script, self.count, self._patience = dict(script or {}), 0, patience
        self.chance: list[float] = []
        self.numb = False

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        self.count += 1
        self.chance.append(float(context.rng.random()))
        world: FakeWorld = context.handle
        said = self.script.get(self.count, "")
        if callable(said):
            said(world)
            said = ""
        word, _, rest = said.partition(" ")
        match word:
            case "raise":
                raise RuntimeError("a bug in the skill")
            case "interrupt":
                raise KeyboardInterrupt
            case "nonsense":
                return None  # type: ignore[return-value]
            case "lie":
                return self._end(step, SkillStatus.DONE, world, world.now)
            case "hang":
                return self._hang(step, context, world)
            case "fail":
                return self._end(step, SkillStatus.NO_PATH, world, world.now, "no motion was found")
            case "land":
                return self._land(step, context, world, rest)
            case "" | "humble":
                result = self._work(step, context, world)
                return SkillResult(step, SkillStatus.GRASP_MISSED, "felt nothing") if word else result
        return self._end(step, SkillStatus(said), world, world.now)

    def _work(self, step: Step, context: SkillContext, world: FakeWorld) -> SkillResult:
        thing, place = step.args
        start = world.now
        if step.action == "pick":
            if world.where[thing] != place:
                return self._end(step, SkillStatus.NOT_THERE, world, start, f"{thing} is not at {place}")
            if world.held is not None:
                return self._end(step, SkillStatus.UNREACHABLE, world, start, "the hand is full")
            missed, world.missing = world.missing, False
            if not self._phase("approach", 2.0, context, world) or not self._phase("grip", 0.5, context, world):
                return self._end(step, SkillStatus.CANCELLED, world, start)
            if missed:
                return self._end(step, SkillStatus.GRASP_MISSED, world, start)
            world.where[thing] = "hand"
        elif world.held != thing:
            return self._end(step, SkillStatus.NOT_THERE, world, start, f"{thing} is not in the hand")
        if not self._phase("transfer", 3.0, context, world, carried=thing):
            return self._lose(step, context, world, start)
        if step.action == "place":
            if not self._phase("lower", 1.0, context, world, carried=thing):
                return self._lose(step, context, world, start)
            if world.held == thing:
                world.where[thing] = place
            self._phase("release", 0.5, context, world)
        return self._end(step, SkillStatus.DONE, world, start)

    def _lose(self, step: Step, context: SkillContext, world: FakeWorld, start: float) -> SkillResult:
        if context.cancelled():
            return self._end(step, SkillStatus.CANCELLED, world, start)
        felt = not self.numb and world.held != step.args[0]
        why, sense = ("the hand is empty", Sense.FELT) if felt else (context.lost(), Sense.SEEN)
        seconds = world.now - start
        return SkillResult(step, SkillStatus.DROPPED, why, seconds, seconds + 2.0, sense)

    def _phase(
        self, name: str, seconds: float, context: SkillContext, world: FakeWorld, carried: str | None = None
    ) -> bool:
        """Whether the phase came to its end: not cancelled, and what is carried, if anything, not known to be lost."""
        context.announce(Phase(name, seconds=seconds))
        for _ in range(10):
            if context.cancelled():
                return False
            world.advance(seconds / 10)
            if carried is not None and ((not self.numb and world.held != carried) or context.lost()):
                return False
        return True

    def _hang(self, step: Step, context: SkillContext, world: FakeWorld) -> SkillResult:
        start = world.now
        for _ in range(self._patience):
            if context.cancelled():
                return self._end(step, SkillStatus.CANCELLED, world, start)
            world.advance(0.1)
        raise AssertionError("nobody cancelled a skill that hangs")

    def _land(self, step: Step, context: SkillContext, world: FakeWorld, rest: str) -> SkillResult:
        start, thing = world.now, step.args[0]
        self._phase("transfer", 3.0, context, world)
        world.where[thing] = rest.removeprefix("quietly ")
        if rest.startswith("quietly "):
            return self._end(step, SkillStatus.DONE, world, start)
        return self._end(step, SkillStatus.DROPPED, world, start, planned=world.now - start + 4.0)

    @staticmethod
    def _end(
        step: Step, status: SkillStatus, world: FakeWorld, start: float, reason: str = "", planned: float | None = None
    ) -> SkillResult:
        seconds = world.now - start
        return SkillResult(step, status, reason, seconds, seconds if planned is None else planned)


class StubbornSkill(FakeSkill):
    """Never carries out one of `never`: it says so of it, and does nothing."""

    def __init__(self, never: Collection[Step], status: SkillStatus = SkillStatus.NO_PATH) -> None:
        super().__init__()
        self._never, self._status = frozenset(never), status

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        if step not in self._never:
            return super().__call__(step, context)
        context.handle.advance(1.0)
        return SkillResult(step, self._status, "it never works")


class Ticking:
    """A clock on the wall that stands still but for calls that are said to take a `second` each."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def second(self, call: Callable[..., _T]) -> Callable[..., _T]:
        def taking(*arguments: Any) -> _T:
            self.now += 1.0
            return call(*arguments)

        return taking


Answer = float | None
"""A probability, or None for no answer."""


class ScriptedEstimator:
    """Sees what is true, unless the script has it otherwise.

    `looks` maps the number of a look (from 1) to what it answers instead, `always` holds for every look, and `scripted`
    is called for the rest: (number, atom, truth) -> answer.
    """

    def __init__(
        self,
        world: FakeWorld,
        looks: Mapping[int, Mapping[Atom, Answer]] | None = None,
        always: Mapping[Atom, Answer] | None = None,
        scripted: Callable[[int, Atom, bool], Answer] | None = None,
    ) -> None:
        self._world, self._looks, self._always, self._scripted = world, dict(looks or {}), dict(always or {}), scripted
        self.count = 0

    @property
    def name(self) -> str:
        return "scripted"

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        self.count += 1
        answers: dict[Atom, Answer] = {}
        for atom, truth in self._world.truth(atoms, observation.id).items():
            answers[atom] = self._scripted(self.count, atom, truth) if self._scripted else float(truth)
        for override in (self._always, self._looks.get(self.count, {})):
            answers.update({atom: answer for atom, answer in override.items() if atom in answers})
        known = {atom: answer for atom, answer in answers.items() if answer is not None}
        return Belief(observation.id, known, frozenset(answers) - frozenset(known), self.name)


@dataclass
class Recorder:
    """A sink that keeps everything."""

    events: list[Event] = field(default_factory=list)
    closed: int = 0

    def write(self, event: Event) -> None:
        self.events.append(event)

    def close(self) -> None:
        self.closed += 1

    def of(self, kind: type[_T]) -> list[_T]:
        """The payloads of one type, in order."""
        return [event.payload for event in self.events if isinstance(event.payload, kind)]


@dataclass
class Stage:
    """Everything for one run, to be changed at will before it is played."""

    goal: Facts
    where: dict[str, str]
    places: tuple[str, ...] = ("p", "q", "r")
    script: Mapping[int, str | Callable[[FakeWorld], None]] = field(default_factory=dict)
    looks: Mapping[int, Mapping[Atom, Answer]] = field(default_factory=dict)
    always: Mapping[Atom, Answer] = field(default_factory=dict)
    settings: Settings = field(default_factory=Settings)
    blind: bool = False
    thresholds: Thresholds = field(default_factory=Thresholds)
    attention: Attention | None = None

    def __post_init__(self) -> None:
        self.task = task(sorted(self.where), self.places, self.goal)
        self.world = FakeWorld(self.where, self.places)
        self.planner = FakePlanner(steps_of(self.task))
        self.skill = FakeSkill(self.script)
        self.estimator = ScriptedEstimator(self.world, self.looks, self.always)
        self.recorder = Recorder()
        self.faults: FaultSource | None = None
        self.monitor: Monitor = ThresholdMonitor(self.task.atoms, self.thresholds)
        self.moves: dict[str, Skill] = {}
        self.prepare: list[Preparing] = []
        self.witness: Witness | None = None

    def executive(self) -> Executive:
        return make_executive(
            self.task,
            self.planner,
            self.world,
            {"pick": self.skill, "place": self.skill},
            None if self.blind else self.estimator,
            [self.recorder],
            self.settings,
            self.faults,
            initial=self.world.truth(self.task.atoms) if self.blind else None,
            domain="things",
            run="fake",
            monitor=self.monitor,
            attention=self.attention,
            moves=self.moves,
            prepare=self.prepare,
            witness=self.witness,
        )

    def play(self) -> Ended:
        return self.executive().run()

    def weighing(self, **parts: Any) -> Stage:
        """The same with a monitor that weighs answers, mutex groups and memory, made of `parts`."""
        self.monitor = BayesMonitor(MutexNetwork(self.task.atoms, groups(self.task)), **parts)
        return self

    @property
    def goal_true(self) -> bool:
        """The scorer's verdict."""
        return self.world.truth(self.task.atoms).entails(self.goal)
