"""The paper's estimation stage: pictures and questions in, a probability for every atom out (Section 4)."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import fmean
from typing import TypeAlias

import numpy as np

from executive.errors import InputError, MissingError, nearest
from executive.s3e.backends.interface import (
    LEAST_MASS,
    Answer,
    AnswerWords,
    Backend,
    CountingBackend,
    Look,
    Numerals,
    Words,
)
from executive.types import Atom, Belief, Evidence, Image, Observation, Questions

log = logging.getLogger(__name__)

Calibrator: TypeAlias = Callable[[Atom, float], float]
"""A function from an atom and the model's probability to the corrected one. A result outside [0, 1] is no answer."""


class Views(StrEnum):
    """How the pictures of several cameras are shown."""

    TOGETHER = "together"  # all in one prompt, in order
    AVERAGED = "averaged"  # each on its own; the probability is the mean over the cameras that can tell


@dataclass(frozen=True, slots=True)
class View:
    """One answer, and the cameras whose pictures it was given for."""

    cameras: tuple[str, ...]
    answer: Answer


@dataclass(frozen=True, slots=True)
class Finding:
    """The question about one atom, all answers, and the probability that follows; None for no answer."""

    question: str
    views: tuple[View, ...]
    probability: float | None


class S3E:
    """Semantic symbolic state estimation: an `Estimator` over a vision-language model.

    Args:
        backend: the model.
        questions: the question about each atom, and the system prompt.
        cameras: the cameras whose pictures are shown, in this order; without it, all of an observation.
        views: how several pictures are shown.
        least_mass: see `LEAST_MASS`.
        calibrate: corrects each probability; the evidence keeps the model's own.

    An atom without a question, a picture or an answer is unanswered, and the evidence says why. So is every atom after
    an error of the model or its server: only `MissingError` is raised in the middle of a run.
    """

    def __init__(
        self,
        backend: Backend,
        questions: Questions,
        *,
        cameras: Sequence[str] | None = None,
        views: Views | str = Views.TOGETHER,
        least_mass: float = LEAST_MASS,
        calibrate: Calibrator | None = None,
    ) -> None:
        if not 0.0 <= least_mass <= 1.0:
            raise ValueError(f"least_mass: expected a share of 1, got {least_mass}")
        self.backend, self.questions, self.views, self.least_mass = backend, questions, Views(views), least_mass
        self.cameras, self._calibrate = None if cameras is None else tuple(cameras), calibrate
        self._observation: Observation | None = None
        self._looks: dict[tuple[tuple[str, ...], Words], Look] = {}

    @property
    def name(self) -> str:
        return f"s3e:{self.backend.name}"

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """Return a belief over exactly `atoms`, with its evidence. More atoms of the same observation only cost their
        questions: its pictures are cached."""
        findings = self.ask(observation, atoms)
        probability = {atom: f.probability for atom, f in findings.items() if f.probability is not None}
        return Belief(
            observation.id,
            probability,
            unanswered=frozenset(findings) - probability.keys(),
            source=self.name,
            evidence={atom: tuple(map(_evidence, finding.views)) for atom, finding in findings.items()},
        )

    def ask(self, observation: Observation, atoms: Sequence[Atom]) -> dict[Atom, Finding]:
        """Return each atom's question, the rendered prompts, and the probability masses of its answers."""
        asked = [atom for atom in dict.fromkeys(atoms) if atom in self.questions.text]
        groups = self._groups(observation)
        answers = {cameras: self._answers(observation, cameras, asked) for cameras in groups}
        findings = {}
        for atom in dict.fromkeys(atoms):
            if atom not in self.questions.text:
                views: tuple[View, ...] = (View((), _no_answer("there is no question for this atom")),)
            elif not groups:
                views = (View((), _no_answer(self._no_picture(observation))),)
            else:
                views = tuple(View(cameras, answers[cameras][atom]) for cameras in groups)
            findings[atom] = Finding(self.questions.text.get(atom, ""), views, self._probability(atom, views))
        return findings

    def _groups(self, observation: Observation) -> list[tuple[str, ...]]:
        """The cameras that are shown together. One that has no picture is left out."""
        chosen = tuple(observation.images) if self.cameras is None else self.cameras
        cameras = tuple(camera for camera in chosen if camera in observation.images)
        if self.views is Views.AVERAGED:
            return [(camera,) for camera in cameras]
        return [cameras] if cameras else []

    def _no_picture(self, observation: Observation) -> str:
        if not self.cameras:
            return "there is no picture"
        return f"no picture from {', '.join(self.cameras)}; {nearest(self.cameras[0], observation.images)}"

    def _answers(self, observation: Observation, cameras: tuple[str, ...], atoms: Sequence[Atom]) -> dict[Atom, Answer]:
        """An answer for each atom, whatever happens. The values of a numeric fluent have one question together."""
        text, numerals = self.questions.text, self.questions.numerals
        plain = [atom for atom in atoms if atom not in numerals]
        said = self._said(observation, cameras, [text[atom] for atom in plain], AnswerWords(*self.questions.answers))
        answers = dict(zip(plain, said, strict=True))
        numbers = list(dict.fromkeys(text[atom] for atom in atoms if atom in numerals))
        most = Numerals(max(numerals.values(), default=0))
        counts = dict(zip(numbers, self._said(observation, cameras, numbers, most), strict=True))
        answers |= {atom: counts[text[atom]].that_it_is(numerals[atom]) for atom in atoms if atom in numerals}
        return {atom: answers[atom] for atom in atoms}

    def _said(
        self, observation: Observation, cameras: tuple[str, ...], questions: Sequence[str], words: Words
    ) -> list[Answer]:
        """An answer to each question, whatever happens."""
        if not questions:
            return []
        try:
            answers = self._look(observation, cameras, words).ask(questions)
            if len(answers) != len(questions):
                raise ValueError(f"{len(answers)} answers to {len(questions)} questions")
        except MissingError:
            raise
        except Exception as error:
            log.warning("%s: no answers: %s", self.name, error, exc_info=log.isEnabledFor(logging.DEBUG))
            return [_no_answer(f"{error}" or type(error).__name__) for _ in questions]
        return answers

    def _look(self, observation: Observation, cameras: tuple[str, ...], words: Words) -> Look:
        """The pictures as the backend took them in, once per observation and kind of answer."""
        if self._observation is not observation:  # the same one, not one of the same number: runs count from zero
            self._observation = observation
            self._looks.clear()  # the former pictures are let go before the next ones are taken in
        if (cameras, words) not in self._looks:
            images = [observation.images[camera] for camera in cameras]
            if not isinstance(words, Numerals):
                look = self.backend.look(images, self.questions.system, words)
            elif isinstance(self.backend, CountingBackend):
                look = self.backend.look_for_numbers(images, self.questions.number_system, words)
            else:
                raise InputError("this backend cannot be asked for numbers")
            self._looks[cameras, words] = look
        return self._looks[cameras, words]

    def _probability(self, atom: Atom, views: Sequence[View]) -> float | None:
        answers = [view.answer.probability(self.least_mass) for view in views]
        known = [probability for probability in answers if probability is not None]
        if not known:
            return None
        probability = fmean(known)
        if self._calibrate is not None and atom not in self.questions.numerals:
            probability = self._calibrate(atom, probability)
        return float(probability) if math.isfinite(probability) and 0.0 <= probability <= 1.0 else None


def observe(images: Mapping[str, Image], *, id: int = 0, time: float = 0.0) -> Observation:
    """Make an observation of pictures, without a world: camera name -> (H, W, 3) uint8 RGB.

    Raises:
        ValueError: a picture has another shape or type.
    """
    return Observation(id, time, dict(images), np.empty(0))


def _no_answer(why: str) -> Answer:
    return Answer("", 0.0, 0.0, error=why)


def _evidence(view: View) -> Evidence:
    return Evidence(view.cameras, view.answer.yes_mass, view.answer.no_mass, view.answer.error)
