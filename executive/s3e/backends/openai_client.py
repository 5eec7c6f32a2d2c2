"""A client of any OpenAI-compatible chat server (vLLM, llama.cpp's llama-server, commercial ones).

Whatever a server does, a request ends in time and ends as a value: the reply as read, or a `Failure` that says what
went wrong. The API key is looked up in the environment for each batch of requests and kept nowhere, so that nothing
that is printed, recorded or raised can tell it.
"""

from __future__ import annotations

import asyncio
import difflib
import json
import logging
import os
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from executive.errors import InputError, OptionError
from executive.s3e.backends.dialect import Dialect
from executive.s3e.backends.openai_replies import (
    KEY,
    OPENAI_KEY,
    ReplyError,
    decoded,
    elsewhere,
    model_names,
    refusal,
)

if TYPE_CHECKING:
    import httpx2

LARGEST = 4_000_000
"""Bytes; no honest reply to what is asked here is larger."""

START = "start one, such as: vllm serve MODEL, or: llama-server -m MODEL.gguf --mmproj PROJECTOR.gguf"

_GREETING = 20.0
"""Seconds that a server may take to list its models."""
_NAMED = 8
"""How many models an error message names."""
_NO_SUCH_PLACE = frozenset({404, 405, 501})
_ELSEWHERE = frozenset({301, 302, 303, 307, 308})
_CHANGES = 8
"""How often a request is changed at most: a server names one thing after the other that it does not take."""
_T = TypeVar("_T")

log = logging.getLogger(__name__)


