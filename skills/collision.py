"""The collision check of configurations and edges, by the convex hulls that MuJoCo uses, in one compiled call.

For names of touching bodies and for lines of sight MuJoCo is used: it has the exact hulls of the meshes, while `free`
and `edge_free` use hulls that are smaller by a millimetre or two. As that is less than the clearance that they keep,
they never miss a contact.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import mujoco
import numpy as np

from executive.sim.robot_api import Handle
from executive.sim.scene import FINGER_JOINTS, GRIP_SITE, JOINTS, slide_of
from executive.skills import collision_kernels, transforms
from executive.skills.collision_geometry import Arguments, CollisionGeometry
from executive.types import FloatArray

_ARM, _HAND, _SURROUNDINGS, _HELD = 1, 2, 4, 8
"""Contact bits. Arm touches everything, hand and held item touch arm and surroundings, never each other."""

_CLEARANCE = 0.004
"""m that planned configurations keep from anything, beyond the hulls."""

_TOLERANCE, _COARSE = 0.001, 0.002
"""m by which a hull may be simplified inwards: that of the gripper or an item, and that of a part of the arm, which is
large and seldom near to anything. The sum of two is no more than the clearance."""

_EDGE = 0.05
"""Largest Euclidean distance in joint space (rad) between two configurations that are checked along an edge."""


_HAND_ROOT = "robotiq_85_adapter_link"
_FINGERS = ("outer_knuckle", "inner_finger", "inner_knuckle")
_HAND_BODIES = (_HAND_ROOT, *(f"{side}_{part}" for side in ("left", "right") for part in _FINGERS))

_APART = {
    "forearm_link": ("wrist_2_link",),
    "wrist_1_link": ("wrist_3_link", *_HAND_BODIES),
    "wrist_2_link": _HAND_BODIES,
    "wrist_3_link": _HAND_BODIES[1:],
}
"""Pairs of bodies that cannot touch at any joint angles; a test checks that."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """An item in the hand: its name and its transform (4, 4) in the frame of the grip point; likewise those of what
    rests on it, and is carried along."""

    item: str
    in_hand: FloatArray
    riders: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def carried(self) -> dict[str, FloatArray]:
        """Everything that moves with the hand."""
        return {self.item: self.in_hand, **self.riders}


class CollisionModel:
    """The collision model of the scene: `update` sets it up, `free` and `edge_free` query it."""

    def __init__(self, handle: Handle) -> None:
        spec = handle.planning_spec()
        for wrist, others in _APART.items():
            for other in others:
                spec.add_exclude(bodyname1=wrist, bodyname2=other)
        model = spec.compile()
        self._model, self._data = model, mujoco.MjData(model)
        self._arm = np.array([model.joint(name).qposadr[0] for name in JOINTS])
        self._fingers = np.array([model.joint(name).qposadr[0] for name in FINGER_JOINTS])
        self._items = {name: int(model.joint(f"{name}/free").qposadr[0]) for name in handle.shapes}
        self._site = model.site(GRIP_SITE).id
        self._slides = {name: int(model.joint(slide_of(name)).qposadr[0]) for name in handle.drawers}
        self._geoms: dict[str, list[int]] = {name: [] for name in (*handle.shapes, *handle.drawers)}
        self._held: Held | None = None
        roots = {int(model.body(name).id): name for name in self._geoms}
        hand = _subtree(model, int(model.body(_HAND_ROOT).id))
        arm = _subtree(model, int(model.body("shoulder_link").id))
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            item = roots.get(int(model.body_rootid[body]))
            if item is not None:
                self._geoms[item].append(geom)
                self._mark(geom, _SURROUNDINGS, 0)
            elif body in hand:
                self._mark(geom, _HAND, _SURROUNDINGS | _ARM)
            elif body in arm:
                self._mark(geom, _ARM, _ARM | _HAND | _SURROUNDINGS | _HELD)
            else:
                self._mark(geom, _SURROUNDINGS, 0)
        model.geom_margin[:] = 0.5 * _CLEARANCE  # margins of a pair add up
        model.geom_gap[:] = 0.0
        rough = {*(arm - hand), int(model.body("fixed_base_link").id)}
        tolerances = [_COARSE if body in rough else _TOLERANCE for body in model.geom_bodyid]
        self._parts = CollisionGeometry(model, JOINTS, tolerances, _CLEARANCE)
        mujoco.mj_kinematics(model, self._data)
        self._geometry: Arguments = self._parts.arguments(self._data)

    def update(
        self,
        items: Mapping[str, FloatArray],
        fingers: FloatArray,
        held: Held | None = None,
        ignored: Collection[str] = (),
        opened: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Sets the poses of the items (7,), the finger joints (rad), the held item, the items and drawers to ignore,
        and how far drawers are open (m)."""
        carried = {} if held is None else held.carried
        for name, start in self._items.items():
            if name in items:
                self._data.qpos[start : start + 7] = items[name]
            for geom in self._geoms[name]:
                if name in carried:
                    self._mark(geom, _HELD, _SURROUNDINGS | _ARM)
                elif name in ignored or name not in items:
                    self._mark(geom, 0, 0)
                else:
                    self._mark(geom, _SURROUNDINGS, 0)
        for name, at in self._slides.items():
            self._data.qpos[at] = opened.get(name, self._data.qpos[at])
            for geom in self._geoms[name]:
                self._mark(geom, 0 if name in ignored else _SURROUNDINGS, 0)
        self._held = held
        self._data.qpos[self._fingers] = fingers
        self._place(np.zeros(len(self._arm)))
        self._geometry = self._parts.arguments(self._data, [geom for name in carried for geom in self._geoms[name]])

    def free(self, q: FloatArray) -> bool:
        """Whether the configuration `q` (6,) is free of contact with the clearance."""
        return bool(collision_kernels.clear(*self._geometry, _CLEARANCE, q, q, _EDGE))

    def all_free(self, configurations: FloatArray) -> collision_kernels.BoolArray:
        """Which of the configurations (N, 6) are free, (N,)."""
        return np.asarray(
            collision_kernels.all_clear(*self._geometry, _CLEARANCE, np.ascontiguousarray(configurations))
        )

    def edge_free(self, start: FloatArray, goal: FloatArray) -> bool:
        """Whether the straight edge between two configurations (6,) is free, its ends included."""
        return bool(collision_kernels.clear(*self._geometry, _CLEARANCE, start, goal, _EDGE))

    def beside(self, q: FloatArray) -> frozenset[str]:
        """The items that touch the held one at `q`, but for those that are carried with it."""
        if self._held is None:
            return frozenset()
        names = {
            part.split("/")[0] for pair in self.touching(q) for part in pair if self._held.item in pair[0] + pair[1]
        }
        return frozenset(names & self._items.keys()) - self._held.carried.keys()

    def hides(self, q: FloatArray, cameras: FloatArray, points: FloatArray) -> int:
        """Counts the lines of sight from `cameras` (M, 3) to `points` (N, 3) that the arm, gripper or held item
        occludes at `q`: one of them is the nearest geom on the line, and nearer than the point."""
        self._place(q)
        mine, hit, count = _ARM | _HAND | _HELD, np.array([-1], dtype=np.int32), 0
        for camera in cameras:
            for point in points:
                away = mujoco.mj_ray(self._model, self._data, camera, point - camera, None, 1, -1, hit)
                count += bool(0.0 <= away < 1.0 and self._model.geom_contype[hit[0]] & mine)
        return count

    def nearest(self, q: FloatArray) -> float:
        """The distance in m of the two nearest hulls at `q` by MuJoCo, at most the clearance; negative for
        penetration."""
        self._place(q)
        mujoco.mj_collision(self._model, self._data)
        contacts = (contact.dist for contact in self._data.contact[: self._data.ncon])
        return float(min(contacts, default=_CLEARANCE))

    def touching(self, q: FloatArray) -> list[tuple[str, str]]:
        """The pairs of bodies that touch at `q`, for messages and tests."""
        self._place(q)
        mujoco.mj_collision(self._model, self._data)
        names = []
        for index in range(self._data.ncon):
            contact = self._data.contact[index]
            first, second = (self._model.body(self._model.geom_bodyid[geom]).name for geom in contact.geom)
            names.append((first, second))
        return names

    def _place(self, q: FloatArray) -> None:
        data = self._data
        data.qpos[self._arm] = q
        mujoco.mj_kinematics(self._model, data)
        if self._held is not None:
            hand = np.eye(4)
            hand[:3, :3] = data.site_xmat[self._site].reshape(3, 3)
            hand[:3, 3] = data.site_xpos[self._site]
            for name, in_hand in self._held.carried.items():
                start = self._items[name]
                data.qpos[start : start + 7] = transforms.pose(hand @ in_hand)
            mujoco.mj_kinematics(self._model, data)

    def _mark(self, geom: int, kind: int, touches: int) -> None:
        self._model.geom_contype[geom] = kind
        self._model.geom_conaffinity[geom] = touches


def _subtree(model: mujoco.MjModel, root: int) -> set[int]:
    found = {root}
    for body in range(root + 1, model.nbody):
        if int(model.body_parentid[body]) in found:
            found.add(body)
    return found
