"""The record of a campaign: `episodes.jsonl`, one line an episode, written when it ends.

A line is on disk before the next episode is submitted (`executive.lab.common.journal`). A damaged one is
named, left out and played again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from executive.errors import InputError
from executive.lab.campaign.episode import Row
from executive.lab.collection.dataset import write_atomically
from executive.lab.common.journal import Journal, lines
from executive.trace.record.codec import decode, encode
from executive.types import OutcomeKind
from executive.util.files import parse_json

FILE = "episodes.jsonl"


class Rows:
    """The rows by key, and the file to which more are appended. A context manager.

    Args:
        warn: receives a line per damaged row.

    Raises:
        InputError: the file cannot be read or written.
    """

    def __init__(self, folder: Path, warn: Callable[[str], None] = lambda line: None) -> None:
        self._path = folder / FILE
        damaged: list[str] = []
        self.known: dict[tuple[str, ...], Row] = read_rows(folder, damaged.append)
        try:
            if damaged:  # the intact rows are written anew, so that the warning is not repeated
                for line in damaged:
                    warn(f"{line}; it is played again")
                write_atomically(self._path, b"".join(map(_line, self.known.values())))
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=self._path) from None
        self._journal = Journal(self._path)

    def __enter__(self) -> Rows:
        return self

    def __exit__(self, *_: object) -> None:
        self._journal.close()

    def add(self, row: Row) -> None:
        """Appends a row.

        Raises:
            InputError: the disk is full or gone; what was written before stays readable.
        """
        self._journal.add(_line(row))
        self.known[row.key] = row


def read_rows(folder: Path, damaged: Callable[[str], None]) -> dict[tuple[str, ...], Row]:
    """The rows of a campaign's folder by their keys; of an episode that was played twice, the later. `damaged`
    receives a text with the number of each damaged line.

    Raises:
        InputError: the file cannot be read.
    """
    path, rows = folder / FILE, dict[tuple[str, ...], Row]()
    for number, line in enumerate(lines(path), start=1):
        try:
            row = _renamed(decode(Row, parse_json(line)))
        except ValueError:
            damaged(f"{path}: line {number}: is damaged")
            continue
        rows[row.key] = row
    return rows


def _renamed(row: Row) -> Row:
    """The current form of the row of an episode without looks: it used to end as if the goal had been observed."""
    unseen = row.outcome == OutcomeKind.GOAL_REACHED and not row.goal_seen
    return replace(row, outcome=OutcomeKind.PLAN_COMPLETED.value) if unseen else row


def _line(row: Row) -> bytes:
    return (json.dumps(encode(row), allow_nan=False) + "\n").encode()
