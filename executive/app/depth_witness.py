"""Depth as a witness: relations asked about the scene that perception estimates, in place of the true one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from executive.app.identity import names_identical, over_identities
from executive.belief import ErrorModel, SensorModel, WitnessModel
from executive.perception import EstimatedScenes
from executive.relations.kinds import RelationKind
from executive.relations.scene import Scene
from executive.sim import footprint
from executive.sim.spec import TableSpec
from executive.sim.world import MujocoWorld
from executive.types import Atom, Lump, Observation, PosesEstimated, Testimony

NAME = "depth"

ABSENT, IN_VIEW = 0.1, 0.01
"""The probability of an atom about an item that is seen nowhere, with nothing there that it could be; and that it is on
a table on which nothing could hide it."""

_APART = 0.04
"""m between the places on a table where something may be hidden."""

ERRORS: Mapping[str, ErrorModel] = {
    "on": ErrorModel(0.001, 0.002),
    "gripping": ErrorModel(0.002, 0.015),
    "gripper-empty": ErrorModel(0.015, 0.011),
    "inside": ErrorModel(0.002, 0.005),
    "open": ErrorModel(0.003, 0.004),
}
"""By relation, how often it is wrong on the estimated scene: none of 59 to 1,062 answers was, which counts with ten
more at 5 % (`python -m benchmarks.relations --depth 15`), nor any of 93 to 222 about drawers (`--domain kitchen --depth
12`, and `--depth 14 --seed 700100`). Relations that were not measured are wrong at 5 %."""


class DepthWitness:
    """Tells of the atoms whose items are seen, or are in the hand.

    Args:
        world: a simulated world whose poses are estimated.
        scenes: draws scenes by what is estimated.
        kinds: the relation of each predicate.
        identical: the names of items that nothing tells apart, in groups.
        marked: a model answers what is asked about these, by their tags, and depth testifies of it; otherwise their
            tracks answer it (`executive.app.identity`).
    """

    name = NAME

    def __init__(
        self,
        world: MujocoWorld,
        scenes: EstimatedScenes,
        kinds: Mapping[str, RelationKind],
        identical: Sequence[Sequence[str]] = (),
        marked: bool = False,
    ) -> None:
        self._world, self._kinds, self._identical, self._is_marked = world, kinds, identical, marked
        self._scenes: EstimatedScenes | None = scenes
        self._items = set(world.items)
        self._hidden_at, self._hidden = float("nan"), dict[tuple[str, str], bool]()

    def testify(self, observation: Observation, atoms: Sequence[Atom]) -> Testimony:
        """Return how probable atoms are; those about identical items only where these are marked. It alone can tell on
        which of two tables something is that lies across the edges of both."""
        now = self._now()
        if now is None:
            return Testimony({})
        about_twins = [atom for atom in atoms if names_identical(atom, self._identical)]
        told = self._told([atom for atom in atoms if atom not in about_twins], *now)
        if self._is_marked and about_twins:
            told |= over_identities(about_twins, self.told, now[0], self._identical)
        return Testimony(told, self._across_edges(told, now[1]))

    def told(self, atoms: Sequence[Atom]) -> Mapping[Atom, float]:
        """Return the share of the scenes that are drawn from what is estimated in which each atom is true, if items are
        what they go by.

        There is no answer about what is hidden and only remembered. What is seen nowhere is hardly on anything, unless
        there is something that may be it, and least of all on a table on which everything is in view: what may be it is
        on one table and on no other. Where the fingers hold something and nobody knows what, there is none about the
        hand, nor about what is seen nowhere.
        """
        now = self._now()
        return {} if now is None else self._told(atoms, *now)

    def _now(self) -> tuple[PosesEstimated, Sequence[Scene]] | None:
        """Return what is estimated at this moment, and scenes that are drawn from it."""
        world = self._world
        if world.localizer is None or self._scenes is None:
            return None
        poses = world.localizer.now()
        return poses, self._scenes.drawn(poses, world.joints(), world.gripper_joints(), world.gripper_width())

    def _told(self, atoms: Sequence[Atom], poses: PosesEstimated, scenes: Sequence[Scene]) -> dict[Atom, float]:
        holds_unknown = scenes[0].feels and all(pose.source != "held" for pose in poses.poses.values())
        told = {}
        for atom in atoms:
            kind = self._kinds.get(atom.predicate)
            if kind is None:
                continue
            about = [name for name in kind.about(atom) if name in self._items]
            if any(name in poses.missing for name in about):
                if not holds_unknown and not self._may_be_one_of(poses.lumps, atom):
                    # Where a camera is left out, nothing may hide what nothing looks at.
                    told[atom] = ABSENT if poses.left_out or self._may_be_hidden(atom) else IN_VIEW
            elif not about and holds_unknown:
                continue
            elif all(poses.poses[name].source != "remembered" for name in about):
                told[atom] = sum(kind.holds(scene, atom) for scene in scenes) / len(scenes)
        return told

    def _across_edges(self, atoms: Iterable[Atom], scenes: Sequence[Scene]) -> frozenset[Atom]:
        """Return those of the atoms that say on which of several tables an item is that carry it together."""
        found, carriers = set(), dict[str, set[str]]()
        for atom in atoms:
            kind = self._kinds[atom.predicate]
            if kind.name != "on":
                continue
            item, table = kind.about(atom)
            if item not in carriers:
                there = [set(scene.supports(item)) for scene in scenes if item in scene.items]
                carriers[item] = set().union(*(each for each in there if len(each) > 1))
            if table in carriers[item]:
                found.add(atom)
        return frozenset(found)

    def _item_on_table(self, atom: Atom) -> tuple[str, TableSpec] | None:
        """Return the item and the table that an atom is about; None if it is about anything else."""
        tables = {table.name: table for table in self._world.spec.tables}
        items = [name for name in atom.args if name in self._items]
        on = [tables[name] for name in atom.args if name in tables]
        return (items[0], on[0]) if len(items) == len(on) == 1 else None

    def _may_be_one_of(self, lumps: Sequence[Lump], atom: Atom) -> bool:
        """Whether something unknown stands where an atom says that an item is."""
        found = self._item_on_table(atom)
        if found is None:
            return bool(lumps)
        table = found[1]
        across = np.array([[np.cos(table.yaw), np.sin(table.yaw)], [-np.sin(table.yaw), np.cos(table.yaw)]])
        beyond = (np.abs(across @ (lump.centre - table.centre)[:2]) - 0.5 * np.array(table.size[:2]) for lump in lumps)
        return any((over < float(np.hypot(*lump.half[:2]))).all() for over, lump in zip(beyond, lumps, strict=True))

    def _may_be_hidden(self, atom: Atom) -> bool:
        """Whether what an atom says would be hidden from the cameras, or is not about a table."""
        localizer, found = self._world.localizer, self._item_on_table(atom)
        if localizer is None or found is None:
            return True
        item, table = found
        key = item, table.name
        if self._hidden_at != self._world.time:
            self._hidden_at, self._hidden = self._world.time, {}
        if key not in self._hidden:
            spots = footprint.grid(np.array(table.centre), (table.size[0], table.size[1]), table.yaw, _APART)
            self._hidden[key] = bool(localizer.hiders(item, spots))
        return self._hidden[key]

    def close(self) -> None:
        """Let go of what is known of robot and room, with its off-screen renderer, while there is an OpenGL to free it
        in; there are no answers afterwards."""
        self._scenes = None


def witness_model(kinds: Mapping[str, RelationKind]) -> WitnessModel:
    """Return how depth errs about the predicates with these relations. A second look at the same moment measures nearly
    the same, and so does the estimator where something is hidden from both."""
    errors = {predicate: ERRORS[kind.name] for predicate, kind in kinds.items() if kind.name in ERRORS}
    return WitnessModel(SensorModel(errors, correlation_within=0.9, correlation_across=0.5), shared=0.2)
