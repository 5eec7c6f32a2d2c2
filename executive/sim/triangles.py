"""What a model's geoms look like as triangles with normals and texture coordinates, for a renderer of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from executive.types import FloatArray

_ROUND = 64
"""Sides that stand for a circle."""

_FLOOR = 6.0
"""m of a floor without end that are drawn around the origin."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Vertices (V, 3) in m with their normals (V, 3) and texture coordinates (V, 2), and faces (F, 3) of vertices'
    indices, counter-clockwise from outside, in the geom's frame."""

    vertices: FloatArray
    normals: FloatArray
    texture: FloatArray
    faces: np.ndarray[Any, np.dtype[np.uint32]]


def triangles(model: mujoco.MjModel, geom: int) -> Triangles | None:
    """A geom's triangles; None for a shape that no scene draws."""
    size = np.array(model.geom_size[geom])
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _mesh(model, int(model.geom_dataid[geom]))
        case mujoco.mjtGeom.mjGEOM_BOX:
            return _box(size)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return _cylinder(float(size[0]), float(size[1]))
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return _turned(*_capsule(float(size[0]), float(size[1])))
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return _turned(*_capsule(float(size[0]), 0.0))
        case mujoco.mjtGeom.mjGEOM_PLANE:
            corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float) * _FLOOR
            up = np.tile([0.0, 0.0, 1.0], (4, 1))
            return Triangles(corners, up, corners[:, :2], np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32))
    return None


def _mesh(model: mujoco.MjModel, mesh: int) -> Triangles:
    """A mesh with its vertices split where normals or texture coordinates differ."""
    first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    rows = slice(first, first + faces)
    keys = [model.mesh_face[rows].ravel(), model.mesh_facenormal[rows].ravel()]
    textured = model.mesh_texcoordadr[mesh] >= 0
    keys.append(model.mesh_facetexcoord[rows].ravel() if textured else np.zeros_like(keys[0]))
    unique, index = np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] + unique[:, 0]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + unique[:, 1]]
    texture = np.zeros((len(unique), 2))
    if textured:
        texture = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + unique[:, 2]]
    return Triangles(
        np.asarray(vertices, dtype=float),
        np.asarray(normals, dtype=float),
        np.asarray(texture, dtype=float),
        index.reshape(-1, 3).astype(np.uint32),
    )


def _box(half: FloatArray) -> Triangles:
    """A box whose texture coordinates are m along each face."""
    corners: list[FloatArray] = []
    normals: list[FloatArray] = []
    texture: list[FloatArray] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, u = np.zeros(3), np.zeros(3)
            normal[axis], u[(axis + 1) % 3] = sign, 1.0
            v, first = np.cross(normal, u), len(corners)
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
            for along, across in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = (normal + along * u + across * v) * half
                corners.append(corner)
                normals.append(normal)
                texture.append(np.array([corner @ u, corner @ v]))
    return Triangles(np.array(corners), np.array(normals), np.array(texture), np.array(faces, dtype=np.uint32))


def _cylinder(radius: float, half: float) -> Triangles:
    profile = np.array([[0, half], [radius, half], [radius, half], [radius, -half], [radius, -half], [0, -half]])
    outward = np.array([[0, 1], [0, 1], [1, 0], [1, 0], [0, -1], [0, -1]], dtype=float)
    return _turned(profile, outward)


def _capsule(radius: float, half: float) -> tuple[FloatArray, FloatArray]:
    """The profile of a ball that is drawn out along z: distances from the axis and heights, and normals."""
    polar = np.linspace(0.0, np.pi, _ROUND // 2 + 1)
    outward = np.stack([np.sin(polar), np.cos(polar)], axis=1)
    profile = radius * outward + np.stack([np.zeros_like(polar), np.where(polar <= np.pi / 2, half, -half)], axis=1)
    return profile, outward


def _turned(profile: FloatArray, outward: FloatArray) -> Triangles:
    """A profile (P, 2), from top to bottom, turned about the z axis, with its normals (P, 2)."""
    around = np.linspace(0.0, 2 * np.pi, _ROUND + 1)  # the first again at the end, where the texture meets itself
    cos, sin = np.cos(around), np.sin(around)

    def spun(points: FloatArray) -> FloatArray:
        x, z = points[:, :1], points[:, 1:]
        return np.stack([x * cos, x * sin, np.broadcast_to(z, (len(points), len(around)))], axis=-1).reshape(-1, 3)

    u, v = np.meshgrid(around / (2 * np.pi), np.linspace(1.0, 0.0, len(profile)))
    faces = []
    width = len(around)
    for row in range(len(profile) - 1):
        a, b = row * width + np.arange(_ROUND), (row + 1) * width + np.arange(_ROUND)
        faces += [np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)]
    return Triangles(
        spun(profile), spun(outward), np.stack([u.ravel(), v.ravel()], axis=1), np.concatenate(faces).astype(np.uint32)
    )
