"""What is only looked at, with fewer triangles: the arm's makers drew every screw, and software draws every triangle.

Measured for the five cameras of the grocery scene: 68.7 against 36.0 ms of processor time at 384 pixels, and 1.9
against 0.1 s to compile, with 142,000 and 44,000 triangles (`python -m benchmarks.speed`).
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from executive.types import FloatArray
from executive.util.arrays import kept

Triangles = np.ndarray[Any, np.dtype[np.int64]]

_VERTEX = re.compile(r"^v\s+(\S+\s+\S+\s+\S+)", re.MULTILINE)
_FACE = re.compile(r"^f\s+(.*\S)", re.MULTILINE)

CELL = 0.003
"""m; what is smaller than this is drawn as one point. A pixel of a camera shows about as much."""

_FORMAT = 1
"""Of the meshes that are kept: to be raised with every change of how they are made."""


def lighten(scene: mujoco.MjSpec) -> None:
    """Draw with fewer triangles what nothing can touch. Textured meshes are left as they are."""
    drawn = {geom.meshname for geom in scene.geoms if geom.contype == 0 and geom.conaffinity == 0}
    touched = {geom.meshname for geom in scene.geoms if geom.contype != 0 or geom.conaffinity != 0}
    textured = {material.name for material in scene.materials if any(material.textures)}
    textured_meshes = {geom.meshname for geom in scene.geoms if geom.material in textured}
    for mesh in scene.meshes:
        file = Path(mesh.file)
        if mesh.name in drawn - touched - textured_meshes and file.suffix == ".obj":
            vertices, triangles = _simplified(file, tuple(mesh.scale))
            if len(triangles):
                mesh.uservert, mesh.userface = vertices.ravel().tolist(), triangles.ravel().tolist()
                mesh.file, mesh.scale = "", [1.0, 1.0, 1.0]


def drop_unused(scene: mujoco.MjSpec) -> None:
    """Leave out the meshes that no geom has: compiling them costs more than all the rest."""
    used = {geom.meshname for geom in scene.geoms}
    for mesh in list(scene.meshes):
        if mesh.name not in used:
            scene.delete(mesh)


def simplified(vertices: FloatArray, triangles: Triangles, cell: float = CELL) -> tuple[FloatArray, Triangles]:
    """The mesh with all vertices in a cube of side `cell` (m) drawn together into their mean, and without the triangles
    that are lines then (vertex clustering, Rossignac and Borrel 1993).

    Args:
        vertices: (N, 3), m.
        triangles: (M, 3), indices of vertices.
    """
    if not len(vertices):
        return vertices, triangles
    _, cluster = np.unique(_as_one(np.round(vertices / cell).astype(np.int64)), return_inverse=True)
    size = np.bincount(cluster)
    means = np.stack([np.bincount(cluster, vertices[:, axis]) / size for axis in range(3)], axis=1)
    kept = cluster[triangles]
    kept = kept[(kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 0] != kept[:, 2])]
    # Of triangles that have fallen together one is enough: the first, which keeps the side that it faces.
    _, first = np.unique(_as_one(np.sort(kept, axis=1)), return_index=True)
    used, renamed = np.unique(kept[np.sort(first)], return_inverse=True)
    return means[used], renamed.reshape(-1, 3).astype(np.int64)


def _as_one(rows: Triangles) -> Triangles:
    """Rows of integers (N, 3) as one integer each (N,), equal where the rows are: those are sorted much faster."""
    if not len(rows):
        return np.empty(0, dtype=np.int64)
    low = rows.min(axis=0)
    span = rows.max(axis=0) - low + 1
    one: Triangles = np.ravel_multi_index(tuple((rows - low).T), tuple(span.tolist()))
    return one


@cache
def _simplified(file: Path, scale: tuple[float, ...]) -> tuple[FloatArray, Triangles]:
    """The lighter mesh of a file. It is kept: to read the arm's 31 MB of text takes more than half a second."""

    def make() -> dict[str, Any]:
        vertices, triangles = read_obj(file)
        vertices, triangles = simplified(vertices * np.array(scale), triangles)
        return {"vertices": vertices, "triangles": triangles}

    digest = hashlib.sha256(repr((_FORMAT, CELL, scale)).encode())
    digest.update(file.read_bytes())
    return kept("meshes", digest.hexdigest(), make, lambda mesh: (mesh["vertices"], mesh["triangles"]))


def read_obj(file: Path) -> tuple[FloatArray, Triangles]:
    """Vertices (N, 3) and triangles (M, 3) of a Wavefront file. Polygons are cut into fans; all else is passed over."""
    text = file.read_text(encoding="utf-8")
    vertices = np.fromstring(" ".join(_VERTEX.findall(text)), sep=" ").reshape(-1, 3)
    # What follows a slash is about texture and normals.
    faces = re.sub(r"/\S*", "", "\n".join(_FACE.findall(text)))
    corners = np.fromstring(faces, dtype=np.int64, sep=" ")
    sides = {line.count(" ") + 1 for line in faces.splitlines()}
    if sides <= {3}:
        triangles = corners.reshape(-1, 3)
    else:
        polygons = [line.split() for line in faces.splitlines()]
        fans = [(points[0], *points[at : at + 2]) for points in polygons for at in range(1, len(points) - 1)]
        triangles = np.array(fans, dtype=np.int64).reshape(-1, 3)
    # They count from 1; from the end, where that is negative.
    return vertices, np.where(triangles < 0, triangles + len(vertices), triangles - 1)
