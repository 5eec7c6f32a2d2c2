"""Collision checks beside Coal's (formerly hpp-fcl), the same hulls and pairs, with Pinocchio's kinematics and broad
phase: `pip install pin`, then `python -m benchmarks.speed --only coal`. Whether our own kernels are worth their lines
is decided by this: they are while a library takes more than three times as long.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from benchmarks.speed.queries import stage
from benchmarks.speed.table import Row, side_by_side
from executive.errors import MissingError
from executive.skills.arm import arm_of
from executive.skills.collision import _CLEARANCE, CollisionModel, Held
from executive.types import FloatArray

_SPACING, _LENGTH, _WORTH_IT = 0.05, 0.8, 3
"""rad between the checks along an edge, the length of an edge in rad, and the factor."""


class CoalModel:
    """The hulls, pairs and chain of a `CollisionModel`, as it was last updated, for Coal."""

    def __init__(self, collision: CollisionModel) -> None:
        try:
            import coal
            import pinocchio
        except ImportError as error:
            raise MissingError(f"Coal and Pinocchio: {error}", command="pip install pin") from error
        points, spans, *_, pairs, _, _ = collision._geometry
        chain = collision._parts.chain
        # Pinocchio's joint frames have their origin on the axis; ours are the bodies' own.
        origins = np.vstack([np.zeros(3), chain.anchors])
        self._model, parent = pinocchio.Model(), 0
        for joint, (frame, axis, anchor) in enumerate(zip(chain.frames, chain.axes, chain.anchors, strict=True)):
            rotation = frame[:9].reshape(3, 3)
            placement = pinocchio.SE3(rotation, frame[9:] + rotation @ anchor - origins[joint])
            parent = self._model.addJoint(
                parent, pinocchio.JointModelRevoluteUnaligned(*axis), placement, f"joint-{joint}"
            )
        geometry = pinocchio.GeometryModel()
        for number in range(len(collision._parts._hulls)):
            link, start, count = spans[number]
            hull = _convex(coal, points[:, start : start + count].T - origins[link])
            identity = pinocchio.SE3.Identity()
            geometry.addGeometryObject(pinocchio.GeometryObject(f"hull-{number}", int(link), identity, hull))
        for first, second in pairs:
            geometry.addCollisionPair(pinocchio.CollisionPair(int(first), int(second)))
        self._data, data = self._model.createData(), pinocchio.GeometryData(geometry)
        for request in data.collisionRequests:
            request.security_margin = _CLEARANCE
        manager = pinocchio.BroadPhaseManager_DynamicAABBTreeCollisionManager
        self._kept = geometry, data  # the manager only points at them
        self._broad_phase, self._collide = manager(self._model, geometry, data), pinocchio.computeCollisions

    def free(self, q: FloatArray) -> bool:
        return not self._collide(self._model, self._data, self._broad_phase, q, True)

    def edge_free(self, start: FloatArray, goal: FloatArray) -> bool:
        steps = max(1, int(np.ceil(np.linalg.norm(goal - start) / _SPACING)))
        return all(self.free(start + (goal - start) * (index / steps)) for index in range(steps + 1))


def _convex(coal: Any, points: FloatArray) -> Any:
    from scipy.spatial import ConvexHull

    hull, middle = ConvexHull(points), points.mean(axis=0)
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points[hull.vertices]:
        corners.append(point)
    number = {int(vertex): index for index, vertex in enumerate(hull.vertices)}
    for a, b, c in hull.simplices:
        outward = np.dot(np.cross(points[b] - points[a], points[c] - points[a]), points[a] - middle) > 0
        triangles.append(coal.Triangle(*(number[int(vertex)] for vertex in ((a, b, c) if outward else (a, c, b)))))
    return coal.Convex(corners, triangles)


def measure(everything: bool) -> list[Row]:
    world = stage(3)
    collision = arm_of(world.handle).collision
    rng, limits = np.random.default_rng(0), world.handle.limits
    in_hand = np.diag([1.0, -1.0, -1.0, 1.0])
    in_hand[2, 3] = 0.03
    collision.update(world.obstacles(), world.gripper_joints(), Held("cereal-box", in_hand))
    other = CoalModel(collision)
    some = rng.uniform(limits.lower, limits.upper, (3000 if everything else 300, 6))
    free = [q for q in some if collision.free(q)]
    edges = [(q, q + (to - q) * min(1.0, _LENGTH / np.linalg.norm(to - q))) for q, to in itertools.pairwise(free)]
    single = side_by_side(lambda: [collision.free(q) for q in some], lambda: [other.free(q) for q in some], 7, times=5)
    along = side_by_side(
        lambda: [collision.edge_free(*edge) for edge in edges], lambda: [other.edge_free(*edge) for edge in edges], 5,
        times=5,
    )  # fmt: skip
    differ = sum(collision.free(q) != other.free(q) for q in some)
    against = f"Coal with Pinocchio's broad phase, one by one; {differ} of {len(some)} answers differ"
    target = f"{_WORTH_IT} times"
    return [
        Row("collision check beside Coal, one configuration", 1e6 * single[0] / len(some), 1e6 * single[1] / len(some),
            "us", target, single[2] >= _WORTH_IT, against),
        Row("collision check beside Coal, one edge of 0.8 rad", 1e6 * along[0] / len(edges),
            1e6 * along[1] / len(edges), "us", target, along[2] >= _WORTH_IT,
            f"the same at every {_SPACING} rad until one touches"),
    ]  # fmt: skip
