"""A MuJoCo model as arguments of the collision kernels: hulls in link frames, and the pairs that must not touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from executive.skills import collision_kernels, convex_hulls
from executive.skills.collision_kernels import BoolArray, IntArray
from executive.types import FloatArray

_CORNERS = 8

_PARTS = 256
"""Of a joint's turn."""

_AROUND = 32

_SLACK = 0.001
"""m by which hulls that nothing is decided by are simplified."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A serial arm: for each of its J joints the frame of the link that it moves in that of the link before, at 0 rad,
    (J, 12): rotation by rows, then position; and the joint's axis and a point on it, (J, 3) each, in the moved link's
    frame. Link 0 is the world, link j what joint j - 1 moves."""

    frames: FloatArray
    axes: FloatArray
    anchors: FloatArray

    def packed(self) -> FloatArray:
        return np.ascontiguousarray(np.concatenate([self.frames, self.axes, self.anchors], axis=1))

    def turned(self, points: FloatArray) -> FloatArray:
        """Points (N, 3) in the world taken all around the first joint's axis: corners of a hull that none of what they
        sweep lies outside of."""
        rotation, position = self.frames[0, :9].reshape(3, 3), self.frames[0, 9:]
        axis = rotation @ self.axes[0]
        across = np.linalg.svd(axis[None])[2][1:]
        relative = points - (rotation @ self.anchors[0] + position)
        height, radius = relative @ axis, np.linalg.norm(relative @ across.T, axis=1) / math.cos(math.pi / _AROUND)
        angles = 2 * math.pi * np.arange(_AROUND) / _AROUND
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across
        rings = radius[:, None, None] * ways + (height[:, None] * axis)[:, None]
        return np.asarray(rings.reshape(-1, 3) + rotation @ self.anchors[0] + position)

    def second(self, angle: float) -> FloatArray:
        """The second link's frame in the world (12,) with the first joint at 0 and the second at `angle`."""
        q, frames = np.zeros(len(self.axes)), np.empty((1, len(self.axes) + 1, 12))
        q[1] = angle
        collision_kernels.arrange(self.packed(), q, q, 0, 0, frames)
        return np.asarray(frames[0, 2])

    def reach(self, link: int, points: FloatArray) -> FloatArray:
        """How far, in m, any of the points (N, 3) of a link can be from each joint's axis, (J,): by how much it moves
        at most for every radian that the joint turns."""
        result = np.zeros(len(self.axes))
        if link == 0:
            return result
        relative = points - self.anchors[link - 1]
        along = relative @ self.axes[link - 1]
        squares = np.maximum((relative**2).sum(axis=1) - along**2, 0.0)
        result[link - 1] = math.sqrt(float(squares.max()))
        away = float(np.linalg.norm(relative, axis=1).max())
        for joint in range(link - 2, -1, -1):
            rotation, position = self.frames[joint + 1, :9].reshape(3, 3), self.frames[joint + 1, 9:]
            away += float(np.linalg.norm(rotation @ self.anchors[joint + 1] + position - self.anchors[joint]))
            result[joint] = away
        return result


Arguments = tuple[FloatArray, IntArray, FloatArray, FloatArray, IntArray, IntArray, FloatArray, BoolArray]
"""The first eight arguments of `collision_kernels.clear`."""


