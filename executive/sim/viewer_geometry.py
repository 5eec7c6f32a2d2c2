"""The scene's shapes as plain triangle meshes, for the viewer: no simulator is needed to look at a trace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import mujoco
import numpy as np
import numpy.typing as npt

from executive.sim import scene
from executive.sim.spec import SceneSpec
from executive.types import Camera, FloatArray, Geometry, Scenery

_CELL = 0.003
"""Vertices of a mesh that fall into one cell of this size (m) are drawn as one: the arm's meshes have 362,000."""


def of(model: mujoco.MjModel, spec: SceneSpec) -> Scenery:
    """Every geom of a scene that is drawn, and every camera."""
    return mujoco_scenery(model, {each.name: (each.width, each.height) for each in spec.cameras}, scene.JOINTS)


def mujoco_scenery(
    model: mujoco.MjModel, cameras: Mapping[str, tuple[int, int]] = MappingProxyType({}), joints: Sequence[str] = ()
) -> Scenery:
    """The shapes and cameras of a MuJoCo model, for the viewer: geoms of the groups 1 and 2, where robosuite and others
    have what is drawn; groups of what only collides are left out.

    Args:
        cameras: name -> width and height of its pictures, for those that are looked through.
        joints: the names of the arm's joints, in the order in which frames have them.
    """
    geometries = []
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in range(model.ngeom):
        if model.geom_group[geom] not in (scene.VISUAL, scene.ITEM) or model.geom(geom).name == "floor":
            continue
        triangles = _triangles(model, geom)
        if triangles is None:
            continue
        vertices, faces = triangles
        body = model.geom_bodyid[geom]
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        local = vertices @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        if model.body_weldid[body] == 0:  # never moves: say where it is in the world
            local = local @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
            name = ""
        else:
            name = model.body(body).name
        label = model.geom(geom).name or f"{model.body(body).name}/{geom}"
        geometries.append(Geometry(name, local.astype(np.float32), faces, _colour(model, geom), label))
    seen = []
    for camera, (width, height) in cameras.items():
        index = model.camera(camera).id
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, data.cam_xmat[index])
        pose = tuple(float(value) for value in (*data.cam_xpos[index], *quaternion))
        seen.append(Camera(camera, pose, float(np.deg2rad(model.cam_fovy[index])), width, height))
    return Scenery(tuple(geometries), tuple(seen), tuple(joints))


def mujoco_poses(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, FloatArray]:
    """Where every body is that can move, (7,) each: what a frame of a world in MuJoCo has."""
    return {
        model.body(body).name: np.concatenate([data.xpos[body], data.xquat[body]])
        for body in range(1, model.nbody)
        if model.body_weldid[body] != 0
    }


def exact(model: mujoco.MjModel, geom: int, body: str) -> Geometry:
    """A geom with all its triangles, in the frame of its outermost body."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        vertices, faces = _mesh(model, model.geom_dataid[geom])
    else:
        triangles = _triangles(model, geom)
        assert triangles is not None  # items are meshes, boxes, cylinders and balls
        vertices, faces = triangles
    local = scene.in_root_frame(model, geom, np.asarray(vertices, dtype=float))
    return Geometry(body, local.astype(np.float32), faces, _colour(model, geom), body)


def merged(parts: Sequence[Geometry]) -> Geometry:
    """Several geometries of one body as one, in the mean of their colours by area."""
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = np.concatenate([part.faces + np.uint32(start) for part, start in zip(parts, starts, strict=True)])
    corners = [part.vertices[part.faces] for part in parts]
    areas = [float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()) for c in corners]
    r, g, b, a = np.average([part.rgba for part in parts], axis=0, weights=areas)
    first = parts[0]
    vertices = np.concatenate([part.vertices for part in parts])
    return Geometry(first.body, vertices, faces, (float(r), float(g), float(b), float(a)), first.name)


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    start, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return np.asarray(model.mesh_vert[first : first + count], dtype=np.float64), np.asarray(
        model.mesh_face[start : start + faces], dtype=np.uint32
    )


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, float, float, float]:
    """The geom's own colour; where a texture covers it, the texture's mean."""
    rgba = np.array(model.geom_rgba[geom], dtype=float)
    material = model.geom_matid[geom]
    if material >= 0:
        rgba = np.array(model.mat_rgba[material], dtype=float)
        texture = model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB]
        if texture >= 0:
            start, channels = model.tex_adr[texture], model.tex_nchannel[texture]
            count = model.tex_height[texture] * model.tex_width[texture] * channels
            texels = model.tex_data[start : start + count].reshape(-1, channels)[:, :3]
            rgba[:3] *= texels.mean(axis=0) / 255.0
    return (float(rgba[0]), float(rgba[1]), float(rgba[2]), float(rgba[3]))


def _triangles(model: mujoco.MjModel, geom: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]] | None:
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _clustered(*_mesh(model, model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64) * size
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        # Corners are not shared between faces, so that each face is flat when shaded.
        vertices = np.concatenate([corners[list(quad)] for quad in quads])
        offsets = 4 * np.arange(6)[:, None, None]
        return vertices, (offsets + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint32)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _cylinder(float(size[0]), float(size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _ball(float(size[0]))
    return None


def _ball(radius: float, rings: int = 12) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    """A sphere of `rings` rows of quadrilaterals, twice as many to a row."""
    polar, around = np.linspace(0.0, np.pi, rings + 1), np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    vertices = np.concatenate([np.column_stack([np.sin(p) * ring, np.full(len(ring), np.cos(p))]) for p in polar])
    i, j = np.arange(2 * rings), (np.arange(2 * rings) + 1) % (2 * rings)
    quads = [
        np.concatenate([np.stack([a + i, b + i, b + j], axis=1), np.stack([a + i, b + j, a + j], axis=1)])
        for a, b in ((2 * rings * row, 2 * rings * (row + 1)) for row in range(rings))
    ]
    return radius * vertices, np.concatenate(quads).astype(np.uint32)


def _cylinder(radius: float, half: float, sides: int = 24) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    bottom, top = np.column_stack([ring, np.full(sides, -half)]), np.column_stack([ring, np.full(sides, half)])
    vertices = np.concatenate([bottom, top, [[0, 0, -half], [0, 0, half]]])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate(
        [
            np.stack([i, j, j + sides], axis=1),
            np.stack([i, j + sides, i + sides], axis=1),
            np.stack([np.full(sides, 2 * sides), j, i], axis=1),
            np.stack([np.full(sides, 2 * sides + 1), i + sides, j + sides], axis=1),
        ]
    )
    return vertices, faces.astype(np.uint32)


def _clustered(
    vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    """The mesh with vertices merged per grid cell and the triangles that this leaves."""
    _, index, inverse = np.unique(np.round(vertices / _CELL), axis=0, return_index=True, return_inverse=True)
    merged = inverse.reshape(-1)[faces]
    distinct = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    kept = np.unique(merged[distinct], axis=0)
    return vertices[index], kept.astype(np.uint32)
