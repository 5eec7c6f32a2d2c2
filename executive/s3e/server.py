"""Models behind an OpenAI-compatible chat server: one that looks at pictures, and one that words questions.

The first is asked for the probabilities of its next token. Each question is one request: the system prompt, the
pictures, the question (the order of the paper's Appendix E.2), one token to be generated, and the `top_logprobs` most
likely tokens in return. What a server does not list it gives no mass to here: an answer that is not among the most
likely tokens counts as nothing, and shows as mass that went elsewhere.
"""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from executive.errors import InputError
from executive.s3e.backend import YES_NO, Answer, AnswerWords
from executive.s3e.chat import ChatServer, Failure, ReplyError, ServerError
from executive.s3e.translators import Reply
from executive.types import Image

Encoding: TypeAlias = Literal["png", "jpeg"]

_TOLERANCE = 1e-3
"""By how much probabilities that were rounded on the way may add up to more than 1."""
_IMPOSSIBLE = -1000.0
"""A logarithm whose probability is 0."""
_NO_NUMBER = object()
_VARIED = 0.7
"""The temperature of a reply that is to differ from the likeliest one."""
_SPACES = str.maketrans({"\N{LOWER ONE EIGHTH BLOCK}": " ", "\N{LATIN CAPITAL LETTER G WITH DOT ABOVE}": " "})
"""How vocabularies spell a leading space (SentencePiece, byte-level BPE), which some servers hand on as it is."""


class ServerBackend:
    """A `Backend` over a chat server.

    Args:
        server: where, and which model.
        top_logprobs: how many of the most likely tokens to ask for. OpenAI and vLLM (`--max-logprobs`) allow 20.
        pictures: how pictures travel: "png" as they are, "jpeg" smaller and a little changed.
    """

    def __init__(self, server: ChatServer, *, top_logprobs: int = 20, pictures: Encoding = "png") -> None:
        if top_logprobs < 2:
            raise ValueError(f"of {top_logprobs} tokens, none can be yes and another one no")
        self.server, self.top_logprobs, self.pictures = server, top_logprobs, pictures

    @property
    def name(self) -> str:
        return self.server.name

    def check(self) -> None:
        """Ask one thing without a picture, to find out a server that can give no answers before any picture is taken.

        Raises:
            ServerError: the server does not have the model, gives no logprobs, or the like.
        """
        request = {"messages": [{"role": "user", "content": "Is water wet? Answer yes or no."}], **self.wanted}
        (reply,) = self.server.complete([request], lambda reply: masses(reply, YES_NO))
        if isinstance(reply, Failure):
            unknown = reply.status == 404 and self.server.model not in self.server.models
            hint = f"; no model {self.server.model!r} there? {self.server.known()}" if unknown else ""
            raise ServerError(f"{reply.reason}{hint}", file=self.server.url)

    @property
    def wanted(self) -> dict[str, object]:
        """What is asked for with each question: one token, and how likely the others were."""
        return {"max_tokens": 1, "logprobs": True, "top_logprobs": self.top_logprobs}

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> ServerLook:
        """Encode the pictures once. Nothing is sent before the first question.

        Raises:
            InputError: there is no picture, or one that is not (H, W, 3) uint8 with a pixel in it.
        """
        if not images:
            raise InputError("there is no picture to ask about")
        return ServerLook(self, tuple(data_url(image, self.pictures) for image in images), system, words)


