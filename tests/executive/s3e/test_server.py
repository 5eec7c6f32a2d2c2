"""The server backend against a real HTTP server: one that is honest, and one that misbehaves in every way."""

from __future__ import annotations

import asyncio
import hashlib
import json
import math
import pickle
import socket
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.s3e.backend import TRUE_FALSE, YES_NO, Backend, Look
from executive.s3e.chat import KEY, OPENAI_KEY, ChatServer, Failure, Patience, ReplyError, ServerError, base_url
from executive.s3e.server import ServerBackend, ServerWriter, masses
from executive.s3e.translators import Reply, Writer
from executive.s3e.vlm import TransformersBackend
from executive.types import Image
from tests.executive.s3e.chat_model import served
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, as_json, completion, serving
from tests.executive.s3e.checkpoints import build

SYSTEM = "Answer with yes or no."
QUESTIONS = [f"Is the {item} on the {table}?" for item in ("lemon", "bread", "can") for table in ("table", "floor")]
QUICK = Patience(connect=2.0, reply=20.0, tries=3, pause=0.001)
IMAGE: Image = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)


def scores(request: Request) -> dict[str, float]:
    """A distribution that depends on all that a model sees, and on nothing else."""
    seen = hashlib.sha256(f"{request.system}|{request.question}".encode())
    for image in request.images:
        seen.update(image.tobytes())
    tokens = ("yes", " yes", "Yes", "YES", "no", " No", "NO", "maybe", "the")
    weights = {token: 1 + byte for token, byte in zip(tokens, seen.digest(), strict=False)}
    return {token: weight / sum(weights.values()) for token, weight in weights.items()}


def honest(request: Request) -> Response:
    return completion(scores(request))


def backend(server: ChatServerUnderTest, patience: Patience = QUICK) -> ServerBackend:
    return ServerBackend(ChatServer(server.url, patience=patience, environment={}))


def look(server: ChatServerUnderTest, patience: Patience = QUICK) -> Look:
    return backend(server, patience).look([IMAGE], SYSTEM)


@pytest.fixture(scope="module")
def good() -> Iterator[ChatServerUnderTest]:
    with serving(honest) as server:
        yield server


# An honest server


def test_it_is_a_backend_and_is_called_by_the_models_name(good: ChatServerUnderTest) -> None:
    assert isinstance(backend(good), Backend)
    assert isinstance(look(good), Look)
    assert backend(good).name == "tiny"


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Qwen/Qwen2.5-VL-7B-Instruct", "Qwen/Qwen2.5-VL-7B-Instruct"),
        ("gpt-4o", "gpt-4o"),
        ("/home/somebody/models/llava/", "llava"),
        ("C:\\models\\llava.gguf", "llava.gguf"),
        ("models/llava.gguf", "llava.gguf"),
        ("./llava", "llava"),
    ],
)
def test_a_name_tells_no_path_of_the_servers_machine(model: str, name: str) -> None:
    with serving(honest, [model]) as server:
        assert backend(server).name == name


def test_masses_are_the_sums_over_all_surface_forms(good: ChatServerUnderTest) -> None:
    for question, answer in zip(QUESTIONS, look(good).ask(QUESTIONS), strict=True):
        expected = scores(next(request for request in good.requests if request.question == question))
        yes = sum(p for token, p in expected.items() if token.strip().lower() == "yes")
        no = sum(p for token, p in expected.items() if token.strip().lower() == "no")
        assert (answer.yes_mass, answer.no_mass) == pytest.approx((yes, no))
        assert answer.error == ""
        assert answer.yes_mass + answer.no_mass < 1.0  # maybe, the


def test_neither_order_nor_company_changes_an_answer(good: ChatServerUnderTest) -> None:
    asked = look(good).ask(QUESTIONS)
    assert look(good).ask(QUESTIONS[::-1]) == asked[::-1]
    assert look(good).ask(QUESTIONS[2:4]) == asked[2:4]
    assert look(good).ask([]) == []


def test_the_request_is_appendix_e2_in_its_order() -> None:
    other = IMAGE[::-1].copy()
    with serving(honest) as server:
        (answer,) = backend(server).look([IMAGE, other], SYSTEM).ask(["Is it?"])
        (request,) = server.requests
    assert request.path == "/v1/chat/completions"
    wanted = {"model": "tiny", "temperature": 0, "max_tokens": 1, "logprobs": True, "top_logprobs": 20}
    assert {key: value for key, value in request.body.items() if key != "messages"} == wanted
    assert [message["role"] for message in request.body["messages"]] == ["system", "user"]
    assert request.system == SYSTEM
    assert [part["type"] for part in request.parts] == ["image_url", "image_url", "text"]
    assert np.array_equal(request.images[0], IMAGE)  # lossless
    assert np.array_equal(request.images[1], other)
    messages = json.loads(answer.prompt)
    assert messages[0] == {"role": "system", "content": SYSTEM}
    assert [part.get("text") or part["image_url"]["url"] for part in messages[1]["content"]] == [
        "<image 1>",
        "<image 2>",
        "Is it?",
    ]


