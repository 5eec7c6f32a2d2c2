"""Observations, questions, answers, and the beliefs and judgements that follow from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from executive.types.facts import Atom, DepthImage, Facts, FloatArray, Image


class LookCause(StrEnum):
    """Why a look is taken. In an `Observation`, what it is about follows the code: `after pick(lemon,wood-table)`."""

    FIRST = "first-look"
    NO_PLAN = "no-plan"
    BEFORE = "before"
    """A step."""
    AFTER = "after"
    """A step."""
    GOAL = "goal"
    GLANCE = "glance"
    """At an atom, while a skill goes on."""

    def about(self, subject: object) -> str:
        """Return the code with what it is about."""
        return f"{self.value} {subject}"


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """The robot's sensor readings at one moment.

    `images` maps a camera's name to an (H, W, 3) uint8 RGB picture; `joints` are the arm's joint positions in rad;
    `time` is the world's clock in seconds; `cause` is why the look was taken, in terms of `LookCause` (only for the
    trace). `noisy` says that the pictures have sensor noise, so that two identical pictures are one frozen picture.
    `depth` maps the name of a camera that measures depth to an (H, W) uint16 picture of the same view: the distance
    along the optical axis in mm, 0 where nothing was measured.
    """

    id: int
    time: float
    images: Mapping[str, Image]
    joints: FloatArray
    cause: str = ""
    noisy: bool = False
    depth: Mapping[str, DepthImage] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for camera, image in self.images.items():
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise ValueError(f"camera {camera!r}: expected (H, W, 3) uint8, got {image.shape} {image.dtype}")
        for camera, depth in self.depth.items():
            if depth.ndim != 2 or depth.dtype != np.uint16:
                raise ValueError(f"camera {camera!r}: expected depth (H, W) uint16, got {depth.shape} {depth.dtype}")


@dataclass(frozen=True, slots=True)
class Questions:
    """The question about each atom, complete enough to ask the same again.

    `text` maps an atom to one line; `system` is the system prompt, `answers` are the two words that the model chooses
    from, the one for true first. `translator` names what worded the questions, and `warnings` say where that failed and
    what was asked instead. Atoms that are not in `text` are not asked about.

    `numerals` maps the atoms that stand for the values of numeric fluents to these values. They have one question
    together, for which `number_system` is the system prompt, and whose answer is a number.
    """

    text: Mapping[Atom, str]
    system: str
    translator: str
    answers: tuple[str, ...] = ("yes", "no")
    warnings: tuple[str, ...] = ()
    numerals: Mapping[Atom, int] = field(default_factory=dict)
    number_system: str = ""

    def __post_init__(self) -> None:
        if unasked := self.numerals.keys() - self.text.keys():
            raise ValueError(f"{min(unasked)} has a value and no question")
        if len(self.answers) != 2 or len({word.lower() for word in self.answers}) != 2:
            raise ValueError(f"expected two different answers, got {self.answers!r}")
        for atom, text in self.text.items():
            if not text.strip() or not text.isprintable():
                raise ValueError(f"{atom}: {text!r} is not a line of text")
        ordered = {atom: self.text[atom] for atom in sorted(self.text)}
        object.__setattr__(self, "text", MappingProxyType(ordered))
        numerals = {atom: self.numerals[atom] for atom in sorted(self.numerals)}
        object.__setattr__(self, "numerals", MappingProxyType(numerals))


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence of one answer about one atom: the `cameras` whose pictures were shown together, and the probability
    mass of the model's next token on either answer. The rest of 1 is on other tokens. `error` says why there is no
    answer.
    """

    cameras: tuple[str, ...]
    yes_mass: float
    no_mass: float
    error: str = ""

    @property
    def elsewhere(self) -> float:
        """The mass on neither answer."""
        return max(0.0, 1.0 - self.yes_mass - self.no_mass)


class Testimony(NamedTuple):
    """What a witness tells at one look: how probable atoms are, and which of them it alone can tell, and no picture, so
    that what the estimator answers about these does not count."""

    probability: Mapping[Atom, float]
    alone: frozenset[Atom] = frozenset()


