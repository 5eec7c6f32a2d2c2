"""Models behind an OpenAI-compatible chat server: one that looks at pictures, and one that words questions.

The first is asked for the probabilities of its next token. Each question is one request: the system prompt, the
pictures, the question (the order of the paper's Appendix E.2), one token to be generated, and the `top_logprobs` most
likely tokens in return. What a server does not list it gives no mass to here: an answer that is not among the most
likely tokens counts as nothing, and shows as mass that went elsewhere. Where nothing is listed beside the token that
was generated, there is no probability at all: what else the model might have said is unknown.

Some models put something before each answer that says nothing (`**Yes**`, a newline, a quote, an empty `<think>`).
They are asked for a few tokens more, and an answer after such a beginning counts with the probability of that
beginning times its own after it: the probability that the reply goes so. Beginnings other than the one that was
generated are not followed; their mass went elsewhere.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from executive.errors import InputError
from executive.s3e.backends.interface import LEAST_MASS, YES_NO, Answer, AnswerWords, Numerals, Words, rather
from executive.s3e.backends.openai_client import ChatServer, Failure, ServerError
from executive.s3e.backends.openai_replies import ReplyError
from executive.s3e.questions import prompts
from executive.s3e.questions.language_model import Reply
from executive.types import Image

Encoding: TypeAlias = Literal["png", "jpeg"]

LARGEST = 9
"""The largest number that a server is asked for. A larger one may be several tokens, of which the first is another
number."""

CHECK = "Is two plus two equal to four? Answer yes or no."
"""What a server is asked before anything else. The answer is known."""

REACH = 16
"""Tokens of a reply, where an answer may come after something that says nothing."""

LISTING = "the server has to list the likeliest tokens with top_logprobs (vllm serve: --max-logprobs 20)"

_DRESSING = re.compile(r"[\s\W_]*(?:(?:</?think>|answer)[\s\W_]*)*", re.IGNORECASE)
"""Tokens that say nothing yet."""

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
        self._tokens = 1

    @property
    def name(self) -> str:
        return self.server.name

    @property
    def runtime(self) -> str:
        return "server"

    def check(self) -> str:
        """Ask one thing whose answer is known, without a picture, to find out what is wrong with a server before any
        picture is taken.

        Returns:
            what is odd about its answer, in one line; "" if nothing is.

        Raises:
            ServerError: the server does not have the model, gives no logprobs, or the like.
        """
        system = {"role": "system", "content": prompts.QUESTION_ANSWERING}
        (heard,) = self.ask([[system, {"role": "user", "content": CHECK}]], YES_NO)
        if isinstance(heard, Failure):
            unknown = heard.status == 404 and self.server.model not in self.server.models
            hint = f"; no model {self.server.model!r} there? {self.server.known()}" if unknown else ""
            hint = f"; {LISTING}" if "logprob" in heard.reason and LISTING not in heard.reason else hint
            raise ServerError(f"{heard.reason}{hint}", file=self.server.url)
        asked = f"{self.name} was asked {CHECK!r} to begin with"
        if heard.yes + heard.no < LEAST_MASS:
            thinks = "It thinks first: switch that off at the server. " if "think" in heard.said.lower() else ""
            put = f"put {heard.yes + heard.no:.0%} on yes and no, and would rather say {heard.said}"
            return f"{asked}, {put}. {thinks}What it takes like this question will be unanswered"
        if heard.no > heard.yes:
            share = heard.no / (heard.yes + heard.no)
            return f"{asked}, and says no ({share:.0%}). Its answers about pictures may be worth no more"
        return ""

    def ask(self, conversations: Sequence[Sequence[Mapping[str, Any]]], words: Words) -> list[Heard | Failure]:
        """What is heard after each conversation, in order."""
        heard = self._heard(conversations, words)
        late = [index for index, each in enumerate(heard) if isinstance(each, Heard) and each.begun]
        if late and self._tokens < REACH:
            self._tokens = REACH  # as it has begun here, it will begin again
            again = self._heard([conversations[index] for index in late], words)
            for index, each in zip(late, again, strict=True):
                heard[index] = each
        return heard

    def _heard(self, conversations: Sequence[Sequence[Mapping[str, Any]]], words: Words) -> list[Heard | Failure]:
        wanted = {"max_tokens": self._tokens, "logprobs": True, "top_logprobs": self.top_logprobs}
        requests = [{"messages": messages, **wanted} for messages in conversations]
        return self.server.complete(requests, lambda reply: hear(reply, words))

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> ServerLook:
        """Encode the pictures once. Nothing is sent before the first question.

        Raises:
            InputError: there is no picture, or one that is not (H, W, 3) uint8 with a pixel in it.
        """
        return self._look(images, system, words)

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> ServerLook:
        """Encode the pictures as `look` does, to ask for numbers about them.

        Raises:
            InputError: as `look`; a number has more than one digit.
        """
        if numerals.most > LARGEST:
            raise InputError(f"a server can be asked for numbers up to {LARGEST}: what its tokens are is not known")
        return self._look(images, system, numerals)

    def _look(self, images: Sequence[Image], system: str, words: Words) -> ServerLook:
        if not images:
            raise InputError("there is no picture to ask about")
        return ServerLook(self, tuple(data_url(image, self.pictures) for image in images), system, words)


@dataclass(frozen=True, slots=True, repr=False)
class ServerLook:
    """Pictures as data URLs, ready to be sent along with each question."""

    backend: ServerBackend
    pictures: tuple[str, ...]
    system: str
    words: Words

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order. What goes wrong with one is its `error`, and no exception."""
        conversations = [self._messages(question, self.pictures) for question in questions]
        heard = self.backend.ask(conversations, self.words)
        return [self._answer(question, each) for question, each in zip(questions, heard, strict=True)]

    def _answer(self, question: str, heard: Heard | Failure) -> Answer:
        # A server fills its own template; what it was given is the messages, here with numbers for the pictures.
        numbers = [f"<image {number}>" for number in range(1, len(self.pictures) + 1)]
        prompt = json.dumps(self._messages(question, numbers), ensure_ascii=False)
        if isinstance(heard, Failure):
            return Answer(prompt, 0.0, 0.0, error=heard.reason)
        said = "" if sum(heard.masses) >= LEAST_MASS else heard.said
        if isinstance(self.words, Numerals):
            return Answer(prompt, min(1.0, sum(heard.masses)), 0.0, said=said, masses=heard.masses)
        return Answer(prompt, heard.yes, heard.no, said=said)

    def _messages(self, question: str, pictures: Sequence[str]) -> list[dict[str, Any]]:
        shown: list[dict[str, Any]] = [{"type": "image_url", "image_url": {"url": picture}} for picture in pictures]
        system = [{"role": "system", "content": self.system}] if self.system else []
        return [*system, {"role": "user", "content": [*shown, {"type": "text", "text": question}]}]


