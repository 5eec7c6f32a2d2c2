"""What a worker of an evaluation does: it takes looks, one a job, with an estimator of its own."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from executive.app.estimators import open_estimator, runs_as, with_default_model, word_questions
from executive.domain.loader import Domain, Subject, load_domain, load_subject
from executive.errors import DomainError, MissingError
from executive.lab.collection import dataset
from executive.lab.collection.dataset import Point
from executive.lab.common.process_pool import ReportProgress
from executive.lab.config import EvalConfig
from executive.lab.evaluation.disturbance import Disturbance, Disturber
from executive.lab.evaluation.paraphrases import Paraphrases
from executive.lab.evaluation.posterior import Posterior
from executive.lab.evaluation.varying import Varying
from executive.s3e import S3E, Templates
from executive.types import Atom, Belief, Image, Observation, Questions


class Look(NamedTuple):
    """The job of one look: its number from 1, and the location of its point. Number 0 is the job of opening the
    estimator without a look."""

    number: int
    episode: int
    row: int


OPENING = Look(0, 0, 0)


class Opened(NamedTuple):
    """The estimator that a worker has opened: the model's name, its cameras, the arguments of `Questions`, what runs
    the model, in which quantisation, as far as that is known, and why a run would believe nothing, if that is so."""

    name: str
    cameras: tuple[str, ...] | None
    asked: tuple[dict[Atom, str], str, str, tuple[str, ...], tuple[str, ...]]
    runtime: str = ""
    quantisation: str = ""
    unbelieved: str = ""

    @property
    def questions(self) -> Questions:
        return Questions(*self.asked)


class Said(NamedTuple):
    """The result of a look: P(true) of each atom, None where unanswered, its seconds, the reason if there is no answer
    at all, and what a run would believe of each atom after it, where it would believe anything."""

    probability: tuple[float | None, ...]
    seconds: float
    why: str = ""
    posterior: tuple[float | None, ...] = ()


class Observer:
    """Takes looks in a worker process, which opens its own estimator with its first job.

    Raises:
        DomainError: the domain has a mistake.
        InputError: the model, or how it goes with the data; from a look, the data is damaged.
        MissingError: the machine lacks something.
    """

    def __init__(self, config: EvalConfig) -> None:
        self._subject, self._drawing = open_domain(config)
        self._shown = Shown(config, self._subject, self._drawing)
        self.eye: S3E = open_estimator(config.eye, self._subject)
        self._questions = self.eye.questions
        self._shown.show(self.eye.cameras)
        self._posterior, self._unbelieved = _open_posterior(config, self._subject, self._shown.varying)

    def __call__(self, look: Look, tell: ReportProgress) -> Opened | Said:
        if look == OPENING:
            own = self._questions
            asked = (dict(own.text), own.system, own.translator, own.answers, own.warnings)
            backend = self.eye.backend
            return Opened(backend.name, self.eye.cameras, asked, *runs_as(backend), self._unbelieved)
        point = self._shown.point(look)
        self.eye.questions = self._shown.questions(point, self._questions)
        atoms = self._shown.atoms(point)
        observation = Observation(look.number, point.time, self._shown.pictures(point), point.joints)
        begin = time.perf_counter()
        belief = self.eye.estimate(observation, atoms)
        seconds = time.perf_counter() - begin
        why = "" if belief.probability else _why(belief)
        posterior = () if self._posterior is None else self._posterior.of(point, atoms, belief)
        return Said(tuple(belief.probability.get(atom) for atom in atoms), seconds, why, posterior)


class Shown:
    """What the estimator is shown of a point, and asked about it."""

    def __init__(self, config: EvalConfig, subject: Subject, drawing: Domain | None) -> None:
        self._config, self._drawing, self._subject = config, drawing, subject
        self.varying = Varying.of(config.domain) if is_varying(config.data) else None
        self._worded: tuple[int, Subject, Questions, Paraphrases | None] | None = None
        self._disturbance = Disturbance.parse(config.disturb)
        self._disturber: Disturber | None = None
        self._paraphrases: Paraphrases | None = None
        if config.paraphrases is not None and self.varying is None:
            own = Templates.read(subject.questions) if subject.questions is not None else None
            self._paraphrases = Paraphrases.read(config.paraphrases, subject.task, own, config.rename)
        dataset.Reader(config.data, ())  # says what an unfinished collection lacks

    @property
    def warnings(self) -> tuple[str, ...]:
        return self._paraphrases.warnings if self._paraphrases is not None else ()

    def show(self, cameras: Sequence[str] | None) -> None:
        """Whose pictures are shown from now on."""
        # Of what is drawn anew, the collection's own pictures are not needed.
        self._reader = dataset.Reader(self._config.data, () if self._disturbance.redraws else cameras)
        self.close()
        self._disturber = Disturber(self._disturbance, self._drawing, cameras, self._config.seed)

    def close(self) -> None:
        if self._disturber is not None:
            self._disturber.__exit__(None, None, None)

    def point(self, look: Look) -> Point:
        point = self._reader.point(look.episode, look.row)
        assert point is not None
        return point

    def pictures(self, point: Point) -> Mapping[str, Image]:
        assert self._disturber is not None
        return self._disturber.pictures(point)

    def atoms(self, point: Point) -> tuple[Atom, ...]:
        """What is asked about a point."""
        return self._subject.task.atoms if self.varying is None else tuple(point.facts)

    def questions(self, point: Point, own: Questions) -> Questions:
        paraphrases = self._paraphrases
        if self.varying is not None:
            own, paraphrases = self._of_episode(point)
        if paraphrases is None:
            return own
        key = np.random.SeedSequence([self._config.seed, point.seed, point.episode, point.step], spawn_key=(2,))
        return replace(own, text=paraphrases.drawn(np.random.default_rng(key)))

    def _of_episode(self, point: Point) -> tuple[Questions, Paraphrases | None]:
        """The questions about an episode's own objects, and their paraphrases."""
        assert self.varying is not None
        subject = self.varying.subject(self._subject, point)
        if self._worded is None or self._worded[0] != point.episode or self._worded[1].task != subject.task:
            paraphrases = None
            if self._config.paraphrases is not None:
                own = Templates.read(subject.questions) if subject.questions is not None else None
                paraphrases = Paraphrases.read(self._config.paraphrases, subject.task, own, self._config.rename)
            worded = word_questions(with_default_model(self._config.eye, subject), subject)
            self._worded = point.episode, subject, worded, paraphrases
        return self._worded[2], self._worded[3]


def is_varying(data: Path) -> bool:
    """Whether a collection has other objects in each episode."""
    return bool(dataset.read_manifest(data)["collection"].get("objects"))


def open_domain(config: EvalConfig) -> tuple[Subject, Domain | None]:
    """The subject of the questions, and the domain where pictures are rendered anew."""
    domain = load_domain(config.domain, config.problem) if Disturbance.parse(config.disturb).redraws else None
    return (domain.subject if domain else load_subject(config.domain, config.problem)), domain


def _open_posterior(config: EvalConfig, subject: Subject, varying: Varying | None) -> tuple[Posterior | None, str]:
    """What a run would believe, or None and the reason: what can be evaluated need not be what can be carried out."""
    try:
        return Posterior(config, subject, varying), ""
    except (DomainError, MissingError) as error:
        return None, str(error)


def _why(belief: Belief) -> str:
    errors = (each.error for evidence in belief.evidence.values() for each in evidence if each.error)
    return next(errors, "too little of the probability is on yes or no")
