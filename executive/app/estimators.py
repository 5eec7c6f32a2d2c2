"""Builds a vision-language estimator from its configuration: the model, the questions' translator, the instructions.

It is shared by the commands `run` and `estimate`. Everything that is built here can be built by hand from
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
"""The values of `--instructions`: the domain's own, the paper's, none; anything else is a file."""

SHIPPED = Path(__file__).parents[1] / "models"
"""The folder of the models that come with Executive: `grocery-eye` for the domain grocery."""

NO_MODEL = (
    "no model comes with the domain {name!r}: pass --vlm with a vision-language model's folder or id on the model hub, "
    "or --server with the address of an OpenAI-compatible server that has one, or train one: executive train {name} "
    "--out {name}-eye (or use ground truth: executive run {name} --estimator oracle)"
)


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """The options of a vision-language estimator.

    Attributes:
        vlm: a checkpoint's folder or hub id; without it, the model that comes with the domain. With `server`, a model's
            name there (without it, the only one there).
        server: the address of an OpenAI-compatible server.
        translator: what words the questions: the domain's `templates`, a language model (`llm`), or `none`.
        llm: the translator's language model: a folder, a hub id, or a model's name at the server; without it, the
            server's model that also answers the questions.
        instructions: descriptions of how things look that go into the prompt: True for the domain's, False for none,
            "paper" for the paper's (for its groceries, Appendix E.3), or a file.
        per_image: whether each picture is asked about on its own, and the probabilities are averaged.
        calibration: a file that corrects probabilities; without it, the one in the model's folder, if there is one.
        cameras: those whose pictures the model gets, in this order; without any, all.
        abstention: whether an answer counts as none when little probability mass is on yes and no; without it, the
            probability is yes / (yes + no) always.

    Raises:
        InputError: a value is not valid, or two options exclude each other.
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
            base_url(self.server)  # refuses addresses with secrets, which would go into a run's record
        if self.llm is not None and self.translator != "llm":
            raise InputError("goes with --translator llm", key="--llm")
        if self.translator == "llm" and self.llm is None and self.server is None:
            raise InputError("needs --llm with a language model's folder or id", key="--translator llm")

    def words(self) -> list[str]:
        """Return the command-line arguments that stand for these options."""
        instructions = self.instructions if isinstance(self.instructions, str) else None
        options = {
            "--vlm": self.vlm,
            "--server": self.server,
            "--translator": self.translator if self.translator != "templates" else None,
            "--llm": self.llm,
            "--instructions": instructions,
            "--cameras": ",".join(self.cameras) or None,
            "--calibration": self.calibration,
        }
        flags = {
            "--no-instructions": self.instructions is False,
            "--per-image": self.per_image,
            "--no-abstention": not self.abstention,
        }
        words = [word for name, value in options.items() if value is not None for word in (name, str(value))]
        return [*words, *(flag for flag, given in flags.items() if given)]

    def check_cameras(self, there: Collection[str]) -> None:
        """Check that the scene has these cameras.

        Raises:
            InputError: it lacks one of them.
        """
        for name in self.cameras:
            if name not in there:
                raise InputError(f"there is no camera {name!r}; {nearest(name, there)}", key="--cameras")


def shipped(name: str) -> Path | None:
    """Return the folder of the model that comes with a domain, or None."""
    folder = SHIPPED / f"{name}-eye"
    return folder if os.path.isfile(folder / "config.json") else None


def with_default_model(config: EstimatorConfig, subject: Subject) -> EstimatorConfig:
    """Return the options with the domain's shipped model filled in, where no model is named.

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
    """Load the model or connect to its server, and word the questions about the subject's atoms.

    Args:
        load: a function that opens a checkpoint by its folder or hub id; by default, it is loaded in this process.

    Raises:
        InputError: the model, the server, the calibration or a file of the domain is missing or damaged.
        MissingError: the model needs a package that is not installed.
    """
    # What is cheap to check comes first.
    config = with_default_model(config, subject)
    calibration = load_calibration(config)
    instructions(config, subject)
    server = None if config.server is None else ChatServer(config.server, config.vlm)
    questions = word_questions(config, subject, server)
    backend, warning = _backend(config, server, load)
    return S3E(
        backend,
        replace(questions, warnings=(*questions.warnings, warning)) if warning else questions,
        cameras=config.cameras or None,
        views=Views.AVERAGED if config.per_image else Views.TOGETHER,
        least_mass=LEAST_MASS if config.abstention else 0.0,
        calibrate=calibration,
    )


def load_calibration(config: EstimatorConfig) -> Calibration | None:
    """Load the calibration of the model's probabilities, if there is one.

    Raises:
        InputError: the file is missing or damaged.
    """
    if config.calibration is not None:
        return Calibration.load(config.calibration)
    file = None if config.vlm is None or config.server is not None else home(config.vlm) / FILE
    return Calibration.load(file) if file is not None and os.path.isfile(file) else None


def word_questions(config: EstimatorConfig, subject: Subject, server: ChatServer | None = None) -> Questions:
    """Word a question for every atom of the subject, with the system prompt.

    Raises:
        InputError: a file of the domain, the language model or the server is missing or damaged.
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
    text = instructions(config, subject)
    return instruct(questions, text) if text else questions


def instructions(config: EstimatorConfig, subject: Subject) -> str:
    """Return the prompt's instructions on how things look; "" for none.

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
    """Return the folder in which a language model's questions are cached."""
    from platformdirs import user_cache_path

    return user_cache_path("executive") / "questions"


def _backend(
    config: EstimatorConfig, server: ChatServer | None, load: Callable[[str], Backend] | None
) -> tuple[Backend, str]:
    """Return the backend, and a warning about it or ""."""
    if server is not None:
        from executive.s3e.backends.openai_backend import ServerBackend

        there = ServerBackend(server)
        return there, there.check()
    from executive.s3e.backends.transformers_backend import TransformersBackend

    assert config.vlm is not None  # with_default_model has set it
    return (load or TransformersBackend)(config.vlm), ""


def _writer(config: EstimatorConfig, server: ChatServer | None) -> Writer:
    if config.server is not None and server is not None:
        from executive.s3e.backends.openai_backend import ServerWriter

        return ServerWriter(server if config.llm is None else ChatServer(config.server, config.llm))
    from executive.s3e.questions.text_model import LocalWriter

    assert config.llm is not None  # EstimatorConfig has checked it
    return LocalWriter(config.llm)
