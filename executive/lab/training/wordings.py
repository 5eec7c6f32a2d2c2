"""Wordings of questions for training: a domain's `wordings.toml`, sampled at random.

    [questions]
    on-table = ["Is the {item} (|now )(on|on top of) the {table}?"]

    [objects]
    soda-can = ["soda can", "can of soda"]

    [values]
    sphere = ["ball"]

[values] is for domains whose objects are described by attributes: other words for an attribute's value. A group such as
(on|on top of) stands for one of its parts; groups nest. Without such a file, questions have the wording of
questions.toml alone, and the trained model cannot be expected to understand another.
"""

from __future__ import annotations

import random
import re
import string
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from executive.errors import DomainError, nearest
from executive.s3e.questions.templates import Templates
from executive.types import Atom, Task
from executive.util.files import caseless, read_toml

WORDINGS = "wordings.toml"
TABLES = ("questions", "objects", "values")

_LONGEST = 2_000
"""Characters of a pattern or a name. The time that a pattern takes grows with their square."""

_GROUP = re.compile(r"\(([^()]*)\)")


@dataclass(frozen=True, slots=True)
class Wordings:
    """Patterns per predicate and names per object, each with at least one entry, for one task."""

    patterns: Mapping[str, tuple[str, ...]]
    names: Mapping[str, tuple[str, ...]]
    parameters: Mapping[str, tuple[str, ...]]
    official: Mapping[Atom, str]
    """Each atom's question in the wording of `questions.toml`, which runs use."""

    @classmethod
    def of(cls, task: Task, templates: Templates, file: Path | None = None, absent: Collection[str] = ()) -> Wordings:
        """Reads the wordings of a task: its templates, and what `file` adds to them. `absent` are objects of other
        tasks, whose names in the file are ignored.

        Raises:
            DomainError: the file has a mistake, named with its key.
        """
        # A bracket in questions.toml is literal: a template that has one is no pattern.
        predicates = {
            name: [small_placeholders(text)] if "(" not in text else [] for name, text in templates.predicates.items()
        }
        names = {name: [text] for name, text in templates.names(task).items()}
        if file is not None:
            tables = read_tables(file)
            for table, target in (("questions", predicates), ("objects", names)):
                for key, entries in tables.get(table, {}).items():
                    if table == "objects" and key in absent and key not in target:
                        continue
                    if key not in target:
                        raise DomainError(f"unknown key; {nearest(key, target)}", file=file, key=f"{table}.{key}")
                    target[key] += map(small_placeholders, read_texts(entries, file, f"{table}.{key}"))
        arity = {atom.predicate: len(atom.args) for atom in task.atoms}
        parameters = {
            name: tuple(task.parameters.get(name, [str(index + 1) for index in range(count)]))
            for name, count in arity.items()
        }
        for predicate, patterns in predicates.items():
            check_patterns(patterns, parameters[predicate], file, f"questions.{predicate}")
        official = templates.translate(task).text
        return cls(
            {name: tuple(patterns) for name, patterns in predicates.items()},
            {name: tuple(dict.fromkeys(entries)) for name, entries in names.items()},
            parameters,
            official,
        )

    def draw(self, atom: Atom, rng: random.Random) -> tuple[str, list[str]]:
        """Samples a question about an atom, and the names that it uses for the arguments. One in five has the official
        wording, which runs use."""
        if rng.random() < 0.2 or not self.patterns[atom.predicate]:
            return self.official[atom], [self.names[name][0] for name in atom.args]
        pattern = expand(rng.choice(self.patterns[atom.predicate]), rng)
        names = [rng.choice(self.names[name]) for name in atom.args]
        return pattern.format("", *names, **dict(zip(self.parameters[atom.predicate], names, strict=True))), names


def expand(pattern: str, rng: random.Random) -> str:
    """Samples one of the texts that a pattern stands for."""
    while (group := _GROUP.search(pattern)) is not None:
        pattern = pattern[: group.start()] + rng.choice(group[1].split("|")) + pattern[group.end() :]
    return " ".join(pattern.split())


def read_tables(file: Path) -> dict[str, dict[str, object]]:
    tables = read_toml(file, mistake=DomainError)
    for name, table in tables.items():
        if name not in TABLES:
            raise DomainError(f"unknown key; {nearest(name, TABLES)}", file=file, key=name)
        if not isinstance(table, dict):
            raise DomainError(f"expected a table, got {table!r}", file=file, key=name)
    return {name: caseless(table, file, name, mistake=DomainError) for name, table in tables.items()}


def read_texts(entries: object, file: Path, key: str) -> list[str]:
    if not isinstance(entries, list) or not all(isinstance(entry, str) and entry.strip() for entry in entries):
        raise DomainError("expected a list of texts, none of them empty", file=file, key=key)
    if (long := max(map(len, entries), default=0)) > _LONGEST:
        raise DomainError(f"a text has {long:,} characters, and may have {_LONGEST:,}", file=file, key=key)
    return entries


def check_patterns(patterns: Sequence[str], parameters: Sequence[str], file: Path | None, key: str) -> None:
    known = {*parameters, *(str(index) for index in range(1, len(parameters) + 1))}
    for pattern in patterns:
        try:
            places = {name for _, name, _, _ in string.Formatter().parse(pattern) if name is not None}
        except ValueError as error:
            raise DomainError(f"{pattern!r}: {error}", file=file, key=key) from None
        if pattern.count("(") != pattern.count(")") or _leftover(pattern):
            raise DomainError(f"{pattern!r} has a bracket that does not open or close a group", file=file, key=key)
        if unknown := places - known:
            raise DomainError(
                f"{pattern!r} names {{{min(unknown)}}}; {nearest(min(unknown), known)}", file=file, key=key
            )
        for index, name in enumerate(parameters, start=1):
            if places.isdisjoint((name, str(index))):
                raise DomainError(f"{pattern!r} does not name {{{name}}}", file=file, key=key)


def small_placeholders(pattern: str) -> str:
    """The pattern with its placeholders in lower case, as PDDL's parameters are."""
    return re.sub(r"\{[^{}]*\}", lambda place: place[0].lower(), pattern)


def _leftover(pattern: str) -> bool:
    while _GROUP.search(pattern):
        pattern = _GROUP.sub("", pattern)
    return "(" in pattern or ")" in pattern
