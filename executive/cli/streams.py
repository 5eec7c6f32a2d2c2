"""Makes standard input, output and error usable in every environment: cron, `>&-`, `| head`, a closed terminal, a
window without a console."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO


def repair() -> None:
    """Open all three streams, for this process and those that it starts. Closed streams lead to the null device, output
    to closed pipes is dropped, and characters that the encoding lacks are replaced."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # otherwise the next opened file would get this number, and the output with it
            _lead_nowhere(number)
    if sys.stdout is None or sys.stderr is None:  # as Python sets them if they were closed
        nowhere = open(os.devnull, "w", encoding="utf-8", errors="replace")  # noqa: SIM115 - as long as the process
        sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    sys.stdout, sys.stderr = _tolerant(sys.stdout, 1), _tolerant(sys.stderr, 2)


def flush_quietly() -> None:
    """Flush the streams, so that Python's flush at exit does not report errors that were reported before."""
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except OSError:
            _lead_nowhere(number)


def _tolerant(stream: TextIO, number: int) -> TextIO:
    """Return the stream, wrapped so that closed pipes raise no error. A replaced stream, as in tests, stays."""
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
    """A file descriptor that tolerates closed pipes and terminals."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self._tolerated = {errno.EPIPE} | ({errno.EIO} if os.isatty(number) else set())
        self._last = number == 2
        """Errors on stderr cannot be reported anywhere."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in self._tolerated and not self._last:
                raise
            _lead_nowhere(self.fileno())
            return memoryview(data).nbytes


def _lead_nowhere(number: int) -> None:
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere != number:
        os.dup2(nowhere, number)
        os.close(nowhere)
    os.set_inheritable(number, True)
