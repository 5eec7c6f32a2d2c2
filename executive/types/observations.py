"""What is seen, what is asked and answered about it, and what is made of the answers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from executive.types.facts import Atom, Facts, FloatArray, Image


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
    """What is made of the looks since the last action, the last one included (see
    `executive.belief.interface.Judgement`): the probability of every atom, and the truth of those that these looks
    tell."""

    observation_id: int
    probability: Mapping[Atom, float]
    seen: Facts
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    remembered: Mapping[Atom, Remembered] = field(default_factory=dict)
    came_about: float | None = None


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
