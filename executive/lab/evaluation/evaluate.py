"""Experiment 1 of the paper: an estimator is evaluated on the pictures of a collection against the ground truth.

The estimator is made by `executive.app.estimators.open_estimator` and called as in a run: `estimate(observation,
atoms)` for all atoms. One or several worker processes do that (`executive.lab.common.process_pool`); a result depends
on its point and the seed alone, not on the worker, and results from before an interruption are kept."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from executive.app.config import EstimatorConfig
from executive.app.estimators import load_calibration, open_estimator, with_default_model
from executive.domain.loader import Domain, Subject, load_domain, load_subject
from executive.errors import InputError
from executive.lab.collection import dataset
from executive.lab.collection.collect import version_of
from executive.lab.collection.dataset import Point
from executive.lab.common.journal import Journal, lines
from executive.lab.common.process_pool import ReportProgress, WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.lab.config import EvalConfig
from executive.lab.evaluation import published
from executive.lab.evaluation.disturbance import Disturbance, Disturber
from executive.lab.evaluation.metrics import Answers
from executive.lab.evaluation.mistakes import Mistakes
from executive.lab.evaluation.paraphrases import Paraphrases
from executive.s3e import S3E, Templates
from executive.types import Atom, Belief, FloatArray, Image, Observation, Questions
from executive.util.files import home, parse_json

FRUITLESS = 10
"""The number of consecutive looks without an answer after which an evaluation is aborted."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """The questions and all answers of an evaluation.

    `name` says what was measured as the paper's tables do (`72B + Instruct + Pose`); `about` everything that decided
    it, as JSON; `looks` are (episode, step) of the points; `surprising` (looks,) whether the last action came to
    something else than its effects; `seconds` (looks,) the wall time of each estimate, without reading or drawing.
    """

    name: str
    about: Mapping[str, Any]
    answers: Answers
    looks: tuple[tuple[int, int], ...]
    surprising: np.ndarray[Any, np.dtype[np.bool_]]
    seconds: FloatArray

    @property
    def seconds_per_look(self) -> float:
        """The median, on which the slow first look has no influence."""
        return float(np.median(self.seconds))


class Look(NamedTuple):
    """The job of one look: its number from 1, and the location of its point. Number 0 is the job of opening the
    estimator without a look."""

    number: int
    episode: int
    row: int


OPENING = Look(0, 0, 0)


class Opened(NamedTuple):
    """The estimator that a worker has opened: the model's name, its cameras, and the arguments of `Questions`."""

    name: str
    cameras: tuple[str, ...] | None
    asked: tuple[dict[Atom, str], str, str, tuple[str, ...], tuple[str, ...]]

    @property
    def questions(self) -> Questions:
        return Questions(*self.asked)


class Said(NamedTuple):
    """The result of a look: P(true) of each atom, None where unanswered, its seconds, and the reason if there is no
    answer at all."""

    probability: tuple[float | None, ...]
    seconds: float
    why: str = ""


class Observer:
    """Takes looks in a worker process, which opens its own estimator with its first job.

    Raises:
        DomainError: the domain has a mistake.
        InputError: the model, or how it goes with the data; from a look, the data is damaged.
        MissingError: the machine lacks something.
    """

    def __init__(self, config: EvalConfig) -> None:
        self._subject, self._drawing = _opened_domain(config)
        self._seen = _Seen(config, self._subject, self._drawing)
        self.eye: S3E = open_estimator(config.eye, self._subject)
        self._questions = self.eye.questions
        self._seen.show(self.eye.cameras)

    def __call__(self, look: Look, tell: ReportProgress) -> Opened | Said:
        if look == OPENING:
            own = self._questions
            asked = (dict(own.text), own.system, own.translator, own.answers, own.warnings)
            return Opened(self.eye.backend.name, self.eye.cameras, asked)
        point = self._seen.point(look)
        self.eye.questions = self._seen.questions(point, self._questions)
        observation = Observation(look.number, point.time, self._seen.pictures(point), point.joints)
        atoms = self._subject.task.atoms
        begin = time.perf_counter()
        belief = self.eye.estimate(observation, atoms)
        seconds = time.perf_counter() - begin
        why = "" if belief.probability else _why(belief)
        return Said(tuple(belief.probability.get(atom) for atom in atoms), seconds, why)


