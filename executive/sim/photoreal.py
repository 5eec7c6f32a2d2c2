"""Photorealistic pictures of a scene, by the path tracer Mitsuba 3 and the denoiser OIDN (the extra `photoreal`).

One Mitsuba scene is kept, and what moved is moved in it before each picture. Light comes from an environment and from
area lights, all drawn by a seed; materials from MuJoCo's textures and from what items are made of. The same seed and
state give the same picture.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from functools import cache
from glob import glob
from importlib.util import find_spec
from typing import Any

import mujoco
import numpy as np

from executive.errors import MissingError
from executive.sim import scene as scenes
from executive.sim.spec import CameraSpec, SceneSpec
from executive.sim.triangles import Triangles, triangles
from executive.types import FloatArray, Image

EXTRA = "photoreal"

SAMPLES = 16
"""Paths traced for each pixel; a denoiser makes the rest of it."""

_GUIDE_SAMPLES = 4
"""Those of the albedo and the normals that guide the denoiser."""

_DEPTH = 6
"""The longest path, in bounces."""

_FIT = "llvm_ad_rgb"
_ANYWHERE = "scalar_rgb"
"""Needs no LLVM, and takes three times as long."""

_LLVM = "DRJIT_LIBLLVM_PATH"
"""Mitsuba's variable for the LLVM that it is to load."""

_LIBRARIES = ("/usr/lib/*/libLLVM*.so*", "/usr/lib/llvm-*/lib/libLLVM*.so*")
"""Where Linux distributions have it; of other systems Mitsuba knows the place."""

_PROBE_SECONDS = 60.0


