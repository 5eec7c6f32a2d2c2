"""The convex hulls that a MuJoCo model's geoms touch each other with, by as few points as will do."""

from __future__ import annotations

import mujoco
import numpy as np

from executive.skills import collision_kernels
from executive.types import FloatArray

_ROUND = 32
"""Corners that stand for a circle: they leave out 0.5 % of its radius."""

_BALL = 96
"""Corners that stand for a sphere: they leave out 3 % of its radius, less than a millimetre of what a hand can hold."""

_DEPTH = 0.5
"""m of ground under a plane that count."""

_DIRECTIONS = 400


def hull(model: mujoco.MjModel, geom: int, tolerance: float) -> FloatArray:
    """Points (N, 3) in the geom's own frame whose hull lies within the geom's and less than `tolerance` m away from any
    of it (round ones apart, see `_ROUND`).

    Raises:
        ValueError: a geom of a type that no scene here has.
    """
    size = model.geom_size[geom]
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_MESH:
            return reduced(_mesh_hull(model, int(model.geom_dataid[geom])), tolerance)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return np.asarray(signs() * size)
        case mujoco.mjtGeom.mjGEOM_PLANE:
            # A size of 0 means without end.
            half = np.array([*np.where(size[:2] > 0, size[:2], 100.0), 0.5 * _DEPTH])
            return np.asarray(signs() * half - np.array([0.0, 0.0, 0.5 * _DEPTH]))
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            angles = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
            rim = np.stack([size[0] * np.cos(angles), size[0] * np.sin(angles), np.full(_ROUND, size[1])], axis=1)
            return np.concatenate([rim, rim * [1.0, 1.0, -1.0]])
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return np.asarray(size[0] * _sphere(_BALL))
    raise ValueError(f"a geom of type {model.geom_type[geom]} is not known to the planner")


def reduced(points: FloatArray, tolerance: float) -> FloatArray:
    """As few of the points (N, 3) as it takes for every one to lie in their hull or at most `tolerance` m outside.

    The farthest one that is left out is taken in until none is too far: first by how far the hulls reach in a few
    hundred directions, then by the distances themselves.
    """
    directions = _sphere(_DIRECTIONS)
    reach = points @ directions.T
    extremes = reach.max(axis=0)
    kept = list(dict.fromkeys(int(index) for index in points.argmax(axis=0)))
    while True:
        gaps = extremes - reach[kept].max(axis=0)
        worst = int(gaps.argmax())
        if gaps[worst] <= 0.8 * tolerance:
            break
        kept.append(int(reach[:, worst].argmax()))
    while True:
        away = distances(points, points[kept])
        worst = int(away.argmax())
        if away[worst] <= tolerance:
            return np.ascontiguousarray(points[sorted(kept)])
        kept.append(worst)


def distances(points: FloatArray, corners: FloatArray) -> FloatArray:
    """How far each of the points (N, 3) is from the hull of `corners` (M, 3), in m."""
    found = np.empty(len(points))
    collision_kernels.distances(points, by_fours(corners), found)
    return found


def apart(first: FloatArray, second: FloatArray) -> float:
    """How far apart the hulls of two sets of points (N, 3) are, in m."""
    one, other = by_fours(first), by_fours(second)
    spans = np.array([[0, 0, len(one)], [0, len(one), len(other)]], dtype=np.int64)
    room = np.zeros((14, 3))
    room[:3], room[4] = np.eye(3), other[0] - one[0]
    room[4, 0] += 1e-9
    both = np.ascontiguousarray(np.concatenate([one, other]).T)
    return collision_kernels.separation(both, spans, 0, 1, 0.0, np.inf, 1e-9, room)


def by_fours(points: FloatArray) -> FloatArray:
    """The points (N, 3), the last one as often as it takes to have a multiple of four: so `separation` wants them."""
    return np.concatenate([points, np.repeat(points[-1:], -len(points) % 4, axis=0)])


def ball(points: FloatArray) -> tuple[FloatArray, float]:
    """A ball around points (N, 3), nearly the smallest: its centre (3,) and radius."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for step in range(1, 200):  # Badoiu and Clarkson (2003): a little towards the farthest, less each time
        farthest = points[int(np.linalg.norm(points - centre, axis=1).argmax())]
        centre = centre + (farthest - centre) / (step + 1)
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


def _mesh_hull(model: mujoco.MjModel, mesh: int) -> FloatArray:
    """The corners of a mesh's convex hull, which MuJoCo's compiler has found."""
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = np.asarray(model.mesh_vert[start : start + count], dtype=float)
    graph = model.mesh_graphadr[mesh]
    if graph < 0:
        return points
    corners = int(model.mesh_graph[graph])
    return np.asarray(points[model.mesh_graph[graph + 2 + corners : graph + 2 + 2 * corners]])


def signs() -> FloatArray:
    """The corners (8, 3) of a box that reaches from -1 to 1."""
    return np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def _sphere(count: int) -> FloatArray:
    """Unit vectors (count, 3) spread evenly: a Fibonacci lattice."""
    index = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * index / count, np.pi * (1.0 + np.sqrt(5.0)) * index
    around = np.sqrt(1.0 - height * height)
    return np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
