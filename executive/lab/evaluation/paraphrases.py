"""The same questions in other words: whether a model reads its questions, or has memorised them.

A file of paraphrases has several templates for each predicate, as `questions.toml` has one
(`executive.s3e.questions.templates`), and several names for some of the objects:

    [questions]
    on-table = ["Does the {table} carry the {item}?", "Would I find the {item} on the {table}?"]

    [objects]
    soda-can = ["soda can", "red tin of soda"]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from executive.errors import DomainError, nearest
from executive.s3e import Templates
from executive.types import Atom, Task
from executive.util.files import caseless, read_toml


@dataclass(frozen=True, slots=True)
class Paraphrases:
    """All wordings of each atom's question, at least one. A look draws one for every atom."""

    wordings: Mapping[Atom, tuple[str, ...]]
    warnings: tuple[str, ...] = ()

    @classmethod
    def read(cls, file: Path, task: Task, own: Templates | None = None, rename: bool = True) -> Paraphrases:
        """Read a file of paraphrases and fill it in for a task.

        Args:
            own: the domain's own templates, whose names are kept for objects that the file does not name.
            rename: whether objects are called as the file says.

        Raises:
            DomainError: the first mistake, in one line with file and key.
        """
        tables = _read(file)
        tables = {name: caseless(table, file, name, mistake=DomainError) for name, table in tables.items()}
        questions = {name: _texts(file, "questions", name, value) for name, value in tables["questions"].items()}
        objects = {name: _texts(file, "objects", name, value) for name, value in tables.get("objects", {}).items()}
        names = dict(own.objects) if own else {}
        rounds = max(map(len, objects.values()), default=1) if rename else 1
        wordings: dict[Atom, dict[str, None]] = {atom: {} for atom in task.atoms}
        warnings: dict[str, None] = {}
        for number in range(max(map(len, questions.values()), default=1)):
            templates = {name: texts[number % len(texts)] for name, texts in questions.items()}
            for turn in range(rounds):
                called = {name: texts[turn % len(texts)] for name, texts in objects.items()} if rename else {}
                filled = Templates(templates, {**names, **called}, file).checked().translate(task)
                for atom, text in filled.text.items():
                    wordings[atom][text] = None
                warnings |= dict.fromkeys(filled.warnings)
        return cls({atom: tuple(texts) for atom, texts in wordings.items()}, tuple(warnings))

    def drawn(self, rng: np.random.Generator) -> dict[Atom, str]:
        """A wording for every atom, each as likely as its others."""
        return {atom: texts[int(rng.integers(len(texts)))] for atom, texts in self.wordings.items()}


def _read(file: Path) -> dict[str, dict[str, Any]]:
    tables = read_toml(file, mistake=DomainError)
    for name, table in tables.items():
        if name not in ("questions", "objects"):
            raise DomainError(f"unknown key; {nearest(name, ('questions', 'objects'))}", file=file, key=name)
        if not isinstance(table, dict):
            raise DomainError(f"expected a table, got {table!r}", file=file, key=name)
    if "questions" not in tables:
        raise DomainError("is missing: the table with the wordings of each predicate", file=file, key="questions")
    return tables


def _texts(file: Path, table: str, name: str, value: object) -> list[str]:
    if isinstance(value, list) and value and all(isinstance(text, str) for text in value):
        return value
    raise DomainError(f"expected a list of texts, got {value!r}", file=file, key=f"{table}.{name}")
