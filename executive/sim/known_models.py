"""What a robot knows of a scene without looking: its own shape, furniture, cameras, and the shapes of items."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from executive.relations import Solid
from executive.sim import scene, viewer_geometry
from executive.sim.drawers import Drawers
from executive.sim.rendering import Drawing
from executive.sim.solids import Solids, floor_solid
from executive.sim.spec import SceneSpec
from executive.types import Camera, FloatArray, Geometry

_AROUND = (0.35, 0.35, 0.0)
"""m beyond the tables within which things are looked for; from the floor up to `_ABOVE` over the highest table."""

_ABOVE = 0.75


class KnownScene:
    """The robot and the furniture of a scene, without any item, as the robot's own model of them.

    Raises:
        MissingError: there is no off-screen OpenGL; at the first picture.
    """

    def __init__(self, spec: SceneSpec) -> None:
        self._spec = spec
        self._model = scene.build(spec.model_copy(update={"items": ()})).compile()
        self._data = mujoco.MjData(self._model)
        self._drawing = Drawing(self._model)
        self._arm = np.array([self._model.joint(name).qposadr[0] for name in scene.JOINTS])
        self._fingers = np.array([self._model.joint(name).qposadr[0] for name in scene.FINGER_JOINTS])
        self.cameras: Mapping[str, Camera] = {
            camera.name: camera for camera in viewer_geometry.of(self._model, spec).cameras
        }
        self._drawers = Drawers({drawer.name: drawer for drawer in spec.drawers}, self._model, self._data)
        self._solids = Solids(self._model, spec.model_copy(update={"items": ()}))
        self.tables: Mapping[str, Solid] = self._solids.tables
        half = np.array([0.5 * np.hypot(table.size[0], table.size[1]) for table in spec.tables])
        centres = np.array([table.centre for table in spec.tables])
        low, high = (centres[:, :2] - half[:, None]).min(axis=0), (centres[:, :2] + half[:, None]).max(axis=0)
        self.bounds: tuple[FloatArray, FloatArray] = (
            np.array([*low, 0.0]) - _AROUND,
            np.array([*high, centres[:, 2].max() + _ABOVE]) + _AROUND,
        )

    def slide(self, openings: Mapping[str, float]) -> None:
        """Have drawers (name -> m) be as far open from now on."""
        for name, opening in openings.items():
            self._drawers.slide(name, opening)

    def drawers(self, openings: Mapping[str, float]) -> tuple[Mapping[str, Solid], Mapping[str, float]]:
        """The floors of drawers that are open by so many m, and which shares of their travel that is."""
        specs = self._drawers.specs
        floors = {name: floor_solid(specs[name].floor(m), specs[name].wall) for name, m in openings.items()}
        return floors, {name: m / specs[name].stroke for name, m in openings.items()}

    def expected(self, joints: FloatArray, fingers: FloatArray, cameras: Sequence[str]) -> dict[str, FloatArray]:
        """The distances (H, W) in m that cameras would measure of robot and furniture alone."""
        self._place(joints, fingers)
        return {
            camera.name: self._drawing.depth(self._data, camera)
            for camera in self._spec.cameras
            if camera.name in cameras
        }

    def hand(self, joints: FloatArray) -> FloatArray:
        """The transform (4, 4) of the grip point."""
        self._place(joints, self._data.qpos[self._fingers])
        site, hand = self._data.site(scene.GRIP_SITE), np.eye(4)
        hand[:3, :3], hand[:3, 3] = site.xmat.reshape(3, 3), site.xpos
        return hand

    def finger_solids(self, joints: FloatArray, fingers: FloatArray) -> tuple[Solid, Solid]:
        """The left and the right finger at measured joint positions of arm and fingers (rad)."""
        self._place(joints, fingers)
        return self._solids.fingers(self._data)

    def close(self) -> None:
        self._drawing.close()

    def _place(self, joints: FloatArray, fingers: FloatArray) -> None:
        self._data.qpos[self._arm] = joints
        self._data.qpos[self._fingers] = fingers
        mujoco.mj_forward(self._model, self._data)


def item_meshes(spec: SceneSpec) -> dict[str, tuple[Geometry, int | None]]:
    """The shape of each item as one mesh in its body's frame, as its maker would tell it, with its mean colour; and the
    axis of the body that it is round about, if it is."""
    model = scene.build(spec).compile()
    shapes, found = scene.item_shapes(model, spec), {}
    for item in spec.items:
        root = model.body(item.name).id
        parts = [
            viewer_geometry.exact(model, geom, item.name)
            for geom in range(model.ngeom)
            if model.body_rootid[model.geom_bodyid[geom]] == root
        ]
        found[item.name] = viewer_geometry.merged(parts), shapes[item.name].axis
    return found
