"""The cameras of a simulated world: their pictures, their depth pictures, and where they stand."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import mujoco
import numpy as np

from executive.sim import depth_sensor
from executive.sim.rendering import Drawing, sensed
from executive.sim.spec import CameraSpec, SceneSpec
from executive.types import DepthImage, FloatArray, Image

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Cameras:
    """The cameras of one world.

    Args:
        model, data: the world's, which go on being its own.
        spec: its scene.
        seed: of every noise.
        depth: whether looks have depth.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, spec: SceneSpec, seed: int, depth: bool = False
    ) -> None:
        self._model, self._data, self._seed, self._depth = model, data, seed, depth
        self._specs: Mapping[str, CameraSpec] = {camera.name: camera for camera in spec.cameras}
        self._numbers = {name: at for at, name in enumerate(self._specs)}
        self._positions = np.array(model.cam_pos)
        self._pictures: dict[str, Image] = {}
        self._measured: dict[str, DepthImage] = {}
        self._moment = b""
        self.drawing = Drawing(model, spec, seed)

    def picture(self, camera: str) -> Image:
        """One camera's picture without noise, (H, W, 3) uint8."""
        mujoco.mj_forward(self._model, self._data)
        return self.drawing.picture(self._data, self._specs[camera])

    def look(self, number: int, cameras: Collection[str] | None) -> tuple[dict[str, Image], dict[str, DepthImage]]:
        """The pictures, with the noise of their sensors, and the depth pictures of a numbered look.

        Args:
            cameras: those that are asked for; all of them if None.
        """
        names = [name for name in self._specs if cameras is None or name in cameras]
        pictures, depth = self._drawn(names, names if self._depth else ())
        return {name: sensed(pictures[name], [self._seed, number, at]) for at, name in enumerate(names)}, depth

    def sense(self) -> tuple[dict[str, Image], dict[str, DepthImage]]:
        """The pictures without noise, and the depth pictures, of the cameras that measure depth."""
        names = [name for name, camera in self._specs.items() if camera.depth]
        return self._drawn(names, names)

    def masks(self, items: Sequence[str]) -> dict[str, Image]:
        """Which item each pixel of each camera shows, (H, W) uint8: from 1 on in the order of `items`, 0 for none."""
        mujoco.mj_forward(self._model, self._data)
        roots = self._model.body_rootid[self._model.geom_bodyid]
        number = np.zeros(self._model.ngeom + 1, dtype=np.uint8)  # the last is for no geom
        for index, item in enumerate(items):
            number[:-1][roots == self._model.body(item).id] = index + 1
        return {name: number[self.drawing.geoms(self._data, camera)] for name, camera in self._specs.items()}

    def move(self, camera: str, by: FloatArray) -> None:
        """Have a camera stand `by` (3,) m, in the world's frame, from where the scene says, and everybody believes."""
        index = self._model.camera(camera).id
        self._model.cam_pos[index] = self._positions[index] + by

    def _drawn(self, names: Iterable[str], deep: Collection[str]) -> tuple[dict[str, Image], dict[str, DepthImage]]:
        """The pictures of cameras, and the depth pictures of those of them that are to measure depth, and do. While
        nothing moves, they are not drawn again: a look and an estimate of the poses are of the same moment.
        """
        mujoco.mj_forward(self._model, self._data)
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        if (moment := state.tobytes() + self._model.cam_pos.tobytes()) != self._moment:
            self._moment, self._pictures, self._measured = moment, {}, {}
        pictures, depth = {}, {}
        for name in names:
            camera = self._specs[name]
            if camera.depth and name in deep:
                if name not in self._measured:
                    self._pictures[name], exact = self.drawing.picture_and_depth(self._data, camera)
                    self._measured[name] = depth_sensor.measured(exact, self._pictures[name], camera, self._noise(name))
                depth[name] = self._measured[name]
            if name not in self._pictures:
                self._pictures[name] = self.drawing.picture(self._data, camera)
            pictures[name] = self._pictures[name]
        return pictures, depth

    def _noise(self, camera: str) -> np.random.Generator:
        """The noise of a depth picture: by seed, time and camera, from nothing that anything else is drawn from."""
        return np.random.default_rng([self._seed, 0xDE, round(1e6 * self._data.time), self._numbers[camera]])
