"""A real server: llama.cpp's, with a real language model, small enough for a test.

llama-cpp-python is built from source, in an environment of its own (a quarter of an hour on two cores; without pictures
it is smaller), and named by LLAMA_CPP_PYTHON:

    python -m venv llama && CMAKE_ARGS=-DLLAVA_BUILD=OFF llama/bin/pip install 'llama-cpp-python[server]'
    LLAMA_CPP_PYTHON=llama/bin/python python -m pytest -m slow tests/executive/s3e/test_llama_cpp.py

The model is SmolLM2-135M-Instruct, from the package index, too (see `smollm2`).
"""

from __future__ import annotations

import os
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from executive.domain.loader import load_subject
from executive.s3e import LanguageModel, Templates
from executive.s3e.backends.interface import YES_NO
from executive.s3e.backends.openai_backend import CHECK, Heard, ServerBackend, ServerWriter
from executive.s3e.backends.openai_client import ChatServer
from executive.s3e.questions import prompts
from tests.executive.s3e import smollm2
from tests.executive.s3e.on_server import IMAGE
from tests.executive.s3e.questions.test_templates import TRAY

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif("LLAMA_CPP_PYTHON" not in os.environ, reason="LLAMA_CPP_PYTHON names no Python that has it"),
]

QUESTIONS = (
    CHECK,
    "Is snow white? Answer yes or no.",
    "Is the sun cold? Answer yes or no.",
    "Does a dog have four legs? Answer yes or no.",
)


@pytest.fixture(scope="module")
def folder(pytestconfig: pytest.Config) -> Path:
    return pytestconfig.cache.mkdir("smollm2")


@pytest.fixture(scope="module")
def url(folder: Path) -> Iterator[str]:
    """The address of a server with the model, for as long as tests need it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # It keeps the logits of all tokens, or else refuses logprobs.
    options = ["--model", str(smollm2.weights(folder)), "--n_ctx", "4096", "--logits_all", "true", "--n_threads", "1"]
    command = [os.environ["LLAMA_CPP_PYTHON"], "-m", "llama_cpp.server", *options, "--port", str(port)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    server = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(600):
            assert server.poll() is None
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/v1/models", timeout=10):
                    break
            except OSError:
                time.sleep(0.5)
        yield f"http://127.0.0.1:{port}/v1"
    finally:
        server.terminate()
        server.wait(30)


@pytest.fixture(scope="module")
def server(url: str) -> ChatServer:
    return ChatServer(url, environment={})


def conversation(question: str) -> list[dict[str, Any]]:
    system = {"role": "system", "content": prompts.QUESTION_ANSWERING}
    return [system, {"role": "user", "content": question}]


def test_its_log_probabilities_are_those_of_the_same_weights(server: ChatServer, folder: Path) -> None:
    """Computed once more by transformers from the GGUF's weights. llama.cpp rounds what it multiplies them with."""
    import torch
    from transformers import AutoModelForCausalLM, AutoTokenizer

    heard = ServerBackend(server).ask([conversation(each) for each in QUESTIONS], YES_NO)
    model = AutoModelForCausalLM.from_pretrained(smollm2.checkpoint(folder), dtype=torch.float32)
    tokenizer = AutoTokenizer.from_pretrained(smollm2.checkpoint(folder))
    words = [tokenizer.decode([token]) for token in range(len(tokenizer))]
    for question, each in zip(QUESTIONS, heard, strict=True):
        text = tokenizer.apply_chat_template(conversation(question), add_generation_prompt=True, tokenize=False)
        ids = tokenizer(text, return_tensors="pt", add_special_tokens=False)["input_ids"]
        with torch.inference_mode():
            likely, order = model(input_ids=ids).logits[0, -1].softmax(0).topk(20)
        mine = [
            sum(float(p) for p, token in zip(likely, order, strict=True) if words[int(token)] in forms)
            for forms in YES_NO.forms()
        ]
        assert isinstance(each, Heard)
        assert each.masses == pytest.approx(mine, abs=0.03)
        assert sum(mine) > 0.05  # else nothing is compared


def test_the_first_question_is_asked_and_its_answer_is_told(server: ChatServer) -> None:
    """So small a model is not sure whether two plus two is four, and a user is told so."""
    assert CHECK in ServerBackend(server).check()


def test_pictures_for_a_model_that_sees_none_are_no_answer_in_silence(server: ChatServer) -> None:
    (answer,) = ServerBackend(server).look([IMAGE], prompts.QUESTION_ANSWERING).ask(["Is the picture noisy?"])
    assert answer.error


def test_it_words_questions_and_their_nonsense_is_caught(server: ChatServer, tmp_path: Path) -> None:
    writer = ServerWriter(server, most=40)
    (capital,) = writer.write("You are a helpful assistant.", ["What is the capital of France?"], 0)
    assert "Paris" in capital.text
    subject, templates = load_subject(TRAY), Templates.read(TRAY / "questions.toml")
    questions = LanguageModel(writer, subject.pddl.read_text(), templates, tmp_path).translate(subject.task)
    asked = templates.translate(subject.task).text
    refused = [warning.partition(": ")[0] for warning in questions.warnings]
    assert len(refused) > len(asked) / 2
    for atom, text in questions.text.items():
        assert (text == asked[atom]) is (str(atom) in refused)
