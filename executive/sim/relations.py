"""The relations of the simulator: the ground truth of predicates, for scores, labels and the oracle.

Each relation is registered under the entry-point group `executive.relations`, so that a domain refers to it by name. It
declares the kinds of its arguments by `takes`, which domains are checked against.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import mujoco
import numpy as np

from executive import former_names
from executive.sim.spec import TableSpec

Kind = Literal["item", "table", "thing"]
"""The kind of an argument: an [[item]] of the scene, a [[table]], or either."""

_Relation = TypeVar("_Relation", bound=Callable[..., bool])

_LEFT = ("left_outer_knuckle", "left_inner_finger", "left_inner_knuckle")
_RIGHT = ("right_outer_knuckle", "right_inner_finger", "right_inner_knuckle")


@dataclass(frozen=True, slots=True, eq=False)
class SimState:
    """A state of the simulation, contacts included."""

    model: mujoco.MjModel
    data: mujoco.MjData
    tables: Mapping[str, TableSpec]
    items: tuple[str, ...]

    def contacts(self, item: str) -> set[str]:
        """The names of the bodies that touch an item; a body inside an item counts as the item."""
        root = self.model.body(item).id
        touching = set()
        for index in range(self.data.ncon):
            contact = self.data.contact[index]
            first, second = (int(self.model.geom_bodyid[geom]) for geom in contact.geom)
            for one, other in ((first, second), (second, first)):
                if self.model.body_rootid[one] == root and self.model.body_rootid[other] != root:
                    owner = self.model.body(self.model.body_rootid[other]).name
                    touching.add(owner if owner in self.items else self.model.body(other).name)
        return touching


def takes(*kinds: Kind) -> Callable[[_Relation], _Relation]:
    """Declares the kinds of a relation's parameters after the state, in their order."""

    def declare(relation: _Relation) -> _Relation:
        vars(relation)["takes"] = kinds
        return relation

    return declare


@takes("item", "table")
def on(state: SimState, item: str, table: str) -> bool:
    """The item rests on the table, directly or on other items, and is not gripped.

    Where it touches several tables at once, it is on the one that its centre of mass is nearest to.
    """
    if gripping(state, item):
        return False
    seen, frontier, tables = {item}, [item], set()
    while frontier:
        for body in state.contacts(frontier.pop()):
            if body in state.tables:
                tables.add(body)
            elif body in state.items and body not in seen:
                seen.add(body)
                frontier.append(body)
    if not tables:
        return False
    centre = state.data.subtree_com[state.model.body(item).id]
    return table == min(sorted(tables), key=lambda name: _outside(centre, state.tables[name]))


@takes("item")
def gripping(state: SimState, item: str) -> bool:
    """The item is between the fingers: both touch it."""
    touching = state.contacts(item)
    return not touching.isdisjoint(_LEFT) and not touching.isdisjoint(_RIGHT)


@takes()
def gripper_empty(state: SimState) -> bool:
    """No item is between the fingers."""
    return not any(gripping(state, item) for item in state.items)


def _outside(point: np.ndarray[tuple[int], np.dtype[np.float64]], table: TableSpec) -> float:
    """Horizontal distance in m from the table's rectangle, 0 inside."""
    x, y = point[:2] - np.asarray(table.centre[:2])
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    local = np.abs([cos * x + sin * y, -sin * x + cos * y]) - 0.5 * np.asarray(table.size[:2])
    return float(np.linalg.norm(np.maximum(local, 0.0)))


def __getattr__(name: str) -> object:
    if name == "State":
        return former_names.renamed(__name__, name, "executive.SimState", SimState)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