class Evaluator:
    """What is to be measured on what, checked. `run` has the looks taken that are missing. A context manager that frees
    what it holds.

    Raises:
        DomainError: the domain or the paraphrases have a mistake.
        InputError: the data, or how it goes with the domain.
        MissingError: the machine lacks something.
    """

    def __init__(self, config: EvalConfig, warn: Callable[[str], None] = lambda line: None) -> None:
        self.config, self._warn = config, warn
        self._manifest = dataset.read_manifest(config.data)
        config.eye.check_cameras(self._manifest["cameras"])
        self.subject, self._drawing = _opened_domain(config)
        self._check_atoms()
        if self._drawing is not None:
            _check_scene(self._drawing, self._manifest, warn)
        self._seen = _Seen(config, self.subject, self._drawing)
        self.published = published.read(self.subject.pddl.parent)
        with_default_model(config.eye, self.subject)
        for line in self._seen.warnings:
            warn(line)
        self.atoms = self.subject.task.atoms
        self.mistakes = Mistakes()
        self._cancelled = False

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self._seen.close()

    def cancel(self) -> None:
        """Makes `open` or `run` stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    @property
    def looker(self) -> Callable[[], Observer]:
        """Makes the `Observer` of this evaluation in a worker process."""
        return partial(Observer, self.config)

    @property
    def wanted(self) -> int:
        """The number of looks."""
        points: int = self._manifest["points"]
        return points if self.config.looks is None else min(points, self.config.looks)

    def open(self, pool: WorkerPool[Look, Opened | Said]) -> Opened | None:
        """Opens an estimator in a worker; None when cancelled.

        Raises:
            InputError: the model, or how it goes with the data.
            MissingError: the machine lacks something.
        """
        waiting = iter([OPENING])
        for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled):
            for each in ended:
                opened = each.value()
                assert isinstance(opened, Opened)
                for line in opened.questions.warnings:
                    self._warn(line)
                return opened
        return None

    def run(
        self,
        pool: WorkerPool[Look, Opened | Said],
        opened: Opened | None = None,
        keep: Path | None = None,
        watch: Callable[[Progress], None] = lambda progress: None,
    ) -> Evaluation | None:
        """Takes all looks; None when cancelled. `watch` is called several times a second.

        Args:
            opened: what `open` gave; without it, an estimator is opened first.
            keep: a file that looks are written to as they are taken, and that those of the same evaluation that are
                there already are read from.

        Raises:
            InputError: the data is damaged, or nothing is answered any more.
        """
        opened = opened or self.open(pool)
        if opened is None:
            return None
        points = list(itertools.islice(dataset.read(self.config.data, ()), self.wanted))
        told: dict[int, Said] = {}
        with Kept(keep, self._same(opened)) if keep is not None else nullcontext() as kept:
            if kept is not None:
                asked = len(self.atoms)
                told |= {n: s for n, s in kept.known.items() if n <= len(points) and len(s.probability) == asked}
            there, began = len(told), time.monotonic()
            waiting = (
                Look(number, point.episode, point.step - 1)
                for number, point in enumerate(points, start=1)
                if number not in told
            )
            watch(Progress(there, len(points), 0, 0.0))
            for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled):
                for each in ended:
                    said = each.value()
                    assert isinstance(said, Said)
                    told[each.job.number] = said
                    if kept is not None:
                        kept.add(each.job.number, said)
                    _abort_if_fruitless(told, each.job.number)
                new = len(told) - there
                watch(Progress(len(told), len(points), new, time.monotonic() - began))
        return None if len(told) < len(points) else self._made(points, told, opened)

    def _made(self, points: Sequence[Point], told: Mapping[int, Said], opened: Opened) -> Evaluation:
        self._seen.show(opened.cameras)
        questions = opened.questions
        for number, point in enumerate(points, start=1):
            probability = zip(self.atoms, told[number].probability, strict=True)
            known = {atom: value for atom, value in probability if value is not None}
            belief = Belief(number, known, frozenset(self.atoms) - known.keys())
            look = Look(number, point.episode, point.step - 1)
            text = self._seen.questions(point, questions).text
            self.mistakes.add(point, belief, lambda look=look: self._seen.pictures(self._seen.point(look)), text)  # type: ignore[misc]
        answers = Answers(
            self.atoms,
            np.array([[math.nan if p is None else p for p in told[n].probability] for n in sorted(told)]),
            np.array([[point.facts[atom] for atom in self.atoms] for point in points]),
        )
        looks = tuple((point.episode, point.step) for point in points)
        surprising = np.array([bool(point.surprises) for point in points])
        seconds = np.array([told[number].seconds for number in sorted(told)])
        name, about = self._described(opened)
        return Evaluation(name, about, answers, looks, surprising, seconds)

    def _same(self, opened: Opened) -> dict[str, Any]:
        """Everything that the answers depend on, except for the number of looks."""
        command = replace(self.config, looks=None).command
        asked = opened.questions
        told = (asked.system, *asked.answers, *(f"{atom}: {text}" for atom, text in asked.text.items()))
        return {
            "version": version_of("executive"),
            "command": command,
            "data": self._manifest["collection"],
            "model": [opened.name, _files_of(with_default_model(self.config.eye, self.subject))],
            "asked": dataset.digest({"told": told}),
        }

    def _described(self, opened: Opened) -> tuple[str, dict[str, Any]]:
        """The evaluation's name, and everything that its results depend on."""
        config, collection = self.config, self._manifest["collection"]
        at_home = bool(collection.get("home_pose", True))
        told = config.eye.instructions
        instructed = told if isinstance(told, str) else told and self.subject.instructions is not None
        model = opened.name
        about = {
            "domain": self.subject.name,
            "problem": self.subject.task.problem,
            "data": {"folder": config.data.name, "seed": collection.get("seed"), "home_pose": at_home},
            "model": model,
            "calibrated": load_calibration(with_default_model(config.eye, self.subject)) is not None,
            "translator": config.eye.translator,
            "instructions": instructed,
            "per_image": config.eye.per_image,
            "cameras": list(config.eye.cameras or self._manifest["cameras"]),
            "abstention": config.eye.abstention,
            "paraphrases": config.paraphrases.name if config.paraphrases is not None else None,
            "rename": config.rename,
            "disturb": list(config.disturb),
            "seed": config.seed,
            "system_prompt": opened.questions.system,
            "command": config.command,
        }
        return row_name(model, about), about

    def _check_atoms(self) -> None:
        there, asked = set(self._manifest["atoms"]), {str(atom) for atom in self.subject.task.atoms}
        if there == asked and asked:
            return
        if self._manifest["collection"].get("objects"):
            raise InputError(
                "has other objects in each episode, and no model is evaluated on these yet", file=self.config.data
            )
        of = self._manifest["collection"].get("problem")
        odd = min(there ^ asked, default="none")
        message = (
            f"was collected in the problem {of!r}, which has other atoms than {self.subject.task.problem!r} ({odd})"
        )
        raise InputError(f"{message}; choose it with --problem", file=self.config.data)


