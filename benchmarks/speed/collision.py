"""Collision checks of arm, gripper and held item against `mj_kinematics` and `mj_collision` on the full model."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np

from benchmarks.speed.queries import stage
from benchmarks.speed.table import Row, side_by_side
from executive.sim.scene import FINGER_JOINTS, GRIP_SITE, JOINTS
from executive.sim.world import MujocoWorld
from executive.skills import transforms
from executive.skills.arm import arm_of
from executive.skills.collision import Held
from executive.types import FloatArray

DEEP = 0.005
"""m; contacts deeper than this are never to be missed."""

_EDGE = 0.05
_LENGTH = 0.8
"""rad between the checks along an edge, and the length of an edge."""


class FullModel:
    """What robosuite's model has to say: everything in it, collision meshes and all, as it is simulated."""

    def __init__(self, world: MujocoWorld) -> None:
        self.model, self._site = world.model, world.model.site(GRIP_SITE).id
        self._data = mujoco.MjData(self.model)
        self._arm = np.array([self.model.joint(name).qposadr[0] for name in JOINTS])
        self._fingers = np.array([self.model.joint(name).qposadr[0] for name in FINGER_JOINTS])
        self._item = {item: int(self.model.joint(f"{item}/free").qposadr[0]) for item in world.shapes}
        self._held: Held | None = None
        arm, hand = self._below("shoulder_link"), self._below("robotiq_85_adapter_link")
        body = self.model.geom_bodyid
        self._base_kind = np.where(np.isin(body, list(hand)), 2, np.where(np.isin(body, list(arm)), 1, 0))
        self._kind = self._base_kind

    def update(self, items: dict[str, FloatArray], fingers: FloatArray, held: Held | None) -> None:
        for item, pose in items.items():
            self._data.qpos[self._item[item] : self._item[item] + 7] = pose
        self._data.qpos[self._fingers] = fingers
        self._held, self._kind = held, self._base_kind
        if held is not None:
            self._kind = np.where(np.isin(self.model.geom_bodyid, list(self._below(held.item))), 2, self._base_kind)

    def check(self, q: FloatArray) -> int:
        """The two calls that the baseline is, and how many contacts they find."""
        self._data.qpos[self._arm] = q
        mujoco.mj_kinematics(self.model, self._data)
        if self._held is not None:
            hand = np.eye(4)
            hand[:3, :3] = self._data.site_xmat[self._site].reshape(3, 3)
            hand[:3, 3] = self._data.site_xpos[self._site]
            start = self._item[self._held.item]
            self._data.qpos[start : start + 7] = transforms.pose(hand @ self._held.in_hand)
            mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_collision(self.model, self._data)
        return int(self._data.ncon)

    def deepest(self, q: FloatArray) -> float:
        """How deep in m anything is in the arm, the hand, or what that holds."""
        if self.check(q) == 0:
            return 0.0
        pairs = self._kind[np.asarray(self._data.contact.geom)]
        # The hand and what it holds touch each other; the rest is none of the arm's business.
        counts = (pairs == 1).any(axis=1) | ((pairs == 2).any(axis=1) & (pairs == 0).any(axis=1))
        return float(max(0.0, -np.min(np.asarray(self._data.contact.dist)[counts], initial=0.0)))

    def free(self, q: FloatArray) -> bool:
        return self.deepest(q) == 0.0

    def edge_free(self, start: FloatArray, goal: FloatArray) -> bool:
        steps = max(1, int(np.ceil(np.linalg.norm(goal - start) / _EDGE)))
        return all(self.free(start + (goal - start) * (index / steps)) for index in range(steps + 1))

    def _below(self, root: str) -> set[int]:
        found = {int(self.model.body(root).id)}
        for body in range(self.model.nbody):
            if int(self.model.body_parentid[body]) in found:
                found.add(body)
        return found


def measure(everything: bool) -> list[Row]:
    world = stage(3)
    arm, full = arm_of(world.handle), FullModel(world)
    rng, limits = np.random.default_rng(0), world.handle.limits
    in_hand = np.diag([1.0, -1.0, -1.0, 1.0])
    in_hand[2, 3] = 0.03
    held = Held("cereal-box", in_hand)
    arm.collision.update(world.obstacles(), world.gripper_joints(), held)
    full.update(world.obstacles(), world.gripper_joints(), held)
    some = rng.uniform(limits.lower, limits.upper, (300, 6))
    alone = side_by_side(lambda: arm.collision.all_free(some), lambda: [full.check(q) for q in some], 15, times=10)
    single = side_by_side(
        lambda: [arm.collision.free(q) for q in some], lambda: [full.check(q) for q in some], 5, times=10
    )
    free = [q for q in some if arm.collision.free(q)]
    edges = [(q, q + (to - q) * min(1.0, _LENGTH / np.linalg.norm(to - q))) for q, to in itertools.pairwise(free)]
    along = side_by_side(
        lambda: [arm.collision.edge_free(*edge) for edge in edges],
        lambda: [full.edge_free(*edge) for edge in edges], 7, times=10,
    )  # fmt: skip
    open_edges = sum(arm.collision.edge_free(*edge) for edge in edges)
    missed, deep, count = _missed(world, full, 100_000 if everything else 10_000)
    against = "mj_kinematics + mj_collision, full model"
    note = f"ratio {alone[2]:.0f} for {len(some)} in one call, {single[2]:.0f} one by one"
    return [
        Row("collision check, one configuration", 1e6 * alone[0] / len(some), 1e6 * alone[1] / len(some), "us",
            "40 times", alone[2] >= 40, against, note),
        Row("collision check, one edge of 0.8 rad", 1e6 * along[0] / len(edges), 1e6 * along[1] / len(edges), "us",
            "100 times", along[2] >= 100, "the same, every 0.05 rad until one touches",
            f"ratio {along[2]:.0f}; {open_edges} of {len(edges)} edges are free"),
        Row("contacts deeper than 5 mm that are missed", missed, None, "", "0", missed == 0,
            f"the exact meshes, {count} random configurations", f"{deep} of them have such a contact"),
    ]  # fmt: skip


def _missed(world: MujocoWorld, full: FullModel, count: int) -> tuple[int, int, int]:
    """How many configurations that are called free have something deep inside something, in how many there is, and how
    many were looked at; with the hand empty or full, the fingers anywhere, the items where they stand."""
    rng, limits, arm = np.random.default_rng(1), world.handle.limits, arm_of(world.handle)
    missed = deep = 0
    items, batch = list(world.shapes), 500
    signs = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    for number in range(count // batch):
        in_hand = np.eye(4)
        in_hand[:3, :3], _ = np.linalg.qr(rng.normal(size=(3, 3)))
        in_hand[:3, 0] *= np.sign(np.linalg.det(in_hand[:3, :3]))
        in_hand[:3, 3] = rng.uniform(-0.04, 0.04, 3)
        held = Held(items[int(rng.integers(len(items)))], in_hand) if number % 2 else None
        fingers = signs * rng.uniform(0.0, 0.8)
        for model in (arm.collision, full):
            model.update(world.obstacles(), fingers, held)
        configurations = rng.uniform(limits.lower, limits.upper, (batch, 6))
        free = arm.collision.all_free(configurations)
        inside = np.array([full.deepest(q) > DEEP for q in configurations])
        missed, deep = missed + int((free & inside).sum()), deep + int(inside.sum())
    return missed, deep, count // batch * batch
