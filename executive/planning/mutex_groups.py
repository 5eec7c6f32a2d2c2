"""Mutex groups from Fast Downward's translator, which runs as a process of its own (it is GPL-3) and writes a file.

The translator proves which sets of atoms no action can bring from at most one true atom to two, and keeps those of
which exactly one is true in the initial state. Two things follow. The initial state has to be a legal one: a set that a
noisy estimate overfills would be dropped without a word. And it has to be complete, while a problem file may leave open
where things are, for the robot to see. So the state is completed first: the translator is asked which invariants the
actions have, whatever the state; where the declared state fills one with no atom, an atom is chosen that fills it and
overfills no other, the one that lets most actions become possible. What invariants do not speak of may be true as well
as false, and is true where an action needs it.

"Exactly one" is believed where no action breaks it (the translator says so: its variable has no value for "none of
them") and no accident does either. Anything can fall to where no atom speaks of it, the floor. A group survives that
if, whichever thing is lost, there is a member that does not mention the thing, and an action that leads there from each
that does: the gripper is empty once what it held is gone, but an item can be in no place at all.
"""

from __future__ import annotations

import contextlib
import logging
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from executive.belief.mutex_inference import Group
from executive.domain.pddl import Schema
from executive.planning.pddl_text import FINISH, PddlText
from executive.planning.programs import TRANSLATOR, translator_command
from executive.planning.sas_task import size
from executive.planning.translation import FILE, TranslatorError, run_translator
from executive.types import Atom

_INVARIANTS = f"{TRANSLATOR}.invariant_finder"
_OPTIONS = ("--full-encoding", "--keep-unimportant-variables", *FILE)
"""Every group becomes a variable with all of its atoms, whether the goal needs it or not."""

_PART = re.compile(r"(\w+)\(\(([-\d, ]*)\)\)")
"""What the translator prints of an invariant: each predicate with the invariant's parameters, -1 for what is counted,
such as {p0((0, -1)) [omitted_pos = 1], p1((0,)) [omitted_pos = None]}."""

MOST_MOVES = 20_000
"""With more grounded actions than this, the initial state is completed without the analysis of reachability."""

log = logging.getLogger(__name__)


class Mutexes(NamedTuple):
    """The mutex groups of a task, sorted; the legal state (its true atoms) that they were found from, in which exactly
    one atom of each is true; and how many grounded actions that state allows (None: the translator failed)."""

    groups: tuple[Group, ...]
    state: frozenset[Atom]
    actions: int | None = None


def find_mutexes(
    schema: Schema, *, timeout: float = 30.0, patience: float | None = None, leaves_open: bool = True
) -> Mutexes:
    """The mutex groups of a task. Unless its :init `leaves_open` where things are, it is taken as it is.

    Where the translator does not finish within `timeout` seconds of processor time, or all that is done within
    `patience` seconds of wall time (by default as many), or it fails, there are none, and a warning is logged: without
    groups there is no consistency, but nothing is wrong either. Processor time is what decides: what a run believes is
    not to hang on how busy the machine is.

    Raises:
        MissingError: the translator is not installed.
    """
    translator_command()  # what is missing is an error, and not a translator that fails
    text, deadline = PddlText(schema), time.monotonic() + (timeout if patience is None else patience)
    domain, declared = text.domain(FINISH), _declared(schema)

    def left() -> float:
        return deadline - time.monotonic()

    try:
        state, sets = declared, list[frozenset[Atom]]()
        if leaves_open or schema.oneof or schema.unknown:
            said = run_translator(domain, text.problem(declared), left(), module=_INVARIANTS, processor=timeout)
            sets = _instances(said, text)
        if leaves_open:
            state = _Completion(schema, sets, deadline).complete()
        sas = run_translator(domain, text.problem(state), left(), _OPTIONS, processor=timeout)
        found = _with_numbers(_extended(_read(sas, text), sets, schema, state), schema, state)
        groups = tuple(sorted(found, key=lambda group: group.atoms))
        return Mutexes(groups, state, sas.count("begin_operator") - 1)  # but for the one that finishes
    except TranslatorError as failure:
        problem = str(failure)
    except (LookupError, RuntimeError, ValueError) as error:
        problem = f"Fast Downward's translator wrote what cannot be read ({error!r})"
    log.warning("%s; answers are not made consistent", problem)
    return Mutexes(tuple(_with_numbers((), schema, declared)), declared)


def _extended(
    groups: Iterable[Group], sets: Sequence[frozenset[Atom]], schema: Schema, state: frozenset[Atom]
) -> Iterator[Group]:
    """The groups, with atoms that no action makes true but that may be so at first, as :init leaves it open or they
    cannot always be seen. A set of which no action makes two true from one grows by them."""
    known = list(groups)
    grouped = {atom for group in known for atom in group.atoms}
    may_be = (schema.unknown.union(*schema.oneof) | schema.task.visible.keys()) - grouped
    kept = [atoms for atoms in sets if not atoms.isdisjoint(may_be) and len(atoms & state) <= 1]
    for group in known:
        wider = [atoms for atoms in kept if atoms.issuperset(group.atoms)]
        more = frozenset[Atom]().union(*(atoms & may_be for atoms in wider[:1]))
        yield Group((*group.atoms, *sorted(more)), group.exact and not more)
    for atoms in kept:
        own = atoms & (may_be | grouped)
        if not any(own & set(group.atoms) for group in known) and len(own) > 1:
            yield Group(tuple(own))


