"""Rendering recorded states under other lights and from other camera poses."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from executive.errors import InputError, nearest
from executive.sim.rendering import Drawing
from executive.sim.spec import SceneSpec, read_scene
from executive.sim.world import compiled
from executive.types import FloatArray, Image

STEEPEST = math.radians(55.0)
"""The largest angle of the lamp's direction from straight down, in rad."""

_KELVIN = (3500.0, 4000.0, 4500.0, 5000.0, 5500.0, 6000.0, 6500.0, 7000.0, 8000.0, 9000.0)
_TINTS = (
    (255, 196, 137), (255, 209, 163), (255, 219, 186), (255, 228, 206), (255, 236, 224),
    (255, 243, 239), (255, 249, 253), (245, 243, 255), (227, 233, 255), (214, 225, 255),
)  # fmt: skip
"""White in sRGB under a black body of each temperature (CIE 1964 observer)."""


@dataclass(frozen=True, slots=True)
class Lights:
    """The lights of a scene: a directional lamp, a light at the camera, and an ambient one.

    `direction` (3,) is the direction of the lamp's light; `lamp`, `glow` and `ambient` are RGB strengths of the lamp,
    of the light at the camera and of that without a direction. A scene's own are (0.55, 0.55, 0.55) and twice 0.35.
    """

    direction: tuple[float, float, float]
    lamp: tuple[float, float, float]
    glow: tuple[float, float, float]
    ambient: tuple[float, float, float]

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Lights:
        """Samples lights: a lamp at most `STEEPEST` from straight above, half to one and a half times as strong, from
        3500 K to 9000 K; the rest 0.6 to 1.4 times as strong, and of a temperature of its own."""
        tilt, round_ = STEEPEST * math.sqrt(rng.uniform()), rng.uniform(-math.pi, math.pi)
        direction = (math.sin(tilt) * math.cos(round_), math.sin(tilt) * math.sin(round_), -math.cos(tilt))
        lamp = 0.55 * rng.uniform(0.5, 1.5) * tint(rng.uniform(_KELVIN[0], _KELVIN[-1]))
        rest = 0.35 * tint(rng.uniform(_KELVIN[0], _KELVIN[-1]))
        glow, ambient = rest * rng.uniform(0.6, 1.4), rest * rng.uniform(0.6, 1.4)
        return cls(direction, _rgb(lamp), _rgb(glow), _rgb(ambient))


@dataclass(frozen=True, slots=True)
class Shift:
    """A displacement of a camera: moved by `offset` (3,) m in the world frame, and turned by the rotation vector
    `turn` (3,) rad in its own."""

    offset: tuple[float, float, float]
    turn: tuple[float, float, float]

    @classmethod
    def drawn(cls, rng: np.random.Generator, metres: float = 0.03, radians: float = math.radians(3.0)) -> Shift:
        """Samples uniformly among displacements of at most `metres` and rotations of at most `radians`."""
        return cls(_in_ball(rng, metres), _in_ball(rng, radians))


class Relighting:
    """Renders a scene at given positions. A context manager that frees its renderers.

    The model is changed during rendering and restored afterwards, so that it may be shared with a world. Within
    `set_up` the caller may render pictures of another kind.
    """

    def __init__(self, model: mujoco.MjModel, spec: SceneSpec) -> None:
        self.model, self.spec = model, spec
        self.data = mujoco.MjData(model)
        self.drawing = Drawing(model)

    @classmethod
    def of(cls, file: Path, objects: Mapping[str, str]) -> Relighting:
        """Makes one from a domain's `scene.toml` with the objects (name -> type) of one problem.

        Raises:
            DomainError: the scene file is wrong, an object has no body, or MuJoCo refuses the scene.
            MissingError: robosuite is not installed.
        """
        spec = read_scene(file).restricted_to(objects, file)
        return cls(compiled(spec, file), spec)

    def __enter__(self) -> Relighting:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.drawing.close()

    def pictures(
        self,
        qpos: FloatArray,
        lights: Lights | None = None,
        shifts: Mapping[str, Shift] = MappingProxyType({}),
        cameras: Collection[str] | None = None,
    ) -> dict[str, Image]:
        """Renders the cameras' pictures: camera -> (H, W, 3) uint8, in the scene's order.

        Args:
            qpos: MuJoCo's positions of everything, (nq,).
            lights: instead of the scene's own.
            shifts: camera -> its displacement.
            cameras: whose pictures to draw; all when not given.

        Raises:
            InputError: the positions are of another scene, or there is no such camera.
            MissingError: there is no off-screen OpenGL.
        """
        known = [camera.name for camera in self.spec.cameras]
        for camera in (*(cameras or ()), *shifts):
            if camera not in known:
                raise InputError(f"the scene has no camera {camera!r}; {nearest(camera, known)}")
        with self.set_up(qpos, lights, shifts):
            return {
                camera.name: self.drawing.picture(self.data, camera)
                for camera in self.spec.cameras
                if cameras is None or camera.name in cameras
            }

    @contextmanager
    def set_up(
        self, qpos: FloatArray, lights: Lights | None = None, shifts: Mapping[str, Shift] = MappingProxyType({})
    ) -> Iterator[None]:
        """Sets positions, lights and camera poses within the context."""
        model, data = self.model, self.data
        if qpos.shape != (model.nq,):
            raise InputError(f"the positions are of another scene: {qpos.size}, and this one has {model.nq}")
        parts = _parts(model)
        before = [part.copy() for part in parts]
        try:
            if lights is not None:
                _light(model, lights)
            for camera, shift in shifts.items():
                _move(model, model.camera(camera).id, shift)
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_camlight(model, data)
            yield
        finally:
            for part, value in zip(parts, before, strict=True):
                part[:] = value


def tint(kelvin: float) -> FloatArray:
    """The colour (3,) of white under a light of this temperature, interpolated; its strongest part is 0.993 to 1."""
    columns = np.asarray(_TINTS, dtype=float).T / 255.0
    return np.array([np.interp(kelvin, _KELVIN, column) for column in columns])


def _parts(model: mujoco.MjModel) -> list[FloatArray]:
    """Views into the model of all parameters of lights and cameras."""
    head = model.vis.headlight
    lights = [model.light_dir, model.light_diffuse, head.diffuse, head.ambient]
    return [*lights, model.cam_pos, model.cam_quat]


def _light(model: mujoco.MjModel, lights: Lights) -> None:
    model.light_dir[:] = lights.direction
    model.light_diffuse[:] = lights.lamp
    model.vis.headlight.diffuse[:] = lights.glow
    model.vis.headlight.ambient[:] = lights.ambient


def _move(model: mujoco.MjModel, camera: int, shift: Shift) -> None:
    model.cam_pos[camera] += shift.offset
    angle = float(np.linalg.norm(shift.turn))
    if angle > 0.0:
        turn, turned = np.empty(4), np.empty(4)
        mujoco.mju_axisAngle2Quat(turn, np.asarray(shift.turn) / angle, angle)
        mujoco.mju_mulQuat(turned, model.cam_quat[camera], turn)
        model.cam_quat[camera] = turned


def _in_ball(rng: np.random.Generator, radius: float) -> tuple[float, float, float]:
    direction = rng.normal(size=3)
    x, y, z = (radius * rng.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)).tolist()
    return x, y, z


def _rgb(colour: FloatArray) -> tuple[float, float, float]:
    red, green, blue = colour.tolist()
    return red, green, blue