class CollisionGeometry:
    """Hulls and pairs of a model, computed once; `arguments` updates them for the present poses.

    Args:
        model: may be changed afterwards in what touches what (`geom_contype`, `geom_conaffinity`), and in nothing else.
        joints: the arm's, from its base on.
        tolerances: m by which each geom's hull may be simplified inwards.
        clearance: m that are going to be asked for, at most.
    """

    def __init__(
        self, model: mujoco.MjModel, joints: Sequence[str], tolerances: Sequence[float], clearance: float
    ) -> None:
        self._model = model
        self._links = [int(model.joint(name).bodyid[0]) for name in joints]
        self.chain = _chain(model, joints, self._links)
        self._packed = self.chain.packed()
        self._hulls = [
            convex_hulls.by_fours(convex_hulls.hull(model, geom, each)) for geom, each in enumerate(tolerances)
        ]
        self._balls = [convex_hulls.ball(points) for points in self._hulls]
        self._link_of = np.array([self._above(int(body)) for body in model.geom_bodyid])
        counts = np.array([len(points) for points in self._hulls])
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self._points = np.zeros((3, int(counts.sum()) + _CORNERS * (len(joints) + 1)))
        # After the hulls, a row for each link: a box around all of its hulls.
        rows = model.ngeom + len(joints) + 1
        self._spans = np.zeros((rows, 3), dtype=np.int64)
        self._spans[: model.ngeom] = np.stack([self._link_of, starts, counts], axis=1)
        self._spans[model.ngeom :, 0] = np.arange(len(joints) + 1)
        self._spans[model.ngeom :, 1] = counts.sum() + _CORNERS * np.arange(len(joints) + 1)
        self._spans[model.ngeom :, 2] = _CORNERS
        self._bounds = np.zeros((rows, 10))
        self._reach = np.zeros((rows, len(joints)))
        self._poses = np.full((model.ngeom, 12), np.nan)
        self._may_touch = _may_touch(model)
        self._marks, self._groups = b"", np.zeros((0, 5), dtype=np.int64)
        self._pairs = np.zeros((0, 2), dtype=np.int64)
        self._stands = [geom for geom in range(model.ngeom) if not model.body_weldid[model.geom_bodyid[geom]]]
        self._quiet = self._quiet_parts(clearance)

    def arguments(self, data: mujoco.MjData, carried: Sequence[int] = ()) -> Arguments:
        """The arguments of `collision_kernels.clear` for the poses in `data`.

        Args:
            data: with the kinematics done, the arm in any configuration.
            carried: geoms of the held item, which move with the last link.
        """
        link = self._link_of.copy()
        link[list(carried)] = len(self._links)
        bodies = [0, *self._links]
        rotations, positions = data.xmat[bodies].reshape(-1, 3, 3)[link], data.xpos[bodies][link]
        turned = np.einsum("gji,gjk->gik", rotations, data.geom_xmat.reshape(-1, 3, 3))
        moved = np.einsum("gji,gj->gi", rotations, data.geom_xpos - positions)
        poses = np.concatenate([turned.reshape(-1, 9), moved], axis=1)
        now = self._spans[: len(link), 0]
        moves = (link != now) | ~(np.abs(poses - self._poses) < 1e-9).all(axis=1)
        others = {*link[moves], *now[moves]} - {0}
        self._spans[: len(link), 0] = link
        for geom in np.flatnonzero(moves):
            self._put(int(geom), int(link[geom]), turned[geom], moved[geom])
            self._poses[geom] = poses[geom]
        for each in others:
            self._sum_up(int(each), np.flatnonzero(link == each))
        marks = self._model.geom_contype.tobytes() + self._model.geom_conaffinity.tobytes() + link.tobytes()
        if marks != self._marks:
            self._marks, self._pairs = marks, self._paired(link)
            self._groups = self._grouped()
        return (
            self._points,
            self._spans,
            self._bounds,
            self._reach,
            self._groups,
            self._pairs,
            self._packed,
            self._quiet,
        )

    def _put(self, geom: int, link: int, rotation: FloatArray, position: FloatArray) -> None:
        _, start, count = self._spans[geom]
        points = self._hulls[geom] @ rotation.T + position
        centre, radius = self._balls[geom]
        self._points[:, start : start + count] = points.T
        self._bounds[geom] = [*(rotation @ centre + position), radius, *points.min(axis=0), *points.max(axis=0)]
        self._reach[geom] = self.chain.reach(link, points)

    def _sum_up(self, link: int, geoms: np.ndarray[Any, Any]) -> None:
        """The row for a link: a box around the boxes of its geoms."""
        row = len(self._link_of) + link
        low, high = self._bounds[geoms, 4:7].min(axis=0), self._bounds[geoms, 7:].max(axis=0)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        start = self._spans[row, 1]
        self._points[:, start : start + _CORNERS] = (middle + convex_hulls.signs() * half).T
        away = np.linalg.norm(self._bounds[geoms, :3] - middle, axis=1) + self._bounds[geoms, 3]
        self._bounds[row] = [*middle, min(away.max(), np.linalg.norm(half)), *low, *high]
        self._reach[row] = self.chain.reach(link, middle + convex_hulls.signs() * half)

    def _grouped(self) -> IntArray:
        """The pairs in runs of one hull with one link's: that hull, the link's row, the first pair, and the last."""
        link = self._spans[self._pairs[:, 1], 0]
        key = np.stack([self._pairs[:, 0], len(self._link_of) + link], axis=1)
        begins = np.flatnonzero(np.append(True, (key[1:] != key[:-1]).any(axis=1)))
        ends = np.append(begins[1:], len(key))
        rows = [
            self._stands.index(geom) if geom in self._stands and row == len(self._link_of) + 2 else -1
            for geom, row in key[begins]
        ]
        columns = [key[begins], begins[:, None], ends[:, None], np.array(rows, dtype=np.int64)[:, None]]
        return np.ascontiguousarray(np.concatenate(columns, axis=1))

    def _quiet_parts(self, clearance: float) -> BoolArray:
        """In which parts of the second joint's turn its link is clear of each thing that stands still, wherever the
        first joint is (S, `_PARTS`). The arm's own base is close to that link nearly always, and never touched.

        What stands is turned about the first joint's axis for that, which makes it no smaller.
        """
        model, chain = self._model, self.chain
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        upper = np.concatenate([self._in_link(int(geom)) for geom in np.flatnonzero(self._link_of == 2)])
        reach = float(chain.reach(2, upper)[1])
        quiet = np.zeros((len(self._stands), _PARTS), dtype=np.bool_)
        for row, geom in enumerate(self._stands):
            points = self._hulls[geom] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            turned = convex_hulls.reduced(chain.turned(points), _SLACK)
            for part in range(_PARTS):
                there = chain.second(2 * np.pi * (part + 0.5) / _PARTS - np.pi)
                moved = upper @ there[:9].reshape(3, 3).T + there[9:]
                apart = convex_hulls.apart(turned, moved)
                quiet[row, part] = apart > clearance + _SLACK + reach * np.pi / _PARTS
        return quiet

    def _in_link(self, geom: int) -> FloatArray:
        """A hull of the arm in the frame of the link whose body it is a part of."""
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, self._model.geom_quat[geom])
        return np.asarray(self._hulls[geom] @ rotation.reshape(3, 3).T + self._model.geom_pos[geom])

    def _paired(self, link: np.ndarray[Any, Any]) -> IntArray:
        """The pairs that MuJoCo would look at, by what the geoms' bits say now: those of the last links first, which
        are in the way most often."""
        kind, touches = self._model.geom_contype, self._model.geom_conaffinity
        wanted = (kind[:, None] & touches[None, :]) | (touches[:, None] & kind[None, :])
        pairs = np.argwhere(np.triu((wanted != 0) & self._may_touch))
        swapped = link[pairs[:, 0]] > link[pairs[:, 1]]
        pairs[swapped] = pairs[swapped][:, ::-1]
        order = np.lexsort((pairs[:, 0], -link[pairs[:, 1]]))
        return np.ascontiguousarray(pairs[order], dtype=np.int64)

    def _above(self, body: int) -> int:
        """Which link carries a body: 0 for what no joint of the arm moves."""
        while body:
            if body in self._links:
                return self._links.index(body) + 1
            body = int(self._model.body_parentid[body])
        return 0


