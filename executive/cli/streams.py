"""Standard input, output and error, whatever the caller has left of them: cron, `>&-`, `| head`, a terminal that is
gone, a window without a console."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO


def settle() -> None:
    """Have all three be there, for this process and those that it starts. What is closed leads nowhere; what nobody
    reads any more is dropped; and what has no character for a text gets another one."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # else the next file that is opened would be it, and get what others print
            _lead_nowhere(number)
    if sys.stdout is None or sys.stderr is None:  # as Python has it where they were closed
        nowhere = open(os.devnull, "w", encoding="utf-8", errors="replace")  # noqa: SIM115 - as long as the process
        sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    sys.stdout, sys.stderr = _heard(sys.stdout, 1), _heard(sys.stderr, 2)


def leave() -> None:
    """Have Python's own flush at exit not complain of what was complained of before."""
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except OSError:
            _lead_nowhere(number)


def _heard(stream: TextIO, number: int) -> TextIO:
    """The same stream, which goes on when nobody hears it. One that somebody put in its place is left alone."""
    if type(stream) is not io.TextIOWrapper or stream.fileno() != number:
        return stream
    descriptor = _Descriptor(number)
    buffered = isinstance(stream.buffer, io.BufferedWriter)  # not with PYTHONUNBUFFERED
    return io.TextIOWrapper(
        io.BufferedWriter(descriptor) if buffered else descriptor,
        encoding=stream.encoding,
        errors="replace",
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


class _Descriptor(io.FileIO):
    """Where a stream leads to."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self._unheard = {errno.EPIPE} | ({errno.EIO} if os.isatty(number) else set())
        self._last = number == 2
        """Of what goes wrong here, there is nowhere left to tell."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in self._unheard and not self._last:
                raise
            _lead_nowhere(self.fileno())
            return memoryview(data).nbytes


def _lead_nowhere(number: int) -> None:
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere != number:
        os.dup2(nowhere, number)
        os.close(nowhere)
    os.set_inheritable(number, True)
