"""Mutex groups from Fast Downward's translator, which runs as a process of its own (it is GPL-3) and writes a file.

The translator proves which sets of atoms no action can bring from at most one true atom to two, and keeps those of
which exactly one is true in the initial state. Two things follow. The initial state has to be a legal one: a set that a
noisy estimate overfills would be dropped without a word. And it has to be complete, while a problem file may leave open
where things are, for the robot to see. So the state is completed here: atoms that no group covers yet are added, as
long as the translator then covers them and keeps every group that it had.

"Exactly one" is believed where no action breaks it (the translator says so: its variable has no value for "none of
them") and no accident does either. Anything can fall to where no atom speaks of it, the floor. A group survives that
if, whichever thing is lost, there is a member that does not mention the thing, and an action that leads there from each
that does: the gripper is empty once what it held is gone, but an item can be in no place at all.
"""

from __future__ import annotations

import importlib.util
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from executive.errors import MissingError
from executive.monitor.groups import Group
from executive.pddl import Condition, Equality, Forall, Literal, Schema
from executive.types import Atom

TRANSLATOR = "fast_downward.translate"
_OPTIONS = ("--full-encoding", "--keep-unimportant-variables")
"""Every group becomes a variable with all of its atoms, whether the goal needs it or not."""

log = logging.getLogger(__name__)


class Mutexes(NamedTuple):
    """The mutex groups of a task, sorted, and the legal state (its true atoms) that they were found from, in which
    exactly one atom of each is true."""

    groups: tuple[Group, ...]
    state: frozenset[Atom]


def find_mutexes(schema: Schema, *, timeout: float = 30.0) -> Mutexes:
    """The mutex groups of a task.

    Where the translator does not finish within `timeout` seconds (wall time, all its runs together) or fails, the
    groups that it has found so far are all there are, and a warning is logged: fewer groups mean less consistency, and
    nothing wrong.

    Raises:
        MissingError: the translator is not installed.
    """
    try:
        found = importlib.util.find_spec(TRANSLATOR)
    except ModuleNotFoundError:
        found = None
    if found is None:
        raise MissingError("Fast Downward's translator is not installed", command="pip install up-fast-downward")
    return _Completion(schema, time.monotonic() + timeout).complete()


class _TranslatorError(Exception):
    """The translator gave no answer, and why."""


