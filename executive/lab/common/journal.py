"""A journal: a file to which long work appends a line per result, so that it can be resumed.

A line is written in one piece, and is on disk before `add` returns. A last line without its newline was cut off when a
process was killed; it is removed.
"""

from __future__ import annotations

import os
from pathlib import Path

from executive.errors import InputError


class Journal:
    """A file to which lines are appended.

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
        """Appends a line, which includes its newline.

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
    """The complete lines of a file with their newlines; none if there is no file.

    Raises:
        InputError: it cannot be read.
    """
    try:
        found = path.read_bytes().splitlines(keepends=True) if os.path.exists(path) else []
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    return found if not found or found[-1].endswith(b"\n") else found[:-1]
