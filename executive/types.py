"""The values that flow through the executive: all frozen, none of them knows a planner, a model or a simulator.

One word for one thing: an *atom* is a grounded predicate, *facts* are signed atoms, a *belief* is what a look says
of each atom, a *verdict* is what an expectation becomes when a belief is held against it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
Image: TypeAlias = npt.NDArray[np.uint8]

_NAME = r"[A-Za-z][A-Za-z0-9_\-]*"
_ATOM = re.compile(rf"\s*({_NAME})\s*(?:\(\s*((?:{_NAME}(?:\s*,\s*{_NAME})*)?)\s*\))?\s*")


@dataclass(frozen=True, slots=True, order=True)
class Atom:
    """A grounded predicate, printed and parsed as `on-table(milk-carton,wood-table)`; without arguments, `name()`."""

    predicate: str
    args: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in (self.predicate, *self.args):
            if not re.fullmatch(_NAME, name):
                raise ValueError(f"{name!r} is not a PDDL name (a letter, then letters, digits, '-' or '_')")

    @classmethod
    def parse(cls, text: str) -> Atom:
        """Read an atom as `str` prints it; `name` alone means `name()`.

        Raises:
            ValueError: when the text is no atom.
        """
        match = _ATOM.fullmatch(text)
        if match is None:
            raise ValueError(f"{text!r} is not an atom such as on-table(lemon,wood-table)")
        args = match.group(2)
        return cls(match.group(1), tuple(part.strip() for part in args.split(",")) if args else ())

    def __str__(self) -> str:
        return f"{self.predicate}({','.join(self.args)})"


class Facts(Mapping[Atom, bool]):
    """An immutable, partial, signed assignment: an atom is true, false, or simply not mentioned.

    Preconditions, effects, goals, expectations and revised states are all facts, so that "must be false" is never
    confused with "is not mentioned". Iteration is in sorted order, so that everything derived from it repeats.
    """

    __slots__ = ("_hash", "_truth")

    def __init__(self, truth: Mapping[Atom, bool] | Iterable[tuple[Atom, bool]] = ()) -> None:
        pairs = dict(truth)
        for atom, value in pairs.items():
            if not isinstance(atom, Atom) or not isinstance(value, bool):
                raise TypeError(f"facts map Atom to bool, got {atom!r}: {value!r}")
        self._truth: Mapping[Atom, bool] = MappingProxyType({atom: pairs[atom] for atom in sorted(pairs)})
        self._hash: int | None = None

    @classmethod
    def closed(cls, true: Iterable[Atom], universe: Iterable[Atom]) -> Facts:
        """Every atom of `universe`: true when in `true`, else false (the closed-world reading of a PDDL :init)."""
        holding = frozenset(true)
        return cls({atom: atom in holding for atom in (*universe, *holding)})

    @classmethod
    def parse(cls, *literals: str) -> Facts:
        """Facts from literals such as `on-table(lemon,wood-table)` and `not robot-gripper-empty()`."""
        truth: dict[Atom, bool] = {}
        for literal in literals:
            text = literal.strip()
            negated = text.startswith("not ")
            truth[Atom.parse(text[4:] if negated else text)] = not negated
        return cls(truth)

    def __getitem__(self, atom: Atom) -> bool:
        return self._truth[atom]

    def __contains__(self, atom: object) -> bool:
        return atom in self._truth

    def __iter__(self) -> Iterator[Atom]:
        return iter(self._truth)

    def __len__(self) -> int:
        return len(self._truth)

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = hash(frozenset(self._truth.items()))
        return self._hash

    def __eq__(self, other: object) -> bool:
        return dict(self._truth) == dict(other._truth) if isinstance(other, Facts) else NotImplemented

    def __or__(self, other: Mapping[Atom, bool]) -> Facts:
        """These facts, overridden by `other`."""
        return Facts({**self._truth, **other})

    def __repr__(self) -> str:
        return f"Facts({', '.join(self.literals())})"

    def literals(self) -> tuple[str, ...]:
        """The facts as text: `atom` or `not atom`, in sorted order. `Facts.parse` reads them back."""
        return tuple(str(atom) if value else f"not {atom}" for atom, value in self._truth.items())

    @property
    def true(self) -> frozenset[Atom]:
        return frozenset(atom for atom, value in self._truth.items() if value)

    @property
    def false(self) -> frozenset[Atom]:
        return frozenset(atom for atom, value in self._truth.items() if not value)

    def without(self, atoms: Iterable[Atom]) -> Facts:
        dropped = frozenset(atoms)
        return Facts({atom: value for atom, value in self._truth.items() if atom not in dropped})

    def only(self, atoms: Iterable[Atom]) -> Facts:
        kept = frozenset(atoms)
        return Facts({atom: value for atom, value in self._truth.items() if atom in kept})

    def entails(self, required: Mapping[Atom, bool]) -> bool:
        """Whether every literal of `required` is mentioned here with the same sign."""
        return all(self._truth.get(atom) is value for atom, value in required.items())


@dataclass(frozen=True, slots=True)
class Step:
    """One grounded action: what must hold before it, what it makes true and false."""

    action: str
    args: tuple[str, ...]
    preconditions: Facts
    effects: Facts

    def __str__(self) -> str:
        return f"{self.action}({','.join(self.args)})"

    def about(self, predicates: Mapping[str, tuple[str, tuple[int, ...]]]) -> Atom | None:
        """An atom about this step's arguments: `predicates` says of an action which predicate, and the positions of its
        arguments among the step's. None where it says nothing of this action."""
        if self.action not in predicates:
            return None
        predicate, positions = predicates[self.action]
        return Atom(predicate, tuple(self.args[position] for position in positions))