def _chain(model: mujoco.MjModel, joints: Sequence[str], links: Sequence[int]) -> Chain:
    data = mujoco.MjData(model)
    for name in joints:
        data.joint(name).qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    rotation, position, frames = np.eye(3), np.zeros(3), []
    for body in links:
        after, there = data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy()
        frames.append([*(rotation.T @ after).ravel(), *(rotation.T @ (there - position))])
        rotation, position = after, there
    numbers = [int(model.joint(name).id) for name in joints]
    return Chain(np.array(frames), np.array(model.jnt_axis[numbers]), np.array(model.jnt_pos[numbers]))


def _may_touch(model: mujoco.MjModel) -> BoolArray:
    """Which geoms MuJoCo lets touch whatever their bits (G, G): not those of one rigid body or of neighbours in a
    chain, nor those that the model excludes."""
    rigid = model.body_weldid[model.geom_bodyid]
    parent = model.body_weldid[model.body_parentid[rigid]]
    next_to = (rigid[:, None] == parent[None, :]) & (rigid[:, None] != 0) & (rigid[None, :] != 0)
    allowed = (rigid[:, None] != rigid[None, :]) & ~next_to & ~next_to.T
    for signature in model.exclude_signature:
        first, second = model.geom_bodyid == (signature >> 16), model.geom_bodyid == (signature & 0xFFFF)
        allowed &= ~(first[:, None] & second[None, :]) & ~(second[:, None] & first[None, :])
    return np.asarray(allowed)