class PhotorealDrawing:
    """Renders one model's pictures.

    Args:
        seed: of the light.

    Raises:
        MissingError: the extra is not installed.
    """

    def __init__(self, model: mujoco.MjModel, spec: SceneSpec, seed: int) -> None:
        self._mi, self._denoise, self.variant = _mitsuba()
        self._model, self._seed = model, seed % 2**31
        self._materials = {item.name: item.material for item in spec.items if item.material is not None}
        for item in spec.items:
            self._materials |= {
                f"{item.name}/part-{number}": part.material
                for number, part in enumerate(item.parts)
                if part.material is not None
            }
        drawn = [
            geom
            for geom in range(model.ngeom)
            if model.geom_group[geom] in (scenes.VISUAL, scenes.ITEM) and model.geom_rgba[geom][3] > 0.0
        ]
        self._shapes: dict[int, Triangles] = {}
        for geom in drawn:
            if (shape := triangles(model, geom)) is not None:
                self._shapes[geom] = shape
        # Without `optimize=False` the meshes are merged into one, which cannot be moved apart again.
        self._scene = self._mi.load_dict(self._described(), optimize=False)
        self._parameters = self._mi.traverse(self._scene)
        self._guide = self._mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
        self._sensors: dict[bytes, Any] = {}
        self._where = {geom: np.full(12, np.nan) for geom in self._shapes}
        self.pictures, self.seconds = 0, 0.0

    def picture(self, data: mujoco.MjData, camera: CameraSpec) -> Image:
        """What a camera sees of `data`, (H, W, 3) uint8."""
        began = time.perf_counter()
        self._move(data)
        sensor = self._sensor(data, camera)
        colour = self._rendered(None, sensor, SAMPLES)
        guide = self._rendered(self._guide, sensor, _GUIDE_SAMPLES)
        colour = np.clip(self._denoise(colour, guide[..., :3].copy(), guide[..., 3:6].copy(), hdr=True), 0.0, 1.0)
        encoded = np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * colour ** (1 / 2.4) - 0.055)  # sRGB
        self.pictures, self.seconds = self.pictures + 1, self.seconds + time.perf_counter() - began
        return np.asarray(np.round(255.0 * encoded), dtype=np.uint8)

    @property
    def cost(self) -> str:
        """What a picture took so far, in words."""
        each = self.seconds / max(1, self.pictures)
        return f"Mitsuba {self._mi.__version__}, {self.variant}: {each:.2f} s a picture of {SAMPLES} samples"

    def forget_cost(self) -> None:
        self.pictures, self.seconds = 0, 0.0

    def _rendered(self, integrator: Any, sensor: Any, samples: int) -> FloatArray:
        how = {} if integrator is None else {"integrator": integrator}
        image = self._mi.render(self._scene, sensor=sensor, spp=samples, seed=self._seed, **how)
        return np.ascontiguousarray(np.array(image), dtype=np.float32)

    def _sensor(self, data: mujoco.MjData, camera: CameraSpec) -> Any:
        index = self._model.camera(camera.name).id
        right, up, backward = data.cam_xmat[index].reshape(3, 3).T
        place = np.eye(4)
        place[:3] = np.stack([-right, up, -backward, data.cam_xpos[index]], axis=1)
        key = place.tobytes() + repr((camera.name, camera.width, camera.height)).encode()
        if key not in self._sensors:
            self._sensors[key] = self._mi.load_dict(
                {
                    "type": "perspective",
                    "fov": camera.fovy_degrees,
                    "fov_axis": "y",
                    "near_clip": 0.01,
                    "far_clip": 100.0,
                    "to_world": self._mi.ScalarTransform4f(place),
                    "film": {
                        "type": "hdrfilm",
                        "width": camera.width,
                        "height": camera.height,
                        "pixel_format": "rgb",
                        "component_format": "float32",
                        "rfilter": {"type": "box"},
                    },
                }
            )
        return self._sensors[key]

    def _move(self, data: mujoco.MjData) -> None:
        """Bring every geom to where `data` has it."""
        moved = False
        for geom, shape in self._shapes.items():
            place = np.concatenate([data.geom_xmat[geom], data.geom_xpos[geom]])
            if np.array_equal(place, self._where[geom]):
                continue
            self._where[geom], moved = place, True
            rotation = data.geom_xmat[geom].reshape(3, 3)
            self._set(f"geom{geom}.vertex_positions", shape.vertices @ rotation.T + data.geom_xpos[geom])
            self._set(f"geom{geom}.vertex_normals", shape.normals @ rotation.T)
        if moved:
            self._parameters.update()

    def _set(self, key: str, values: FloatArray) -> None:
        kept = self._parameters[key]
        self._parameters[key] = type(kept)(np.ascontiguousarray(values.ravel(), dtype=np.float32))

    # What the scene is made of.

    def _described(self) -> dict[str, Any]:
        """The scene: its meshes, with their materials, and its light."""
        described: dict[str, Any] = {"type": "scene", "integrator": {"type": "path", "max_depth": _DEPTH}}
        described |= self._light()
        for geom, shape in self._shapes.items():
            described[f"geom{geom}"] = self._mesh(geom, shape)
        return described

    def _mesh(self, geom: int, shape: Triangles) -> Any:
        properties = self._mi.Properties()
        properties["bsdf"] = self._mi.load_dict(self._material(geom))
        mesh = self._mi.Mesh(
            f"geom{geom}",
            vertex_count=len(shape.vertices),
            face_count=len(shape.faces),
            has_vertex_normals=True,
            has_vertex_texcoords=True,
            props=properties,
        )
        mesh.set_id(f"geom{geom}")
        parameters = self._mi.traverse(mesh)
        repeat = np.ones(2)
        material = int(self._model.geom_matid[geom])
        if material >= 0 and self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            repeat = np.array(self._model.mat_texrepeat[material])
        for key, values in (
            ("vertex_positions", shape.vertices),
            ("vertex_normals", shape.normals),
            ("vertex_texcoords", shape.texture * repeat),
        ):
            parameters[key] = type(parameters[key])(np.ascontiguousarray(values.ravel(), dtype=np.float32))
        parameters["faces"] = type(parameters["faces"])(np.ascontiguousarray(shape.faces.ravel()))
        parameters.update()
        return mesh

    def _material(self, geom: int) -> dict[str, Any]:
        """What a geom is made of: what its item says, or the texture and colour that MuJoCo draws."""
        model, material = self._model, int(self._model.geom_matid[geom])
        rgba = np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], dtype=float)
        colour: dict[str, Any] = {"type": "rgb", "value": _linear(rgba[:3]).tolist()}
        texture = -1 if material < 0 else int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB])
        if texture >= 0:
            texels = self._texels(texture) * rgba[:3]
            if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_2D:
                bitmap = self._mi.Bitmap(np.ascontiguousarray(np.clip(texels, 0, 255), dtype=np.uint8))
                colour = {"type": "bitmap", "bitmap": bitmap, "raw": False}
            else:  # around a cube: of one colour, in all assets that there are
                colour = {"type": "rgb", "value": _linear(texels.mean(axis=(0, 1)) / 255.0).tolist()}
        item = model.body(model.body_rootid[model.geom_bodyid[geom]]).name
        match self._materials.get(item, self._materials.get(model.geom(geom).name)):
            case "metal":
                return {"type": "roughconductor", "material": "Al", "alpha": 0.12, "specular_reflectance": colour}
            case "chrome":  # which reflects what is there, and not what MuJoCo draws on it
                own = {"type": "rgb", "value": _linear(rgba[:3]).tolist()}
                return {"type": "roughconductor", "material": "Al", "alpha": 0.06, "specular_reflectance": own}
            case "glass":
                return {"type": "roughdielectric", "alpha": 0.02, "specular_transmittance": colour}
            case "wood":
                return _plastic(colour, 0.25)
            case "rubber":
                return _plastic(colour, 0.5)
        if model.geom(geom).name == "floor":
            return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}
        shiny = 0.0 if material < 0 else float(model.mat_specular[material])
        return _plastic(colour, 0.35 if shiny < 0.3 else 0.15)

    def _texels(self, texture: int) -> FloatArray:
        model = self._model
        shape = model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture]
        start = model.tex_adr[texture]
        return np.asarray(model.tex_data[start : start + np.prod(shape)].reshape(shape)[..., :3], dtype=float)

    def _light(self) -> dict[str, Any]:
        """The light by seed: an environment with a bright sky and some soft windows, and two area lights above."""
        rng = np.random.default_rng([self._seed, 0x11687])
        height, width = 64, 128
        up = np.linspace(1.0, -1.0, height)[:, None, None]
        sky, ground = rng.uniform(0.25, 0.45) * _warmth(rng), rng.uniform(0.15, 0.25) * np.ones(3)
        picture = np.where(up > 0, sky * (0.7 + 0.3 * up), ground) * np.ones((height, width, 3))
        azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, width), np.linspace(0, np.pi, height))
        ways = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
        for _ in range(int(rng.integers(2, 5))):
            towards = np.array([*rng.normal(size=2), abs(rng.normal()) + 0.3])
            towards /= np.linalg.norm(towards)
            lobe = np.exp((ways @ towards - 1.0) * rng.uniform(15.0, 60.0))
            picture = picture + rng.uniform(0.6, 2.0) * lobe[..., None] * _warmth(rng)
        # Mitsuba's environment has y up; the scene's z is turned onto it.
        upright = self._mi.ScalarTransform4f().rotate([1, 0, 0], 90)
        bitmap = self._mi.Bitmap(np.ascontiguousarray(picture, dtype=np.float32))
        light: dict[str, Any] = {
            "environment": {"type": "envmap", "bitmap": bitmap, "to_world": upright},
        }
        for number in range(2):
            angle = rng.uniform(-np.pi, np.pi)
            centre = np.array([0.5 + 1.0 * np.cos(angle), 1.0 * np.sin(angle), rng.uniform(2.2, 2.8)])
            strength = rng.uniform(38.0, 60.0) * _warmth(rng)
            light[f"lamp{number}"] = {
                "type": "rectangle",
                "to_world": self._mi.ScalarTransform4f().look_at(
                    origin=centre.tolist(), target=[0.5, 0.0, 0.8], up=[0.0, 1.0, 0.1]
                )
                @ self._mi.ScalarTransform4f().scale(rng.uniform(0.15, 0.3)),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": strength.tolist()}},
            }
        return light