def test_jpeg_on_request_is_close_and_smaller() -> None:
    smooth: Image = np.repeat(np.linspace(0, 255, 96, dtype=np.uint8)[:, None, None], 3, axis=2).repeat(96, axis=1)
    with serving(honest) as server:
        for encoding in ("png", "jpeg"):
            ServerBackend(ChatServer(server.url, environment={}), pictures=encoding).look([smooth], "").ask(["Is it?"])
        lossless, lossy = (request.images[0].astype(int) for request in server.requests)
    assert np.array_equal(lossless, smooth)
    assert 0 < np.abs(lossy - lossless).max() < 16


def test_questions_are_asked_together_but_never_more_than_allowed() -> None:
    arrived = threading.Barrier(3)

    def wait_for_company(request: Request) -> Response:
        if request.number > 1:  # the first goes alone, so that the server has the pictures when the others come
            arrived.wait(timeout=10)
        return honest(request)

    with serving(wait_for_company) as server:
        patience = Patience(concurrent=3, tries=1)
        answers = look(server, patience).ask([*QUESTIONS, "And the last?"])
        assert server.most_at_once == 3
        assert server.requests[0].question == QUESTIONS[0]
    assert not [answer.error for answer in answers if answer.error]


def test_it_works_inside_a_running_event_loop(good: ChatServerUnderTest) -> None:
    async def notebook() -> float | None:
        return look(good).ask(QUESTIONS[:1])[0].probability()

    assert asyncio.run(notebook()) == look(good).ask(QUESTIONS[:1])[0].probability()


def writer(server: ChatServerUnderTest) -> ServerWriter:
    return ServerWriter(ChatServer(server.url, patience=QUICK, environment={}))


def test_a_writer_gives_the_models_own_words() -> None:
    with serving(lambda request: completion({"Is": 1.0}, f"{request.system}|{request.question}")) as server:
        writes = writer(server)
        assert isinstance(writes, Writer)
        assert writes.name == "tiny"
        assert writes.write("Word it.", ["on(a,b)", "on(b,a)"], 0) == [
            Reply("Word it.|on(a,b)"),
            Reply("Word it.|on(b,a)"),
        ]
        assert writes.write("Word it.", [], 1) == []
        likeliest = server.requests[0].body
        assert "logprobs" not in likeliest
        assert likeliest["max_tokens"] > 20
        assert likeliest["temperature"] == 0
        for attempt in (1, 2):
            writes.write("Word it.", ["on(a,b)"], attempt)
            assert server.requests[-1].body["temperature"] > 0
            assert server.requests[-1].body["seed"] == attempt


# What is counted


@given(st.dictionaries(st.sampled_from([*(f for g in YES_NO.forms() for f in g), "maybe", "y"]), st.floats(1e-6, 1.0)))
def test_masses_are_masses(weights: dict[str, float]) -> None:
    total = max(1.0, sum(weights.values()))
    top = {token: weight / total for token, weight in weights.items()}
    if not top:
        return
    yes, no = masses(json.loads(completion(top).body), YES_NO)
    assert yes == pytest.approx(sum(p for token, p in top.items() if token in YES_NO.forms()[0]))
    assert no == pytest.approx(sum(p for token, p in top.items() if token in YES_NO.forms()[1]))


def test_what_is_not_among_the_listed_has_no_mass() -> None:
    reply = json.loads(completion({"Yes": 0.4, "perhaps": 0.3}).body)
    assert masses(reply, YES_NO) == pytest.approx((0.4, 0.0))
    assert masses(reply, TRUE_FALSE) == (0.0, 0.0)


def test_different_tokens_with_the_same_text_all_count() -> None:
    reply = json.loads(completion([("yes", 0.3), ("yes", 0.2), ("no", 0.1)]).body)
    assert masses(reply, YES_NO) == pytest.approx((0.5, 0.1))


def test_the_generated_token_counts_once_even_where_it_is_not_listed() -> None:
    reply = json.loads(completion({"no": 0.3}).body)
    entry = reply["choices"][0]["logprobs"]["content"][0]
    assert masses(reply, YES_NO) == pytest.approx((0.0, 0.3))
    entry.update(token=" Yes", logprob=math.log(0.2))
    assert masses(reply, YES_NO) == pytest.approx((0.2, 0.3))
    entry["top_logprobs"] = []
    assert masses(reply, YES_NO) == pytest.approx((0.2, 0.0))


@pytest.mark.parametrize("token", ["\u2581Yes", "\u0120Yes"])
def test_leading_spaces_are_known_as_vocabularies_spell_them(token: str) -> None:
    assert masses(json.loads(completion({token: 0.5}).body), YES_NO) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize("logprob", [None, -9999.0, -math.inf])
def test_minus_infinity_has_many_spellings(logprob: float | None) -> None:
    reply = json.loads(completion({"yes": 0.5, "no": 0.2}).body)
    reply["choices"][0]["logprobs"]["content"][0]["top_logprobs"][1]["logprob"] = logprob
    assert masses(reply, YES_NO) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize("logprob", [math.nan, math.inf, 0.7, "-0.1", True, [], {}])
