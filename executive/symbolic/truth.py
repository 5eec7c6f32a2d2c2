"""The ground truth of atoms in the symbolic world, for scores and for the blind baseline's start. Decisions never use
it: only what assembles a run and what scores one may import this module."""

from __future__ import annotations

from collections.abc import Iterable

from executive.symbolic.world import SymbolicWorld
from executive.types import Atom, Facts


class SymbolicTruth:
    """The ground truth."""

    def __init__(self, world: SymbolicWorld) -> None:
        self._world = world

    def of(self, atoms: Iterable[Atom]) -> Facts:
        """The ground truth of each atom now."""
        state = self._world.state
        return Facts({atom: state[atom] for atom in atoms})