def _plastic(colour: dict[str, Any], roughness: float) -> dict[str, Any]:
    return {
        "type": "twosided",
        "bsdf": {"type": "roughplastic", "distribution": "ggx", "alpha": roughness, "diffuse_reflectance": colour},
    }


def _linear(srgb: FloatArray) -> FloatArray:
    """Linear RGB of a colour as it is shown."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _warmth(rng: np.random.Generator) -> FloatArray:
    """White, a little warmer or cooler."""
    share = rng.uniform(-0.08, 0.08)
    return np.array([1.0 + share, 1.0, 1.0 - share])


def require() -> None:
    """Check, without loading it, that there is what renders photorealistic pictures.

    Raises:
        MissingError: the extra is not installed.
    """
    if find_spec("mitsuba") is None or find_spec("mitsuba_oidn") is None:
        raise MissingError(
            f"for photorealistic pictures the extra {EXTRA!r} is missing",
            command=f"{sys.executable} -m pip install 'executive[{EXTRA}]'",
        )


@cache
def _mitsuba() -> tuple[Any, Any, str]:
    """Mitsuba with the fastest variant that works here, and the denoiser.

    Raises:
        MissingError: the extra is not installed.
    """
    require()
    import mitsuba
    from mitsuba_oidn import denoise

    variant = _variant()
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba, denoise, variant


def _variant() -> str:
    """The fastest variant that works here; tried in a process of its own, which an LLVM that does not fit ends."""
    said = os.environ.get(_LLVM)
    places = [found for pattern in _LIBRARIES for found in glob(pattern)]
    newest = sorted({os.path.realpath(each) for each in places}, reverse=True)
    for library in (said,) if said else (None, *newest):
        surroundings = os.environ | ({} if library is None else {_LLVM: library})
        try:
            done = subprocess.run(
                [sys.executable, "-m", "executive.sim.photoreal_probe", _FIT],
                env=surroundings,
                capture_output=True,
                timeout=_PROBE_SECONDS,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired):
            continue
        if done.returncode == 0:
            if library is not None:
                os.environ[_LLVM] = library
            return _FIT
    return _ANYWHERE
