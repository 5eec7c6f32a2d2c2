"""Items that are put together from several shapes: their meshes, volumes and geoms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from executive.sim.meshes import Triangles
from executive.sim.part_spec import PartSpec
from executive.types import FloatArray

SIDES = 32
"""How many sides stand for a circle; a multiple of four, so that extents along x and y are exact."""

_TUBE = 12
"""The same for the tube of a torus."""


class Mesh(NamedTuple):
    """Vertices (V, 3) in m and faces (F, 3) of their indices, counter-clockwise from outside."""

    vertices: FloatArray
    faces: Triangles

    @property
    def volume(self) -> float:
        """What it encloses, in m^3 (the sum of the signed tetrahedra between its faces and the origin)."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def lathe(profile: Sequence[tuple[float, float]], sides: int = SIDES) -> Mesh:
    """Return the closed surface that a profile of (radius, height) sweeps about the z axis, from axis to axis."""
    (first, bottom), (last, top) = profile[0], profile[-1]
    points = [*([(0.0, bottom)] if first > 0 else []), *profile, *([(0.0, top)] if last > 0 else [])]
    angles = 2 * np.pi * np.arange(sides) / sides
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices: list[FloatArray] = []
    rings: list[np.ndarray[tuple[int], np.dtype[np.int64]]] = []
    for radius, height in points:
        start = len(vertices)
        if radius == 0.0:  # all of a ring is one point on the axis
            vertices.append(np.array([0.0, 0.0, height]))
            rings.append(np.full(sides, start))
        else:
            vertices += [np.array([radius * x, radius * y, height]) for x, y in around]
            rings.append(start + np.arange(sides))
    faces = [_band(lower, upper) for lower, upper in pairwise(rings)]
    mesh = Mesh(np.array(vertices), np.concatenate(faces))
    return mesh if mesh.volume >= 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def torus(size: tuple[float, float, float], sides: int = SIDES, tube: int = _TUBE) -> Mesh:
    """Return a torus around the z axis: its outer extents along x and y, and the thickness of its tube, in m."""
    radius = 0.5 * size[2]
    angles, around = 2 * np.pi * np.arange(sides) / sides, 2 * np.pi * np.arange(tube) / tube
    middle = np.stack([(0.5 * size[0] - radius) * np.cos(angles), (0.5 * size[1] - radius) * np.sin(angles)], axis=1)
    # The tube's cross-section is upright on the middle line, whose normal is not its radius where it is an ellipse.
    outward = np.stack([(0.5 * size[1] - radius) * np.cos(angles), (0.5 * size[0] - radius) * np.sin(angles)], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    flat = middle[:, None] + radius * np.cos(around)[None, :, None] * outward[:, None]
    height = np.broadcast_to(radius * np.sin(around), (sides, tube))
    vertices = np.concatenate([flat, height[..., None]], axis=-1).reshape(-1, 3)
    rings = np.arange(sides * tube).reshape(sides, tube)
    faces = np.concatenate([_band(rings[number - 1], rings[number]) for number in range(sides)])
    mesh = Mesh(vertices, faces)
    return mesh if mesh.volume >= 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def add_parts(
    scene: mujoco.MjSpec, body: mujoco.MjsBody, name: str, parts: Sequence[PartSpec], mass: float
) -> list[mujoco.MjsGeom]:
    """Give a body a geom for each part of an item; the parts share its mass (kg) by their volumes."""
    shapes = [_mesh(part) for part in parts]
    volumes = [shape.volume if shape is not None else _volume(part) for part, shape in zip(parts, shapes, strict=True)]
    geoms = []
    for number, (part, shape, volume) in enumerate(zip(parts, shapes, volumes, strict=True)):
        label = f"{name}/part-{number}"
        kind, size = mujoco.mjtGeom.mjGEOM_MESH, [0.0, 0.0, 0.0]
        if shape is not None:
            mesh = scene.add_mesh(name=label)
            mesh.uservert, mesh.userface = shape.vertices.ravel().tolist(), shape.faces.ravel().tolist()
        else:
            kind, size = _primitive(part)
        x, y, z, w = Rotation.from_euler("xyz", part.turn_degrees, degrees=True).as_quat()
        geom = body.add_geom(
            name=label,
            type=kind,
            size=size,
            pos=part.position,
            quat=[w, x, y, z],
            rgba=part.rgba,
            mass=mass * volume / math.fsum(volumes),
        )
        if shape is not None:
            geom.meshname = label
        geoms.append(geom)
    return geoms


def _mesh(part: PartSpec) -> Mesh | None:
    """The mesh of a part; None for a shape that MuJoCo has."""
    if part.shape == "lathe":
        assert part.profile is not None
        return lathe(part.profile)
    if part.shape == "torus":
        assert part.size is not None
        return torus(part.size)
    return None


def _primitive(part: PartSpec) -> tuple[mujoco.mjtGeom, list[float]]:
    assert part.size is not None
    x, y, z = (0.5 * extent for extent in part.size)
    match part.shape:
        case "cylinder":
            return mujoco.mjtGeom.mjGEOM_CYLINDER, [x, z, 0.0]
        case "sphere":
            return mujoco.mjtGeom.mjGEOM_SPHERE, [x, 0.0, 0.0]
    return mujoco.mjtGeom.mjGEOM_BOX, [x, y, z]


def _volume(part: PartSpec) -> float:
    assert part.size is not None
    x, y, z = part.size
    return x * y * z * {"cylinder": math.pi / 4.0, "sphere": math.pi / 6.0}.get(part.shape, 1.0)


def _band(
    lower: np.ndarray[tuple[int], np.dtype[np.int64]], upper: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> Triangles:
    """The faces between two rings of vertices, without those that a point on the axis leaves no area."""
    after, beyond = np.roll(lower, -1), np.roll(upper, -1)
    faces = np.concatenate([np.stack([lower, after, beyond], axis=1), np.stack([lower, beyond, upper], axis=1)])
    apart = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return np.asarray(faces[apart], dtype=np.int64)