class ServerError(InputError):
    """A server that is not there, is of another kind, or gives no usable reply."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long and how often to try.

    `connect` and `reply` are seconds: for the connection, and for one request with all its tries. A request is tried up
    to `tries` times, the second time `pause` seconds after the first, each pause twice as long as the one before (or as
    long as the server asks for). `concurrent` requests are under way at once.
    """

    connect: float = 5.0
    reply: float = 120.0
    tries: int = 4
    pause: float = 0.5
    concurrent: int = 8

    def __post_init__(self) -> None:
        if not (self.connect > 0 and self.reply > 0 and self.pause >= 0 and self.tries >= 1 and self.concurrent >= 1):
            raise ValueError(f"{self} leaves no time for a single try")


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a request got no usable reply, in one line. `gone`: nothing answers there at all, or not in time. `status`:
    what HTTP calls it, where the server said so."""

    reason: str
    gone: bool = False
    status: int = 200


class ChatServer:
    """A server and the model that is asked there.

    Args:
        url: where the server's API is, such as `http://127.0.0.1:8000/v1`; without a path, `/v1` is meant.
        model: the model's name at the server; without it, the only one that the server has.
        patience: how long and how often to try.
        environment: where the API key is looked up; without it, the process's environment.

    Raises:
        ServerError: nothing answers there, the key is refused, or it is not clear which model is meant.
        InputError: the URL is none, or has a password or a query in it, which would end up in the record of a run.
    """

    def __init__(
        self,
        url: str,
        model: str | None = None,
        *,
        patience: Patience | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.url, self._local = base_url(url)
        self.patience = patience or Patience()
        self._environment = environment  # never a copy of the process's own: it has keys in it
        self._encrypted = self.url.startswith("https:")
        self._met = False
        self._dialect, self._understood = Dialect(), False
        self.models = self._list_models(needed=model is None)
        self.model = model or ""
        if model is None and not self.models:
            raise ServerError("has no model yet: load one there, or name one with --vlm NAME", file=self.url)
        if model is None and len(self.models) != 1:
            raise ServerError(f"name the model that is to be asked with --vlm NAME; {self.known()}", file=self.url)
        self.model = model or self.models[0]
        self._met = True

    def __repr__(self) -> str:
        return f"ChatServer({self.url!r}, {self.model!r})"

    @property
    def name(self) -> str:
        """The model's name, or the last part of it where it is a path on the server's machine."""
        parts = [part for part in self.model.replace("\\", "/").split("/") if part]
        path = len(parts) > 2 or self.model.startswith((".", "/", "~")) or "\\" in self.model
        return parts[-1] if parts and (path or self.model.endswith(".gguf")) else self.model

    def known(self) -> str:
        """The models that the server has, for an error message; the nearest to what was asked for where it has many."""
        near = difflib.get_close_matches(self.model, self.models, n=_NAMED, cutoff=0.0)
        shown = sorted(self.models if len(self.models) <= _NAMED else near)
        more = f" and {len(self.models) - len(shown)} more" if len(self.models) > len(shown) else ""
        return f"it has: {', '.join(shown)}{more}" if shown else "it does not say which it has"

    def complete(self, requests: Sequence[Mapping[str, Any]], read: Callable[[Any], _T]) -> list[_T | Failure]:
        """Ask for a chat completion of each request, several at once; what `read` makes of each reply, in order.

        The first request goes alone: a server that keeps the prefixes of prompts then has what the others share, and
        one that is gone is found out once. What the server says it does not take is changed, and written so from then
        on. `read` gets the decoded JSON and raises `ReplyError` for what it cannot use.
        """
        bodies = [{"model": self.model, "temperature": 0, **request} for request in requests]
        return _run(self._complete(bodies, read)) if bodies else []

    async def _complete(self, bodies: Sequence[Mapping[str, Any]], read: Callable[[Any], _T]) -> list[_T | Failure]:
        gate = asyncio.Semaphore(self.patience.concurrent)
        async with self._client() as client:

            async def one(body: Mapping[str, Any]) -> _T | Failure:
                async with gate:  # encoded here, so that no more pictures are in memory than are under way
                    return await self._try(client, "chat/completions", read, body)

            first = await one(bodies[0])
            if isinstance(first, Failure) and first.gone:
                return [first] * len(bodies)
            return [first, *await asyncio.gather(*map(one, bodies[1:]))]

    def _list_models(self, needed: bool) -> tuple[str, ...]:
        """The models that the server says it has; none where it has no such list, unless that is `needed`."""

        async def ask() -> tuple[str, ...] | Failure:
            async with self._client() as client:
                return await self._try(client, "models", model_names, seconds=min(_GREETING, self.patience.reply))

        models = _run(ask())
        if not isinstance(models, Failure):
            return models
        if models.gone:
            raise ServerError(f"no server answers there ({models.reason}); {START}", file=self.url)
        if models.status in _NO_SUCH_PLACE:
            if not needed:
                return ()
            raise ServerError(f"lists no models (status {models.status}); name one with --vlm NAME", file=self.url)
        raise ServerError(models.reason, file=self.url)

    def _client(self) -> httpx2.AsyncClient:
        import httpx2

        key = self._key()
        return httpx2.AsyncClient(
            headers={"Authorization": f"Bearer {key}"} if key else {},
            timeout=httpx2.Timeout(None, connect=self.patience.connect),
            limits=httpx2.Limits(max_connections=self.patience.concurrent),
            trust_env=not self._local,  # a proxy has no part in what this machine says to itself
            verify=self._encrypted,  # certificates take long to load, and there is nothing to verify without them
        )

    def _keys(self) -> tuple[str, str]:
        environment = os.environ if self._environment is None else self._environment
        return environment.get(KEY, "").strip(), environment.get(OPENAI_KEY, "").strip()

    def _key(self) -> str:
        key, openai_key = self._keys()
        if not key and (self._encrypted or self._local):
            key = openai_key
        if not (key.isascii() and key.isprintable()):
            raise InputError(f"the API key in {KEY} or {OPENAI_KEY} has characters that none has")
        return key

    async def _try(
        self,
        client: httpx2.AsyncClient,
        path: str,
        read: Callable[[Any], _T],
        request: Mapping[str, Any] | None = None,
        seconds: float | None = None,
    ) -> _T | Failure:
        """Ask, and ask again while that may help and there is time left (`seconds`, or what the patience allows)."""
        patience, trouble = self.patience, ReplyError("")
        seconds = patience.reply if seconds is None else seconds
        dialect, number, changes = self._dialect, 0, 0
        try:
            async with asyncio.timeout(seconds):
                while number < patience.tries:
                    if trouble.reason and number:
                        await asyncio.sleep(max(trouble.after, patience.pause * 2 ** (number - 1)))
                    body = None if request is None else json.dumps(dialect.written(request)).encode()
                    try:
                        reply = await self._once(client, path, body)
                        if request is not None:  # as it was written, it is taken
                            self._dialect, self._understood = dialect, True
                        return read(reply)
                    except ReplyError as error:
                        trouble = error
                        changed = None
                        if request is not None and error.words is not None and changes < _CHANGES:
                            known = self._understood and dialect == self._dialect
                            changed = dialect.after(error.words, error.status, request, known=known)
                        if changed is not None:
                            log.info("%s: asked in another way, because %s", self.url, self._told(error.reason))
                            dialect, changes, trouble = changed, changes + 1, ReplyError("")
                            continue
                        if not error.again or (error.gone and not self._met):  # nobody to wait for
                            break
                        number += 1
        except TimeoutError:
            last = f"; the last try: {trouble.reason}" if trouble.reason else ""
            trouble = ReplyError(f"no reply within {seconds:g} s{last}", gone=True)
        return Failure(self._told(trouble.reason), trouble.gone, trouble.status)

    async def _once(self, client: httpx2.AsyncClient, path: str, body: bytes | None) -> Any:
        """One request: the JSON that comes back."""
        import httpx2

        method = "GET" if body is None else "POST"
        headers = {} if body is None else {"Content-Type": "application/json"}
        data = bytearray()
        try:
            async with client.stream(method, f"{self.url}/{path}", content=body, headers=headers) as response:
                async for chunk in response.aiter_bytes():
                    data += chunk
                    if len(data) > LARGEST:
                        raise ReplyError(f"the reply has more than {LARGEST:,} bytes", again=False)
        except (httpx2.ConnectError, httpx2.ConnectTimeout) as error:
            raise ReplyError(str(error) or "the connection cannot be made in time", gone=True) from None
        except httpx2.HTTPError as error:
            raise ReplyError(f"no whole HTTP reply ({error or type(error).__name__})") from None
        if response.status_code in _ELSEWHERE:
            raise elsewhere(response.status_code, response.headers.get("location", ""), path)
        if response.status_code != 200:
            raise refusal(response.status_code, response.headers.get("retry-after", ""), bytes(data))
        return decoded(bytes(data))

    def _told(self, reason: str) -> str:
        """What can be told of it: one line, and the key not in it even where the server sent it back."""
        for key in filter(None, self._keys()):
            reason = reason.replace(key, "***")
        return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(reason.split()))


def base_url(url: str) -> tuple[str, bool]:
    """The URL of a server's API without a slash at its end, and whether it is on this machine.

    Raises:
        InputError: it is no such URL, or has more in it than scheme, host, port and path.
    """
    try:
        parts = urlsplit(url.strip())
        host, port = parts.hostname or "", parts.port
    except ValueError:
        parts, host, port = urlsplit(""), "", None
    if parts.scheme not in ("http", "https") or not host or not all("!" <= character <= "~" for character in url):
        # Not repeated: what it was meant to be is unknown, and it may have a password in it.
        raise OptionError("is not a server's address such as http://127.0.0.1:8000/v1", option="server")
    place = f"[{host}]" if ":" in host else host
    shown = f"{parts.scheme}://{place}{f':{port}' if port is not None else ''}{parts.path.rstrip('/') or '/v1'}"
    if parts.username is not None or parts.password is not None or parts.query or parts.fragment:
        raise OptionError(
            f"a server's address is scheme, host, port and path alone, such as {shown}; give a key as {KEY}",
            option="server",
        )
    try:
        local = ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost" or host.endswith(".localhost")
    return shown.removesuffix("/chat/completions"), local


def _run(coroutine: Coroutine[Any, Any, _T]) -> _T:
    """Run to the end, also where an event loop is already running in this thread (a notebook)."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(coroutine)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, coroutine).result()
