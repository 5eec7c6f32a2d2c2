"""S3E: from a PDDL domain and camera pictures to a probability for every atom (the paper's Sections 4 and 5).

Works without the rest of the executive:

    from executive.domain.loader import load_subject
    from executive.s3e import S3E, Templates, instruct, load_instructions, observe

    subject = load_subject("grocery")                                    # or any folder with PDDL in it
    questions = Templates.read(subject.questions).translate(subject.task)
    questions = instruct(questions, load_instructions(subject.instructions))
    estimator = S3E(backend, questions)                                  # any `Backend`
    belief = estimator.estimate(observe({"front": picture}), subject.task.atoms)
    belief.probability[Atom.parse("on-table(lemon,wood-table)")]         # not there if it is in belief.unanswered

A backend is a checkpoint in this process, `TransformersBackend("path/to/checkpoint")`, or a model behind any
OpenAI-compatible server, `ServerBackend(ChatServer("http://127.0.0.1:8000/v1"))`; a picture comes from a camera or from
`read_picture("front.png")`.

The names below load no model and no library that runs one; those come with the first model that is made.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from executive.s3e.backends.interface import LEAST_MASS, TRUE_FALSE, YES_NO, Answer, AnswerWords, Backend, Look
from executive.s3e.backends.openai_backend import ServerBackend, ServerWriter
from executive.s3e.backends.openai_client import ChatServer
from executive.s3e.backends.s3e_package import FromS3E, as_s3e
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.s3e.calibration import Calibration
from executive.s3e.estimator import S3E, Finding, View, Views, observe
from executive.s3e.pictures import read_picture
from executive.s3e.questions.language_model import LanguageModel, Reply, Writer
from executive.s3e.questions.templates import (
    Templates,
    Translator,
    Untranslated,
    generic,
    instruct,
    load_instructions,
    load_questions,
)
from executive.s3e.questions.text_model import LocalWriter
from executive.types import Questions

if TYPE_CHECKING:
    from executive.s3e.interchange import PlattProfile, Prediction, PredictionSet

__all__ = [
    "LEAST_MASS",
    "S3E",
    "TRUE_FALSE",
    "YES_NO",
    "Answer",
    "AnswerWords",
    "Backend",
    "Calibration",
    "ChatServer",
    "Finding",
    "FromS3E",
    "LanguageModel",
    "LocalWriter",
    "Look",
    "PlattProfile",
    "Prediction",
    "PredictionSet",
    "Questions",
    "Reply",
    "ServerBackend",
    "ServerWriter",
    "Templates",
    "TransformersBackend",
    "Translator",
    "Untranslated",
    "View",
    "Views",
    "Writer",
    "as_s3e",
    "generic",
    "instruct",
    "load_instructions",
    "load_questions",
    "observe",
    "read_picture",
]

_FILES = frozenset(["PlattProfile", "Prediction", "PredictionSet"])
"""Names of `executive.s3e.interchange`, which is loaded with the first of them: it takes pydantic."""


def __getattr__(name: str) -> object:
    if name not in _FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("executive.s3e.interchange"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