class _Completion:
    """Makes the declared initial state a complete one, step by step, and keeps the groups of the last step."""

    def __init__(self, schema: Schema, deadline: float) -> None:
        self._schema, self._deadline = schema, deadline
        self._names = _Names(schema)
        changing = {effect.predicate for action in schema.actions.values() for effect in _literals(action.effects)}
        self._fluent = [atom for atom in schema.task.atoms if atom.predicate in changing]
        self._state = frozenset(schema.task.declared)
        self._groups: tuple[Group, ...] = ()

    def complete(self) -> Mutexes:
        try:
            self._groups = self._translate(self._state)
            refused: set[Atom] = set()
            while batch := self._batch(refused):
                refused |= self._add(batch)
        except _TranslatorError as failure:
            log.warning("%s; consistency rests on %d mutex groups", failure, len(self._groups))
        return Mutexes(self._groups, self._state)

    def _batch(self, refused: Iterable[Atom]) -> list[Atom]:
        """Atoms of one predicate that no group covers: one for each object that comes first in them, with the other
        objects as different as can be, so that two of them are hardly ever in one group."""
        covered = {atom for group in self._groups for atom in group.atoms}.union(refused, self._state)
        left = [atom for atom in self._fluent if atom not in covered]
        if not left:
            return []
        by_object: dict[tuple[str, ...], list[Atom]] = {}
        for atom in left:
            if atom.predicate == left[0].predicate:
                by_object.setdefault(atom.args[:1], []).append(atom)
        return [atoms[turn % len(atoms)] for turn, atoms in enumerate(by_object.values())]

    def _add(self, atoms: Sequence[Atom]) -> set[Atom]:
        """Add those of the atoms (of one predicate) that groups then cover, and return those that need not be tried."""
        groups = self._translate(self._state.union(atoms))
        now = [frozenset(group.atoms) for group in groups]
        kept = all(any(atoms_.issuperset(group.atoms) for atoms_ in now) for group in self._groups)
        if kept and frozenset().union(*now).issuperset(atoms):
            self._state, self._groups = self._state.union(atoms), groups
            return set()
        if len(atoms) == 1:  # it is too much for a group, or there is no group for atoms of its kind
            return set(atoms) if not kept else {atom for atom in self._fluent if atom.predicate == atoms[0].predicate}
        if refused := self._add(atoms[:1]):
            return refused.union(atoms)
        rest, half = atoms[1:], len(atoms) // 2
        return self._add(rest[:half]) | (self._add(rest[half:]) if rest[half:] else set())

    def _translate(self, state: Iterable[Atom]) -> tuple[Group, ...]:
        """The groups of which exactly one atom is true in a state.

        Raises:
            _TranslatorError: the translator ends with an error, or not in time.
        """
        with tempfile.TemporaryDirectory(prefix="executive-mutex-") as name:
            folder = Path(name)
            (folder / "domain.pddl").write_text(self._names.domain(), encoding="utf-8")
            (folder / "problem.pddl").write_text(self._names.problem(state), encoding="utf-8")
            command = [sys.executable, "-m", TRANSLATOR, *_OPTIONS, "--sas-file", "task.sas"]
            left = self._deadline - time.monotonic()
            try:
                if left <= 0:
                    raise subprocess.TimeoutExpired(command, 0)
                done = subprocess.run(
                    [*command, "domain.pddl", "problem.pddl"],
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                    errors="replace",
                    timeout=left,
                )
                sas = (folder / "task.sas").read_text(encoding="utf-8") if done.returncode == 0 else ""
            except subprocess.TimeoutExpired:
                raise _TranslatorError("Fast Downward's translator did not finish in time") from None
            except OSError as error:
                raise _TranslatorError(f"Fast Downward's translator cannot be run ({error.strerror})") from None
            if not sas:
                said = (done.stderr.strip() or done.stdout.strip()).splitlines()
                raise _TranslatorError(f"Fast Downward's translator failed ({said[-1] if said else done.returncode})")
        try:
            return tuple(sorted(_read(sas, self._names), key=lambda group: group.atoms))
        except (LookupError, RuntimeError, ValueError) as error:
            raise _TranslatorError(f"Fast Downward's translator wrote a file that cannot be read ({error!r})") from None


