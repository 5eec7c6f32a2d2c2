"""The options of a collection, of an evaluation and of a training."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from executive.app.config import DOMAIN_NAME, HOME_POSE, PROBLEM, RENDERER, EstimatorConfig
from executive.app.options import Configuration, Option, check, command_words
from executive.errors import OptionError, nearest
from executive.util.files import legible

RECIPES = MappingProxyType(
    {
        "small": "as shipped",
        "fine": "for many small things in one picture, and objects that are described",
        "smallest": "to try it out",
    }
)

MOST_POINTS = 20
"""Completed actions before a reset (Appendix D, step 4)."""


def read_range(said: str) -> tuple[int, int]:
    """Return the two numbers of a range such as 2-10; a single number is both.

    Raises:
        OptionError: it is none.
    """
    match = re.fullmatch(r"\s*(\d{1,4})(?:-(\d{1,4}))?\s*", said)
    if match is None:
        raise OptionError(f"should be a number or a range such as 2-10, got {said!r}", option="objects")
    return int(match[1]), int(match[2] or match[1])


COMBINATIONS = MappingProxyType(
    {
        "all": "any objects",
        "seen": "none that is held out of training",
        "held-out": "at least one that is held out of training",
    }
)
"""Which objects the problems of a domain may have that are made up (`executive.lab.problems`)."""


def read_combinations(said: str) -> str:
    """Return the word for combinations of values.

    Raises:
        OptionError: it is none.
    """
    if said not in COMBINATIONS:
        raise OptionError(f"no combinations {said!r}; {nearest(said, COMBINATIONS)}", option="combinations")
    return said


@dataclass(frozen=True, slots=True)
class CollectConfig:
    """The options of a collection.

    With the default grasp noise and slips, `executive collect grocery --points 60 --seed 1` completed 31 of 35 picks
    and 29 of 30 places; 6 mm spoil hardly any pick, 15 mm spoil three in ten. Each data card has its own count.

    Attributes:
        jobs: the number of processes; the data does not depend on it.
        objects: a number or a range; without it, each episode has the problem's own objects, on tables at random.

    Raises:
        OptionError: a value is not valid.
    """

    domain: Annotated[str, DOMAIN_NAME]
    out: Annotated[Path, Option("The folder for the data; an interrupted collection in it is continued.", flag="--out")]
    points: Annotated[int, Option("How many completed actions to picture.", least=1)] = 2000
    problem: Annotated[str | None, PROBLEM] = None
    seed: Annotated[int, Option("Fixes everything, however many processes share the work.", least=0)] = 0
    home_pose: Annotated[bool, HOME_POSE] = True
    grasp_noise: Annotated[float, Option("Standard deviation of the grasp, in m.", least=0)] = 0.010
    slips: Annotated[float, Option("Chance of losing what is carried.", least=0, most=1)] = 0.05
    renderer: Annotated[str | None, RENDERER] = None
    masks: Annotated[bool, Option("Which item each pixel shows, too.")] = False
    objects: Annotated[
        str | None, Option("Other objects in each episode: how many, such as 2-10 (where there is a problems.toml).")
    ] = None
    demonstrations: Annotated[
        bool, Option("How the arm moved in each action, too: what it sensed, and what it was told.")
    ] = False
    combinations: Annotated[
        str, Option("Which of these: all, seen (none that is held out of training), or held-out.", choices=COMBINATIONS)
    ] = "all"
    subset: Annotated[str | None, Option("Only objects of one of the subsets in problems.toml.")] = None
    jobs: Annotated[int | None, Option("How many at a time; as many as there are cores if not given.", least=1)] = None
    per_episode: Annotated[int, Option("How many completed actions before all is set anew.", least=1)] = MOST_POINTS

    def __post_init__(self) -> None:
        check(self)
        if self.objects is not None:
            read_range(self.objects)
            if self.problem is not None:
                raise OptionError("has problems made, and excludes `problem`", option="objects")
        elif self.combinations != "all" or self.subset is not None:
            option = "combinations" if self.subset is None else "subset"
            raise OptionError("is about objects that are made up: it needs `objects`", option=option)

    @property
    def command(self) -> str:
        """The command that starts this collection, and that resumes it."""
        return _command("collect", self)


@dataclass(frozen=True, slots=True)
class EvalConfig:
    """What is evaluated, on what, and how.

    Attributes:
        looks: how many of the collection's points are looked at; without it, all.
        disturb: as of `executive.lab.evaluation.disturbance`.

    Raises:
        OptionError: a value is not valid, or two options exclude each other.
    """

    domain: Annotated[str, DOMAIN_NAME]
    data: Annotated[
        Path,
        Option("A finished collection (see: executive collect), a film, or a folder of films (see: executive film)."),
    ]
    eye: EstimatorConfig = field(default_factory=EstimatorConfig)
    problem: Annotated[str | None, PROBLEM] = None
    looks: Annotated[int | None, Option("Only the first ones.", least=1)] = None
    paraphrases: Annotated[Path | None, Option("A file with other wordings of the questions.")] = None
    rename: Annotated[bool, Option("Use that file's names of objects, too.")] = True
    disturb: Annotated[
        tuple[str, ...],
        Option("Disturb the pictures: lights, cameras, jpeg=40, blurred=3, noisy=40, dark=0.7; repeat it for more."),
    ] = ()
    seed: Annotated[int, Option("Fixes which wording and what disturbance a look gets.", least=0)] = 0

    def __post_init__(self) -> None:
        from executive.lab.evaluation.disturbance import Disturbance

        check(self)
        Disturbance.parse(self.disturb)
        if self.paraphrases is not None and self.eye.translator != "templates":
            raise OptionError("words the questions itself; it goes with `translator` templates", option="paraphrases")
        if not self.rename and self.paraphrases is None:
            raise OptionError("needs `paraphrases`, if names are to be kept", option="rename")

    @property
    def command(self) -> str:
        """The command that repeats the evaluation."""
        return _command("eval", self)


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """The options of a training.

    Attributes:
        start: the folder of a trained model that the training starts from, or the name of one that comes along.
        minutes: all of the training is shortened to fit into this on this machine, as measured at its start.
        jobs: the number of processes that draw pictures and of threads that train, on which the model depends by
            rounding alone.

    Raises:
        OptionError: a value is not valid.
    """

    domain: Annotated[str, DOMAIN_NAME]
    out: Annotated[Path, Option("The folder for everything; an interrupted training in it is continued.", flag="--out")]
    problem: Annotated[str | None, PROBLEM] = None
    recipe: Annotated[
        str,
        Option("The size of the model and of the training: small, fine, or smallest to try it out.", choices=RECIPES),
    ] = "small"
    start: Annotated[
        str | None,
        Option("Start from a trained model, in a third of the time: its folder, or grocery-eye.", flag="--from"),
    ] = None
    further: Annotated[
        bool, Option("Go on with a model of this domain (--from): it keeps its words, and learns from new pictures.")
    ] = False
    objects: Annotated[
        str, Option("How many, where objects change from problem to problem (where there is a problems.toml).")
    ] = "2-10"
    data: Annotated[
        tuple[str, ...],
        Option("Train on a collection's pictures (--masks) in place of drawing any; repeat it for more."),
    ] = ()
    minutes: Annotated[
        float | None, Option("Shorten it to fit into so many minutes on this machine.", least=1, most=100_000)
    ] = None
    seed: Annotated[int, Option("Fixes everything but rounding.", least=0)] = 0
    jobs: Annotated[int | None, Option("Processes and threads; all cores if not given.", least=1)] = None

    def __post_init__(self) -> None:
        check(self)
        read_range(self.objects)
        if self.further and self.start is None:
            raise OptionError("needs the model that the training goes on with: --from MODEL", option="further")

    @property
    def command(self) -> str:
        """The command that starts this training, and that resumes it."""
        return _command("train", self)


def _command(name: str, config: Configuration) -> str:
    """Return the command for this work, without the number of processes, on which nothing depends."""
    return legible(shlex.join(["executive", name, *command_words(config, without=("jobs",))]))
