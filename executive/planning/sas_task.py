"""A task grounded once, and searched again and again by Fast Downward's search alone.

What costs time in asking a planner is not the search: it is reading PDDL, grounding it and starting interpreters. Here
every action is grounded once, when the task is read, and a state and a goal become a few lines of a file in the
format that Fast Downward's search reads (version 3 of its translator's): a variable with two values for each atom, so
that every state and every goal can be written down, and an operator for each grounded action that can change
something (the search refuses operators without effects). Which invariants there are need not be known.

Fast Downward is GPL-3. Nothing of it is imported: its search is a program that runs in a process of its own.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from executive.domain.pddl import Schema
from executive.errors import MissingError
from executive.types import Atom, Step

PACKAGE, ENGINE = "up_fast_downward", "downward/builds/release/bin/downward"
"""Fast Downward's search, and the package that brings it."""

SOLVED, UNSOLVABLE, OUT_OF_TIME = 0, 11, 23
"""Exit codes of the search; UNSOLVABLE only where that is proven."""

_FENCE = 'cd "$1" && ulimit -t "$2" && shift 2 && exec "$@" < task.sas'
"""Runs the search in a directory of its own, and with a limit on CPU seconds that ends it even where this process was
killed and can end nothing any more."""


_BOOKKEEPING = re.compile(
    r"(?i)^\[t=|^INFO\b|exit ?code|^peak memory|^\w+ time:|^remove intermediate|^driver aborting|^usage error occurred"
)
"""Lines that Fast Downward prints however it ended."""

_LEAST = ("--search", "eager_greedy([lmcut()], bound=0)")
"""Works out one heuristic value and ends: no state is worth going on from."""


def size(schema: Schema) -> int:
    """How many grounded actions a task may have at most."""
    members = {kind: len(schema.typing.members(kind)) for kind in {*schema.typing.supertypes, "object"}}
    return sum(math.prod(members[kind] for _, kind in action.parameters) for action in schema.actions.values())


@dataclass(frozen=True, slots=True)
class Answer:
    """How the search ended: its exit code (negative where it was killed), its plan, what it said, and whether it was
    ended because its time was up."""

    code: int
    steps: tuple[Step, ...]
    said: str
    expired: bool

    @property
    def last_words(self) -> str:
        """The line that says most about how it ended."""
        return last_words(self.said.splitlines())


def last_words(lines: Sequence[str]) -> str:
    """Of what an engine printed, the line that says most about how it ended: the last one that it does not print
    however it ends, or else the last."""
    said = [line.strip() for line in lines if line.strip()]
    telling = [line for line in said if not _BOOKKEEPING.search(line)]
    return (telling or said or ["it said nothing"])[-1]


