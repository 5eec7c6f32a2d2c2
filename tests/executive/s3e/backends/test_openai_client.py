"""A real HTTP server that misbehaves in every way, is not there, or is not to be trusted with the key."""

from __future__ import annotations

import asyncio
import json
import math
import pickle
import socket
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest

from executive.errors import InputError
from executive.s3e.backends.openai_backend import ServerBackend, ServerWriter
from executive.s3e.backends.openai_client import (
    ChatServer,
    Failure,
    Patience,
    ServerError,
    base_url,
)
from executive.s3e.backends.openai_replies import KEY, OPENAI_KEY, ReplyError
from executive.s3e.questions.language_model import Reply
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, as_json, completion, serving
from tests.executive.s3e.on_server import IMAGE, QUESTIONS, QUICK, SYSTEM, backend, honest, look, writer


@pytest.fixture(scope="module")
def good() -> Iterator[ChatServerUnderTest]:
    with serving(honest) as server:
        yield server


# A server that misbehaves: an answer with an error, and what was asked


GOOD_REPLY = completion({"yes": 0.9, "no": 0.05}).body
WRONG: dict[str, tuple[Response, str]] = {
    "status 500": (as_json({"error": {"message": "CUDA out of memory"}}, 500), "status 500: CUDA out of memory"),
    "status 500 without words": (Response(b"<html>oops</html>", 500), "status 500"),
    "busy": (as_json({"error": "slow down"}, 429), "status 429: slow down"),
    "bad request": (as_json({"message": "the context is too long"}, 400), "the context is too long"),
    "key refused": (as_json({"error": {"message": "Invalid key"}}, 401), f"give its API key as {KEY}"),
    "no probabilities for this key": (
        as_json({"error": {"message": "You are not allowed to request logprobs from this model."}}, 403),
        "refuses access (403: You are not allowed to request logprobs from this model.)",
    ),
    "sent elsewhere": (
        Response(b"", 307, {"Location": "https://127.0.0.1:9/api/chat/completions?x=1"}),
        "(status 307); pass that address with --server: https://127.0.0.1:9/api",
    ),
    "sent nowhere": (Response(b"", 308), "sends requests elsewhere (status 308)"),
    "truncated JSON": (Response(GOOD_REPLY[: len(GOOD_REPLY) // 2]), "not complete JSON"),
    "closed mid-reply": (Response(GOOD_REPLY, cut=40), "no whole HTTP reply"),
    "empty": (Response(b""), "not complete JSON"),
    "not text": (Response(b"\xff\xfe\x00"), "not complete JSON"),
    "bad compression": (Response(b"nonsense", headers={"Content-Encoding": "gzip"}), "no whole HTTP reply"),
    "nested deep": (Response(b"[" * 100_000), "not complete JSON"),
    "a list": (as_json([1, 2]), "no chat completion"),
    "null": (as_json(None), "no chat completion"),
    "no choices": (as_json({"choices": []}), "no chat completion"),
    "an error that is called fine": (as_json({"error": {"message": "queue is full"}}), "queue is full"),
    "no logprobs": (completion({}, text="yes"), "no logprobs"),
    "endless": (Response(b" " * 5_000_000), "more than 4,000,000 bytes"),
}
nan = json.loads(GOOD_REPLY)
nan["choices"][0]["logprobs"]["content"][0]["top_logprobs"][0]["logprob"] = math.nan
WRONG["NaN logprobs"] = (as_json(nan), "a log-probability in the reply is nan")
AGAIN = ["status 500", "busy", "truncated JSON", "closed mid-reply", "empty", "a list", "NaN logprobs"]
NEVER = ["key refused", "no probabilities for this key", "no logprobs", "sent elsewhere", "endless"]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_goes_wrong_is_an_answers_error(wrong: str) -> None:
    response, said = WRONG[wrong]
    with serving(lambda request: response) as server:
        answers = look(server).ask(QUESTIONS[:3])
    for answer, question in zip(answers, QUESTIONS[:3], strict=True):
        assert said in answer.error
        assert "\n" not in answer.error
        assert len(answer.error) < 400
        assert (answer.yes_mass, answer.no_mass, answer.probability()) == (0.0, 0.0, None)
        assert question in answer.prompt


@pytest.mark.parametrize("wrong", AGAIN)
def test_what_may_pass_is_tried_again(wrong: str) -> None:
    with serving(lambda request: WRONG[wrong][0] if request.number < 3 else honest(request)) as server:
        (answer,) = look(server).ask(QUESTIONS[:1])
        assert len(server.requests) == 3
    assert answer.error == ""
    assert answer.probability() is not None


@pytest.mark.parametrize("wrong", AGAIN)
def test_it_is_tried_only_so_often(wrong: str) -> None:
    with serving(lambda request: WRONG[wrong][0]) as server:
        look(server).ask(QUESTIONS[:2])
        assert len(server.requests) == 2 * QUICK.tries


@pytest.mark.parametrize("wrong", NEVER)
def test_what_stays_wrong_is_not_tried_again(wrong: str) -> None:
    with serving(lambda request: WRONG[wrong][0]) as server:
        look(server).ask(QUESTIONS[:1])
        assert len(server.requests) == 1


def test_one_bad_answer_spoils_no_other() -> None:
    bad = QUESTIONS[2]
    with serving(lambda request: WRONG["no logprobs"][0] if request.question == bad else honest(request)) as server:
        answers = look(server).ask(QUESTIONS)
    assert [bool(answer.error) for answer in answers] == [question == bad for question in QUESTIONS]


def test_a_silent_server_is_given_up_in_time_for_all_questions_at_once() -> None:
    release = threading.Event()

    def silent(request: Request) -> Response:
        release.wait(timeout=60)
        return honest(request)

    with serving(silent) as server:
        try:
            answers = look(server, Patience(reply=0.3)).ask(QUESTIONS)
            assert len(server.requests) <= 1
        finally:
            release.set()
    assert {answer.error for answer in answers} == {"no reply within 0.3 s"}


def test_a_server_that_trickles_is_given_up_in_time_too() -> None:
    with serving(lambda request: Response(GOOD_REPLY, drip=0.05)) as server:  # each byte within any usual timeout
        (answer,) = look(server, Patience(reply=0.5)).ask(QUESTIONS[:1])
    assert answer.error == "no reply within 0.5 s"


def test_a_slow_server_that_is_in_time_is_heard() -> None:
    with serving(lambda request: Response(honest(request).body, seconds=0.2)) as server:
        (answer,) = look(server, Patience(reply=30.0)).ask(QUESTIONS[:1])
    assert answer.error == ""


def test_a_pause_that_the_server_asks_for_is_kept_within_the_time_there_is() -> None:
    with serving(lambda request: as_json({}, 429, {"Retry-After": "30"})) as server:
        (answer,) = look(server, Patience(reply=2.0)).ask(QUESTIONS[:1])
        assert len(server.requests) == 1
    assert answer.error == "no reply within 2 s; the last try: the server answers with status 429"


def test_a_server_that_goes_is_an_error_of_every_answer() -> None:
    with serving(honest) as server:
        taken = look(server)
        assert taken.ask(QUESTIONS[:1])[0].error == ""
    answers = taken.ask(QUESTIONS)
    assert len(answers) == len(QUESTIONS)
    assert all(answer.error and answer.probability() is None for answer in answers)


@pytest.mark.parametrize("wrong", ["bad request", "truncated JSON", "null"])
def test_what_goes_wrong_is_a_replys_error(wrong: str) -> None:
    with serving(lambda request: WRONG[wrong][0] if request.question == "on(a,b)" else completion({"Is": 1})) as server:
        bad, good = writer(server).write("Word it.", ["on(a,b)", "on(b,a)"], 0)
    assert bad.text == ""
    assert bad.error
    assert good == Reply("Is")


def test_pauses_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    real: Callable[[float], object] = asyncio.sleep

    async def noted(seconds: float) -> None:
        pauses.append(seconds)
        await real(0)  # type: ignore[misc]

    monkeypatch.setattr(asyncio, "sleep", noted)
    with serving(lambda request: WRONG["status 500"][0]) as server:
        look(server, Patience(tries=4, pause=0.01)).ask(["Is it?"])
    waited = [pause for pause in pauses if pause > 0]
    assert waited == [0.01, 0.02, 0.04]
    assert all(later == 2 * earlier for earlier, later in pairwise(waited))


def test_failures_are_values(good: ChatServerUnderTest) -> None:
    def refuse(reply: object) -> str:
        raise ReplyError("not this one", again=False)

    server = ChatServer(good.url, environment={})
    assert server.complete([{"messages": [{"role": "user", "content": "?"}]}], refuse) == [Failure("not this one")]


# A server that is not there, or not meant


def test_nobody_there_is_one_line_with_what_to_start() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/v1"
    with pytest.raises(ServerError) as caught:
        ChatServer(url, "tiny", environment={})
    assert str(caught.value).startswith(f"{url}: no server answers there")
    assert "vllm serve" in str(caught.value)
    assert "llama-server" in str(caught.value)


def test_somebody_else_there_is_one_line() -> None:
    for other in (Response(b"<html>Welcome</html>"), as_json({"hello": "world"}), Response(b"SSH-2.0", cut=0)):
        with serving(honest, other) as server, pytest.raises(ServerError) as caught:
            ChatServer(server.url, "tiny", patience=QUICK, environment={})
        assert str(caught.value).startswith(f"{server.url}: ")


@pytest.mark.parametrize("name", [3, None, ["a"], "a\x1b[2Jb", "two\nlines", "\ud800"])
def test_a_name_that_is_no_line_of_text_is_no_models(name: object) -> None:
    listed = as_json({"data": [{"id": "tiny"}, {"id": name}]})
    with serving(honest, listed) as server, pytest.raises(ServerError, match="it lists no models"):
        ChatServer(server.url, "tiny", environment={})


@pytest.mark.parametrize(
    ("models", "said"),
    [
        ([], "has no model yet: load one there"),
        (as_json({"object": "list", "data": None}), "has no model yet: load one there"),
        (["llava", "qwen"], "name the model that is to be asked with --vlm NAME; it has: llava, qwen"),
        (as_json({"detail": "Not Found"}, 404), "lists no models (status 404); name one with --vlm NAME"),
        (
            Response(b"", 307, {"Location": "https://h/v2/models"}),
            "(status 307); pass that address with --server: https://h/v2",
        ),
    ],
)
def test_which_model_is_meant_has_to_be_clear(models: list[str] | Response, said: str) -> None:
    with serving(honest, models) as server:
        with pytest.raises(ServerError) as caught:
            ChatServer(server.url, environment={})
        assert str(caught.value).startswith(f"{server.url}: ")
        assert said in str(caught.value)
        if "307" not in said:
            assert ChatServer(server.url, "qwen", environment={}).model == "qwen"


def test_of_very_many_models_the_nearest_are_named() -> None:
    missing = as_json({"error": {"message": "The model does not exist."}}, 404)
    with serving(lambda request: missing, [f"model-{number}" for number in range(500)]) as server:
        with pytest.raises(ServerError) as none:
            ChatServer(server.url, environment={})
        with pytest.raises(ServerError) as wrong:
            ServerBackend(ChatServer(server.url, "modle-77", environment={})).check()
    assert str(none.value).endswith("and 492 more")
    assert "status 404: The model does not exist.; no model 'modle-77' there? it has: " in str(wrong.value)
    assert "model-77," in str(wrong.value)
    assert len(str(wrong.value)) < 300


def test_a_server_without_a_list_of_models_will_do_where_the_model_is_named() -> None:
    with serving(honest, as_json({"detail": "Not Found"}, 404)) as server:
        assert not look_error(ChatServer(server.url, "tiny", environment={}))
        with pytest.raises(ServerError, match="404"):
            ChatServer(server.url, environment={})


def look_error(server: ChatServer) -> str:
    return ServerBackend(server).look([IMAGE], SYSTEM).ask(["Is it?"])[0].error


def test_a_check_finds_out_what_can_give_no_answers(good: ChatServerUnderTest) -> None:
    backend(good).check()
    with serving(lambda request: WRONG["no logprobs"][0]) as server, pytest.raises(ServerError, match="no logprobs"):
        backend(server).check()


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("http://127.0.0.1:8000/v1", "http://127.0.0.1:8000/v1"),
        ("http://127.0.0.1:8000/v1/", "http://127.0.0.1:8000/v1"),
        ("http://127.0.0.1:8000", "http://127.0.0.1:8000/v1"),
        ("http://127.0.0.1:8000/v1/chat/completions", "http://127.0.0.1:8000/v1"),
        ("https://models.example/api/v3", "https://models.example/api/v3"),
        ("http://[::1]:8000", "http://[::1]:8000/v1"),
    ],
)
def test_a_servers_address(url: str, meant: str) -> None:
    assert base_url(url)[0] == meant


@pytest.mark.parametrize("url", ["", "8000", "localhost:8000", "ftp://host/v1", "http://", "http://a b/", "http://h:x"])
def test_what_is_no_address(url: str) -> None:
    with pytest.raises(InputError, match="server: is not a server's address"):
        base_url(url)


@pytest.mark.parametrize(
    ("url", "local"),
    [
        ("http://localhost", True),
        ("http://127.1.2.3:80", True),
        ("http://[::1]", True),
        ("http://10.0.0.1", False),
        ("http://localhost.example", False),
        ("http://127.0.0.1.example", False),
    ],
)
def test_what_this_machine_says_to_itself(url: str, local: bool) -> None:
    assert base_url(url)[1] is local


# The key


SECRET = "sk-THE-KEY-1234567890"


def test_the_key_is_sent_and_shown_nowhere(capfd: pytest.CaptureFixture[str]) -> None:
    def tell(request: Request) -> Response:
        key = request.headers.get("Authorization", "")
        return as_json({"error": {"message": f"I got {key}, {SECRET}!"}}, 400)

    environment = {KEY: SECRET}
    with serving(tell) as server:
        chat_server = ChatServer(server.url, environment=environment, patience=QUICK)
        eye = ServerBackend(chat_server)
        taken = eye.look([IMAGE], SYSTEM)
        (answer,) = taken.ask(["Is it?"])
        assert server.requests[0].headers["Authorization"] == f"Bearer {SECRET}"
        (reply,) = ServerWriter(chat_server).write("Word it.", ["on(a,b)"], 0)
        with pytest.raises(ServerError) as caught:
            eye.check()
    assert "I got Bearer ***, ***!" in answer.error
    for shown in (answer, reply, eye, taken, chat_server, eye.name, caught.value):
        assert SECRET not in repr(shown)
        assert SECRET not in str(shown)
    assert SECRET not in "".join(capfd.readouterr())


def test_the_key_is_not_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY, SECRET)
    with serving(honest) as server:
        eye = ServerBackend(ChatServer(server.url))
        assert SECRET.encode() not in pickle.dumps(eye)
        assert eye.look([IMAGE], SYSTEM).ask(["Is it?"])[0].error == ""
        assert server.requests[0].headers["Authorization"] == f"Bearer {SECRET}"


