"""Draws what a problem's :init leaves open, for the worlds that play it. The robot is never told what was drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from executive.domain.pddl import Schema
from executive.planning.mutex_groups import find_mutexes
from executive.types import Atom


def draw_initial(
    schema: Schema,
    rng: np.random.Generator,
    *,
    leaves_open: bool = True,
    timeout: float = 30.0,
    usual: Mapping[Atom, float] = MappingProxyType({}),
) -> frozenset[Atom]:
    """Return the atoms that are true at first: what :init says, one atom of each `(oneof ...)`, and with even chances
    each that it calls unknown, as long as that fills no mutex group twice.

    Args:
        leaves_open: whether :init may leave open what it does not name. If so, an atom of each mutex group that has
            none is drawn, too: one that :init calls unknown, where it does so.
        usual: where things usually are, by which one of each `(oneof ...)` is drawn (see `draw_one`).
        timeout: the wall seconds that finding the mutex groups may take.

    Raises:
        MissingError: Fast Downward's translator is not installed.
    """
    true = set(schema.task.declared)
    if not (leaves_open or schema.unknown or schema.oneof):
        return frozenset(true)
    groups = find_mutexes(schema, timeout=timeout, leaves_open=leaves_open).groups

    def full() -> set[Atom]:
        return {atom for group in groups if true.intersection(group.atoms) for atom in group.atoms}

    for atoms in schema.oneof:
        # With two things that exclude each other, what is left may be fewer; with none left, :init contradicts itself.
        free = [atom for atom in atoms if atom not in full()] or list(atoms)
        true.add(draw_one(free, usual, rng))
    closed = {atom for atoms in schema.oneof for atom in atoms}
    for group in groups if leaves_open else ():
        taken = full() | closed
        free = [atom for atom in group.atoms if atom not in taken]
        free = [atom for atom in free if atom in schema.unknown] or free
        if free and true.isdisjoint(group.atoms):
            true.add(free[int(rng.integers(len(free)))])
    for atom in sorted(schema.unknown):
        if atom not in full() and rng.random() < 0.5:
            true.add(atom)
    return frozenset(true)


def draw_one(atoms: Sequence[Atom], usual: Mapping[Atom, float], rng: np.random.Generator) -> Atom:
    """Draw one of some atoms, each as often as is usual; those of which nothing is said share the rest evenly, and
    where nothing is said of any, all do."""
    if usual.keys().isdisjoint(atoms):
        return atoms[int(rng.integers(len(atoms)))]
    open_ = sum(atom not in usual for atom in atoms)
    rest = max(0.0, 1.0 - sum(usual.get(atom, 0.0) for atom in atoms)) / max(1, open_)
    weights = np.array([usual.get(atom, rest) for atom in atoms])
    total = float(weights.sum())
    return atoms[int(rng.choice(len(atoms), p=weights / total if total > 0.0 else None))]
