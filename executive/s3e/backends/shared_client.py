"""A model that one process holds for several others: what those others have of it.

`SharedBackend` is a `Backend` like any other; behind it is the process of an
`executive.s3e.backends.shared_host.ModelHost`. The two speak over a socket of this machine (AF_UNIX) in a private
folder, with a key: nothing is on the network, and neither side accepts anything without the key.

Each look is a batch of its own: all questions about its pictures go through the model together, and looks of different
clients never do. What goes through together decides how sums are rounded, so that an answer would depend on who else
was looking at that moment, and the same seed would not give the same run. The looks of several clients take turns.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from itertools import count
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any, TypeAlias

from executive.errors import ExecutiveError
from executive.s3e.backends.interface import YES_NO, Answer, AnswerWords, Numerals, Words
from executive.s3e.backends.wire import receive, send
from executive.types import Image

ENDED = "the process that holds the model has ended (was there enough memory?)"


class HostEndedError(ExecutiveError):
    """The process that holds the model is gone, and what it had taken in with it."""

    def __init__(self, message: str = ENDED) -> None:
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Address:
    """Where a process is that holds models, and the key to it. It can be handed to other processes."""

    path: str
    key: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class Open:
    """Have the model, a folder or a hub id, loaded unless it is; the reply is its name."""

    model: str


@dataclass(frozen=True, slots=True)
class Take:
    """Take pictures in (see `Backend.look`), to be asked about as `look`, a number that this client has not used."""

    look: int
    model: str
    images: tuple[Image, ...]
    system: str
    words: Words


@dataclass(frozen=True, slots=True)
class Ask:
    """Ask about a look; the reply is a list of answers."""

    look: int
    questions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Free:
    """Keep the pictures of a look no longer. There is no reply."""

    look: int


@dataclass(frozen=True, slots=True)
class Count:
    """The reply is how many looks are kept, of all clients together. It comes at once, whatever the model is at."""


class SharedBackend:
    """A model in the process at `address` (implements `executive.s3e.backends.interface.Backend`). What it keeps there
    is freed with it.

    Args:
        model: a checkpoint's folder, or its id on the model hub. Loaded by the first client that asks for it.

    Raises:
        InputError: there is no such checkpoint, or it is broken.
        MissingError: its family needs a package that is not installed.
        HostEndedError: the process is gone.
    """

    def __init__(self, address: Address, model: str | Path) -> None:
        self._line, self._model, self._numbers = _Line(address), str(model), count()
        self._name: str = self._line.ask(Open(self._model))

    def __repr__(self) -> str:
        return f"SharedBackend({self._name!r})"

    @property
    def name(self) -> str:
        return self._name

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> SharedLook:
        """Take in pictures, (H, W, 3) uint8 each, shown together and in order, under a system prompt.

        Raises:
            InputError: as the model's own `look`.
            HostEndedError: the process is gone.
        """
        return self._look(images, system, words)

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> SharedLook:
        """Take in pictures as `look` does, to ask for numbers about them.

        Raises:
            InputError: as the model's own `look_for_numbers`.
            HostEndedError: the process is gone.
        """
        return self._look(images, system, numerals)

    def _look(self, images: Sequence[Image], system: str, words: Words) -> SharedLook:
        look = SharedLook(self._line, next(self._numbers))
        self._line.ask(Take(look.number, self._model, tuple(images), system, words))
        return look

    def check(self) -> None:
        """Whether all looks so far have reached the model, and the next one would.

        Raises:
            HostEndedError: the process that this backend was opened at is gone.
        """
        self._line.ask(Count())


class SharedLook:
    """Pictures that a model in another process has taken in (implements `executive.s3e.backends.interface.Look`). They
    are freed there with this look, or by `close`."""

    def __init__(self, line: _Line, number: int) -> None:
        self._line, self.number = line, number
        self._free = weakref.finalize(self, line.tell, Free(number))

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order. Where the process is gone, their `error` says so."""
        if not self._free.alive:
            raise ValueError("this look is closed")
        try:
            answers: list[Answer] = self._line.ask(Ask(self.number, tuple(questions)))
        except HostEndedError as error:
            return [Answer("", 0.0, 0.0, str(error)) for _ in questions]
        return answers

    def close(self) -> None:
        """Free what is kept of the pictures. No question can be asked any more."""
        self._free()


def kept(address: Address) -> int:
    """How many looks the process at an address keeps.

    Raises:
        HostEndedError: the process is gone.
    """
    number: int = _Line(address).ask(Count())
    return number


_Waiting: TypeAlias = SimpleQueue[tuple[object, Future[Any] | None] | None]


class _Line:
    """A client's way to the process that holds the model, and its only one.

    A thread of its own does the speaking, message by message. So a caller may be interrupted at any moment (a look that
    takes too long is ended) and leaves no half of a message behind, and a garbage collector that has something to tell
    waits for nobody: to put something into this kind of queue is safe wherever it happens.

    Raises:
        HostEndedError: the host has ended.
    """

    def __init__(self, address: Address) -> None:
        try:
            connection = Client(address.path, "AF_UNIX", authkey=address.key)
        except (OSError, EOFError, AuthenticationError):
            raise HostEndedError from None
        self._waiting: _Waiting = SimpleQueue()
        Thread(target=_speak, args=(connection, self._waiting), name="model", daemon=True).start()
        weakref.finalize(self, self._waiting.put, None)

    def ask(self, message: object) -> Any:
        """Send a message and wait for its reply.

        Raises:
            HostEndedError: the process is gone.
            ExecutiveError: whatever was raised there on purpose; anything else comes as a RuntimeError.
        """
        reply: Future[Any] = Future()
        self._waiting.put((message, reply))
        try:
            return reply.result()
        finally:
            del reply  # an error would hold this frame, which would hold the error, and both the look, for a while

    def tell(self, message: object) -> None:
        """Send a message that has no reply."""
        self._waiting.put((message, None))


def _speak(connection: Connection, waiting: _Waiting) -> None:
    with connection:
        while (item := waiting.get()) is not None:
            message, reply = item
            try:
                send(connection, message)
                if reply is not None:
                    fine, value = receive(connection)
                    if fine:
                        reply.set_result(value)
                    else:
                        reply.set_exception(value)
            except (EOFError, OSError):
                connection.close()  # whatever is sent on one that is closed comes here, too
                if reply is not None:
                    reply.set_exception(HostEndedError())
            except Exception as error:  # what cannot be sent at all
                if reply is not None:
                    reply.set_exception(error)
            del item, message, reply  # pictures are not kept between requests