@dataclass(frozen=True, slots=True)
class Plan:
    """A sequence of steps, its cost, who found it and how long that took (wall seconds)."""

    steps: tuple[Step, ...]
    cost: float
    planner: str
    seconds: float


class NoPlanReason(StrEnum):
    UNSOLVABLE = "unsolvable"
    TIMED_OUT = "timed out"
    CRASHED = "crashed"


@dataclass(frozen=True, slots=True)
class NoPlan:
    """Why there is no plan. Unsolvable, timed out and crashed call for different answers and are kept apart."""

    reason: NoPlanReason
    detail: str = ""
    planner: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Task:
    """A planning task without its initial state, which the robot has to see for itself.

    `objects` maps each object to its type, `atoms` are all grounded boolean fluents, `goal` is signed. `declared` are
    the atoms that the problem file's :init names; they set the stage (a simulator places items accordingly), and the
    robot is not told. `parameters` maps each predicate to the names of its parameters; `numeric` are the names of the
    numeric fluents, which have no atoms and are not estimated.
    """

    name: str
    problem: str
    objects: Mapping[str, str]
    atoms: tuple[Atom, ...]
    goal: Facts
    declared: frozenset[Atom] = frozenset()
    parameters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    numeric: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = set(self.goal) - set(self.atoms)
        if unknown:
            raise ValueError(f"the goal names {sorted(map(str, unknown))}, which the task does not have")


@dataclass(frozen=True, slots=True)
class Probed:
    """What the planner answered about `goal` where nothing comes of it: it was only asked whether that can be reached,
    or the budget is used up. A plan, or why there is none."""

    goal: Facts
    plan: Plan | None
    no_plan: NoPlan | None = None

    def __post_init__(self) -> None:
        if (self.plan is None) is (self.no_plan is None):
            raise ValueError("a planner answers with a plan or with why there is none")


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot's sensors say at one moment.

    `images` maps a camera's name to an (H, W, 3) uint8 RGB picture; `joints` are the arm's joint positions in rad;
    `time` is the world's clock in seconds; `cause` is why the look was taken (for the trace alone). `noisy`: the
    pictures have a sensor's noise in them, so that two that are the same, bit for bit, are one picture shown twice.
    """

    id: int
    time: float
    images: Mapping[str, Image]
    joints: FloatArray
    cause: str = ""
    noisy: bool = False

    def __post_init__(self) -> None:
        for camera, image in self.images.items():
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise ValueError(f"camera {camera!r}: expected (H, W, 3) uint8, got {image.shape} {image.dtype}")


@dataclass(frozen=True, slots=True)
class Questions:
    """What a model is asked of each atom, so completely that an outsider can ask the same again.

    `text` maps an atom to one line; `system` is the prompt that goes before, `answers` are the two words that the model
    is to choose from, the one for true first. `translator` is who worded the questions, and `warnings` say where that
    went wrong and what was asked instead. An atom that is not in `text` is not asked about.
    """

    text: Mapping[Atom, str]
    system: str
    translator: str
    answers: tuple[str, ...] = ("yes", "no")
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.answers) != 2 or len({word.lower() for word in self.answers}) != 2:
            raise ValueError(f"expected two different answers, got {self.answers!r}")
        for atom, text in self.text.items():
            if not text.strip() or not text.isprintable():
                raise ValueError(f"{atom}: {text!r} is not a line of text")
        ordered = {atom: self.text[atom] for atom in sorted(self.text)}
        object.__setattr__(self, "text", MappingProxyType(ordered))


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one answer about one atom rests on: the pictures of `cameras`, shown together, and the probability mass that
    the model's next word put on either answer. What is left of 1 went elsewhere. `error` says why there is no answer.
    """

    cameras: tuple[str, ...]
    yes_mass: float
    no_mass: float
    error: str = ""

    @property
    def elsewhere(self) -> float:
        """The mass on neither answer."""
        return max(0.0, 1.0 - self.yes_mass - self.no_mass)


