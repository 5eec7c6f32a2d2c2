"""What the cameras see: pictures drawn off screen.

An OpenGL context belongs to the thread in which it was made, and a look may come from any: from the loop, or from a
skill, which runs in a thread of its own. So one thread of the process does all the drawing for worlds.
"""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from functools import cache, partial
from queue import SimpleQueue
from threading import Thread, current_thread
from typing import TYPE_CHECKING, Any, TypeVar

import mujoco
import numpy as np

from executive.sim import scene
from executive.sim.spec import CameraSpec, SceneSpec
from executive.types import FloatArray, Image
from executive.util.native_libraries import keep_triton_apart
from executive.util.requirements import cannot_draw

if TYPE_CHECKING:
    from executive.sim.photoreal import PhotorealDrawing

_THREAD = "drawing"
_T = TypeVar("_T")


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

    Args:
        spec: the model's scene, for cameras whose pictures Mitsuba renders.
        seed: of the light in these.

    Raises:
        MissingError: there is no off-screen OpenGL, or no Mitsuba for a camera that wants it; at the first picture.
        InputError: the environment leads it astray.
    """

    def __init__(self, model: mujoco.MjModel, spec: SceneSpec | None = None, seed: int = 0) -> None:
        self._model, self._spec, self._seed = model, spec, seed
        self._photoreal: PhotorealDrawing | None = None
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._warming: Future[None] | None = None

    def picture(self, data: mujoco.MjData, camera: CameraSpec) -> Image:
        """What a camera sees of `data`, (H, W, 3) uint8."""
        if camera.renderer == "mitsuba" and self._spec is not None:
            return self.photoreal().picture(data, camera)
        return self.drawn(data, camera, lambda renderer: np.array(renderer.render()))

    def photoreal(self) -> PhotorealDrawing:
        """The renderer of photorealistic pictures, made at its first use.

        Raises:
            MissingError: Mitsuba is not installed.
        """
        if self._photoreal is None:
            from executive.sim.photoreal import PhotorealDrawing

            assert self._spec is not None, "its materials are the scene's"
            self._photoreal = PhotorealDrawing(self._model, self._spec, self._seed)
        return self._photoreal

    def depth(self, data: mujoco.MjData, camera: CameraSpec) -> FloatArray:
        """How far what a camera sees of `data` is along its optical axis, (H, W) in m, without any error."""

        def measure(renderer: mujoco.Renderer) -> FloatArray:
            renderer.enable_depth_rendering()
            try:
                return np.array(renderer.render(), dtype=float)
            finally:
                renderer.disable_depth_rendering()

        return self.drawn(data, camera, measure)

    def geoms(self, data: mujoco.MjData, camera: CameraSpec) -> np.ndarray[Any, np.dtype[np.int32]]:
        """Which geom each pixel of a camera shows, (H, W); -1 for none."""

        def segment(renderer: mujoco.Renderer) -> np.ndarray[Any, np.dtype[np.int32]]:
            renderer.enable_segmentation_rendering()
            try:
                shown = np.array(renderer.render(), dtype=np.int32)
            finally:
                renderer.disable_segmentation_rendering()
            return np.where(shown[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, shown[..., 0], -1)

        return self.drawn(data, camera, segment)

    def picture_and_depth(self, data: mujoco.MjData, camera: CameraSpec) -> tuple[Image, FloatArray]:
        """What `picture` and `depth` return, in half the time, but for where there is nothing to be seen: that is some
        distance far beyond everything."""
        if camera.renderer == "mitsuba" and self._spec is not None:
            return self.photoreal().picture(data, camera), self.depth(data, camera)
        return self.drawn(data, camera, _picture_and_depth)

    def drawn(self, data: mujoco.MjData, camera: CameraSpec, draw: Callable[[mujoco.Renderer], _T]) -> _T:
        """What `draw` makes, in the thread that draws, of the renderer for a camera's size, ready to draw what the
        camera sees: visuals and items, no helpers."""

        def work() -> _T:
            options = mujoco.MjvOption()
            options.geomgroup[:] = 0
            options.geomgroup[scene.VISUAL] = options.geomgroup[scene.ITEM] = 1
            renderer = self._of_size(camera.height, camera.width)
            renderer.update_scene(data, camera.name, options)
            return draw(renderer)

        return _there(work)

    def ready(self, cameras: Sequence[CameraSpec]) -> None:
        """Make the renderers for the cameras now, not at the first picture."""
        _there(lambda: [self._of_size(camera.height, camera.width) for camera in cameras])

    def warm_up(self, cameras: Sequence[CameraSpec]) -> None:
        """Have the renderers made and a first picture drawn, for which shaders are compiled, and wait for nothing. What
        fails is raised by the next picture."""
        if cameras:
            _close_at_exit(self)
            self._warming = Future()
            _jobs().put((self._warming, partial(self._warm, weakref.ref(self), cameras)))

    @staticmethod
    def _warm(this: weakref.ref[Drawing], cameras: Sequence[CameraSpec]) -> None:
        if (drawing := this()) is not None:
            drawing.ready(cameras)
            # Data of its own: the world's may be computed with meanwhile.
            drawing.picture(mujoco.MjData(drawing._model), cameras[0])

    def close(self) -> None:
        """Free all of them."""
        if self._warming is not None:
            wait([self._warming])
        self._photoreal = None
        while self._renderers:
            _there(self._renderers.popitem()[1].close)

    def _of_size(self, height: int, width: int) -> mujoco.Renderer:
        renderer = self._renderers.get((height, width))
        if renderer is None:
            renderer = make_renderer(self._model, height, width)
            # Shadows and reflections cost a fifth of a picture and hide small items.
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
            self._renderers[height, width] = renderer
            weakref.finalize(self, _there, renderer.close).atexit = False
            _close_at_exit(self)
        return renderer


def _picture_and_depth(renderer: mujoco.Renderer) -> tuple[Image, FloatArray]:
    """A picture (H, W, 3) and its depth (H, W) in m by one drawing, of which `mujoco.Renderer` itself reads one."""
    picture = np.empty((renderer.height, renderer.width, 3), np.uint8)
    raw = np.empty((renderer.height, renderer.width), np.float32)
    renderer._gl_context.make_current()
    mujoco.mjr_render(renderer._rect, renderer.scene, renderer._mjr_context)
    mujoco.mjr_readPixels(picture, raw, renderer._rect, renderer._mjr_context)
    # OpenGL's projection has numbers of single precision, and so has what takes it back.
    near = np.float32(renderer.model.vis.map.znear * renderer.model.stat.extent)
    far = np.float32(renderer.model.vis.map.zfar * renderer.model.stat.extent)
    scale = np.float32(0.5) * ((far + near) / (far - near)) - np.float32(0.5)
    depth = (far * near / (far - near)) / (raw.astype(float) + scale)
    depth = depth.astype(np.float32).astype(float)
    # OpenGL counts rows from below.
    return np.ascontiguousarray(picture[::-1]), np.ascontiguousarray(depth[::-1])


_unclosed = weakref.WeakSet[Drawing]()


def _close_at_exit(drawing: Drawing) -> None:
    """Have a drawing freed at exit, if nobody has closed it. MuJoCo's module for OpenGL, which is loaded with the first
    renderer, ends OpenGL at exit, and what is freed after that says so at length. What is registered last comes first:
    therefore anew with each renderer."""
    _unclosed.add(drawing)
    atexit.unregister(_close_all)
    atexit.register(_close_all)


def _close_all() -> None:
    for drawing in [*_unclosed]:
        drawing.close()


def _there(work: Callable[[], _T]) -> _T:
    """Do something in the thread that draws. It is waited for in any case: what it draws must not move meanwhile."""
    if current_thread().name == _THREAD:  # the garbage collector may free a renderer anywhere
        return work()
    job: Future[_T] = Future()
    _jobs().put((job, work))
    try:
        return job.result()
    except BaseException:  # Ctrl-C while waiting: the picture is finished first
        wait([job])
        raise


_Jobs = SimpleQueue[tuple[Future[Any], Callable[[], Any]]]


@cache
def _jobs() -> _Jobs:
    """What the thread that draws has to do; it is started with the first job."""
    jobs: _Jobs = SimpleQueue()
    Thread(target=_draw, args=(jobs,), name=_THREAD, daemon=True).start()
    return jobs


def _draw(jobs: _Jobs) -> None:
    while True:
        job, work = jobs.get()
        try:
            job.set_result(work())
        except BaseException as error:  # raised again in the thread that waits for it
            job.set_exception(error)
        del job, work  # pictures and worlds are not kept between jobs
