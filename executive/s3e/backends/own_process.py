"""A vision-language model in a process of its own: what it is at can be ended, and it loads while others work.

Nothing of torch is imported here. A call into torch cannot be interrupted from within its process; a process can be
killed wherever it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from weakref import finalize

from executive.s3e.backends.interface import YES_NO, AnswerWords, Backend, Numerals
from executive.s3e.backends.numpy_backend import open_checkpoint
from executive.s3e.backends.shared_client import HostEndedError, SharedBackend, SharedLook
from executive.s3e.backends.shared_host import ModelHost
from executive.types import Image


class OwnProcess:
    """A model in a process that begins to load it at once (implements `executive.s3e.backends.interface.Backend`). A
    process that has ended is replaced at the next look.

    Args:
        model: a checkpoint's folder, or its id on the model hub.
        load: what opens it there, importable by its name.
    """

    def __init__(self, model: str, load: Callable[[str], Backend] = open_checkpoint) -> None:
        self._model, self._host = model, ModelHost(load, first=model, threads=True)
        self._client: SharedBackend | None = None
        self._host.start()
        self._close = finalize(self, self._host.close)

    @property
    def name(self) -> str:
        return self.ready().name

    def ready(self) -> SharedBackend:
        """Wait until the model is loaded.

        Raises:
            InputError: there is no such checkpoint, or it is broken.
            MissingError: its family needs a package that is not installed.
            ExecutiveError: the process does not start, or ended while it loaded the model.
        """
        if self._client is None:
            self._host.wait()
            self._client = SharedBackend(self._host.address, self._model)
        return self._client

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> SharedLook:
        return self._taken(lambda model: model.look(images, system, words))

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> SharedLook:
        return self._taken(lambda model: model.look_for_numbers(images, system, numerals))

    def end(self) -> None:
        """End what the model is at, wherever it is. It is loaded again at once, for the next look."""
        self._host.end()
        self._client = None
        self._host.start()

    def close(self) -> None:
        """End the process."""
        self._close()

    def _taken(self, look: Callable[[SharedBackend], SharedLook]) -> SharedLook:
        try:
            return look(self.ready())
        except HostEndedError:  # it may have needed too much memory this time
            self.end()
            return look(self.ready())
