"""The simulator's truth per atom: the oracle estimator, labels and scores. Decisions never come here on their own;
only what assembles a run and what scores one may import this module."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from inspect import signature
from pathlib import Path
from types import MappingProxyType

import mujoco

from executive.errors import DomainError, nearest
from executive.sim.relations import State
from executive.sim.world import MujocoWorld
from executive.types import Atom, Belief, Facts, Observation

Relation = Callable[..., bool]


def relations() -> dict[str, Relation]:
    """The registered relations by name."""
    return {point.name: point.load() for point in entry_points(group="executive.relations")}


class Truth:
    """What is really so.

    Args:
        world: the simulated world.
        meaning: predicate -> name of the relation that is its truth.
        parameters: predicate -> the names of its parameters, to be held against the relation's.
        file: the domain file, for the error message.

    Raises:
        DomainError: a relation is not registered, or takes another number of objects than its predicate.
    """

    def __init__(
        self,
        world: MujocoWorld,
        meaning: Mapping[str, str],
        parameters: Mapping[str, Sequence[str]] = MappingProxyType({}),
        file: Path | None = None,
    ) -> None:
        known = relations()
        for predicate, name in meaning.items():
            key = f"predicates.{predicate}.relation"
            if name not in known:
                raise DomainError(f"no relation {name!r} is registered; {nearest(name, known)}", file=file, key=key)
            takes, has = len(signature(known[name]).parameters) - 1, len(parameters.get(predicate, ()))
            if predicate in parameters and takes != has:
                raise DomainError(
                    f"{name!r} needs {takes} object{'s' * (takes != 1)}, this predicate has {has}", file=file, key=key
                )
        self._world = world
        self._meaning = {predicate: known[name] for predicate, name in meaning.items()}

    def of(self, atoms: Sequence[Atom]) -> Facts:
        """The truth of each atom now."""
        world = self._world
        mujoco.mj_forward(world.model, world.data)
        tables = {table.name: table for table in world.spec.tables}
        state = State(world.model, world.data, tables, tuple(world.shapes))
        return Facts({atom: bool(self._meaning[atom.predicate](state, *atom.args)) for atom in atoms})


class Oracle:
    """The estimator that is always right: probability 0 or 1 for every atom, as the simulator has it."""

    name = "oracle"

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """The truth at this moment, which is the moment of the observation when called right after it."""
        return Belief.certain(self._truth.of(atoms), observation.id, self.name)