@dataclass(frozen=True, slots=True)
class Belief:
    """The probability of each atom after one look.

    Evidence is stored, decisions are derived: `truth` thresholds on demand. An atom that was asked about and not
    answered is in `unanswered` and has no probability; its truth is None, and None is never True. `source` names the
    estimator, or is "assumed" in a blind run. `evidence` has the answers that the probabilities were computed from, if
    the estimator has them: several for an atom if each camera was asked on its own. `witnesses` has what else tells of
    atoms at that look, by its name, each with probabilities of its own.
    """

    observation_id: int
    probability: Mapping[Atom, float]
    unanswered: frozenset[Atom] = frozenset()
    source: str = ""
    evidence: Mapping[Atom, tuple[Evidence, ...]] = field(default_factory=dict)
    witnesses: Mapping[str, Mapping[Atom, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        told = (each.items() for each in (self.probability, *self.witnesses.values()))
        for atom, value in itertools.chain.from_iterable(told):
            if not (isinstance(value, int | float) and math.isfinite(value) and 0.0 <= value <= 1.0):
                raise ValueError(f"P({atom}) = {value!r} is not a probability")
        both = self.unanswered & self.probability.keys()
        if both:
            raise ValueError(f"{', '.join(map(str, sorted(both)))}: both answered and unanswered")
        ordered = {atom: float(self.probability[atom]) for atom in sorted(self.probability)}
        object.__setattr__(self, "probability", MappingProxyType(ordered))
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))
        witnesses = {name: MappingProxyType(dict(sorted(each.items()))) for name, each in self.witnesses.items()}
        object.__setattr__(self, "witnesses", MappingProxyType(witnesses))

    @classmethod
    def certain(cls, facts: Mapping[Atom, bool], observation_id: int = -1, source: str = "assumed") -> Belief:
        """Return the belief that `facts` hold with certainty."""
        return cls(observation_id, {atom: float(value) for atom, value in facts.items()}, source=source)

    def without(self, atoms: Collection[Atom]) -> Belief:
        """Return the same with these atoms unanswered, as far as they were asked about."""
        kept = {atom: value for atom, value in self.probability.items() if atom not in atoms}
        evidence = {atom: each for atom, each in self.evidence.items() if atom not in atoms}
        unanswered = self.unanswered | (self.probability.keys() - kept.keys())
        return replace(self, probability=kept, unanswered=unanswered, evidence=evidence)

    def truth(self, atom: Atom, low: float = 0.5, high: float = 0.5) -> bool | None:
        """Return True at or above `high`, False below `low`, and None in between or without an answer."""
        value = self.probability.get(atom)
        if value is None:
            return None
        if value >= high:
            return True
        return False if value < low else None

    def facts(self, low: float = 0.5, high: float = 0.5) -> Facts:
        """Return the atoms whose truth is known at these thresholds."""
        known = ((atom, self.truth(atom, low, high)) for atom in self.probability)
        return Facts({atom: value for atom, value in known if value is not None})


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of comparing an expectation with a belief: three disjoint sets of atoms that cover the expectation."""

    holds: frozenset[Atom] = frozenset()
    violated: frozenset[Atom] = frozenset()
    unknown: frozenset[Atom] = frozenset()

    def __post_init__(self) -> None:
        if self.holds & self.violated or self.holds & self.unknown or self.violated & self.unknown:
            raise ValueError("a verdict's sets must be disjoint")

    @property
    def satisfied(self) -> bool:
        """Whether nothing is violated and nothing is unknown."""
        return not self.violated and not self.unknown


class LookKind(StrEnum):
    """The kind of a look: which atoms it was about, and through which cameras."""

    FULL = "full"  # about every atom
    FOCUSED = "focused"  # about what matters, as many atoms as a look may have
    CLOSER = "closer"  # about uncertain atoms, through the cameras that show them best
    MOVED = "moved"  # the same with the arm moved out of the way
    GUARD = "guard"  # about what is carried, while it is carried


@dataclass(frozen=True, slots=True)
class Looked:
    """One look: how many questions were asked, how many atoms there are, and which cameras' pictures were shown."""

    observation_id: int
    kind: LookKind
    questions: int
    atoms: int
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Answers of one look that violate a mutex group, and how they were resolved.

    `answers` are the conflicting ones: in a group of which at most one atom can be true, all that were answered with
    yes; in a group that cannot be all false (`exact`) without any yes, all of them. `resolved` are the same atoms'
    posterior probabilities.
    """

    answers: Mapping[Atom, float]
    resolved: Mapping[Atom, float]
    exact: bool = False


@dataclass(frozen=True, slots=True)
class Overruled:
    """An answer of the newest look that the posterior does not follow: the answer is `answered` (its probability is
    `answer`), while mutex groups, memory or earlier looks at the same moment make the atom `believed` (None: unknown),
    with the posterior `probability`."""

    atom: Atom
    answered: bool
    answer: float
    believed: bool | None
    probability: float


@dataclass(frozen=True, slots=True)
class Remembered:
    """An atom that no look since the last action decides: its last known value, how many cycles ago that was seen, and
    the atom's present probability."""

    value: bool
    age: int
    probability: float


@dataclass(frozen=True, slots=True)
class Judged:
    """The state estimate after the looks since the last action (see `executive.belief.interface.Judgement`): the
    probability of every atom, and the truth of those that these looks decide."""

    observation_id: int
    probability: Mapping[Atom, float]
    seen: Facts
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    remembered: Mapping[Atom, Remembered] = field(default_factory=dict)
    came_about: float | None = None


@dataclass(frozen=True, slots=True)
class Guarded:
    """A look of the hold guard: whether the carried object is still held (None: no answer). `lost` says whether the
    skill is cancelled, which takes more than one answer."""

    atom: Atom
    held: bool | None
    lost: bool
    observation_id: int


class PictureFault(StrEnum):
    """Why a picture tells nothing."""

    PLAIN = "plain"  # it is all of one colour
    FROZEN = "frozen"  # it is the one before, bit for bit


@dataclass(frozen=True, slots=True)
class Blinded:
    """A camera whose picture is left out of the look; `reason` is a `PictureFault`, or what an older record says."""

    camera: str
    reason: str
    observation_id: int
