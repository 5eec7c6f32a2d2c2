"""A backend and a language model that say what a test wants, and write down what they were asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from executive.s3e import YES_NO, Answer, AnswerWords, Reply
from executive.types import Image

Said = Answer | tuple[float, float] | Exception


@dataclass
class FakeBackend:
    """Answers each question by `say(question, pictures)`: masses, a whole answer, or an exception to be raised."""

    say: Callable[[str, Sequence[Image]], Said]
    refuse: Exception | None = None
    """Raised instead of taking pictures in."""
    looks: list[FakeLook] = field(default_factory=list)
    name: str = "fake"

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> FakeLook:
        if self.refuse is not None:
            raise self.refuse
        self.looks.append(FakeLook(self, tuple(images), system, words))
        return self.looks[-1]

    @property
    def asked(self) -> list[str]:
        return [question for look in self.looks for batch in look.asked for question in batch]


@dataclass
class FakeLook:
    backend: FakeBackend
    images: tuple[Image, ...]
    system: str
    words: AnswerWords
    asked: list[list[str]] = field(default_factory=list)

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        self.asked.append(list(questions))
        answers = []
        for question in questions:
            said = self.backend.say(question, self.images)
            if isinstance(said, Exception):
                raise said
            answers.append(said if isinstance(said, Answer) else Answer(f"{self.system}\n{question}", *said))
        return answers


@dataclass
class FakeWriter:
    """Writes `say(prompt, attempt)`."""

    say: Callable[[str, int], str | Reply]
    name: str = "fake"
    calls: list[tuple[str, list[str], int]] = field(default_factory=list)

    def write(self, system: str, prompts: Sequence[str], attempt: int) -> list[Reply]:
        self.calls.append((system, list(prompts), attempt))
        said = [self.say(prompt, attempt) for prompt in prompts]
        return [reply if isinstance(reply, Reply) else Reply(reply) for reply in said]

    @property
    def asked(self) -> list[tuple[str, int]]:
        return [(prompt, attempt) for _, prompts, attempt in self.calls for prompt in prompts]


def picture(shade: int = 0) -> Image:
    return np.full((4, 6, 3), shade, dtype=np.uint8)