def _declared(schema: Schema) -> frozenset[Atom]:
    """What :init says is so; of what it says that one of several is, the first: all lead to the same groups."""
    return schema.task.declared.union(atoms[0] for atoms in schema.oneof)


def _with_numbers(groups: Iterable[Group], schema: Schema, state: frozenset[Atom]) -> Iterator[Group]:
    """The groups, and for each numeric fluent one of its values, in the place of any that are about these alone."""
    values = [frozenset(atom for _, atom in fluent.values) for fluent in schema.task.fluents]
    yield from (group for group in groups if not any(each.issuperset(group.atoms) for each in values))
    yield from (Group(tuple(each), exact=not each.isdisjoint(state)) for each in values)


def _in_time(deadline: float) -> None:
    """
    Raises:
        TranslatorError: it is later.
    """
    if time.monotonic() > deadline:
        raise TranslatorError("Fast Downward's translator did not finish in time", late=True)


def _instances(said: str, names: PddlText) -> list[frozenset[Atom]]:
    """The sets of atoms that the printed invariants are about, for all objects."""
    found: dict[tuple[int, tuple[str, ...]], set[Atom]] = {}
    invariants = (line for line in said.splitlines() if line.startswith("{"))
    for number, line in enumerate(dict.fromkeys(invariants)):
        for name, terms in _PART.findall(line):
            where = [int(term) for term in terms.split(",") if term.strip()]
            for atom in names.atoms(name):
                fixed = sorted((index, arg) for index, arg in zip(where, atom.args, strict=True) if index >= 0)
                found.setdefault((number, tuple(arg for _, arg in fixed)), set()).add(atom)
    return [frozenset(found[key]) for key in sorted(found)]


class _Completion:
    """Completes the declared initial state. `sets` are the sets of atoms of which exactly one should be true."""

    def __init__(self, schema: Schema, sets: Sequence[frozenset[Atom]], deadline: float) -> None:
        self._deadline = deadline
        self._state = set(_declared(schema))
        # What the declared state overfills is no invariant of this task.
        self._sets = [atoms for atoms in sets if len(atoms & self._state) <= 1]
        self._of: dict[Atom, list[frozenset[Atom]]] = {}
        for atoms in self._sets:
            for atom in atoms:
                self._of.setdefault(atom, []).append(atoms)
        self._moves = _moves(schema, deadline)
        self._waiting: dict[Atom, list[_Move]] = {}
        for move in self._moves:
            for atom in move.needs:
                self._waiting.setdefault(atom, []).append(move)
        self._possible: set[Atom] = set()
        unconditional = (move.gives for move in self._moves if not move.needs)
        self._possible = self._opened(self._state.union(*unconditional))

    def complete(self) -> frozenset[Atom]:
        for atoms in self._sets:
            _in_time(self._deadline)
            if not atoms & self._state:
                self._add(atom for atom in sorted(atoms) if not any(other & self._state for other in self._of[atom]))
        free = {atom for move in self._moves for atom in move.changes} - self._of.keys()
        for move in self._moves:
            _in_time(self._deadline)
            for atom in sorted(move.needs & free):
                if atom not in self._possible:
                    self._add([atom])
        return frozenset(self._state)

    def _add(self, options: Iterable[Atom]) -> None:
        """Make one of the atoms true, if there are any: the first of those that open up most."""
        opened = {atom: self._opened([atom]) for atom in options}
        if opened:
            atom = max(opened, key=lambda option: len(opened[option]))
            self._state.add(atom)
            self._possible |= opened[atom]

    def _opened(self, atoms: Iterable[Atom]) -> set[Atom]:
        """What becomes possible once `atoms` are true: they, and the effects of actions whose conditions are then all
        possible, as if nothing were ever deleted or had to be false."""
        opened: set[Atom] = set()
        frontier = list(atoms)
        while frontier:
            atom = frontier.pop()
            if atom not in opened and atom not in self._possible:
                opened.add(atom)
                for move in self._waiting.get(atom, ()):
                    if all(each in opened or each in self._possible for each in move.needs):
                        frontier.extend(move.gives)
        return opened


class _Move(NamedTuple):
    """A grounded action: the atoms that it needs to be true, that it makes true, and that it changes."""

    needs: frozenset[Atom]
    gives: frozenset[Atom]
    changes: frozenset[Atom]


def _moves(schema: Schema, deadline: float) -> list[_Move]:
    """Every grounded action of a task; none if there are too many."""
    if size(schema) > MOST_MOVES:
        return []
    found = []
    for name in schema.actions:
        for args in schema.arguments(name):
            _in_time(deadline)
            with contextlib.suppress(ValueError):  # this one contradicts itself
                step = schema.ground(name, args)
                found.append(_Move(step.precondition.facts.true, step.unconditional.true, frozenset(step.affects)))
    return found


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


def _read(sas: str, names: PddlText) -> Iterator[Group]:
    """The groups in a file of the translator (its format 3)."""
    lines = iter(sas.splitlines())
    values: list[tuple[Atom | None, ...]] = []
    moves: dict[int, set[tuple[int, int]]] = {}
    for line in lines:
        if line == "begin_variable":
            _name, _layer, size = (next(lines) for _ in range(3))
            texts = [next(lines) for _ in range(int(size))]
            values.append(tuple(names.atom(text) if text.startswith("Atom ") else None for text in texts))
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