def test_what_is_no_logarithm_of_a_probability_is_no_answer(logprob: object) -> None:
    reply = json.loads(completion({"yes": 0.5, "no": 0.2}).body)
    reply["choices"][0]["logprobs"]["content"][0]["top_logprobs"][0]["logprob"] = logprob
    with pytest.raises(ReplyError):
        masses(reply, YES_NO)


def test_more_than_everything_is_no_answer() -> None:
    with pytest.raises(ReplyError, match=r"add up to 1\.2"):
        masses(json.loads(completion({"yes": 0.7, "no": 0.5}).body), YES_NO)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["choices", "logprobs", "content", "top_logprobs", "token", "logprob", "error"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@given(json_values)
def test_no_reply_whatever_is_more_than_an_error(reply: object) -> None:
    try:
        yes, no = masses(reply, YES_NO)
    except ReplyError:
        return
    assert min(yes, no) >= 0
    assert yes + no <= 1 + 1e-9


# A server that misbehaves: an answer with an error, and what was asked


GOOD_REPLY = completion({"yes": 0.9}).body
WRONG: dict[str, tuple[Response, str]] = {
    "status 500": (as_json({"error": {"message": "CUDA out of memory"}}, 500), "status 500: CUDA out of memory"),
    "status 500 without words": (Response(b"<html>oops</html>", 500), "status 500"),
    "busy": (as_json({"error": "slow down"}, 429), "status 429: slow down"),
    "bad request": (as_json({"message": "top_logprobs must be at most 5"}, 400), "top_logprobs must be at most 5"),
    "key refused": (as_json({"error": {"message": "Invalid key"}}, 401), f"give its API key as {KEY}"),
    "sent elsewhere": (Response(b"", 302, {"Location": "http://127.0.0.1:9/"}), "status 302"),
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
NEVER = ["bad request", "key refused", "no logprobs", "sent elsewhere", "endless"]


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
            assert len(server.requests) == 1
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
        (answer,) = look(server, Patience(reply=0.3)).ask(QUESTIONS[:1])
        assert len(server.requests) == 1
    assert answer.error == "no reply within 0.3 s; the last try: the server answers with status 429"


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


@pytest.mark.parametrize("models", [[], ["llava", "qwen"]])
def test_which_model_is_meant_has_to_be_clear(models: list[str]) -> None:
    with serving(honest, models) as server:
        with pytest.raises(ServerError, match="name the model"):
            ChatServer(server.url, environment={})
        assert ChatServer(server.url, "qwen", environment={}).model == "qwen"


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
    with pytest.raises(InputError, match="--server: is not a server's address"):
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


# Pictures


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((0, 4, 3), np.uint8),
        np.zeros((4, 4, 3), np.float64),
    ],
)
def test_what_is_no_picture_is_refused_before_anything_is_sent(image: Image, good: ChatServerUnderTest) -> None:
    with pytest.raises(InputError, match="uint8"):
        backend(good).look([image], SYSTEM)


def test_no_picture_is_refused(good: ChatServerUnderTest) -> None:
    with pytest.raises(InputError, match="no picture"):
        backend(good).look([], SYSTEM)


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


# The same checkpoint, here and behind a server


@pytest.fixture(scope="module", params=["fastvlm", "llava-onevision"])
def checkpoint(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(request.param, tmp_path_factory.mktemp("checkpoint") / request.param)


@pytest.mark.parametrize("count", [1, 2])
def test_a_checkpoint_gives_the_same_answers_here_and_behind_a_server(checkpoint: Path, count: int) -> None:
    rng = np.random.default_rng(count)
    images = [rng.integers(0, 256, (60, 80, 3), dtype=np.uint8) for _ in range(count)]
    here = TransformersBackend(checkpoint, device="cpu")
    with serving(served(checkpoint)) as server:
        chat_server = ChatServer(server.url, environment={})
        there = ServerBackend(chat_server, top_logprobs=10_000)
        for words in (YES_NO, TRUE_FALSE):
            expected = here.look(images, SYSTEM, words).ask(QUESTIONS)
            answers = there.look(images, SYSTEM, words).ask(QUESTIONS)
            for one, other in zip(expected, answers, strict=True):
                assert (other.yes_mass, other.no_mass) == pytest.approx((one.yes_mass, one.no_mass), abs=1e-5)
                assert other.error == ""
        # The likeliest 20 tokens are all that a real server lists: no mass is counted that is not there.
        few = ServerBackend(chat_server, top_logprobs=20).look(images, SYSTEM).ask(QUESTIONS)
        for one, other in zip(here.look(images, SYSTEM).ask(QUESTIONS), few, strict=True):
            assert other.yes_mass <= one.yes_mass + 1e-5
            assert other.no_mass <= one.no_mass + 1e-5
        assert any(answer.yes_mass + answer.no_mass > 0 for answer in few)
