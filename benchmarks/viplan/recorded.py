"""Recorded answers of vision-language models in ViPlan's form, and the planning tasks that they are about."""

from __future__ import annotations

import gzip
import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from executive.domain.pddl import Schema, read_task
from executive.errors import InputError
from executive.types import Atom


class Answer(NamedTuple):
    """What a model says of an atom: yes, no, or neither (None), how probable it takes yes to be, if it says so, and
    whether the atom is true."""

    yes: bool | None
    probability: float | None
    truth: bool


class Look(NamedTuple):
    """The answers to the questions of one moment. `kind` is all, preconditions or effects (of `action`)."""

    kind: str
    step: int
    action: Atom | None
    worked: bool
    answers: Mapping[Atom, Answer]


@dataclass(frozen=True, slots=True)
class Run:
    """A model's answers along one problem; `reached` is whether it was published as solved."""

    model: str
    split: str
    problem: str
    reached: bool
    looks: tuple[Look, ...]

    @property
    def unit(self) -> tuple[str, str]:
        """The problem: what is left out, all of it, where something is learned for it."""
        return self.split, self.problem


def read_runs(file: Path) -> list[Run]:
    """Read recorded runs, one JSON document a line.

    Raises:
        InputError: the file cannot be read, or a line is none of that form.
    """
    found = []
    try:
        with gzip.open(file, "rt", encoding="utf-8") as lines:
            for number, line in enumerate(lines, 1):
                try:
                    found.append(_run(json.loads(line)))
                except (KeyError, TypeError, ValueError, AttributeError) as error:
                    raise InputError(f"line {number} is no recorded run ({error!r})", file=file) from None
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read as compressed JSON lines ({error})", file=file) from None
    if not found:
        raise InputError("has no run", file=file)
    return found


def _run(said: Mapping[str, Any]) -> Run:
    looks = tuple(_look(look) for look in said["looks"])
    return Run(said["model"], said["split"], said["problem"], bool(said["goal_reached"]), looks)


def _look(said: Mapping[str, Any]) -> Look:
    action = said.get("action")
    answers = {Atom.parse(name): _answer(*kept) for name, kept in said["answers"].items()}
    return Look(
        said["kind"], said["step"], Atom.parse(action) if action else None, said.get("worked") == "success", answers
    )


def _answer(word: str, yes: float | None, no: float | None, truth: bool) -> Answer:
    probability = None if yes is None or no is None or yes + no <= 0.0 else yes / (yes + no)
    return Answer({"yes": True, "no": False}.get(str(word).strip().lower()), probability, truth)


class Tasks:
    """The tasks in a file that maps the names of PDDL files to their texts; each is read when it is asked for.

    Raises:
        InputError: the file cannot be read, or it has no domain.
    """

    def __init__(self, file: Path) -> None:
        try:
            with gzip.open(file, "rt", encoding="utf-8") as source:
                self.texts: dict[str, str] = json.load(source)
            self._domain = self.texts["domain.pddl"]
        except (OSError, EOFError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"has no domain and problems as compressed JSON ({error!r})", file=file) from None
        self._file = file
        self._read: dict[str, Schema] = {}

    def schema(self, run: Run) -> Schema:
        """Return the task of a run.

        Raises:
            InputError: there is no such problem, or it cannot be read.
        """
        name = run.problem.partition(".pddl")[0] + ".pddl"
        matching = [key for key in self.texts if key.endswith(f"{run.split}/{name}")]
        if len(matching) != 1:
            raise InputError(f"has no problem {run.split}/{name}", file=self._file)
        if matching[0] not in self._read:
            with tempfile.TemporaryDirectory(prefix="executive-viplan-") as folder:
                domain, problem = Path(folder, "domain.pddl"), Path(folder, "problem.pddl")
                domain.write_text(self._domain, encoding="utf-8")
                problem.write_text(self.texts[matching[0]], encoding="utf-8")
                self._read[matching[0]] = read_task(domain, problem)
        return self._read[matching[0]]
