"""The record of a campaign: `episodes.jsonl`, one line an episode, written as each comes to its end.

A line is written in one piece and is on disk before the next episode is handed out in its place. A last line without
its newline was cut off by a kill and is cut off here, too; a damaged one is named, left out and played again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from executive.errors import InputError
from executive.files import parse_json
from executive.lab.campaign.episode import Row
from executive.lab.dataset import write_atomically
from executive.trace.codec import decode, encode
from executive.types import OutcomeKind

FILE = "episodes.jsonl"


class Rows:
    """The rows that there are, by their keys, and the file that more are written to. A context manager.

    Args:
        warn: is told of damage.

    Raises:
        InputError: the file cannot be read or written.
    """

    def __init__(self, folder: Path, warn: Callable[[str], None] = lambda line: None) -> None:
        self._path = folder / FILE
        damaged: list[str] = []
        self.known: dict[tuple[str, ...], Row] = read_rows(folder, damaged.append)
        try:
            if damaged:  # what is whole is written anew, so that the same is not said each time
                for line in damaged:
                    warn(f"{line}; it is played again")
                write_atomically(self._path, b"".join(map(_line, self.known.values())))
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            os.ftruncate(self._file, _whole(self._path))
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=self._path) from None

    def __enter__(self) -> Rows:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def add(self, row: Row) -> None:
        """Write a row down.

        Raises:
            InputError: the disk is full or gone; what was written before stays readable.
        """
        data, size = _line(row), os.fstat(self._file).st_size
        try:
            if os.write(self._file, data) != len(data):
                raise OSError(None, "only a part of a line could be written")
            os.fdatasync(self._file)
        except OSError as error:
            os.ftruncate(self._file, size)
            raise InputError(f"cannot be written ({error.strerror})", file=self._path) from None
        self.known[row.key] = row


def read_rows(folder: Path, damaged: Callable[[str], None]) -> dict[tuple[str, ...], Row]:
    """The rows of a campaign's folder by their keys; of one that was played twice, the later. `damaged` is told of each
    line that is none, by its number.

    Raises:
        InputError: the file cannot be read.
    """
    path, rows = folder / FILE, dict[tuple[str, ...], Row]()
    try:
        lines = path.read_bytes().splitlines(keepends=True) if os.path.exists(path) else []
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    for number, line in enumerate(lines, start=1):
        if not line.endswith(b"\n"):
            break
        try:
            row = _renamed(decode(Row, parse_json(line)))
        except ValueError:
            damaged(f"{path}: line {number}: is damaged")
            continue
        rows[row.key] = row
    return rows


def _renamed(row: Row) -> Row:
    """The row of an episode in which nobody looked, as it is written now: it used to end as if the goal was seen."""
    unseen = row.outcome == OutcomeKind.GOAL_REACHED and not row.goal_seen
    return replace(row, outcome=OutcomeKind.PLAN_COMPLETED.value) if unseen else row


def _line(row: Row) -> bytes:
    return (json.dumps(encode(row), allow_nan=False) + "\n").encode()


def _whole(path: Path) -> int:
    """How many bytes are whole lines."""
    data = path.read_bytes()
    return data.rfind(b"\n") + 1
