"""Experiment 1 of the paper: an estimator is evaluated on the pictures of a collection against the ground truth.

The estimator is made by `executive.app.estimators.open_estimator` and called as in a run: `estimate(observation,
atoms)` for all atoms. One or several worker processes do that (`executive.lab.common.process_pool`); a result depends
on its point and the seed alone, not on the worker, and results from before an interruption are kept."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from executive.app.config import EstimatorConfig
from executive.app.estimators import load_calibration, with_default_model
from executive.domain.loader import Domain, load_visibility
from executive.errors import InputError, OptionError
from executive.lab.collection import dataset
from executive.lab.collection.collect import version_of
from executive.lab.collection.dataset import Point
from executive.lab.common.process_pool import WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.lab.config import EvalConfig
from executive.lab.evaluation import published
from executive.lab.evaluation.kept_looks import Kept
from executive.lab.evaluation.looks import OPENING, Look, Observer, Opened, Said, Shown, is_varying, open_domain
from executive.lab.evaluation.metrics import Answers
from executive.lab.evaluation.mistakes import Mistakes
from executive.lab.evaluation.varying import Varying, columns
from executive.types import Atom, Belief, FloatArray
from executive.types.visibility import Visibility
from executive.util.files import home

FRUITLESS = 10
"""The number of consecutive looks without an answer after which an evaluation is aborted."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """The questions and all answers of an evaluation.

    `name` says what was measured as the paper's tables do (`72B + Instruct + Pose`); `about` everything that decided
    it, as JSON; `looks` are (episode, step) of the points; `surprising` (looks,) whether the last action came to
    something else than its effects; `seconds` (looks,) the wall time of each estimate, without reading or drawing.
    Where objects change from episode to episode, `groups` are looks (looks,) that are scored apart, and `held_out` (as
    the answers) says which of these are about objects with combinations that training did not see. `posterior` (as the
    answers) is what a run would believe after each look alone; None where no run could be made of the domain.
    """

    name: str
    about: Mapping[str, Any]
    answers: Answers
    looks: tuple[tuple[int, int], ...]
    surprising: np.ndarray[Any, np.dtype[np.bool_]]
    seconds: FloatArray
    groups: Mapping[str, np.ndarray[Any, np.dtype[np.bool_]]] = field(default_factory=dict)
    held_out: np.ndarray[Any, np.dtype[np.bool_]] | None = None
    posterior: FloatArray | None = None

    @property
    def seconds_per_look(self) -> float:
        """The median, on which the slow first look has no influence."""
        return float(np.median(self.seconds))


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
        self.subject, self._drawing = open_domain(config)
        self._varying = Varying.of(config.domain) if is_varying(config.data) else None
        if self._varying is None:
            self._check_atoms()
        else:
            self._check_varying()
        self._visibility = Visibility() if self._varying else load_visibility(config.domain, config.problem)
        if self._drawing is not None:
            _check_scene(self._drawing, self._manifest, warn)
        self._shown = Shown(config, self.subject, self._drawing)
        self.published = published.read(self.subject.pddl.parent)
        with_default_model(config.eye, self.subject)
        for line in self._shown.warnings:
            warn(line)
        self.atoms = self.subject.task.atoms
        self.mistakes = Mistakes()
        self._cancelled = False

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self._shown.close()

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
                if opened.unbelieved:
                    self._warn(f"what a run would believe is not scored: {opened.unbelieved}")
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
                told |= {
                    n: s
                    for n, s in kept.known.items()
                    if n <= len(points) and len(s.probability) == len(self._shown.atoms(points[n - 1]))
                }
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
        self._shown.show(opened.cameras)
        questions = opened.questions
        for number, point in enumerate(points, start=1):
            atoms = self._shown.atoms(point)
            hidden = self._hidden(point)
            probability = zip(atoms, told[number].probability, strict=True)
            known = {atom: value for atom, value in probability if value is not None and atom not in hidden}
            belief = Belief(number, known, frozenset(atoms) - known.keys() - hidden)
            look = Look(number, point.episode, point.step - 1)
            text = self._shown.questions(point, questions).text
            self.mistakes.add(point, belief, lambda look=look: self._shown.pictures(self._shown.point(look)), text)  # type: ignore[misc]
        answers = self._answers(points, {number: each.probability for number, each in told.items()})
        posterior = None
        if all(each.posterior for each in told.values()):
            posterior = self._answers(points, {n: each.posterior for n, each in told.items()}).probability
        groups = self._varying.groups(points) if self._varying is not None else {}
        looks = tuple((point.episode, point.step) for point in points)
        surprising = np.array([bool(point.surprises) for point in points])
        seconds = np.array([told[number].seconds for number in sorted(told)])
        name, about = self._described(opened)
        held_out = self._held_out(points, answers)
        return Evaluation(name, about, answers, looks, surprising, seconds, groups, held_out, posterior)

    def _answers(self, points: Sequence[Point], said: Mapping[int, Sequence[float | None]]) -> Answers:
        """What was said of each point's atoms (number of the look -> P(true) of each), with the truth."""
        if self._varying is not None:
            atoms, which, probability, truth = columns(points, said)
            return Answers(atoms, probability, truth, which)
        probability = np.array([[math.nan if p is None else p for p in said[number]] for number in sorted(said)])
        truth = np.array([[point.facts[atom] for atom in self.atoms] for point in points])
        if not self._visibility:
            return Answers(self.atoms, probability, truth)
        hidden = np.array([[atom in self._hidden(point) for atom in self.atoms] for point in points])
        asked = np.where(hidden, -1, np.arange(len(self.atoms)))
        return Answers(self.atoms, np.where(hidden, math.nan, probability), truth, asked)

    def _held_out(self, points: Sequence[Point], answers: Answers) -> np.ndarray[Any, np.dtype[np.bool_]] | None:
        """Which answers are about what training did not see."""
        if self._varying is None:
            return None
        held_out = np.zeros(answers.truth.shape, np.bool_)
        for row, point in enumerate(points):
            held_out[row, : len(point.facts)] = self._varying.held_out(point)
        return held_out

    def _hidden(self, point: Point) -> frozenset[Atom]:
        """The atoms of which no picture of this moment can show whether they are true."""
        return self._visibility.hidden(point.facts) if self._visibility else frozenset()

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
            "runtime": opened.runtime,
            "quantisation": opened.quantisation,
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

    def _check_varying(self) -> None:
        """Check that a collection with other objects in each episode is of this domain.

        Raises:
            InputError: it is not, or its moments cannot be drawn anew.
        """
        of = self._manifest["collection"].get("domain")
        if of != self.subject.name:
            raise InputError(f"is of the domain {of!r}, and not of {self.subject.name!r}", file=self.config.data)
        if self._drawing is not None:
            message = "lights and cameras are for collections with the same objects in all episodes"
            raise OptionError(message, option="disturb")

    def _check_atoms(self) -> None:
        there, asked = set(self._manifest["atoms"]), {str(atom) for atom in self.subject.task.atoms}
        if there == asked and asked:
            return
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
