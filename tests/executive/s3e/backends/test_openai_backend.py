"""The server backend against a real HTTP server that is honest: what is sent, what is counted, whose answers."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.s3e.backends.interface import TRUE_FALSE, YES_NO, AnswerWords, Backend, Look
from executive.s3e.backends.openai_backend import CHECK, REACH, ServerBackend, hear
from executive.s3e.backends.openai_client import ChatServer, Patience
from executive.s3e.backends.openai_replies import ReplyError
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.s3e.questions.language_model import Reply, Writer
from executive.types import Image
from tests.executive.s3e.chat_model import served
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, completion, serving, spoken
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.on_server import IMAGE, QUESTIONS, SYSTEM, backend, honest, look, scores, writer


def masses(reply: object, words: AnswerWords) -> tuple[float, float]:
    heard = hear(reply, words)
    return heard.yes, heard.no


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
    wanted |= {"chat_template_kwargs": {"enable_thinking": False}, "reasoning_effort": "none"}
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
    if len(top) < 2:
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
    reply = json.loads(completion({"no": 0.3, "well": 0.1}).body)
    entry = reply["choices"][0]["logprobs"]["content"][0]
    assert masses(reply, YES_NO) == pytest.approx((0.0, 0.3))
    entry.update(token=" Yes", logprob=math.log(0.2))
    assert masses(reply, YES_NO) == pytest.approx((0.2, 0.3))


@pytest.mark.parametrize("listed", [[], None, "itself"])
def test_with_nothing_listed_beside_it_there_is_no_probability(listed: object) -> None:
    reply = json.loads(completion({"Yes": 0.6}).body)
    entry = reply["choices"][0]["logprobs"]["content"][0]
    if listed != "itself":
        entry["top_logprobs"] = listed
    with pytest.raises(ReplyError, match=r"no probability; the server has to list .* --max-logprobs"):
        masses(reply, YES_NO)
    entry.update(logprob=0.0)  # all there is
    entry["top_logprobs"] = []
    assert masses(reply, YES_NO) == (1.0, 0.0)


# What comes before an answer and says nothing


def test_an_answer_behind_what_says_nothing_counts_with_the_way_there() -> None:
    reply = json.loads(spoken({"**": 0.9, "Yes": 0.05, "No": 0.01}, {"Yes": 0.7, "No": 0.2}).body)
    assert masses(reply, YES_NO) == pytest.approx((0.05 + 0.9 * 0.7, 0.01 + 0.9 * 0.2))
    assert hear(reply, YES_NO).said == "'**Yes' (90%)"


places = st.lists(
    st.dictionaries(
        st.sampled_from(["Yes", " no", "**", "\n", '"', "<think>", "</think>", "Answer", ":", "well"]),
        st.floats(0.01, 1.0),
        min_size=2,
        max_size=5,
    ),
    min_size=1,
    max_size=6,
)


@given(places)
def test_masses_behind_what_says_nothing_are_masses(weights: list[dict[str, float]]) -> None:
    tops = [{token: weight / sum(each.values()) for token, weight in each.items()} for each in weights]
    heard = hear(json.loads(spoken(*tops).body), YES_NO)
    assert min(heard.yes, heard.no) >= 0.0
    assert heard.yes + heard.no <= 1.0 + 1e-9
    chosen = [max(top, key=lambda token: top[token]) for top in tops]
    saying = next((number for number, token in enumerate(chosen) if token in ("Yes", " no", "well")), None)
    assert heard.begun == (saying is None)
    # Nothing after the first token that says anything counts.
    if saying is not None:
        assert masses(json.loads(spoken(*tops[: saying + 1]).body), YES_NO) == (heard.yes, heard.no)


@pytest.mark.parametrize("beginning", [["**"], ["\n"], ['"'], ["<think>", "\n\n", "</think>", "\n\n"], ["Answer", ":"]])
def test_a_model_that_begins_with_what_says_nothing_is_asked_for_more_once(beginning: list[str]) -> None:
    def begins(request: Request) -> Response:
        answer = {"Yes": 0.8, "No": 0.15} if "lemon" in request.question else {"No": 0.9, "Yes": 0.05}
        tokens = [*({each: 0.97, "Hm": 0.01} for each in beginning), answer, {"</s>": 0.9, ".": 0.1}]
        return spoken(*tokens[: request.body["max_tokens"]])

    with serving(begins) as server:
        taken = look(server)
        answers = taken.ask(QUESTIONS[:4])
        again = taken.ask(QUESTIONS[:4])
        asked = [request.body["max_tokens"] for request in server.requests]
    assert asked == [1] * 4 + [REACH] * 8
    way = 0.97 ** len(beginning)
    for question, answer, later in zip(QUESTIONS, answers, again, strict=False):
        yes, no = (0.8, 0.15) if "lemon" in question else (0.05, 0.9)
        assert (answer.yes_mass, answer.no_mass) == pytest.approx((way * yes, way * no))
        assert later == answer


def test_a_model_that_thinks_is_heard_out() -> None:
    """What it thinks is no answer, and is shown."""
    words = ["<think>", "\n", "Okay", ",", " the", " user", " asks"]
    with serving(lambda request: spoken(*({word: 0.98, "x": 0.01} for word in words))) as server:
        (answer,) = look(server).ask(QUESTIONS[:1])
        odd = backend(server).check()
    assert (answer.yes_mass, answer.no_mass, answer.probability(0.5)) == (0.0, 0.0, None)
    assert answer.said == r"'<think>\nOkay, the user asks' (98%)"
    assert answer.said in odd
    assert "It thinks first" in odd


# What a server is asked first


@pytest.mark.parametrize(
    ("top", "said"),
    [
        ({"Yes": 0.7, "No": 0.2}, ""),
        ({"No": 0.6, "Yes": 0.2}, "says no (75%)"),
        ({"The": 0.6, "Yes": 0.2}, "would rather say 'The' (60%)"),
    ],
)
def test_the_first_question_is_one_whose_answer_is_known(top: dict[str, float], said: str) -> None:
    with serving(lambda request: completion(top)) as server:
        odd = backend(server).check()
        (request,) = server.requests
    assert request.question == CHECK
    assert request.system
    assert said in odd
    assert bool(odd) == bool(said)


def test_a_token_is_the_same_by_its_number_whatever_it_is_written_as() -> None:
    reply = json.loads(completion({" yes": 0.6, "no": 0.3}).body)
    entry = reply["choices"][0]["logprobs"]["content"][0]
    for number, top in enumerate(entry["top_logprobs"]):
        top["id"] = number
    entry.update(token="yes", id=0)
    assert masses(reply, YES_NO) == pytest.approx((0.6, 0.3))
    entry["id"] = 7
    entry["logprob"] = math.log(0.1)
    assert masses(reply, YES_NO) == pytest.approx((0.7, 0.3))


@pytest.mark.parametrize("token", ["\u2581Yes", "\u0120Yes"])
def test_leading_spaces_are_known_as_vocabularies_spell_them(token: str) -> None:
    assert masses(json.loads(completion({token: 0.5, "well": 0.1}).body), YES_NO) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize("logprob", [None, -9999.0, -9999, -(10**400), -math.inf])
def test_minus_infinity_has_many_spellings(logprob: float | None) -> None:
    reply = json.loads(completion({"yes": 0.5, "no": 0.2}).body)
    reply["choices"][0]["logprobs"]["content"][0]["top_logprobs"][1]["logprob"] = logprob
    assert masses(reply, YES_NO) == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize("logprob", [math.nan, math.inf, 0.7, 10**400, "-0.1", True, [], {}])
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
            st.sampled_from(["choices", "logprobs", "content", "top_logprobs", "tokens", "token", "logprob", "error"]),
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