class Grounded:
    """All grounded actions of a task that can change something. They take time: `ground` has to be called until it is
    done with them."""

    def __init__(self, schema: Schema) -> None:
        self._steps: list[Step] = []
        self._operators: list[str] = []
        self._fixed: list[tuple[tuple[Atom, bool], ...]] = []
        self._makes: dict[Atom, set[bool]] = {}
        self._number = {atom: number for number, atom in enumerate(schema.task.atoms)}
        self._work = self._grounding(schema)
        self._head = "\n".join(
            [
                "begin_version\n3\nend_version\nbegin_metric\n0\nend_metric",
                str(len(self._number)),
                *(
                    f"begin_variable\nv{n}\n-1\n2\nAtom a{n}()\nNegatedAtom a{n}()\nend_variable"
                    for n in self._number.values()
                ),
                "0",
            ]
        )

    def __len__(self) -> int:
        return len(self._steps)

    def ground(self, stop: Callable[[], bool]) -> bool:
        """Go on with the grounding until it is done or is to `stop`, which is asked after each action; whether it is
        done. Not to be called from two threads at once."""
        return not any(stop() for _ in self._work)

    def _grounding(self, schema: Schema) -> Iterator[None]:
        for name, action in schema.actions.items():
            for args in schema.typing.tuples([kind for _, kind in action.parameters]):
                with contextlib.suppress(ValueError):  # this one contradicts itself
                    step = schema.ground(name, args)
                    if not step.precondition.facts.entails(step.unconditional):
                        self._operators.append(self._operator(len(self._steps), step))
                        self._steps.append(step)
                        for atom, value in step.unconditional.items():
                            self._makes.setdefault(atom, set()).add(value)
                yield
        for step in self._steps:
            fixed = ((atom, value) for atom, value in step.precondition.facts.items() if atom not in self._makes)
            self._fixed.append(tuple(fixed))
            yield

    def task(
        self, true: frozenset[Atom], goal: Sequence[tuple[Atom, bool]], avoid: Collection[Step] = frozenset()
    ) -> str:
        """The file for the search from the state in which exactly the atoms in `true` are true, without the actions in
        `avoid`."""
        state = "\n".join("0" if atom in true else "1" for atom in self._number)
        goals = "\n".join(f"{self._number[atom]} {0 if value else 1}" for atom, value in goal)
        # What no action changes is as it is: an action that needs it otherwise can never be carried out, and one that
        # would make it so changes nothing.
        lasting = {atom for atom, values in self._makes.items() if values == {atom in true}}
        operators = [
            text
            for step, text, fixed in zip(self._steps, self._operators, self._fixed, strict=True)
            if all((atom in true) is value for atom, value in fixed)
            and not (lasting and lasting.issuperset(step.affects))
            and not (avoid and step in avoid)
        ]
        return "\n".join(
            [
                self._head,
                f"begin_state\n{state}\nend_state",
                f"begin_goal\n{len(goal)}\n{goals}\nend_goal",
                str(len(operators)),
                *operators,
                "0\n",
            ]
        )

    def search(self, engine: Path, task: str, options: Sequence[str], seconds: float) -> Answer:
        """What the search finds within `seconds` (wall time). Nothing of it runs on afterwards, whatever happens."""
        with tempfile.TemporaryDirectory(prefix="executive-plan-") as name:
            folder = Path(name)
            (folder / "task.sas").write_text(task, encoding="ascii")
            command = [str(engine), *options, "--internal-plan-file", "plan"]
            process = subprocess.Popen(
                ["sh", "-c", _FENCE, "sh", name, str(math.ceil(seconds) + 1), *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
            expired = False
            try:
                said, _ = process.communicate(timeout=seconds)
            except subprocess.TimeoutExpired:
                expired, said = True, ""
            finally:
                _end(process)
            plan = folder / "plan"
            lines = plan.read_text(encoding="ascii").splitlines() if plan.exists() else []
        steps = tuple(self._steps[int(line[2:-1])] for line in lines if line.startswith("("))
        return Answer(process.returncode, steps, said, expired)

    def least(self, engine: Path, task: str, seconds: float) -> int | None:
        """So many steps every plan has at least, by LM-cut in the first state; None where that is not told in time."""
        told = re.search(
            r"Initial heuristic value for lmcut\S*: (\d+)", self.search(engine, task, _LEAST, seconds).said
        )
        return None if told is None else int(told[1])

    def _operator(self, number: int, step: Step) -> str:
        needs = {self._number[atom]: 0 if value else 1 for atom, value in step.precondition.facts.items()}
        gives = {self._number[atom]: 0 if value else 1 for atom, value in step.unconditional.items()}
        kept = [f"{atom} {value}" for atom, value in needs.items() if gives.get(atom, value) == value]
        changed = [
            f"0 {atom} {needs.get(atom, -1)} {value}" for atom, value in gives.items() if needs.get(atom) != value
        ]
        lines = [
            "begin_operator",
            f"s{number}",
            str(len(kept)),
            *kept,
            str(len(changed)),
            *changed,
            "1",
            "end_operator",
        ]
        return "\n".join(lines)


def find_engine() -> Path:
    """Where Fast Downward's search is.

    Raises:
        MissingError: it is not installed.
    """
    package = importlib.util.find_spec(PACKAGE)
    for place in () if package is None else package.submodule_search_locations or ():
        if (Path(place) / ENGINE).exists():
            return Path(place) / ENGINE
    raise MissingError("Fast Downward is not installed", command="pip install up-fast-downward")


def _end(process: subprocess.Popen[str]) -> None:
    """Kill a process and the group that it leads. There is nothing in it worth a farewell."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
