"""The ground truth of atoms in the simulator, for the oracle estimator, labels and scores. Decisions never use it: only
what assembles a run and what scores one may import this module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import mujoco

from executive.sim.relation_kinds import RelationKind, read_relation_kinds
from executive.sim.relations import SimState
from executive.sim.world import MujocoWorld
from executive.types import Atom, Belief, Facts, Observation


class Truth:
    """The ground truth.

    Args:
        world: the simulated world.
        relations: predicate -> the relation that is its truth (see `executive.sim.relation_kinds`).
        parameters: predicate -> the names of its parameters, to be held against the relation's.
        file: the domain file, for the error message.

    Raises:
        DomainError: a relation is not registered, or takes another number of objects than its predicate.
    """

    def __init__(
        self,
        world: MujocoWorld,
        relations: Mapping[str, str],
        parameters: Mapping[str, Sequence[str]] = MappingProxyType({}),
        file: Path | None = None,
    ) -> None:
        self._world = world
        self.relation_kinds = read_relation_kinds(relations, parameters, file)

    def of(self, atoms: Sequence[Atom]) -> Facts:
        """The ground truth of each atom now."""
        world = self._world
        mujoco.mj_forward(world.model, world.data)
        tables = {table.name: table for table in world.spec.tables}
        state = SimState(world.model, world.data, tables, tuple(world.shapes))
        return Facts({atom: self._holds(self.relation_kinds[atom.predicate], state, atom) for atom in atoms})

    @staticmethod
    def _holds(kind: RelationKind, state: SimState, atom: Atom) -> bool:
        return bool(kind.relation(state, *kind.about(atom)))


class Oracle:
    """The estimator that returns the ground truth: probability 0 or 1 for every atom."""

    name = "oracle"

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """The truth at this moment, which is the moment of the observation when called right after it."""
        return Belief.certain(self._truth.of(atoms), observation.id, self.name)