def row_name(model: str, about: Mapping[str, Any]) -> str:
    """What the paper's tables would call it: `72B (no trans) + Instruct + Pose`."""
    odd = ["no trans"] if about["translator"] == "none" else []
    odd += ["one by one"] if about["per_image"] else []
    odd += [Path(about["instructions"]).name] if isinstance(about["instructions"], str) else []
    odd += ["paraphrased" if about["rename"] else "paraphrased, same names"] if about["paraphrases"] else []
    odd += about["disturb"]
    first = f"{model} ({', '.join(odd)})" if odd else model
    modified = {"Instruct": about["instructions"], "Pose": about["data"]["home_pose"]}
    return " + ".join([first, *(name for name, given in modified.items() if given)])


def _check_scene(domain: Domain, manifest: Mapping[str, Any], warn: Callable[[str], None]) -> None:
    """Say so if moments are drawn as they never were."""
    if domain.fingerprint() != manifest["collection"].get("files"):
        warn(f"the files of {domain.name} have changed since the data was collected; looks are drawn as it is now")


class _Seen:
    """What the estimator is shown of a point, and asked about it."""

    def __init__(self, config: EvalConfig, subject: Subject, drawing: Domain | None) -> None:
        self._config, self._drawing = config, drawing
        self._disturbance = Disturbance.parse(config.disturb)
        self._disturber: Disturber | None = None
        self._paraphrases: Paraphrases | None = None
        if config.paraphrases is not None:
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

    def questions(self, point: Point, own: Questions) -> Questions:
        if self._paraphrases is None:
            return own
        key = np.random.SeedSequence([self._config.seed, point.seed, point.episode, point.step], spawn_key=(2,))
        return replace(own, text=self._paraphrases.drawn(np.random.default_rng(key)))


