"""Experiment 1 of the paper: an eye is shown the looks of a collection, and what it says is held against the truth.

The eye is made by `executive.eye.open_eye` and asked as a run asks it: `estimate(observation, atoms)` for all atoms.
"""

from __future__ import annotations

import itertools
import math
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from executive.domain import Domain, load_domain, load_subject
from executive.errors import InputError
from executive.eye import EyeConfig, load_calibration, open_eye, settled
from executive.lab import dataset, published
from executive.lab.dataset import Point
from executive.lab.disturbance import Disturbance, Disturber
from executive.lab.metrics import Answers
from executive.lab.mistakes import Mistakes
from executive.lab.paraphrases import Paraphrases
from executive.lab.progress import Progress
from executive.s3e import S3E, Templates
from executive.types import Atom, Belief, FloatArray, Observation

FRUITLESS = 10
"""Looks in a row without a single answer after which an evaluation is given up."""


@dataclass(frozen=True, slots=True)
class EvalConfig:
    """What is evaluated, on what, and how.

    `data` is the folder of a finished collection; `looks` how many of its points are looked at, the first ones, or None
    for all. `paraphrases` is a file of other wordings; `rename` whether objects are called as it says, too. `disturb`
    makes looks harder (`executive.lab.disturbance`). `seed` fixes which wording and what disturbance each look gets.
    """

    domain: str
    data: Path
    eye: EyeConfig
    problem: str | None = None
    looks: int | None = None
    paraphrases: Path | None = None
    rename: bool = True
    disturb: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        Disturbance.parse(self.disturb)
        if self.looks is not None and self.looks < 1:
            raise InputError(f"{self.looks} is not a number of looks from 1 on", key="--looks")
        if self.seed < 0:
            raise InputError(f"{self.seed} is not a seed from 0 on", key="--seed")
        if self.paraphrases is not None and self.eye.translator != "templates":
            raise InputError("words the questions itself; it goes with --translator templates", key="--paraphrases")
        if not self.rename and self.paraphrases is None:
            raise InputError("goes with --paraphrases", key="--no-rename")

    @property
    def command(self) -> str:
        """The command that does the same again."""
        words = ["executive", "eval", self.domain, str(self.data)]
        options = {
            "--problem": self.problem,
            "--looks": self.looks,
            "--paraphrases": self.paraphrases,
            "--seed": self.seed or None,
        }
        for name, value in options.items():
            words += [name, str(value)] if value is not None else []
        words += [word for spec in self.disturb for word in ("--disturb", spec)]
        return shlex.join([*words, *self.eye.words(), *([] if self.rename else ["--no-rename"])])


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """What was asked, and all that was answered.

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
        """The median, which the first look's warming up does not move."""
        return float(np.median(self.seconds))


