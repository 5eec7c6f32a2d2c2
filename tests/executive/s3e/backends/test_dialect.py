"""Servers that take some requests alone: each limit is met by one changed request, and remembered."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from executive.s3e.backends.dialect import UNTHINKING, Dialect
from tests.executive.s3e.chat_server import Request, Response, as_json, serving
from tests.executive.s3e.on_server import IMAGE, QUESTIONS, SYSTEM, backend, honest, look, writer

Body = dict[str, Any]


def roles(body: Body) -> list[str]:
    return [message["role"] for message in body["messages"]]


def tokens(body: Body) -> int:
    return int(body["max_tokens"] if "max_tokens" in body else body["max_completion_tokens"])


def refusal(message: str, status: int = 400, **more: object) -> Response:
    return as_json({"error": {"message": message, "type": "invalid_request_error", **more}}, status)


LIMITS: dict[str, tuple[Callable[[Body], bool], Response]] = {
    "listed, in OpenAI's words": (
        lambda body: body["top_logprobs"] > 5,
        refusal("Invalid 'top_logprobs': integer above maximum value. Expected a value <= 5, but got 20 instead."),
    ),
    "listed, in vLLM's words": (
        lambda body: body["top_logprobs"] > 5,
        refusal("Requested sample logprobs of 20, which is greater than max allowed: 5"),
    ),
    "listed, in pydantic's words": (
        lambda body: body["top_logprobs"] > 5,
        as_json({"detail": [{"loc": ["body", "top_logprobs"], "msg": "Input should be less than or equal to 5"}]}, 422),
    ),
    "listed, as a range": (
        lambda body: body["top_logprobs"] > 5,
        refusal("Range of top_logprobs should be [0, 5]"),
    ),
    "listed by number": (
        lambda body: body["logprobs"] is True,
        as_json({"detail": [{"loc": ["body", "logprobs"], "msg": "Input should be a valid integer"}]}, 422),
    ),
    "listed by number, as an unknown field": (
        lambda body: "top_logprobs" in body,
        refusal("Unrecognized request argument supplied: top_logprobs"),
    ),
    "another name for tokens": (
        lambda body: "max_tokens" in body,
        refusal(
            "Unsupported parameter: 'max_tokens' is not supported here. Use 'max_completion_tokens' instead.",
            param="max_tokens",
        ),
    ),
    "fewest tokens": (
        lambda body: tokens(body) < 16,
        refusal("Invalid 'max_output_tokens': integer below minimum value. Expected a value >= 16, but got 1 instead."),
    ),
    "fewest tokens, handed on": (
        lambda body: tokens(body) < 16,
        refusal("Provider returned error", metadata={"raw": '{"error": "max_tokens must be at least 16"}'}),
    ),
    "temperature": (
        lambda body: "temperature" in body,
        refusal(
            "Unsupported value: 'temperature' does not support 0 with this model. Only the default (1) is supported."
        ),
    ),
    "temperature, as a server's own fault": (
        lambda body: "temperature" in body,
        refusal("`temperature` must be strictly positive", 500),
    ),
    "system role": (lambda body: "system" in roles(body), refusal("System role not supported")),
    "system role, in OpenAI's words": (
        lambda body: "system" in roles(body),
        refusal("Unsupported value: 'messages[0].role' does not support 'system' with this model."),
    ),
    "system role, in Google's words": (
        lambda body: "system" in roles(body),
        as_json([{"error": {"code": 400, "message": "Developer instruction is not enabled for models/gemma-3"}}], 400),
    ),
    "template options": (
        lambda body: "chat_template_kwargs" in body,
        as_json({"detail": [{"loc": ["body", "chat_template_kwargs"], "msg": "Extra inputs are not permitted"}]}, 422),
    ),
    "effort": (
        lambda body: "reasoning_effort" in body,
        refusal("Unrecognized request argument supplied: reasoning_effort"),
    ),
    "no such effort": (
        lambda body: body.get("reasoning_effort") not in ("minimal", "low"),
        refusal("Unsupported value: 'none' is not supported. reasoning_effort is one of: 'minimal', 'low', 'medium'."),
    ),
    "thinking": (
        lambda body: any(name in body for name in UNTHINKING),
        refusal("this model does not support thinking"),
    ),
    "without a word": (lambda body: any(name in body for name in UNTHINKING), Response(b"Bad Request", 400)),
    "without a word, as a server's own fault": (
        lambda body: any(name in body for name in UNTHINKING),
        Response(b"Internal Server Error", 500),
    ),
}


def picky(*names: str) -> Callable[[Request], Response]:
    def respond(request: Request) -> Response:
        refused = (response for name in names for limit, response in [LIMITS[name]] if limit(request.body))
        return next(refused, None) or honest(request)

    return respond


def older(response: Response) -> Response:
    """The same in the form of the older API for completions."""
    reply = json.loads(response.body)
    content = reply["choices"][0]["logprobs"]["content"]
    reply["choices"][0]["logprobs"] = {
        "tokens": [each["token"] for each in content],
        "token_logprobs": [each["logprob"] for each in content],
        "top_logprobs": [{top["token"]: top["logprob"] for top in each["top_logprobs"]} for each in content],
    }
    return as_json(reply)


def test_a_server_of_the_older_kind_gives_the_same_answers() -> None:
    def respond(request: Request) -> Response:
        refused = picky("listed by number")(request)
        return refused if refused.status != 200 else older(refused)

    with serving(respond) as server, serving(honest) as plain:
        assert look(server).ask(QUESTIONS) == look(plain).ask(QUESTIONS)
        assert {request.body["logprobs"] for request in server.requests[1:]} == {20}


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_is_met_by_one_changed_request_and_remembered(name: str) -> None:
    limit, _ = LIMITS[name]
    with serving(picky(name)) as server:
        eye = backend(server)
        eye.check()
        bodies = [request.body for request in server.requests]
        assert [limit(body) for body in bodies] == [True, False]
        answers = eye.look([IMAGE], SYSTEM).ask(QUESTIONS[:3])
        assert not [answer.error for answer in answers if answer.error]
        assert len(server.requests) == 5
        assert not any(limit(request.body) for request in server.requests[1:])


def test_a_server_may_name_one_limit_after_the_other() -> None:
    names = ("temperature", "another name for tokens", "fewest tokens", "listed, in vLLM's words", "template options")
    with serving(picky(*names, "system role", "no such effort")) as server:
        taken = look(server)
        (answer,) = taken.ask(QUESTIONS[:1])
        assert answer.error == ""
        assert len(server.requests) == 8
        taken.ask(QUESTIONS)
        assert len(server.requests) == 8 + len(QUESTIONS)
    assert len({frozenset(request.body) for request in server.requests[8:]}) == 1
    last = server.requests[-1]
    assert {name: value for name, value in last.body.items() if name != "messages"} == {
        "model": "tiny",
        "max_completion_tokens": 16,
        "logprobs": True,
        "top_logprobs": 5,
        "reasoning_effort": "minimal",
    }


def test_without_a_system_role_its_text_goes_before_the_question() -> None:
    with serving(picky("system role")) as server:
        look(server).ask(QUESTIONS[:1])
        writer(server).write("Word it.", ["on(a,b)"], 0)
    seen, worded = (server.requests[index] for index in (1, 3))
    assert roles(seen.body) == roles(worded.body) == ["user"]
    assert [part["type"] for part in seen.parts] == ["image_url", "text"]
    assert seen.question == f"{SYSTEM}\n\n{QUESTIONS[0]}"
    assert worded.question == "Word it.\n\non(a,b)"


@pytest.mark.parametrize(
    "words",
    ["", "the context is too long", "max_tokens must be at least 100000", "top_logprobs is at most 0", "system error"],
)
def test_what_cannot_be_met_changes_nothing(words: str) -> None:
    request = {"messages": [{"role": "system", "content": "?"}], "max_tokens": 1, "top_logprobs": 20}
    assert Dialect().after(words, 400, request, known=True) is None


def test_a_change_that_does_not_help_is_not_remembered() -> None:
    with serving(lambda request: refusal("the temperature of the machine is too high")) as server:
        eye = look(server)
        for _ in range(2):
            assert "too high" in eye.ask(QUESTIONS[:1])[0].error
    assert ["temperature" in request.body for request in server.requests] == [True, False] * 2


def test_what_was_taken_before_is_no_reason_to_write_otherwise() -> None:
    full = refusal("the context is too long")
    with serving(lambda request: honest(request) if request.number == 1 else full) as server:
        eye = look(server)
        assert eye.ask(QUESTIONS[:1])[0].error == ""
        assert "too long" in eye.ask(QUESTIONS[:1])[0].error
        assert len(server.requests) == 2
