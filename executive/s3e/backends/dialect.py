"""How one server wants its requests written, as far as its refusals have told.

What calls itself an OpenAI-compatible server knows some of the fields, under some of the names, within some limits. A
request is written once, as most servers take it; a server that names what it does not take gets a changed one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

UNTHINKING: Mapping[str, Any] = {"chat_template_kwargs": {"enable_thinking": False}, "reasoning_effort": "none"}
"""Asks a model not to think aloud first, which would put no probability on an answer yet: in the words of chat
templates (vLLM, SGLang, llama.cpp) and in those of commercial servers (Ollama knows them, too)."""

_EFFORTS = ("none", "minimal", "low")
"""Some servers have no "none"; the least effort that one names is asked for."""

_MOST_TOKENS = 256
"""A server that wants longer replies than this is not met: they would take too long."""

_SILENT = frozenset({400, 415, 422, 500, 501})
"""Statuses that a field which a server does not know may come to without a word."""

_LEAST = re.compile(r"(?:at least|minimum|>=|greater than or equal to|no(?:t be)? less than|range)\D{0,40}?(\d{1,4})")
_MOST = re.compile(
    r"(?:at most|maximum|max allowed|<=|less than or equal to|no more than|not exceed|up to|0 (?:and|to)|\[?0,)"
    r"\D{0,40}?(\d{1,4})"
)
_COUNTED = re.compile(
    r"logprobs\W.{0,60}\binteger|top_logprobs\W.{0,60}(?:not support|not permitted|unknown)"
    r"|(?:unsupported|unrecognized|unknown|unexpected|extra)\b.{0,60}top_logprobs"
)
_TOKENS = re.compile(r"use\W+max_completion_tokens|max_completion_tokens\W+instead|\bmax_tokens\b.{0,60}not support")
_SYSTEM = re.compile(
    r"\b(?:system|developer)\W{1,3}(?:role|message|prompt|instruction)|role\W.{0,40}\bsystem\b|roles must alternate"
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """What a server is written instead of the usual.

    Attributes:
        left_out: fields that it does not take.
        tokens: what it calls the most tokens that a reply may have.
        fewest_tokens: how many of them it wants to be asked for at least.
        most_listed: how many of the likeliest tokens it lists at most; None where it has named no limit.
        counted: whether `logprobs` is how many tokens it lists, as in the older API for completions, which has no
            `top_logprobs`.
        effort: what it calls not to think.
        system: whether there may be a system prompt of its own; else it goes before the user's text.
    """

    left_out: frozenset[str] = frozenset()
    tokens: str = "max_tokens"
    fewest_tokens: int = 1
    most_listed: int | None = None
    counted: bool = False
    effort: str = _EFFORTS[0]
    system: bool = True

    def written(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The request as this server takes it."""
        meant = {**UNTHINKING, "reasoning_effort": self.effort, **request}
        body = {name: value for name, value in meant.items() if name not in self.left_out}
        if "max_tokens" in body:
            body[self.tokens] = max(body.pop("max_tokens"), self.fewest_tokens)
        if self.most_listed is not None and "top_logprobs" in body:
            body["top_logprobs"] = min(body["top_logprobs"], self.most_listed)
        if self.counted and "top_logprobs" in body:
            body["logprobs"] = body.pop("top_logprobs")
        if not self.system:
            body["messages"] = _without_system(body["messages"])
        return body

    def after(self, words: str, status: int, request: Mapping[str, Any], *, known: bool) -> Dialect | None:
        """How to write instead, after a request was refused with these words; None where nothing that could be changed
        is named. A first refusal that names nothing is taken for one of what asks not to think, unless such requests
        are `known` to be taken."""
        said, sent = words.lower(), self.written(request)
        changed = self._named(said, sent)
        if changed == self == Dialect() and status in _SILENT and not known and (status < 500 or not words):
            changed = self._without(*UNTHINKING)
        return changed if changed != self else None

    def _named(self, said: str, sent: Mapping[str, Any]) -> Dialect:
        """What to write after all that a refusal names."""
        changed = self
        if "logprob" in said:
            most = _number(_MOST, said)
            if most is not None and 2 <= most < sent.get("top_logprobs", sent.get("logprobs", 0)):
                return replace(changed, most_listed=most)
            if "top_logprobs" in sent and _COUNTED.search(said):
                return replace(changed, counted=True)
        elif "token" in said:
            if self.tokens == "max_tokens" and "max_tokens" in sent and _TOKENS.search(said):
                return replace(changed, tokens="max_completion_tokens")
            fewest = _number(_LEAST, said)
            if fewest is not None and sent.get(self.tokens, fewest) < fewest <= _MOST_TOKENS:
                return replace(changed, fewest_tokens=fewest)
        if "temperature" in said:
            changed = changed._without("temperature")
        if "chat_template_kwargs" in said or "enable_thinking" in said:
            changed = changed._without("chat_template_kwargs")
        if re.search(r"reasoning.effort", said):
            less = (e for e in _EFFORTS[_EFFORTS.index(self.effort) + 1 :] if re.search(rf"\b{e}\b", said))
            effort = next(less, None)
            changed = changed._without("reasoning_effort") if effort is None else replace(changed, effort=effort)
        elif changed == self and re.search(r"\bthink", said):
            changed = changed._without(*UNTHINKING)
        if self.system and _SYSTEM.search(said) and any(each["role"] == "system" for each in sent["messages"]):
            changed = replace(changed, system=False)
        return changed

    def _without(self, *fields: str) -> Dialect:
        return replace(self, left_out=self.left_out.union(fields))


def _number(pattern: re.Pattern[str], said: str) -> int | None:
    found = pattern.search(said)
    return None if found is None else int(found[1])


def _without_system(messages: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The same messages, the system prompt before the text of the user's."""
    system = "\n\n".join(each["content"] for each in messages if each["role"] == "system")
    kept: list[dict[str, Any]] = [dict(each) for each in messages if each["role"] != "system"]
    if not system:
        return kept
    content = kept[0]["content"]
    if isinstance(content, str):
        kept[0]["content"] = f"{system}\n\n{content}"
    else:  # the pictures first, as everywhere
        kept[0]["content"] = [
            {**part, "text": f"{system}\n\n{part['text']}"} if part["type"] == "text" else part for part in content
        ]
    return kept
