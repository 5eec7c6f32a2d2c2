"""From records of runs to where things usually are.

Of each mutex group that has atoms which cannot always be seen, a run tells which was true when it began, or at least
which were not: those that were seen to be false before anything was done to them. What a run never found counts, too,
shared out among what is left as probably as it is by all runs together (expectation maximisation, Dempster, Laird and
Rubin 1977): else the places that are looked at last would seem to be those where nothing is.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

from executive.app.config import CONFIG
from executive.belief import BayesMonitor
from executive.domain.loader import load_domain
from executive.domain.places import write_places
from executive.errors import InputError
from executive.trace.record import monitor_file
from executive.trace.record.log import read_events
from executive.types import Atom, Dispatched, Event, Judged, Started, Task

_ROUNDS = 50
_STEPS = 10_000
"""Probabilities are kept in ten-thousandths, rounded down: together they are never more than one."""

Found: TypeAlias = "dict[frozenset[Atom], Counter[frozenset[Atom]]]"
"""By mutex group, how often its true atom was one of these at first."""


class Learned(NamedTuple):
    """Where things usually are, and from how many runs that is known."""

    file: Path
    priors: Mapping[Atom, float]
    runs: int


def learn_places(domain: str, folders: Sequence[Path], out: Path, problem: str | None = None) -> Learned:
    """Learn from the records of some runs where things usually are, and write it into a file.

    Raises:
        DomainError: the domain has a mistake.
        InputError: a folder is no run's, or one of another domain or without a memory; no run tells of anything that
            cannot always be seen; or the file cannot be written.
    """
    loaded = load_domain(domain, problem)
    found: Found = {}
    for folder in folders:
        if not os.path.isfile(folder / CONFIG):
            raise InputError("is no folder of a run", file=folder)
        _add(found, folder, loaded.name)
    priors = {atom: value for group, told in found.items() for atom, value in shares(group, told).items()}
    if not priors:
        raise InputError("no run has anything that cannot always be seen (`visible` in domain.toml)", file=folders[0])
    return Learned(write_places(out, priors, len(folders)), priors, len(folders))


def shares(group: Iterable[Atom], told: Mapping[frozenset[Atom], int]) -> dict[Atom, float]:
    """Return how probable each atom of a group is, by how often the true one was among some of them."""
    atoms = sorted(group)
    even = 1.0 / len(atoms)
    total = sum(told.values()) + 1.0
    found = dict.fromkeys(atoms, even)
    for _ in range(_ROUNDS):
        counts = dict.fromkeys(atoms, even)  # one observation more
        for among, times in told.items():
            whole = math.fsum(found[atom] for atom in among)
            for atom in among:
                counts[atom] += times * found[atom] / whole
        found = {atom: count / total for atom, count in counts.items()}
    return {atom: math.floor(value * _STEPS + 1e-9) / _STEPS for atom, value in found.items()}


def _add(found: Found, folder: Path, domain: str) -> None:
    events = list(read_events(folder, images=False))
    started = next((event.payload for event in events if isinstance(event.payload, Started)), None)
    if started is None or started.domain != domain:
        what = "none" if started is None else f"domain {started.domain!r}"
        raise InputError(f"is a run of {what}, and not of {domain!r}", file=folder)
    monitor = monitor_file.load(folder, started.task.atoms)
    if not isinstance(monitor, BayesMonitor):
        raise InputError("has no memory of what it saw (--threshold)", file=folder)
    may_be = at_first(events, started.task)
    for each in monitor.network.groups:
        atoms = frozenset(each.atoms)
        if not atoms.isdisjoint(started.task.visible) and (among := may_be & atoms):
            found.setdefault(atoms, Counter())[among] += 1


def at_first(events: Iterable[Event], task: Task) -> frozenset[Atom]:
    """Return the atoms that may have been true when a run began: all but those that were seen to be false, directly or
    as another of their group was seen to be true, before an action could change them."""
    touched: set[Atom] = set()
    seen: dict[Atom, bool] = {}
    for event in events:
        match event.payload:
            case Dispatched(step=step):
                touched.update(step.affects)
            case Judged(seen=told):
                for atom, value in told.items():
                    if atom not in touched:
                        seen.setdefault(atom, value)
    return frozenset(atom for atom in task.atoms if seen.get(atom) is not False)
