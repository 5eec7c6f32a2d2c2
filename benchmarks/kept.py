"""What a long measurement has measured, kept in a file: stopped and begun again, it goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from executive.lab.common.journal import Journal, lines

Row = dict[str, Any]


class Kept:
    """Measurements by name, a JSON object each, in the order in which they were asked for. A context manager.

    Args:
        path: the file, a line for each; they are kept nowhere if it is not given.

    Raises:
        InputError: the file cannot be read or written.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._before: dict[str, Row] = {}
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._before = {entry["of"]: entry["row"] for entry in map(json.loads, lines(path))}
        self._journal = None if path is None else Journal(path)
        self.rows: dict[str, Row] = {}

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        if self._journal is not None:
            self._journal.close()

    def of(self, name: str, measure: Callable[[], Row]) -> Row:
        """Returns what was measured under this name; measures it if that has not been done."""
        row = self._before.get(name)
        if row is None:
            row = measure()
            if self._journal is not None:
                self._journal.add(json.dumps({"of": name, "row": row}).encode() + b"\n")
        self.rows[name] = row
        return row