class ServerWriter:
    """A language model that words questions (a `Writer` for `executive.s3e.questions.language_model`).

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


@dataclass(frozen=True, slots=True)
class Heard:
    """The answer in a reply.

    Attributes:
        masses: the probability mass on each answer.
        said: what was said, with the probability of its first token.
        begun: it ends before it has said anything.
    """

    masses: tuple[float, ...]
    said: str
    begun: bool

    @property
    def yes(self) -> float:
        """The mass on the first answer."""
        return self.masses[0]

    @property
    def no(self) -> float:
        """The mass on the second answer."""
        return self.masses[1]


def hear(reply: Any, words: Words) -> Heard:
    """The probability mass that a reply's first token that says anything puts on each answer.

    Tokens are compared as text, in every surface form of `words`; different tokens with the same text all count.

    Raises:
        ReplyError: the reply has no log-probabilities, or such that are none, or none but those of what it says.
    """
    try:
        entries = _entries(reply["choices"][0]["logprobs"])[:REACH]
        said, places = "".join(_spelling(entry["token"]) for entry in entries), [_place(entries[0])]
        for entry in entries[1:]:
            if not _DRESSING.fullmatch(places[-1].token):
                break
            places.append(_place(entry))
    except (LookupError, TypeError, AttributeError, ValueError):
        raise _no_logprobs(reply) from None
    wanted, way = words.forms(), 1.0
    masses = (0.0,) * len(wanted)
    for place in places:
        if len(place.listed) == 1 and place.probability < 1.0 - _TOLERANCE:
            raise ReplyError(
                f"the reply lists nothing beside {place.token!r}, so that there is no probability; {LISTING}",
                again=False,
            )
        total = sum(probability for _, probability in place.listed)
        if total > 1.0 + _TOLERANCE:
            raise ReplyError(f"the probabilities in the reply add up to {total:.3g}")
        here = (
            sum(probability for token, probability in place.listed if token in forms) / max(1.0, total)
            for forms in wanted
        )
        masses = tuple(mass + way * more for mass, more in zip(masses, here, strict=True))
        way *= min(1.0, place.probability / max(1.0, total))
    begun = _DRESSING.fullmatch(places[-1].token) is not None
    return Heard(masses, rather(said, places[0].probability), begun)


def _entries(logprobs: Any) -> list[Any]:
    """What is said of each token, in the form that chats have; some servers answer in that of the older API."""
    if logprobs.get("content") is not None or "tokens" not in logprobs:
        return list(logprobs["content"])
    said = zip(logprobs["tokens"], logprobs["token_logprobs"], logprobs["top_logprobs"] or (), strict=True)
    return [
        {"token": token, "logprob": own, "top_logprobs": [{"token": t, "logprob": p} for t, p in (top or {}).items()]}
        for token, own, top in said
    ]


class _Place(NamedTuple):
    """A token that was generated, its probability, and all that are listed there, itself included."""

    token: str
    probability: float
    listed: Sequence[tuple[str, float]]


def _place(entry: Any) -> _Place:
    tops = entry.get("top_logprobs") or ()
    listed = [(top["token"], top["logprob"]) for top in tops]
    numbers = [top.get("id") for top in tops]
    chosen = (entry["token"], entry["logprob"])
    # The token that was generated is not always among those that are listed beside it. llama.cpp gives each a number,
    # and may write the same token differently here and there.
    if chosen[0] not in [token for token, _ in listed] and entry.get("id", _NO_NUMBER) not in numbers:
        listed.append(chosen)
    known = [(_spelling(token), _probability(logprob)) for token, logprob in listed]
    return _Place(_spelling(chosen[0]), _probability(chosen[1]), known)


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
        return ReplyError(f"the reply has no logprobs; {LISTING}", again=False)
    return ReplyError("the reply is no chat completion")
