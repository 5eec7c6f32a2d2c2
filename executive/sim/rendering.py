"""What the cameras see: pictures drawn off screen."""

from __future__ import annotations

import weakref
from collections.abc import Sequence

import mujoco
import numpy as np

from executive.sim import scene
from executive.sim.spec import CameraSpec
from executive.types import FloatArray, Image
from executive.util.native_libraries import keep_triton_apart
from executive.util.requirements import cannot_draw


def sensed(picture: Image, seed: Sequence[int]) -> Image:
    """The picture as a camera's sensor has it: what is drawn is the same as long as nothing moves, and no sensor ever
    gives two pictures that are. The lowest bit of every value is noise."""
    noise = np.frombuffer(np.random.default_rng(seed).bytes(picture.size), np.uint8)
    return picture ^ (noise.reshape(picture.shape) & np.uint8(1))


def make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """An off-screen renderer of pictures of this size, and the OpenGL context that it takes: the one place where they
    are made.

    Raises:
        MissingError: there is no off-screen OpenGL.
        InputError: the environment leads it astray.
    """
    keep_triton_apart()
    try:
        return mujoco.Renderer(model, height, width)
    except Exception as error:  # mujoco raises whatever its GL binding raises
        raise cannot_draw(str(error)) from error


class Drawing:
    """The off-screen renderers of one model, one for each size of picture: making one takes most of a second.

    Raises:
        MissingError: there is no off-screen OpenGL; at the first picture.
        InputError: the environment leads it astray.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}

    def picture(self, data: mujoco.MjData, camera: CameraSpec) -> Image:
        """What a camera sees of `data`, (H, W, 3) uint8."""
        return np.array(self.prepared(data, camera).render())

    def depth(self, data: mujoco.MjData, camera: CameraSpec) -> FloatArray:
        """How far what a camera sees of `data` is along its optical axis, (H, W) in m, without any error."""
        renderer = self.prepared(data, camera)
        renderer.enable_depth_rendering()
        try:
            return np.array(renderer.render(), dtype=float)
        finally:
            renderer.disable_depth_rendering()

    def prepared(self, data: mujoco.MjData, camera: CameraSpec) -> mujoco.Renderer:
        """The renderer for a camera's size, ready to draw what the camera sees: visuals and items, no helpers."""
        options = mujoco.MjvOption()
        options.geomgroup[:] = 0
        options.geomgroup[scene.VISUAL] = options.geomgroup[scene.ITEM] = 1
        renderer = self._of_size(camera.height, camera.width)
        renderer.update_scene(data, camera.name, options)
        return renderer

    def close(self) -> None:
        """Free all of them."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _of_size(self, height: int, width: int) -> mujoco.Renderer:
        renderer = self._renderers.get((height, width))
        if renderer is None:
            renderer = make_renderer(self._model, height, width)
            # Shadows and reflections cost a fifth of a picture and hide small items.
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
            self._renderers[height, width] = renderer
            # At exit OpenGL may be gone before a world that nobody closed, and would say so at length.
            weakref.finalize(self, renderer.close)
        return renderer
