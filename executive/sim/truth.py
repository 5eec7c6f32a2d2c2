"""The ground truth of atoms in the simulator, for the oracle estimator, labels and scores. Decisions never use it: only
what assembles a run and what scores one may import this module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import mujoco

from executive.relations import Scene
from executive.relations.kinds import read_relation_kinds
from executive.sim.solids import Solids
from executive.sim.world import MujocoWorld
from executive.types import Atom, Belief, Facts, Frame, Observation


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
        self._aside: mujoco.MjData | None = None
        self.relation_kinds = read_relation_kinds(relations, parameters, file)

    def of(self, atoms: Sequence[Atom]) -> Facts:
        """The ground truth of each atom now."""
        return self._facts(self.scene(), atoms)

    def watched(self, atoms: Sequence[Atom]) -> Facts:
        """The ground truth of each atom now, worked out beside the world, which goes on as if nobody had watched: a
        solver that is asked once more begins its next step from elsewhere."""
        if self._aside is None:
            self._aside = mujoco.MjData(self._world.model)
        self._world.copy_state(self._aside)
        mujoco.mj_forward(self._world.model, self._aside)
        return self._facts(self._solids.scene(self._aside), atoms)

    def of_frame(self, frame: Frame, atoms: Sequence[Atom], tolerance: float) -> Facts:
        """What is true where a recorded frame has everything. Poses that were rounded touch within a `tolerance` in m,
        and the hand grips what its fingers touch while they are told to close.

        Everything in the world is moved to where the frame has it."""
        self._world.show(frame)
        closing = frame.command is not None and bool(frame.command[-1] > 0.5)
        return self._facts(replace(self.scene(), tolerance=tolerance, feels=closing), atoms)

    def _facts(self, scene: Scene, atoms: Sequence[Atom]) -> Facts:
        return Facts({atom: self.relation_kinds[atom.predicate].holds(scene, atom) for atom in atoms})

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
