"""The simulator's scene for relations: solids from a MuJoCo model, where its state has them."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from executive.relations import Part, Region, Scene, Solid
from executive.sim.fixtures import Floor
from executive.sim.scene import slide_of
from executive.sim.spec import SceneSpec
from executive.types import FloatArray, about_vertical

FINGERS = (
    ("left_outer_knuckle", "left_inner_finger", "left_inner_knuckle"),
    ("right_outer_knuckle", "right_inner_finger", "right_inner_knuckle"),
)
"""The bodies of each finger."""

_ROUND = 512
"""Corners that stand for a circle: they leave out 0.002 % of its radius, a micrometre for what a hand can hold. What
rests is pressed in by more (8 to 200), so that a cylinder on its side rests on something wherever it was rolled to."""


class Solids:
    """The solids of a model: their corners are read once, and moved to where a state has them."""

    def __init__(self, model: mujoco.MjModel, spec: SceneSpec) -> None:
        self._model = model
        self.tables: Mapping[str, Solid] = {
            table.name: Solid.box(
                np.array(table.centre) - [0.0, 0.0, 0.5 * table.size[2]],
                0.5 * np.array(table.size),
                about_vertical(table.yaw),
            )
            for table in spec.tables
        } | {container.name: floor_solid(container.floor, container.wall) for container in spec.containers}
        """All that stays where it is and carries items."""
        self._drawers = {drawer: int(model.joint(slide_of(drawer.name)).qposadr[0]) for drawer in spec.drawers}
        self.regions: Mapping[str, Region] = {
            region.name: Region(region.table, region.centre, (0.5 * region.size[0], 0.5 * region.size[1]))
            for region in spec.regions
        }
        self._items = {item.name: _touchable(model, [model.body(item.name).id], rooted=True) for item in spec.items}
        self._fingers = [_touchable(model, [model.body(name).id for name in names]) for names in FINGERS]
        self._corners = {
            geom: Part(*_corners(model, geom)) for geoms in (*self._items.values(), *self._fingers) for geom in geoms
        }

    def scene(self, data: mujoco.MjData) -> Scene:
        """Return the scene of a state, with kinematics and contacts computed."""
        items = {name: self._solid(data, self._model.body(name).id, geoms) for name, geoms in self._items.items()}
        opened = {drawer: float(data.qpos[at]) for drawer, at in self._drawers.items()}
        floors = {drawer.name: floor_solid(drawer.floor(m), drawer.wall) for drawer, m in opened.items()}
        return Scene(
            items,
            {**self.tables, **floors},
            self.fingers(data),
            self._feels(data),
            regions=self.regions,
            openings={drawer.name: m / drawer.stroke for drawer, m in opened.items()},
        )

    def fingers(self, data: mujoco.MjData) -> tuple[Solid, Solid]:
        """Return the left and the right finger where a state has them."""
        left, right = (self._solid(data, int(self._model.geom_bodyid[geoms[0]]), geoms) for geoms in self._fingers)
        return left, right

    def _solid(self, data: mujoco.MjData, body: int, geoms: list[int]) -> Solid:
        parts = []
        for geom in geoms:
            part, turned = self._corners[geom], data.geom_xmat[geom].reshape(3, 3)
            parts.append(Part(part.corners @ turned.T + data.geom_xpos[geom], part.radius))
        rotation = data.xmat[body].reshape(3, 3).copy()
        return Solid(tuple(parts), rotation, data.xpos[body].copy(), data.subtree_com[body].copy())

    def _feels(self, data: mujoco.MjData) -> bool:
        """Whether something that is not the hand presses on both fingers."""
        felt = set()
        for contact in data.contact[: data.ncon]:
            first, second = (int(geom) for geom in contact.geom)
            for mine, other in ((first, second), (second, first)):
                for side, geoms in enumerate(self._fingers):
                    if mine in geoms and not any(other in each for each in self._fingers):
                        felt.add(side)
        return len(felt) == len(self._fingers)


def floor_solid(floor: Floor, thickness: float) -> Solid:
    """Return a floor as a slab of some `thickness` in m."""
    half = np.array([0.5 * floor.size[0], 0.5 * floor.size[1], 0.5 * thickness])
    return Solid.box(np.array(floor.centre) - [0.0, 0.0, half[2]], half, about_vertical(floor.yaw))


def _touchable(model: mujoco.MjModel, bodies: list[int], rooted: bool = False) -> list[int]:
    """The geoms of some bodies, or of all that hangs on them, that touch anything."""
    owner = model.body_rootid[model.geom_bodyid] if rooted else model.geom_bodyid
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [int(geom) for geom in np.flatnonzero(np.isin(owner, bodies) & touches)]


def _corners(model: mujoco.MjModel, geom: int) -> tuple[FloatArray, float]:
    """Corners (N, 3) of a geom in its own frame, and the radius around them, whose hull is its shape."""
    size = model.geom_size[geom]
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            return np.unique(np.asarray(model.mesh_vert[start : start + count], dtype=float), axis=0), 0.0
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return np.zeros((1, 3)), float(size[0])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            angles = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
            rim = np.stack([size[0] * np.cos(angles), size[0] * np.sin(angles), np.full(_ROUND, size[1])], axis=1)
            return np.concatenate([rim, rim * [1.0, 1.0, -1.0]]), 0.0
    return np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size, 0.0