class Evaluator:
    """An eye, the data, and what makes looks harder, ready to `run`. A context manager that frees what it holds.

    Raises:
        DomainError: the domain or the paraphrases have a mistake.
        InputError: the model, the data, or how they go together.
        MissingError: the machine lacks something.
    """

    def __init__(self, config: EvalConfig, warn: Callable[[str], None] = lambda line: None) -> None:
        self.config = config
        disturbance = Disturbance.parse(config.disturb)
        # What costs little and can be wrong comes first.
        self._manifest = dataset.read_manifest(config.data)
        config.eye.check_cameras(self._manifest["cameras"])
        domain = load_domain(config.domain, config.problem) if disturbance.redraws else None
        self.subject = subject = domain.subject if domain else load_subject(config.domain, config.problem)
        self._check_atoms()
        if domain is not None:
            _check_scene(domain, self._manifest, warn)
        self._paraphrases: Paraphrases | None = None
        if config.paraphrases is not None:
            own = Templates.read(subject.questions) if subject.questions is not None else None
            self._paraphrases = Paraphrases.read(config.paraphrases, subject.task, own, config.rename)
        self.published = published.read(subject.pddl.parent)
        dataset.read(config.data)  # says what an unfinished collection lacks
        self.eye: S3E = open_eye(config.eye, subject)
        for line in (*self.eye.questions.warnings, *(self._paraphrases.warnings if self._paraphrases else ())):
            warn(line)
        self.atoms = subject.task.atoms
        self.mistakes = Mistakes()
        self._disturber = Disturber(disturbance, domain, self.eye.cameras, config.seed)
        self._redraws = disturbance.redraws
        self._cancelled = False

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self._disturber.__exit__(None, None, None)

    def cancel(self) -> None:
        """Have `run` stop after the look at hand. A flag: safe from any thread and signal handler."""
        self._cancelled = True

    @property
    def wanted(self) -> int:
        """How many looks are taken."""
        points: int = self._manifest["points"]
        return points if self.config.looks is None else min(points, self.config.looks)

    def run(self, watch: Callable[[Progress], None] = lambda progress: None) -> Evaluation | None:
        """Take all looks; None when cancelled. `watch` is called before the first and after
        each.

        Raises:
            InputError: the data is damaged, or nothing is answered any more.
        """
        began, fruitless, taken = time.monotonic(), 0, _Taken(self.atoms)
        watch(Progress(0, self.wanted, 0, 0.0))
        for number, point in enumerate(itertools.islice(self._points(), self.wanted), start=1):
            belief, seconds, images = self._look(number, point)
            taken.add(point, belief, seconds)
            self.mistakes.add(point, belief, images, self.eye.questions.text)
            fruitless = 0 if belief.probability else fruitless + 1
            if fruitless == FRUITLESS:
                raise InputError(f"there was no answer in {FRUITLESS} looks in a row: {_why(belief)}", key="eval")
            watch(Progress(number, self.wanted, number, time.monotonic() - began))
            if self._cancelled:
                return None
        return taken.evaluation(*self._described())

    def _points(self) -> Iterator[Point]:
        """The points, with the pictures that the eye is shown unless they are drawn anew."""
        return dataset.read(self.config.data, () if self._redraws else self.eye.cameras)

    def _look(self, number: int, point: Point) -> tuple[Belief, float, Mapping[str, Any]]:
        if self._paraphrases is not None:
            key = np.random.SeedSequence([self.config.seed, point.seed, point.episode, point.step], spawn_key=(2,))
            text = self._paraphrases.drawn(np.random.default_rng(key))
            self.eye.questions = replace(self.eye.questions, text=text)
        images = self._disturber.pictures(point)
        observation = Observation(number, point.time, images, point.joints)
        begin = time.perf_counter()
        belief = self.eye.estimate(observation, self.atoms)
        return belief, time.perf_counter() - begin, images

    def _described(self) -> tuple[str, dict[str, Any]]:
        """The evaluation's name, and everything that decided it."""
        config, collection = self.config, self._manifest["collection"]
        at_home = bool(collection.get("home_pose", True))
        told = config.eye.instructions
        instructed = told if isinstance(told, str) else told and self.subject.instructions is not None
        model = self.eye.backend.name
        about = {
            "domain": self.subject.name,
            "problem": self.subject.task.problem,
            "data": {"folder": config.data.name, "seed": collection.get("seed"), "home_pose": at_home},
            "model": model,
            "calibrated": load_calibration(settled(config.eye, self.subject)) is not None,
            "translator": config.eye.translator,
            "instructions": instructed,
            "per_image": config.eye.per_image,
            "cameras": list(config.eye.cameras or self._manifest["cameras"]),
            "abstention": config.eye.abstention,
            "paraphrases": config.paraphrases.name if config.paraphrases is not None else None,
            "rename": config.rename,
            "disturb": list(config.disturb),
            "seed": config.seed,
            "system_prompt": self.eye.questions.system,
            "command": config.command,
        }
        return row_name(model, about), about

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


class _Taken:
    """What is kept of each look: no pictures."""

    def __init__(self, atoms: Sequence[Atom]) -> None:
        self._atoms = tuple(atoms)
        self._probability: list[list[float]] = []
        self._truth: list[list[bool]] = []
        self._looks: list[tuple[int, int]] = []
        self._surprising: list[bool] = []
        self._seconds: list[float] = []

    def add(self, point: Point, belief: Belief, seconds: float) -> None:
        self._probability.append([belief.probability.get(atom, math.nan) for atom in self._atoms])
        self._truth.append([point.facts[atom] for atom in self._atoms])
        self._looks.append((point.episode, point.step))
        self._surprising.append(bool(point.surprises))
        self._seconds.append(seconds)

    def evaluation(self, name: str, about: Mapping[str, Any]) -> Evaluation:
        answers = Answers(self._atoms, np.array(self._probability), np.array(self._truth))
        surprising, seconds = np.array(self._surprising), np.array(self._seconds)
        return Evaluation(name, about, answers, tuple(self._looks), surprising, seconds)


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


def _why(belief: Belief) -> str:
    errors = (each.error for evidence in belief.evidence.values() for each in evidence if each.error)
    return next(errors, "too little of the probability is on yes or no")