@dataclass(frozen=True, slots=True)
class Belief:
    """For each atom the probability that it is true, after one look.

    Evidence is stored, decisions are derived: `truth` thresholds on demand. An atom that was asked about and not
    answered is in `unanswered` and has no probability; its truth is None, and None is never True.
    `source` names who believes this (an estimator, or "assumed" for a blind executive). `evidence` is what the
    probabilities were made from, where the estimator has such: several answers where each camera was asked on its own.
    """

    observation_id: int
    probability: Mapping[Atom, float]
    unanswered: frozenset[Atom] = frozenset()
    source: str = ""
    evidence: Mapping[Atom, tuple[Evidence, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for atom, value in self.probability.items():
            if not (isinstance(value, int | float) and math.isfinite(value) and 0.0 <= value <= 1.0):
                raise ValueError(f"P({atom}) = {value!r} is not a probability")
        both = self.unanswered & self.probability.keys()
        if both:
            raise ValueError(f"{', '.join(map(str, sorted(both)))}: both answered and unanswered")
        ordered = {atom: float(self.probability[atom]) for atom in sorted(self.probability)}
        object.__setattr__(self, "probability", MappingProxyType(ordered))
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))

    @classmethod
    def certain(cls, facts: Mapping[Atom, bool], observation_id: int = -1, source: str = "assumed") -> Belief:
        """The belief that `facts` hold beyond doubt."""
        return cls(observation_id, {atom: float(value) for atom, value in facts.items()}, source=source)

    def truth(self, atom: Atom, low: float = 0.5, high: float = 0.5) -> bool | None:
        """True at or above `high`, False below `low`, None in between or where no answer is known."""
        value = self.probability.get(atom)
        if value is None:
            return None
        if value >= high:
            return True
        return False if value < low else None

    def facts(self, low: float = 0.5, high: float = 0.5) -> Facts:
        """The atoms whose truth is known at these thresholds."""
        known = ((atom, self.truth(atom, low, high)) for atom in self.probability)
        return Facts({atom: value for atom, value in known if value is not None})


@dataclass(frozen=True, slots=True)
class Verdict:
    """An expectation held against a belief: three disjoint sets of atoms that cover the expectation."""

    holds: frozenset[Atom] = frozenset()
    violated: frozenset[Atom] = frozenset()
    unknown: frozenset[Atom] = frozenset()

    def __post_init__(self) -> None:
        if self.holds & self.violated or self.holds & self.unknown or self.violated & self.unknown:
            raise ValueError("a verdict's sets must be disjoint")

    @property
    def satisfied(self) -> bool:
        """Nothing violated and nothing unknown."""
        return not self.violated and not self.unknown


class SkillStatus(StrEnum):
    DONE = "done"
    NO_PATH = "no path"
    UNREACHABLE = "unreachable"
    NOT_THERE = "not there"  # the object is not where the step says; it is not fetched from elsewhere
    GRASP_MISSED = "grasp missed"
    DROPPED = "dropped"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    CRASHED = "crashed"


class Sense(StrEnum):
    """By what the robot knows whether it still holds what it carries."""

    FELT = "felt"  # the gripper's width, the joints
    SEEN = "seen"  # the pictures that the guard took meanwhile


