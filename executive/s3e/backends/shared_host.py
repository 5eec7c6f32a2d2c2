"""A process that holds vision-language models for others: see `executive.s3e.backends.shared_client`.

A campaign has one so that a GPU holds each model once; a run has one so that a look can be ended
(`executive.s3e.backends.own_process`).
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from threading import Thread
from typing import Any

from executive.errors import ExecutiveError, InputError
from executive.s3e.backends.interface import Backend, CountingBackend, Look, Numerals
from executive.s3e.backends.shared_client import Address, Ask, Count, Free, Open, Take
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.s3e.backends.wire import receive, send
from executive.util.processes import block_signals, exit_with_parent
from executive.util.threads import shared_by

_LONGEST = 60
"""Characters of the folder for temporary files: a socket's whole path has to be shorter than 104 (macOS)."""

_PROGRAM = f"""
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from {__name__} import main
main()
"""
"""The process is started afresh, without what `multiprocessing` does: it would import the program of whoever uses this
as a library anew, and run it once more where that does not guard against it."""

log = logging.getLogger(__name__)


class ModelHost:
    """A process that opens models as they are asked for and keeps them until it is ended. A context manager; on the way
    out the process is ended, and nothing of it is left. It ends with this process, too, however that ends.

    Args:
        load: what opens a model by its folder or hub id. Importable there by its name.
        first: a model that is opened at once, before anybody asks for it.
        threads: whether the model's arithmetic may take all cores; else it is done on one thread, so that how many
            processes share the machine changes no rounding.

    Attributes:
        address: where it is, for `executive.s3e.backends.shared_client.SharedBackend` in any process of this machine.
    """

    address: Address

    def __init__(
        self, load: Callable[[str], Backend] = TransformersBackend, first: str | None = None, threads: bool = False
    ) -> None:
        self._load, self._first, self._threads = load, first, threads
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> ModelHost:
        self.start()
        try:
            self.wait()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int | None:
        """The process's number."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the process, and wait for nothing."""
        if not hasattr(self, "address"):
            # A folder that nobody else may enter.
            short = len(tempfile.gettempdir()) <= _LONGEST
            folder = tempfile.mkdtemp(prefix="executive-model-", dir=None if short else "/tmp")
            self.address = Address(str(Path(folder) / "model"), secrets.token_bytes(32))
        Path(self.address.path).unlink(missing_ok=True)
        with block_signals(), shared_by(1, alone=not self._threads):
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended, which `wait` says
            self._process.stdin.write(pickle.dumps(sys.path) + pickle.dumps((self.address, self._load, self._first)))
            self._process.stdin.flush()

    def wait(self) -> None:
        """Wait until the process takes clients.

        Raises:
            ExecutiveError: it did not start.
        """
        assert self._process is not None
        assert self._process.stdout is not None
        if not self._process.stdout.closed and not self._process.stdout.read():
            raise ExecutiveError("the process that is to hold the model did not start")
        self._process.stdout.close()

    def revive(self) -> None:
        """Start the process again, at the same address, if it has died; what it kept is lost. Else do nothing.

        Raises:
            ExecutiveError: it does not start.
        """
        if not self._listens():
            self.end()
            self.start()
            self.wait()

    def end(self) -> None:
        """End the process wherever it is."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                with suppress(OSError):  # what could not be written any more
                    if pipe is not None:
                        pipe.close()

    def close(self) -> None:
        """End the process, and leave nothing of it."""
        self.end()
        shutil.rmtree(Path(self.address.path).parent, ignore_errors=True)

    def _listens(self) -> bool:
        """Whether the process takes clients. One that was killed counts as alive for a moment after its clients have
        been told."""
        with socket.socket(socket.AF_UNIX) as knock:
            knock.setblocking(False)
            try:
                knock.connect(self.address.path)
            except BlockingIOError:  # others are waiting, too
                return True
            except OSError:
                return False
        return True


class _Visitor:
    """A client, and what is kept for it. One is the same as no other."""

    def __init__(self) -> None:
        self.looks: dict[int, Look] = {}


class _Holder:
    """The models, and who has looks at them. Whatever is done with a model is done on one thread, first come, first
    served: nothing of one look happens in the middle of another."""

    def __init__(self, load: Callable[[str], Backend]) -> None:
        self._load = load
        self._models: dict[str, Backend] = {}
        self._visitors: set[_Visitor] = set()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="model")

    def open_ahead(self, model: str) -> None:
        """Begin to open a model. If that fails, whoever asks for it is told."""
        self._thread.submit(self._opened, model)

    def serve(self, connection: Connection) -> None:
        """Answer a client until it is gone, and free what it leaves behind."""
        visitor = _Visitor()
        self._visitors.add(visitor)
        try:
            with connection, suppress(EOFError, OSError):
                while True:
                    message = receive(connection)
                    if isinstance(message, Free):
                        visitor.looks.pop(message.look, None)
                    else:
                        send(connection, self._reply(visitor, message))
                    del message  # pictures are the look's from here on
        finally:
            self._visitors.remove(visitor)

    def _reply(self, visitor: _Visitor, message: object) -> tuple[bool, object]:
        """Whether it succeeded; and the result, or the error."""
        if isinstance(message, Count):
            return True, sum(len(each.looks) for each in list(self._visitors))
        try:
            return True, self._thread.submit(self._do, visitor, message).result()
        except ExecutiveError as error:
            return False, error
        except Exception as error:  # of no kind that all processes know
            log.debug("it was asked for %s", type(message).__name__, exc_info=True)
            return False, RuntimeError(f"{type(error).__name__}: {error}")

    def _do(self, visitor: _Visitor, message: object) -> Any:
        match message:
            case Open(model):
                return self._opened(model).name
            case Take(number, model, images, system, words):
                backend = self._opened(model)
                if not isinstance(words, Numerals):
                    visitor.looks[number] = backend.look(images, system, words)
                elif isinstance(backend, CountingBackend):
                    visitor.looks[number] = backend.look_for_numbers(images, system, words)
                else:
                    raise InputError(f"{backend.name} cannot be asked for numbers")
            case Ask(number, questions):
                return visitor.looks[number].ask(questions)
        return None

    def _opened(self, model: str) -> Backend:
        if model not in self._models:
            self._models[model] = self._load(model)
        return self._models[model]


def main() -> None:
    """What the process does. Its parent tells on stdin, which ends with the parent; it says on stdout when it takes
    clients, and what libraries print from then on goes to stderr."""
    address, load, first = pickle.load(sys.stdin.buffer)
    exit_with_parent(partial(shutil.rmtree, Path(address.path).parent, ignore_errors=True), partial(os.read, 0, 1))
    holder = _Holder(load)
    if first is not None:
        holder.open_ahead(first)
    with Listener(address.path, "AF_UNIX", backlog=64, authkey=address.key) as listener:
        os.write(1, b"ready")
        with suppress(OSError):  # somebody has closed stderr
            os.dup2(2, 1)
        while True:
            # Who knocks may be gone before the key was shown, or have another one.
            with suppress(OSError, EOFError, multiprocessing.AuthenticationError):
                Thread(target=holder.serve, args=(listener.accept(),), daemon=True).start()
