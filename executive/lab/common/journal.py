"""Lines in a file that are written down as the work goes on, so that it can be gone on with.

A line is written in one piece and is on disk before the next thing is done. A last line without its newline was cut off
by a kill and is cut off here, too.
"""

from __future__ import annotations

import os
from pathlib import Path

from executive.errors import InputError


class Journal:
    """A file that lines are added to.

    Raises:
        InputError: it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            os.ftruncate(self._file, sum(map(len, lines(path))))
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None

    def add(self, line: bytes) -> None:
        """Write a line down, its newline included.

        Raises:
            InputError: the disk is full or gone; what was written before stays readable.
        """
        size = os.fstat(self._file).st_size
        try:
            if os.write(self._file, line) != len(line):
                raise OSError(None, "only a part of a line could be written")
            os.fdatasync(self._file)
        except OSError as error:
            os.ftruncate(self._file, size)
            raise InputError(f"cannot be written ({error.strerror})", file=self._path) from None

    def close(self) -> None:
        os.close(self._file)


def lines(path: Path) -> list[bytes]:
    """The whole lines of a file, with their newlines; none of one that is not there.

    Raises:
        InputError: it cannot be read.
    """
    try:
        found = path.read_bytes().splitlines(keepends=True) if os.path.exists(path) else []
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    return found if not found or found[-1].endswith(b"\n") else found[:-1]