class Kept:
    """The looks of an evaluation that have been taken, by their numbers, and the file that more are written to. A
    context manager. Looks of another evaluation are not continued: the file is begun anew.

    Args:
        same: what two evaluations have in common whose looks are the same.
    """

    def __init__(self, file: Path, same: Mapping[str, Any]) -> None:
        self.known: dict[int, Said] = {}
        there = lines(file)
        with suppress(ValueError, LookupError, TypeError):
            if there and parse_json(there[0]) == same:
                for line in there[1:]:
                    number, probability, seconds, why = parse_json(line)
                    self.known[number] = Said(tuple(probability), float(seconds), str(why))
        self._file, self._same = file, same
        self._journal: Journal | None = None
        if not self.known:
            file.unlink(missing_ok=True)
        elif len(self.known) < len(there) - 1:  # something in it is damaged; what is whole is written anew
            dataset.write_atomically(file, b"".join(map(_line, [same, *([n, *s] for n, s in self.known.items())])))

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        if self._journal is not None:
            self._journal.close()

    def add(self, number: int, said: Said) -> None:
        """Write a look down."""
        if self._journal is None:  # there is no file before there is a look
            self._journal = Journal(self._file)
            if not self.known:
                self._journal.add(_line(self._same))
        self._journal.add(_line([number, *said]))
        self.known[number] = said


def command_of(file: Path) -> str:
    """The command of the evaluation whose looks are kept in a file, for all of its looks; empty where there is none."""
    with suppress(InputError, ValueError, LookupError, TypeError):
        return str(parse_json(lines(file)[0])["command"])
    return ""


def _line(value: object) -> bytes:
    return (json.dumps(value) + "\n").encode()


def _opened_domain(config: EvalConfig) -> tuple[Subject, Domain | None]:
    """The subject of the questions, and the domain where pictures are rendered anew."""
    domain = load_domain(config.domain, config.problem) if Disturbance.parse(config.disturb).redraws else None
    return (domain.subject if domain else load_subject(config.domain, config.problem)), domain


def _abort_if_fruitless(told: Mapping[int, Said], last: int) -> None:
    """Aborts after a run of looks without an answer that includes the last one.

    Raises:
        InputError: they did.
    """
    for first in range(last - FRUITLESS + 1, last + 1):
        row = [told.get(number) for number in range(first, first + FRUITLESS)]
        if all(said is not None and said.why for said in row):
            why = told[first + FRUITLESS - 1].why
            raise InputError(f"there was no answer in {FRUITLESS} looks in a row: {why}", key="eval")


def _files_of(eye: EstimatorConfig) -> list[list[Any]]:
    """The files of a model in a local folder: names, sizes and modification times."""
    folder = home(eye.vlm) if eye.vlm is not None and eye.server is None else None
    if folder is None or not folder.is_dir():
        return []
    found = ((each.name, each.stat()) for each in sorted(folder.iterdir()) if each.is_file())
    return [[name, status.st_size, status.st_mtime_ns] for name, status in found]


def _why(belief: Belief) -> str:
    errors = (each.error for evidence in belief.evidence.values() for each in evidence if each.error)
    return next(errors, "too little of the probability is on yes or no")