class _Names:
    """The task in PDDL under names that hit no word of PDDL's own, whatever it calls things. The goal is a flag that an
    action of no conditions sets, so that it can be reached from any state."""

    def __init__(self, schema: Schema) -> None:
        self._schema = schema
        self._objects = {name: f"o{number}" for number, name in enumerate(schema.typing.objects)}
        self._types = {name: f"t{number}" for number, name in enumerate(schema.typing.supertypes)}
        self._predicates = {name: f"p{number}" for number, name in enumerate(schema.predicates)}
        self._object_of = {new: name for name, new in self._objects.items()}
        self._predicate_of = {new: name for name, new in self._predicates.items()}

    def read(self, text: str) -> Atom | None:
        """The atom that the translator calls `Atom p1(o2, o3)`; None for the flag."""
        head, _, tail = text.removeprefix("Atom ").removesuffix(")").partition("(")
        if head not in self._predicate_of:
            return None
        return Atom(self._predicate_of[head], tuple(self._object_of[name] for name in tail.split(", ") if name))

    def domain(self) -> str:
        schema, kinds = self._schema, self._types
        above = schema.typing.supertypes.items()
        types = [f"{kinds[name]} - {'object' if parent is None else kinds[parent]}" for name, parent in above]
        objects = [f"{self._objects[name]} - {kinds[kind]}" for name, kind in schema.typing.objects.items()]
        predicates = []
        for name, signature in schema.predicates.items():
            terms = " ".join(f"?v{index} - {kinds[kind]}" for index, kind in enumerate(signature))
            predicates.append(f"({self._predicates[name]} {terms})")
        actions = ["(:action finish :parameters () :precondition () :effect (done))"]
        for number, action in enumerate(schema.actions.values()):
            scope = {variable: f"?v{index}" for index, (variable, _) in enumerate(action.parameters)}
            parameters = " ".join(f"{scope[variable]} - {kinds[kind]}" for variable, kind in action.parameters)
            # What is quantified is written out where it is a condition: the translator would make axioms of it. Where
            # it is an effect, it stays as it is: groups are found by looking at effects before they are grounded.
            conditions = [self._text(each, scope) for each in schema.typing.expand(action.preconditions, {})]
            effects = [self._text(each, scope) for each in action.effects]
            actions.append(
                f"(:action a{number} :parameters ({parameters})"
                f" :precondition (and {' '.join(conditions)}) :effect (and {' '.join(effects)}))"
            )
        lines = [
            "(define (domain task)",
            "(:requirements :adl :typing :equality)",
            f"(:types {' '.join(types)})",
            f"(:constants {' '.join(objects)})",
            f"(:predicates (done) {' '.join(predicates)})",
            *actions,
            ")",
        ]
        return "\n".join(lines)

    def problem(self, true: Iterable[Atom]) -> str:
        atoms = [
            f"({' '.join((self._predicates[atom.predicate], *(self._objects[name] for name in atom.args)))})"
            for atom in sorted(true)
        ]
        return f"(define (problem task) (:domain task) (:init {' '.join(atoms)}) (:goal (done)))"

    def _text(self, condition: Condition, scope: Mapping[str, str]) -> str:
        if isinstance(condition, Forall):
            inner = dict(scope)
            for variable, _ in condition.variables:
                inner[variable] = f"?v{len(scope) + len(inner)}"
            terms = " ".join(f"{inner[variable]} - {self._types[kind]}" for variable, kind in condition.variables)
            return f"(forall ({terms}) (and {' '.join(self._text(each, inner) for each in condition.body)}))"
        if isinstance(condition, Equality):
            words: tuple[str, ...] = ("=", self._term(condition.left, scope), self._term(condition.right, scope))
        else:
            words = (self._predicates[condition.predicate], *(self._term(term, scope) for term in condition.terms))
        text = f"({' '.join(words)})"
        return text if condition.positive else f"(not {text})"

    def _term(self, term: str, scope: Mapping[str, str]) -> str:
        return scope[term] if term.startswith("?") else self._objects[term]


@dataclass(frozen=True, slots=True)
class _Variable:
    """A variable of the translator's file: its values (None where none of the atoms is true), and from which value to
    which its operators lead."""

    values: tuple[Atom | None, ...]
    moves: frozenset[tuple[int, int]]

    @property
    def exact(self) -> bool:
        """Whether neither an action nor an accident leaves none of the atoms true."""
        things = {thing for atom in self.values if atom is not None for thing in atom.args}
        return None not in self.values and all(
            any((number, to) in self.moves for to in self._without(thing))
            for thing in things
            for number, atom in enumerate(self.values)
            if atom is not None and thing in atom.args
        )

    def _without(self, thing: str) -> Iterator[int]:
        return (number for number, atom in enumerate(self.values) if atom is not None and thing not in atom.args)


def _read(sas: str, names: _Names) -> Iterator[Group]:
    """The groups in a file of the translator (its format 3)."""
    lines = iter(sas.splitlines())
    values: list[tuple[Atom | None, ...]] = []
    moves: dict[int, set[tuple[int, int]]] = {}
    for line in lines:
        if line == "begin_variable":
            _name, _layer, size = (next(lines) for _ in range(3))
            texts = [next(lines) for _ in range(int(size))]
            values.append(tuple(names.read(text) if text.startswith("Atom ") else None for text in texts))
        elif line == "begin_operator":
            next(lines)
            for _ in range(int(next(lines))):  # what has to hold and stays
                next(lines)
            for _ in range(int(next(lines))):
                variable, before, after = map(int, next(lines).split()[-3:])
                moves.setdefault(variable, set()).add((before, after))
    for number, atoms in enumerate(values):
        variable_ = _Variable(atoms, frozenset(moves.get(number, ())))
        members = tuple(atom for atom in atoms if atom is not None)
        if len(members) > 1:
            yield Group(members, variable_.exact)


def _literals(conditions: Iterable[Condition]) -> Iterator[Literal]:
    for condition in conditions:
        if isinstance(condition, Forall):
            yield from _literals(condition.body)
        elif isinstance(condition, Literal):
            yield condition
