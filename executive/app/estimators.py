"""Builds a vision-language estimator from its configuration: the model, the questions' translator, the instructions.

It is shared by the commands `run` and `estimate`. Everything that is built here can be built by hand from
`executive.s3e`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from executive.app.config import INSTRUCTIONS, PAPER, EstimatorConfig
from executive.domain.loader import Subject
from executive.errors import OptionError, nearest
from executive.s3e import (
    LEAST_MASS,
    S3E,
    Backend,
    LanguageModel,
    Templates,
    Untranslated,
    Views,
    Writer,
    calibration_file,
    generic,
    instruct,
    load_instructions,
)
from executive.s3e.backends.openai_client import ChatServer
from executive.s3e.calibration import Calibration
from executive.s3e.questions.prompts import GROCERY_INSTRUCTIONS
from executive.types import Questions
from executive.util.files import home

SHIPPED = Path(__file__).parents[1] / "models"
"""The folder of the models that come with Executive: `grocery-eye` for the domain grocery."""

NO_MODEL = (
    "no model comes with the domain {name!r}: pass `vlm` with a vision-language model's folder or id on the model hub, "
    "or `server` with the address of an OpenAI-compatible server that has one, or train one: executive train {name} "
    "--out {name}-eye (or use ground truth: executive run {name} --estimator oracle)"
)


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
        raise OptionError(NO_MODEL.format(name=subject.name), option="vlm")
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
    warnings = tuple(filter(None, (warning, _of_another_runtime(config, backend))))
    return S3E(
        backend,
        replace(questions, warnings=(*questions.warnings, *warnings)),
        cameras=config.cameras or None,
        views=Views.AVERAGED if config.per_image else Views.TOGETHER,
        least_mass=LEAST_MASS if config.abstention else 0.0,
        calibrate=calibration,
    )


def load_calibration(config: EstimatorConfig) -> Calibration | None:
    """Load the correction of the model's probabilities, if there is one: that of the file that is named, or else of the
    one in the model's folder.

    Raises:
        InputError: the file is missing or damaged.
    """
    path = calibration_path(config)
    return None if path is None else Calibration.of(calibration_file.read(path), calibration_file.place(path))


def calibration_path(config: EstimatorConfig) -> Path | None:
    """Return the file, or the model's folder, that has what is known of the model's mistakes."""
    if config.calibration is not None:
        return config.calibration
    folder = None if config.vlm is None or config.server is not None else home(config.vlm)
    return folder if folder is not None and calibration_file.is_in(folder) else None


def runs_as(backend: Backend) -> tuple[str, str]:
    """Return what runs the model, and in which quantisation; "" where that is not known, as of a model at a server."""
    return str(getattr(backend, "runtime", "")), str(getattr(backend, "quantisation", ""))


def _of_another_runtime(config: EstimatorConfig, backend: Backend) -> str:
    """Return a warning if the model's mistakes are known as another runtime runs it, or in another quantisation."""
    path = calibration_path(config)
    if path is None:
        return ""
    known = calibration_file.read(path)
    for was, now in zip((known.runtime, known.quantisation), runs_as(backend), strict=True):
        if was and now and was != now:
            file = calibration_file.place(path).name
            return f"{file} is of the model as {was}, and it runs as {now}: calibrate it anew"
    return ""


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
                hint = nearest(name, INSTRUCTIONS)
                raise OptionError(f"there is no file {name!r}; or, of the words: {hint}", option="instructions")
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
    from executive.s3e.backends.numpy_backend import open_checkpoint

    assert config.vlm is not None  # with_default_model has set it
    return (load or open_checkpoint)(config.vlm), ""


def _writer(config: EstimatorConfig, server: ChatServer | None) -> Writer:
    if config.server is not None and server is not None:
        from executive.s3e.backends.openai_backend import ServerWriter

        return ServerWriter(server if config.llm is None else ChatServer(config.server, config.llm))
    from executive.s3e.questions.text_model import LocalWriter

    assert config.llm is not None  # EstimatorConfig has checked it
    return LocalWriter(config.llm)
