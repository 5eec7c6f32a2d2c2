"""S3E: from a PDDL domain and camera pictures to a probability for every atom (the paper's Sections 4 and 5).

Works without the rest of the executive:

    from executive.domain import load_subject
    from executive.s3e import S3E, Templates, instruct, load_instructions, observe

    subject = load_subject("grocery")                                    # or any folder with PDDL in it
    questions = Templates.read(subject.questions).translate(subject.task)
    questions = instruct(questions, load_instructions(subject.instructions))
    estimator = S3E(backend, questions)                                  # any `Backend`
    belief = estimator.estimate(observe({"front": picture}), subject.task.atoms)
    belief.probability[Atom.parse("on-table(lemon,wood-table)")]         # not there if it is in belief.unanswered

The names below load no model and no library that runs one; those come with the first model that is made.
"""

from executive.s3e.backend import TRUE_FALSE, YES_NO, Answer, AnswerWords, Backend, Look
from executive.s3e.estimator import LEAST_MASS, S3E, Finding, View, Views, observe
from executive.s3e.questions import (
    Templates,
    Translator,
    Untranslated,
    generic,
    instruct,
    load_instructions,
    load_questions,
)
from executive.s3e.translators import LanguageModel, Reply, Writer
from executive.types import Questions

__all__ = [
    "LEAST_MASS",
    "S3E",
    "TRUE_FALSE",
    "YES_NO",
    "Answer",
    "AnswerWords",
    "Backend",
    "Finding",
    "LanguageModel",
    "Look",
    "Questions",
    "Reply",
    "Templates",
    "Translator",
    "Untranslated",
    "View",
    "Views",
    "Writer",
    "generic",
    "instruct",
    "load_instructions",
    "load_questions",
    "observe",
]
