"""The interface between S3E's questions and what answers them: a checkpoint in this process, or a server.

A backend is shown pictures once and asked about them as often as one likes. It answers with the probability mass that
its next token puts on each of two answers, and leaves what that means to `executive.s3e.estimator`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias, runtime_checkable

from executive.types import Image


@dataclass(frozen=True, slots=True)
class AnswerWords:
    """The two answers, as bare lower-case words. Every surface form counts: any case, with and without a leading
    space (Section 4: "multiple tokens for each")."""

    affirmative: str
    negative: str

    def forms(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """All surface forms of the affirmative and of the negative answer."""

        def spellings(word: str) -> tuple[str, ...]:
            cased = (word.lower(), word.capitalize(), word.upper())
            return tuple(space + form for form in cased for space in ("", " "))

        return spellings(self.affirmative), spellings(self.negative)


@dataclass(frozen=True, slots=True)
class Numerals:
    """The whole numbers from 0 to `most` as answers. The surface forms of each are its digits and, up to ten, its name,
    in any case, with and without a leading space."""

    most: int

    def forms(self) -> tuple[tuple[str, ...], ...]:
        """All surface forms of each number."""

        def spellings(number: int) -> tuple[str, ...]:
            name = _NAMES[number] if number < len(_NAMES) else ""
            words = (str(number), *((name, name.capitalize(), name.upper()) if name else ()))
            return tuple(space + word for word in words for space in ("", " "))

        return tuple(spellings(number) for number in range(self.most + 1))


_NAMES = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

Words: TypeAlias = AnswerWords | Numerals
"""What a question may be answered with."""

_TOLD = 60
"""Characters of what a model would rather say."""

YES_NO = AnswerWords("yes", "no")
TRUE_FALSE = AnswerWords("true", "false")
"""The answers of the ablation without translation (Appendix B)."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a model answered to one question.

    `yes_mass` and `no_mass` are the next token's probabilities summed over the surface forms of either answer; the
    rest of the mass went elsewhere. `prompt` is the text exactly as the model was given it. `error` says why there is
    no answer at all (a server that is gone, a reply that makes no sense); both masses are then 0. `said` is what the
    model would rather say, with its probability, where little of the mass is on either answer. Where the question was
    for a number, `masses` are those of the numbers from 0 on, and `yes_mass` is their sum.
    """

    prompt: str
    yes_mass: float
    no_mass: float
    error: str = ""
    said: str = ""
    masses: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("yes_mass", "no_mass"):
            value = getattr(self, name)
            if not (math.isfinite(value) and -1e-6 <= value <= 1.0 + 1e-6):
                raise ValueError(f"{name} = {value!r} is not a probability mass")

    def that_it_is(self, number: int) -> Answer:
        """The answer to the question for a number as one to whether it is this number."""
        if self.error or number >= len(self.masses):
            return replace(self, yes_mass=0.0, no_mass=0.0, error=self.error or "this number is not among the answers")
        mass = self.masses[number]
        return replace(self, yes_mass=mass, no_mass=max(0.0, min(1.0, sum(self.masses) - mass)))

    def probability(self, least_mass: float = 0.0) -> float | None:
        """yes / (yes + no), or None where an answer is missing or the two together have no more than `least_mass`."""
        mass = self.yes_mass + self.no_mass
        if self.error or mass <= 0.0 or mass < least_mass:
            return None
        return min(1.0, max(0.0, self.yes_mass / mass))


LEAST_MASS = 0.5
"""An answer counts when yes and no together have at least this share of the next token's probability: with less, the
model would rather have said something else."""


def rather(text: str, probability: float) -> str:
    """The tokens that a model prefers to yes and no, as text: `'<think>' (98 %)`."""
    return f"{text[:_TOLD]!r} ({probability:.0%})"


@runtime_checkable
class Look(Protocol):
    """Pictures that a backend has taken in. Asking again costs the questions alone."""

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order, none influenced by another: a permutation or a subset of the questions
        gets the same answers."""
        ...


@runtime_checkable
class Backend(Protocol):
    """A vision-language model."""

    @property
    def name(self) -> str:
        """What to call the model in a trace: never a key, never a machine's path beyond the folder's own name."""
        ...

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> Look:
        """Take in pictures, (H, W, 3) uint8 each, shown together and in order, under a system prompt.

        Raises:
            InputError: there is no picture, or one that the model cannot take.
        """
        ...


@runtime_checkable
class CountingBackend(Protocol):
    """A backend that can be asked for numbers, too."""

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> Look:
        """Take in pictures as `Backend.look` does. The answers' `masses` are those of the numbers.

        Raises:
            InputError: there is no picture, or one that the model cannot take; or it cannot tell these numbers.
        """
        ...