@pytest.mark.parametrize("url", ["http://user:{}@127.0.0.1/v1", "http://127.0.0.1/v1?key={}", "http://h/v1#{}"])
def test_a_key_in_the_address_is_refused_and_not_repeated(url: str) -> None:
    with pytest.raises(InputError) as caught:
        ChatServer(url.format(SECRET), "tiny", environment={})
    assert KEY in str(caught.value)
    assert SECRET not in str(caught.value)


def test_a_key_that_is_none_is_refused_and_not_repeated(good: ChatServerUnderTest) -> None:
    with pytest.raises(InputError) as caught:
        ChatServer(good.url, environment={KEY: f"{SECRET}\r\nX: y"})
    assert SECRET not in str(caught.value)


def test_openais_key_goes_where_nobody_can_read_it_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = {OPENAI_KEY: SECRET}
    with serving(honest) as server:
        local = ChatServer(server.url, environment=environment)
        assert local._key() == SECRET
        for url, sent in (("http://models.example/v1", ""), ("https://models.example/v1", SECRET)):
            local.url, local._local = base_url(url)
            local._encrypted = local.url.startswith("https:")
            assert local._key() == sent
        environment[KEY] = "mine"
        assert local._key() == "mine"


def test_a_proxy_has_no_part_in_what_stays_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    for name in ("NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    with serving(honest) as server:
        assert not look_error(ChatServer(server.url, environment={}))
