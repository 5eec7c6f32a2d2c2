"""The ground truth of atoms in the simulator, for the oracle estimator, labels and scores. Decisions never use it: only
what assembles a run and what scores one may import this module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import mujoco

from executive.relations import Scene
from executive.relations.kinds import read_relation_kinds
from executive.sim.solids import Solids
from executive.sim.world import MujocoWorld
from executive.types import Atom, Belief, Facts, Observation


class Truth:
    """The ground truth.

    Args:
        world: the simulated world.
        relations: predicate -> the relation that is its truth (see `executive.relations.kinds`).
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
        self._world, self._solids = world, Solids(world.model, world.spec)
        self.relation_kinds = read_relation_kinds(relations, parameters, file)

    def of(self, atoms: Sequence[Atom]) -> Facts:
        """The ground truth of each atom now."""
        scene, kinds = self.scene(), self.relation_kinds
        return Facts({atom: kinds[atom.predicate].holds(scene, atom) for atom in atoms})

    def scene(self) -> Scene:
        """What is where now."""
        mujoco.mj_forward(self._world.model, self._world.data)
        return self._solids.scene(self._world.data)


class Oracle:
    """The estimator that returns the ground truth: probability 0 or 1 for every atom."""

    name = "oracle"

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """The truth at this moment, which is the moment of the observation when called right after it."""
        return Belief.certain(self._truth.of(atoms), observation.id, self.name)
