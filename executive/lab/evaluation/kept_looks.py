"""The looks of an evaluation that have been taken, kept in a file as they come."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from executive.errors import InputError
from executive.lab.collection import dataset
from executive.lab.common.journal import Journal, lines
from executive.lab.evaluation.looks import Said
from executive.util.files import parse_json


class Kept:
    """The looks of an evaluation that have been taken, by their numbers, and the file that more are written to. A
    context manager. Looks of another evaluation are not continued: the file is begun anew.

    Args:
        same: what two evaluations have in common whose looks are the same.
    """

    def __init__(self, file: Path, same: Mapping[str, Any]) -> None:
        self.known: dict[int, Said] = {}
        there = lines(file)
        with suppress(ValueError, LookupError, TypeError):
            if there and parse_json(there[0]) == same:
                for line in there[1:]:
                    number, probability, seconds, why, posterior = parse_json(line)
                    self.known[number] = Said(tuple(probability), float(seconds), str(why), tuple(posterior))
        self._file, self._same = file, same
        self._journal: Journal | None = None
        if not self.known:
            file.unlink(missing_ok=True)
        elif len(self.known) < len(there) - 1:  # something in it is damaged; what is whole is written anew
            dataset.write_atomically(file, b"".join(map(_line, [same, *([n, *s] for n, s in self.known.items())])))

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        if self._journal is not None:
            self._journal.close()

    def add(self, number: int, said: Said) -> None:
        """Write a look down."""
        if self._journal is None:  # there is no file before there is a look
            self._journal = Journal(self._file)
            if not self.known:
                self._journal.add(_line(self._same))
        self._journal.add(_line([number, *said]))
        self.known[number] = said


def command_of(file: Path) -> str:
    """The command of the evaluation whose looks are kept in a file, for all of its looks; empty where there is none."""
    with suppress(InputError, ValueError, LookupError, TypeError):
        return str(parse_json(lines(file)[0])["command"])
    return ""


def _line(value: object) -> bytes:
    return (json.dumps(value) + "\n").encode()
