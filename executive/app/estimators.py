"""The eye, put together from a few words: which model looks, who words the questions, what it is told beside.

What the commands `run` and `estimate` have in common. Everything that is built here could be built by hand from
`executive.s3e`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path

from executive.domain.loader import Subject
from executive.errors import InputError, nearest
from executive.s3e import (
    LEAST_MASS,
    S3E,
    Backend,
    LanguageModel,
    Templates,
    Untranslated,
    Views,
    Writer,
    generic,
    instruct,
    load_instructions,
)
from executive.s3e.backends.openai_client import ChatServer, base_url
from executive.s3e.calibration import FILE, Calibration
from executive.s3e.questions.prompts import GROCERY_INSTRUCTIONS
from executive.types import Questions
from executive.util.files import home

TRANSLATORS = ("templates", "llm", "none")

DOMAIN, PAPER, NONE = "domain", "paper", "none"
"""What `--instructions` says: those of the domain, those of the paper, none; anything else is a file."""

SHIPPED = Path(__file__).parents[1] / "models"
"""Where the models are that come with Executive: `grocery-eye` for the domain grocery."""

NO_MODEL = (
    "no eye comes with the domain {name!r}: pass --vlm with a vision-language model's folder or id on the model hub, "
    "or --server with the address of an OpenAI-compatible server that has one, or grow one: executive train {name} "
    "--out {name}-eye (or do without: executive run {name} --estimator oracle)"
)


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """What decides how an eye sees.

    `vlm` is a checkpoint's folder or hub id, and without it the model that comes with the domain; with `server`,
    the address of an OpenAI-compatible server, it is the name of a model there (without one, the only one there).
    `translator` words the questions: the domain's templates, a language model (`llm`: a folder, a hub id, or a
    model's name at the server; without one, the model at the server that looks), or nobody. `instructions` says
    whether the model is told how things look, as far as the domain says it, or who says it instead: "paper" (for its
    groceries, Appendix E.3), or a file. `per_image` asks about each picture on its own, `cameras` are those whose
    pictures the model is shown, in this order; without any, all are. Without `abstention`, yes over yes and no is the
    probability however little is on either. `calibration` is a file that corrects probabilities; without it, the one
    beside the model's folder, if there is any.
    """

    vlm: str | None = None
    server: str | None = None
    translator: str = "templates"
    llm: str | None = None
    instructions: bool | str = True
    per_image: bool = False
    calibration: Path | None = None
    cameras: tuple[str, ...] = ()
    abstention: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "instructions", {DOMAIN: True, NONE: False}.get(str(self.instructions), self.instructions)
        )
        object.__setattr__(self, "cameras", tuple(dict.fromkeys(self.cameras)))
        if self.translator not in TRANSLATORS:
            hint = nearest(self.translator, TRANSLATORS)
            raise InputError(f"no translator {self.translator!r}; {hint}", key="--translator")
        if self.server is not None:
            base_url(self.server)  # nothing that could be a secret goes into a run's record
        if self.llm is not None and self.translator != "llm":
            raise InputError("goes with --translator llm", key="--llm")
        if self.translator == "llm" and self.llm is None and self.server is None:
            raise InputError("needs --llm with a language model's folder or id", key="--translator llm")

    def words(self) -> list[str]:
        """What is said of it on a command line."""
        told = self.instructions if isinstance(self.instructions, str) else None
        options = {
            "--vlm": self.vlm,
            "--server": self.server,
            "--translator": self.translator if self.translator != "templates" else None,
            "--llm": self.llm,
            "--instructions": told,
            "--cameras": ",".join(self.cameras) or None,
            "--calibration": self.calibration,
        }
        flags = {
            "--no-instructions": self.instructions is False,
            "--per-image": self.per_image,
            "--no-abstention": not self.abstention,
        }
        said = [word for name, value in options.items() if value is not None for word in (name, str(value))]
        return [*said, *(flag for flag, given in flags.items() if given)]

    def check_cameras(self, there: Collection[str]) -> None:
        """Whether there are the cameras that are to be shown.

        Raises:
            InputError: there is no such camera.
        """
        for name in self.cameras:
            if name not in there:
                raise InputError(f"there is no camera {name!r}; {nearest(name, there)}", key="--cameras")


def shipped(name: str) -> Path | None:
    """The folder of the model that comes with a domain, or None."""
    folder = SHIPPED / f"{name}-eye"
    return folder if os.path.isfile(folder / "config.json") else None


def settled(config: EstimatorConfig, subject: Subject) -> EstimatorConfig:
    """The same with the model named, where the domain's own was meant.

    Raises:
        InputError: no model comes with the domain.
    """
    if config.vlm is not None or config.server is not None:
        return config
    folder = shipped(subject.name)
    if folder is None:
        raise InputError(NO_MODEL.format(name=subject.name), key="--vlm")
    return replace(config, vlm=str(folder))


def open_estimator(config: EstimatorConfig, subject: Subject, load: Callable[[str], Backend] | None = None) -> S3E:
    """Load or reach the model, and word the questions about the subject's atoms.

    Args:
        load: what opens a checkpoint by its folder or hub id; by default, it is loaded in this process.

    Raises:
        InputError: the model, the server, the calibration or the files of the domain are no such.
        MissingError: the model needs a package that is not installed.
    """
    # What costs little and can be wrong comes first.
    config = settled(config, subject)
    calibration = load_calibration(config)
    instructions(config, subject)
    server = None if config.server is None else ChatServer(config.server, config.vlm)
    questions = word_questions(config, subject, server)
    backend, odd = _backend(config, server, load)
    return S3E(
        backend,
        replace(questions, warnings=(*questions.warnings, odd)) if odd else questions,
        cameras=config.cameras or None,
        views=Views.AVERAGED if config.per_image else Views.TOGETHER,
        least_mass=LEAST_MASS if config.abstention else 0.0,
        calibrate=calibration,
    )


def load_calibration(config: EstimatorConfig) -> Calibration | None:
    """The correction of the model's probabilities, if there is one.

    Raises:
        InputError: the file is none.
    """
    if config.calibration is not None:
        return Calibration.load(config.calibration)
    beside = None if config.vlm is None or config.server is not None else home(config.vlm) / FILE
    return Calibration.load(beside) if beside is not None and os.path.isfile(beside) else None


def word_questions(config: EstimatorConfig, subject: Subject, server: ChatServer | None = None) -> Questions:
    """A question for every atom of the subject, under the system prompt that goes with them.

    Raises:
        InputError: the domain's files, the language model or the server are no such.
    """
    task = subject.task
    templates = Templates.read(subject.questions) if subject.questions is not None else None
    if config.translator == "templates":
        questions = (templates or generic(task)).translate(task)
    else:
        domain = subject.pddl.read_text(encoding="utf-8-sig", errors="replace")
        if config.translator == "none":
            questions = Untranslated(domain).translate(task)
        else:
            writer = _writer(config, server)
            questions = LanguageModel(writer, domain, templates, cache=cache_folder()).translate(task)
    told = instructions(config, subject)
    return instruct(questions, told) if told else questions


def instructions(config: EstimatorConfig, subject: Subject) -> str:
    """What the model is told of how things look; "" for nothing.

    Raises:
        InputError: there is no such file, or a damaged one.
    """
    match config.instructions:
        case str(name) if name == PAPER:
            return GROCERY_INSTRUCTIONS
        case str(name):
            if not os.path.isfile(home(name)):
                hint = nearest(name, (DOMAIN, PAPER, NONE))
                raise InputError(f"there is no file {name!r}; or, of the words: {hint}", key="--instructions")
            return load_instructions(home(name))
        case True if subject.instructions is not None:
            return load_instructions(subject.instructions)
    return ""


def cache_folder() -> Path:
    """Where what a language model wrote is kept for the next time."""
    from platformdirs import user_cache_path

    return user_cache_path("executive") / "questions"


def _backend(
    config: EstimatorConfig, server: ChatServer | None, load: Callable[[str], Backend] | None
) -> tuple[Backend, str]:
    """What looks, and what is odd about it."""
    if server is not None:
        from executive.s3e.backends.openai_backend import ServerBackend

        there = ServerBackend(server)
        return there, there.check()
    from executive.s3e.backends.transformers_backend import TransformersBackend

    assert config.vlm is not None  # EyeConfig saw to it
    return (load or TransformersBackend)(config.vlm), ""


def _writer(config: EstimatorConfig, server: ChatServer | None) -> Writer:
    if config.server is not None and server is not None:
        from executive.s3e.backends.openai_backend import ServerWriter

        return ServerWriter(server if config.llm is None else ChatServer(config.server, config.llm))
    from executive.s3e.questions.text_model import LocalWriter

    assert config.llm is not None  # EyeConfig saw to it
    return LocalWriter(config.llm)
