"""The label space of training: the items of a task, its drawers among them, and the atoms that can be true of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from executive.domain.loader import Domain
from executive.s3e.questions.templates import plain
from executive.sim.spec import read_scene
from executive.types import Atom


@dataclass(frozen=True, slots=True)
class LabelSpace:
    """A task's atoms arranged by item.

    `items` are the objects that can move, drawers too, sorted. A facet is an item with an atom that names it: `facets`
    holds them all as (index of the item, index of the atom), so that an atom about two items is a facet of both.
    """

    items: tuple[str, ...]
    atoms: tuple[Atom, ...]
    facets: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, domain: Domain) -> LabelSpace:
        task = domain.task
        spec = read_scene(domain.scene).restricted_to(task.objects, domain.scene)
        items = tuple(sorted([*(item.name for item in spec.items), *(drawer.name for drawer in spec.drawers)]))
        facets = tuple(
            (number, index)
            for number, item in enumerate(items)
            for index, atom in enumerate(task.atoms)
            if item in atom.args
        )
        return cls(items, task.atoms, facets)

    @property
    def facet_items(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.array([item for item, _ in self.facets])

    @property
    def facet_atoms(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.array([atom for _, atom in self.facets])

    def of_item(self, item: int) -> list[int]:
        """The indices of an item's facets."""
        return [number for number, (owner, _) in enumerate(self.facets) if owner == item]

    def label(self, facet: int) -> str:
        """A one- or two-word label of a facet: the other arguments of its atom, or else the last word of its
        predicate."""
        item, index = self.facets[facet]
        atom = self.atoms[index]
        others = [plain(name) for name in atom.args if name != self.items[item]]
        return " ".join(others) or plain(atom.predicate).split()[-1]


def fits(atoms: Sequence[str], labels: LabelSpace) -> bool:
    """Whether the labels of a data set are these atoms, in this order."""
    return list(atoms) == [str(atom) for atom in labels.atoms]
