"""Backends of the package `s3e` 0.5 as ours, and ours as its (the extra `s3e`).

estimator = S3E(FromS3E(s3e.HuggingFaceVLM("FOLDER")), questions)
engine = s3e.QueryEngine(as_s3e(TransformersBackend("FOLDER")), answers=s3e.BinaryAnswers("yes", "no"))
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from executive.errors import InputError, MissingError
from executive.s3e.backends.interface import YES_NO, Answer, AnswerWords, Backend, Look
from executive.types import Image

if TYPE_CHECKING:
    from PIL import Image as Picture

EXTRA = "s3e"


class Output(Protocol):
    """What s3e calls a `VLMOutput`, as far as it is used here."""

    token_probs: dict[str, float] | None


class VLM(Protocol):
    """What s3e calls a `VLMBackend`, as far as it is used here."""

    def query_batch(
        self,
        images: list[Picture.Image],
        prompts: list[str],
        system_prompt: str | None = None,
        generate: bool = False,
        interest_tokens: Sequence[str] | None = None,
    ) -> Sequence[Output]: ...


class FromS3E:
    """One of s3e's backends (a `VLMBackend`) as a backend of ours."""

    def __init__(self, vlm: VLM, name: str = "") -> None:
        self.name = name or type(vlm).__name__
        self._vlm = vlm

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> Look:
        """Take in pictures as `Backend.look` does.

        Raises:
            InputError: there is no picture.
        """
        from PIL import Image as Picture

        if not images:
            raise InputError("there is no picture to look at")
        return _Look(self._vlm, [Picture.fromarray(np.asarray(image)) for image in images], system, words)


class _Look:
    def __init__(self, vlm: VLM, images: list[Picture.Image], system: str, words: AnswerWords) -> None:
        self._vlm, self._images, self._system, self._forms = vlm, images, system, words.forms()

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        asked = [form for forms in self._forms for form in forms]
        outputs = self._vlm.query_batch(self._images, list(questions), self._system, interest_tokens=asked)
        answers = []
        for question, output in zip(questions, outputs, strict=True):
            masses = output.token_probs or {}
            yes, no = (sum(masses.get(form, 0.0) for form in forms) for forms in self._forms)
            answers.append(Answer(question, yes, no))
        return answers


def as_s3e(backend: Backend) -> Any:
    """Return a backend of ours as one of s3e's (a `VLMBackend`). It scores two answers: it writes no text, and knows no
    null answer.

    Raises:
        MissingError: s3e is not installed.
    """
    try:
        from s3e import VLMBackend, VLMOutput  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError:
        raise MissingError(
            "a backend of ours as one of s3e's needs the package s3e, which is missing",
            command=f"{sys.executable} -m pip install 'executive[{EXTRA}]'",
        ) from None

    class AsS3E(VLMBackend):  # type: ignore[misc, no-any-unimported, unused-ignore]
        """A backend of Executive."""

        def query(
            self,
            images: list[Picture.Image],
            prompt: str,
            system_prompt: str | None = None,
            generate: bool = False,
            interest_tokens: Sequence[str] | None = None,
            **inference_kwargs: Any,
        ) -> Any:
            asked = {"interest_tokens": interest_tokens, **inference_kwargs}
            return self.query_batch(images, [prompt], system_prompt, generate, **asked)[0]

        def query_batch(
            self,
            images: list[Picture.Image],
            prompts: list[str],
            system_prompt: str | None = None,
            generate: bool = False,
            interest_tokens: Sequence[str] | None = None,
            **inference_kwargs: Any,
        ) -> list[Any]:
            words = _words(interest_tokens)
            if generate or words is None:
                raise ValueError(
                    "a backend of Executive scores two answers by their first tokens (scoring='logprobs', no "
                    "null_tokens); it writes no text"
                )
            pictures = [np.asarray(image.convert("RGB")) for image in images]
            answers = backend.look(pictures, system_prompt or "", words).ask(prompts)
            return [_output(answer, words, interest_tokens or ()) for answer in answers]

    def _output(answer: Answer, words: AnswerWords, tokens: Sequence[str]) -> Any:
        # A mass is of all forms of an answer together: it goes to the first of them, and s3e adds up.
        found = dict.fromkeys(tokens, 0.0)
        for word, mass in ((words.affirmative, answer.yes_mass), (words.negative, answer.no_mass)):
            found[next(token for token in tokens if _bare(token) == word)] = mass
        return VLMOutput(token_probs=found)

    return AsS3E()


def _words(tokens: Sequence[str] | None) -> AnswerWords | None:
    """Return the two answers that tokens are forms of, if there are two."""
    words = list(dict.fromkeys(map(_bare, tokens or ())))
    return AnswerWords(*words) if len(words) == 2 else None


def _bare(token: str) -> str:
    return token.strip().lower()