@dataclass(frozen=True, slots=True)
class SkillResult:
    """What a skill says of itself. `seconds` is the world's time that it took, `planned_seconds` what it would have
    taken to the end as far as it was planned (larger than `seconds` when it ended early). `sense` is by what a skill
    that ended because of a drop came to know of it. `holding`: whether the hand feels, at the end, that it holds
    something (None: it cannot feel, or was not asked)."""

    step: Step
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0
    planned_seconds: float = 0.0
    sense: Sense | None = None
    holding: bool | None = None

    @property
    def done(self) -> bool:
        return self.status is SkillStatus.DONE


class DecisionKind(StrEnum):
    CONTINUE = "continue"
    LOOK_AGAIN = "look again"
    RETRY = "retry"
    REPLAN = "replan"
    GIVE_UP_GOAL = "give up a goal"
    STOP = "stop"


class OutcomeKind(StrEnum):
    GOAL_REACHED = "goal-reached"
    PARTIAL = "partial"
    NO_PLAN = "no-plan"
    GAVE_UP = "gave-up"
    INTERRUPTED = "interrupted"
    CRASHED = "crashed"


@dataclass(frozen=True, slots=True)
class Ground:
    """One atom that spoke for a decision, as it stood then: what was expected of it (None: nothing), what it was taken
    for (None: it cannot be told), its probability where there was one, and the last look that was asked about it, with
    the cameras whose pictures that look took (-1 and none: no look was)."""

    atom: Atom
    expected: bool | None
    believed: bool | None
    probability: float | None
    observation_id: int = -1
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do next, why, and the atoms that spoke for it. A decision to stop carries the outcome.

    `grounds` say of each atom in `evidence` what it rested on, and `report` is what the skill said, if it was asked.
    """

    kind: DecisionKind
    reason: str
    evidence: tuple[Atom, ...] = ()
    outcome: OutcomeKind | None = None
    grounds: tuple[Ground, ...] = ()
    report: SkillResult | None = None

    def __post_init__(self) -> None:
        if (self.kind is DecisionKind.STOP) != (self.outcome is not None):
            raise ValueError("a decision carries an outcome if and only if it stops the run")


# What else can happen in a run and is worth a line in the trace.


@dataclass(frozen=True, slots=True)
class Started:
    """The run begins: everything that is needed to repeat it."""

    run: str
    domain: str
    task: Task
    estimator: str
    seed: int
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Resumed:
    """Another process goes on with the run. The simulated world is as it was in the cycle `restored`; of the rest it is
    said how far the run had come by its record: `cycle`, dispatched `actions`, `plans` and `looks`, and the `wall`
    seconds that the processes before this one took."""

    restored: int
    cycle: int
    actions: int
    plans: int
    looks: int
    wall: float = 0.0


@dataclass(frozen=True, slots=True)
class Dispatched:
    """A step is handed to its skill: the `action`-th one of the run (from 1), the `attempt`-th try of it."""

    step: Step
    action: int
    attempt: int
    index: int
    """Position in the current plan, from 0."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A skill enters a phase of its work (`plan`, `approach`, `grip`, `transfer`, ...), expected to last `seconds`."""

    name: str
    detail: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion about to be followed: (N, dof) configurations in rad and the (N, 3) path of the end effector in m,
    world frame. `planner` and `planning_seconds` (wall) say where it came from. `tree`, where a run asks for it, is all
    that was searched: the (M, 2, 3) edges of the planner's tree as the end effector would go along them, in m."""

    configurations: FloatArray
    end_effector: FloatArray
    seconds: float
    planner: str
    planning_seconds: float
    cost: float = math.nan
    tree: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Where all moving bodies are: name -> (7,) position in m and quaternion (w, x, y, z), world frame.

    For the people who watch; nothing that decides ever sees one.
    """

    poses: Mapping[str, FloatArray]
    joints: FloatArray
    gripper: float
    """Opening between the finger pads in m."""


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """A rigid triangle mesh that moves with `body`: (V, 3) vertices in m in the body's frame, (F, 3) vertex indices,
    RGBA in 0..1. The body name "" is the world."""

    body: str
    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]
    rgba: tuple[float, float, float, float]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera. `pose` is (7,): position in m and quaternion (w, x, y, z) in the world frame, looking along its
    own -z with +x to the right (the OpenGL convention, RUB); `fovy` is the vertical field of view in rad."""

    name: str
    pose: tuple[float, ...]
    fovy: float
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """What the world looks like, for the people who watch: shapes that `Frame` moves, and where the cameras stand."""

    geometries: tuple[Geometry, ...] = ()
    cameras: tuple[Camera, ...] = ()


