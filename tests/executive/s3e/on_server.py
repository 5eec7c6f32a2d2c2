"""A backend on a server that answers by what it is shown, for the tests of both sides of the wire."""

from __future__ import annotations

import hashlib

import numpy as np

from executive.s3e.backends.interface import Look
from executive.s3e.backends.openai_backend import ServerBackend, ServerWriter
from executive.s3e.backends.openai_client import ChatServer, Patience
from executive.types import Image
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, completion

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


def writer(server: ChatServerUnderTest) -> ServerWriter:
    return ServerWriter(ChatServer(server.url, patience=QUICK, environment={}))
