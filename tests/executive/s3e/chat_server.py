"""A real HTTP server on this machine that speaks the OpenAI chat API, as well or as badly as a test wants.

What it answers is up to a function from request to response; `completion` makes the response of an honest server from
probabilities, and a `Response` can be slow, cut short, or no JSON at all.
"""

from __future__ import annotations

import base64
import io
import json
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, TypeAlias

import numpy as np
from PIL import Image as Picture

from executive.types import Image


@dataclass(frozen=True)
class Request:
    """What came in. `number` counts chat requests from 1."""

    path: str
    headers: Mapping[str, str]
    body: Any
    number: int

    @property
    def system(self) -> str:
        return next((str(m["content"]) for m in self.body["messages"] if m["role"] == "system"), "")

    @property
    def parts(self) -> list[dict[str, Any]]:
        content = self.body["messages"][-1]["content"]
        return [{"type": "text", "text": content}] if isinstance(content, str) else content

    @property
    def question(self) -> str:
        return str(self.parts[-1]["text"])

    @property
    def images(self) -> list[Image]:
        return [decoded(part["image_url"]["url"]) for part in self.parts if part["type"] == "image_url"]


@dataclass(frozen=True)
class Response:
    """What goes out. With `cut`, the connection closes after so many bytes of the body; `seconds` pass before the first
    byte, and `drip` seconds before each byte of the body."""

    body: bytes
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)
    cut: int | None = None
    seconds: float = 0.0
    drip: float = 0.0


def as_json(value: object, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    return Response(json.dumps(value).encode(), status, headers or {})


Top: TypeAlias = Mapping[str, float] | Sequence[tuple[str, float]]
"""The most likely tokens at a place, and their probabilities."""


def completion(top: Top, text: str | None = None) -> Response:
    """The response of an honest server: the next token's `top` probabilities, most likely first, and what it says."""
    return spoken(*([top] if top else []), text=text)


def spoken(*tops: Top, text: str | None = None) -> Response:
    """The response of an honest server: at each place the `top` probabilities, of which the most likely is said."""
    content = []
    for top in tops:
        pairs = sorted(top.items() if isinstance(top, Mapping) else top, key=lambda pair: -pair[1])
        listed = [{"token": token, "logprob": math.log(p) if p > 0 else -9999.0, "bytes": None} for token, p in pairs]
        content.append({**listed[0], "top_logprobs": listed})
    said = "".join(str(each["token"]) for each in content) if content else None
    choice = {
        "index": 0,
        "message": {"role": "assistant", "content": said if text is None else text},
        "finish_reason": "length",
        "logprobs": {"content": content} if content else None,
    }
    return as_json({"id": "1", "object": "chat.completion", "model": "tiny", "choices": [choice]})


def decoded(url: str) -> Image:
    """The picture in a data URL."""
    header, data = url.split(",", 1)
    assert header in ("data:image/png;base64", "data:image/jpeg;base64")
    return np.asarray(Picture.open(io.BytesIO(base64.b64decode(data, validate=True))).convert("RGB"))


@dataclass
class ChatServerUnderTest:
    """Where the server is, what it was asked, and how many chat requests it ever had at once."""

    url: str
    requests: list[Request] = field(default_factory=list)
    most_at_once: int = 0


@contextmanager
def serving(
    respond: Callable[[Request], Response],
    models: Sequence[str] | Response = ("tiny",),
) -> Iterator[ChatServerUnderTest]:
    """Serve on a free port of 127.0.0.1 until the block ends. `models` is what `/v1/models` lists, or its response."""
    lock, busy = threading.Lock(), 0

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True  # else the body waits 40 ms until the headers are acknowledged

        def do_GET(self) -> None:
            if self.path != "/v1/models":
                self.send(as_json({"detail": "Not Found"}, 404))
            elif isinstance(models, Response):
                self.send(models)
            else:
                self.send(as_json({"object": "list", "data": [{"id": name, "object": "model"} for name in models]}))

        def do_POST(self) -> None:
            nonlocal busy
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            with lock:
                busy += 1
                server.most_at_once = max(server.most_at_once, busy)
                request = Request(self.path, dict(self.headers.items()), body, len(server.requests) + 1)
                server.requests.append(request)
            try:
                response = respond(request)
            finally:
                with lock:
                    busy -= 1
            self.send(response)

        def send(self, response: Response) -> None:
            time.sleep(response.seconds)
            try:
                self.send_response(response.status)
                self.send_header("Content-Type", "application/json")
                for name, value in {"Content-Length": str(len(response.body)), **response.headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                if response.drip:
                    for byte in response.body:
                        time.sleep(response.drip)
                        self.wfile.write(bytes([byte]))
                        self.wfile.flush()
                else:
                    self.wfile.write(response.body[: response.cut])
            except OSError:  # the client had enough
                self.close_connection = True
            if response.cut is not None:
                self.close_connection = True

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    http.daemon_threads = True
    http.block_on_close = False  # a slow response is not waited for
    server = ChatServerUnderTest(f"http://127.0.0.1:{http.server_address[1]}/v1")
    thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        http.shutdown()
        http.server_close()
        thread.join()