@dataclass(frozen=True, slots=True)
class FaultInjected:
    """Something was broken on purpose, and what exactly."""

    kind: str
    spec: str
    action: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Compared:
    """An expectation was held against what was seen. `what` is `preconditions`, `effects` or `goal`."""

    what: str
    expected: Facts
    verdict: Verdict
    observation_id: int


@dataclass(frozen=True, slots=True)
class Revised:
    """The facts that are planned from changed to what was seen."""

    facts: Facts
    changed: Facts


class LookKind(StrEnum):
    """How far a look went."""

    FULL = "full"  # about every atom
    FOCUSED = "focused"  # about what matters, as many atoms as a look may have
    CLOSER = "closer"  # about what is in doubt, through the cameras that show it best
    MOVED = "moved"  # the same with the arm brought out of the way
    GUARD = "guard"  # about what is carried, while it is carried


@dataclass(frozen=True, slots=True)
class Looked:
    """What one look took: how many questions, of how many atoms that there are, about pictures of which cameras."""

    observation_id: int
    kind: LookKind
    questions: int
    atoms: int
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Moved:
    """The arm was brought out of the way for a better look, or was to be: by which skill, how that ended, and how long
    it took in the world's seconds."""

    move: str
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Guarded:
    """While something was carried, a look asked whether it is still held: `held` is the answer (None: no answer).
    `lost` says whether the skill is told to end, which takes more than one answer."""

    atom: Atom
    held: bool | None
    lost: bool
    observation_id: int


@dataclass(frozen=True, slots=True)
class Blinded:
    """A camera's picture tells nothing and is left out of the look: it is black, or has frozen."""

    camera: str
    reason: str
    observation_id: int


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Answers of one look that cannot all be so, and what is made of them.

    `answers` are those of one group's atoms that clash: of a group of which at most one atom can be true, all that the
    look calls true; of one that cannot all be false (`exact`), and of which the look calls none true, all of them.
    `resolved` are the same atoms' probabilities once groups and memory have spoken.
    """

    answers: Mapping[Atom, float]
    resolved: Mapping[Atom, float]
    exact: bool = False


@dataclass(frozen=True, slots=True)
class Overruled:
    """An answer of the last look that is not what is believed: the look says `answered` (with the probability
    `answer`), groups, memory or earlier looks of the same moment make it `believed` (None: cannot tell), with
    `probability`."""

    atom: Atom
    answered: bool
    answer: float
    believed: bool | None
    probability: float


@dataclass(frozen=True, slots=True)
class Remembered:
    """An atom that no look since the last action could tell: its last known value, how many cycles ago that was seen,
    and how probable the atom is by now."""

    value: bool
    age: int
    probability: float


@dataclass(frozen=True, slots=True)
class Judged:
    """What is made of the looks since the last action, the last one included (see `executive.monitor.seam.Judgement`):
    the probability of every atom, and the truth of those that these looks tell."""

    observation_id: int
    probability: Mapping[Atom, float]
    seen: Facts
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    remembered: Mapping[Atom, Remembered] = field(default_factory=dict)
    came_about: float | None = None


@dataclass(frozen=True, slots=True)
class Timing:
    """Wall seconds that the loop spent in one stage, sinks not counted: `observe`, `estimate`, `plan` or `skill`; of
    the last, `guard` is the part that was spent on looking meanwhile."""

    stage: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Ended:
    """The run is over. `goal_seen` is the executive's own claim; nobody but the scorer knows better. `looks` are those
    that decisions were made on; what the guard took while something was carried comes beside them."""

    outcome: OutcomeKind
    reason: str
    goal_seen: bool
    unreached: tuple[str, ...]
    cycles: int
    actions: int
    replans: int
    looks: int


Payload: TypeAlias = (
    Started
    | Resumed
    | Questions
    | Scenery
    | Observation
    | Belief
    | Plan
    | NoPlan
    | Probed
    | Dispatched
    | Phase
    | Motion
    | Frame
    | FaultInjected
    | SkillResult
    | Compared
    | Decision
    | Revised
    | Looked
    | Judged
    | Moved
    | Guarded
    | Blinded
    | Timing
    | Ended
)


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """One thing that happened. `cycle` counts turns of the loop, `time` is the world's clock and `wall` the process's
    monotonic clock since the run began, both in seconds. Events are all that a sink ever sees."""

    cycle: int
    time: float
    wall: float
    payload: Payload