@dataclass(frozen=True, slots=True, repr=False)
class ServerLook:
    """Pictures as data URLs, ready to be sent along with each question."""

    backend: ServerBackend
    pictures: tuple[str, ...]
    system: str
    words: AnswerWords

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order. What goes wrong with one is its `error`, and no exception."""
        wanted = self.backend.wanted
        requests = [{"messages": self._messages(question, self.pictures), **wanted} for question in questions]
        replies = self.backend.server.complete(requests, lambda reply: masses(reply, self.words))
        return [self._answer(question, reply) for question, reply in zip(questions, replies, strict=True)]

    def _answer(self, question: str, reply: tuple[float, float] | Failure) -> Answer:
        # A server fills its own template; what it was given is the messages, here with numbers for the pictures.
        numbers = [f"<image {number}>" for number in range(1, len(self.pictures) + 1)]
        prompt = json.dumps(self._messages(question, numbers), ensure_ascii=False)
        if isinstance(reply, Failure):
            return Answer(prompt, 0.0, 0.0, error=reply.reason)
        return Answer(prompt, *reply)

    def _messages(self, question: str, pictures: Sequence[str]) -> list[dict[str, Any]]:
        shown: list[dict[str, Any]] = [{"type": "image_url", "image_url": {"url": picture}} for picture in pictures]
        system = [{"role": "system", "content": self.system}] if self.system else []
        return [*system, {"role": "user", "content": [*shown, {"type": "text", "text": question}]}]


class ServerWriter:
    """A language model that words questions (a `Writer` for `executive.s3e.translators`).

    Args:
        server: where, and which model.
        most: how many tokens a reply may have.
    """

    def __init__(self, server: ChatServer, *, most: int = 200) -> None:
        self.server, self.most = server, most

    @property
    def name(self) -> str:
        return self.server.name

    def write(self, system: str, prompts: Sequence[str], attempt: int) -> list[Reply]:
        """A reply to each prompt, in order: the likeliest one at attempt 0, one that is drawn at each later one."""
        drawn = {"temperature": _VARIED, "seed": attempt} if attempt else {}
        requests = [
            {
                "messages": [{"role": "system", "content": system}, {"role": "user", "content": prompt}],
                "max_tokens": self.most,
                **drawn,
            }
            for prompt in prompts
        ]
        replies = self.server.complete(requests, text)
        return [Reply(error=reply.reason) if isinstance(reply, Failure) else Reply(reply) for reply in replies]


def data_url(image: Image, encoding: Encoding = "png") -> str:
    """An (H, W, 3) uint8 RGB picture as a `data:` URL.

    Raises:
        InputError: the array is no such picture.
    """
    from PIL import Image as Picture

    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise InputError(f"a picture is (H, W, 3) uint8 and not empty, got {image.shape} {image.dtype}")
    buffer = io.BytesIO()
    # PNG's fastest compression: most servers are near, and all of them decode any.
    options: dict[str, int] = {"compress_level": 1} if encoding == "png" else {"quality": 92}
    Picture.fromarray(np.ascontiguousarray(image)).save(buffer, encoding.upper(), **options)
    return f"data:image/{encoding};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def masses(reply: Any, words: AnswerWords) -> tuple[float, float]:
    """The probability mass that a reply's first token puts on each answer.

    Tokens are compared as text, in every surface form of `words`; different tokens with the same text all count.

    Raises:
        ReplyError: the reply has no log-probabilities, or such that are none.
    """
    try:
        entry = reply["choices"][0]["logprobs"]["content"][0]
        listed = [(top["token"], top["logprob"]) for top in entry.get("top_logprobs") or ()]
        chosen = (entry["token"], entry["logprob"])
        numbers = [top.get("id") for top in entry.get("top_logprobs") or ()]
    except (LookupError, TypeError, AttributeError):
        raise _no_logprobs(reply) from None
    # The token that was generated is not always among those that are listed beside it. llama.cpp gives each a number,
    # and may write the same token differently here and there.
    if chosen[0] not in [token for token, _ in listed] and entry.get("id", _NO_NUMBER) not in numbers:
        listed.append(chosen)
    probabilities = [(_spelling(token), _probability(logprob)) for token, logprob in listed]
    total = sum(probability for _, probability in probabilities)
    if total > 1.0 + _TOLERANCE:
        raise ReplyError(f"the probabilities in the reply add up to {total:.3g}")
    yes, no = (
        sum(probability for token, probability in probabilities if token in forms) / max(1.0, total)
        for forms in words.forms()
    )
    return yes, no


def text(reply: Any) -> str:
    """What a reply says.

    Raises:
        ReplyError: it says nothing.
    """
    try:
        said = reply["choices"][0]["message"]["content"]
    except (LookupError, TypeError):
        said = None
    if not isinstance(said, str):
        raise ReplyError("the reply has no text")
    return said


def _spelling(token: object) -> str:
    return token.translate(_SPACES) if isinstance(token, str) else ""


def _probability(logprob: object) -> float:
    """The probability, from its logarithm; servers write minus infinity in many ways (a huge negative number, null)."""
    if logprob is None:
        return 0.0
    if isinstance(logprob, bool) or not isinstance(logprob, int | float) or not logprob <= _TOLERANCE:
        raise ReplyError(f"a log-probability in the reply is {logprob!r:.40}")
    return math.exp(min(0.0, max(_IMPOSSIBLE, logprob)))


def _no_logprobs(reply: Any) -> ReplyError:
    """Why a reply has none: an error that came with status 200, or a server that does not give any."""
    if isinstance(reply, Mapping) and reply.get("error"):
        return ReplyError(f"the server reports an error: {reply['error']!s:.200}")
    if isinstance(reply, Mapping) and isinstance(reply.get("choices"), list) and reply["choices"]:
        return ReplyError("the reply has no logprobs; the server has to give top_logprobs for chat", again=False)
    return ReplyError("the reply is no chat completion")
