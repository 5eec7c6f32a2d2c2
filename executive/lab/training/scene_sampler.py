"""Samples of scenes for training: items anywhere, the arm anywhere, the gripper empty or around an item.

Episodes seldom show the states that a model has to tell apart: an item just above a table and one on it, fingers around
an item and fingers that hold it, an item on the floor. Here these are as frequent as any others. They are physical all
the same: items come to rest, fingers close until contact stops them, and the labels are read from the contacts. What
the pictures cannot show, such as what is in a closed drawer, is labelled as not true: there is none of it to be seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from executive.domain.loader import Domain
from executive.relations.kinds import read_relation_kinds
from executive.sim import placement, scene
from executive.sim.initial_state import InitialState
from executive.sim.scene import ItemShape
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills import grasps, transforms
from executive.skills.ik import Kinematics
from executive.types import Atom, Facts, FloatArray, about_vertical

VARIANTS = 4
"""Samples of arm and gripper per arrangement of the items."""

_FLOOR = 0.06
_TIPPED = 0.18
"""The probabilities that an item lies on the floor, and that it was dropped onto a table in any orientation."""

_BESIDE = 0.35
"""The probability that an item is put or dropped right beside another one, as what fell off it or rolled up to it. Seen
from the front, what touches another from behind looks much like what stands on it."""

_IN_REGION, _ABSENT, _HIGHEST = 0.7, 0.5, 5
"""The probabilities that an item is put into a region where the domain speaks of any, and that some items are out of
sight where items stand on each other; and the most items of a tower."""

_AS_AT_START, _ATOP = 0.2, 0.4
"""The probabilities that everything is as at the start of a problem, and that what is put elsewhere is put on top of
something."""

_ASIDE, _FARTHEST = 0.15, 0.25
"""The standard deviation in rad of the direction that counts as behind an item, and m behind it at most."""

_AT_TABLE, _ATOP_WITHIN = 0.01, 0.02
"""m from a table's top within which an item stands on the table, and m of horizontal distance within which one item is
above another."""

_STRAIGHT = 0.02
"""The largest x and y of the quaternion of what stands upright: 2.3 degrees."""

_CLOSED, _AJAR = 0.45, 0.1
"""The probabilities that a drawer is closed, and that it is open no more than partly."""

_OUT_OF_SIGHT = (6.0, -3.0, 0.1)
"""m; on the floor behind all cameras."""

_ON, _IN = "directly-on", "in-region"

_KINDS = ("at home", "holding at home", "above", "holding above", "closing", "letting go", "anywhere")
_SHARES = (0.24, 0.22, 0.13, 0.17, 0.08, 0.06, 0.10)

_PERIOD = 0.008
_TOUCH = 0.004
"""The largest penetration in m of a pose that was set directly."""


class Moment(NamedTuple):
    """MuJoCo's positions (nq,), whether each atom of the task is true and can be seen, and the kind of sample that was
    intended."""

    qpos: FloatArray
    facts: Facts
    kind: str


class SceneSampler:
    """Samples states of a domain's scene. Call `close` at the end.

    Args:
        seed: fixes all samples.
        start: what stands on what, and where; without it, items are anywhere on tables, in drawers and containers, and
            on the floor.
    """

    def __init__(self, domain: Domain, seed: Sequence[int], start: InitialState | None = None) -> None:
        self._rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        begin = start or InitialState()
        self.world = MujocoWorld(
            domain.scene,
            domain.task.objects,
            seed=int(self._rng.integers(2**31)),
            placed=begin.placed,
            stacked=begin.stacked,
            regions=begin.regions,
        )
        self._begin = None if start is None else self.world.snapshot()
        kinds = read_relation_kinds(domain.relations, domain.task.parameters, domain.files[0])
        told = [kinds[atom.predicate].about(atom) for atom in domain.task.atoms if kinds[atom.predicate].name == _ON]
        self._bases = {
            item: sorted(base for upper, base in told if upper == item and base in self.world.shapes)
            for item in sorted({upper for upper, base in told if base in self.world.shapes})
        }
        used = {
            kinds[atom.predicate].about(atom)[-1] for atom in domain.task.atoms if kinds[atom.predicate].name == _IN
        }
        self._regions = [region for region in self.world.spec.regions if region.name in used]
        self._visibility = domain.task.visibility
        self._truth, self._atoms = Truth(self.world, domain.relations, domain.task.parameters), domain.task.atoms
        self._kinematics = Kinematics(self.world.handle)
        self._model, self._data = self.world.model, self.world.data
        names = [*scene.JOINTS]
        self._arm = np.array([self._model.joint(name).qposadr[0] for name in names])
        self._fingers = np.array([self._model.joint(name).qposadr[0] for name in scene.FINGER_JOINTS])
        self._signs = np.array([-1.0 if "inner_finger" in name else 1.0 for name in scene.FINGER_JOINTS])
        self._free = {item: self._model.joint(f"{item}/free") for item in self.world.shapes}
        self._home = self.world.handle.limits.home

    def close(self) -> None:
        self.world.close()

    def draw(self) -> list[Moment]:
        """Draws an arrangement of the items, and up to `VARIANTS` samples with it."""
        if self._begin is None:
            self._arrange()
        else:
            self._disarrange(self._begin)
        state = self.world.snapshot()
        moments = []
        for kind in self._rng.choice(_KINDS, VARIANTS, p=_SHARES):
            for _ in range(4):
                self.world.restore(state)
                if self._pose(str(kind)):
                    moments.append(Moment(self._data.qpos.copy(), self._seen(), str(kind)))
                    break
        return moments

    def atoms(self) -> tuple[Atom, ...]:
        return self._atoms

    def _seen(self) -> Facts:
        facts = self._truth.of(self._atoms)
        return Facts({**facts, **dict.fromkeys(self._visibility.hidden(facts), False)})

    # The items.

    def _arrange(self) -> None:
        """Places all items with the arm at home, and lets them come to rest."""
        mujoco.mj_resetData(self._model, self._data)
        self._set_arm(self._home)
        self._set_fingers(0.0)
        for name, drawer in self.world.drawers.specs.items():
            share = self._rng.choice([0.0, 1.0, self._rng.random()], p=[_CLOSED, 1.0 - _CLOSED - _AJAR, _AJAR])
            self.world.drawers.slide(name, float(share) * drawer.stroke)
        placed: dict[str, FloatArray] = {}
        gap = float(self._rng.choice([0.0, 0.02, 0.06]))
        favourite = int(self._rng.integers(len(self.world.spec.tables))) if self._rng.random() < 0.3 else None
        for item in self._rng.permutation(sorted(self.world.shapes)):
            placed[item] = self._spot(str(item), placed, gap, favourite)
            self._put(str(item), placed[item])
        if self._bases:
            self._stack(placed)
        self._pass_time(0.5)

    def _stack(self, placed: dict[str, FloatArray]) -> None:
        """Puts some items on top of others, and at times some out of sight, as those that another problem lacks."""
        rng, below = self._rng, dict[str, str]()
        for item in rng.permutation(sorted(self._bases)):
            open_ = self._open_bases(str(item), placed, below)
            if item in below.values() or not open_ or rng.random() < 0.45:
                continue
            self._put_atop(str(item), str(rng.choice(open_)), placed, below)
        alone = sorted(set(self.world.shapes) - set(below) - set(below.values()))
        if rng.random() < _ABSENT:
            for number, item in enumerate(rng.permutation(alone)[: int(rng.integers(1, max(2, len(alone) + 1)))]):
                away = np.array([*_OUT_OF_SIGHT, 1.0, 0.0, 0.0, 0.0])
                away[1] += 0.5 * number
                self._put(str(item), away)

    def _open_bases(self, item: str, placed: Mapping[str, FloatArray], below: Mapping[str, str]) -> list[str]:
        """The items on which an item may be put: upright ones that carry nothing, but for those on high towers.

        Args:
            below: what each item stands on that stands on another.
        """

        def height(base: str) -> int:
            return 1 + height(below[base]) if base in below else 1

        return [
            base
            for base in self._bases.get(item, ())
            if base not in below.values() and base != item and _is_upright(placed[base]) and height(base) < _HIGHEST
        ]

    def _put_atop(self, item: str, base: str, placed: dict[str, FloatArray], below: dict[str, str]) -> None:
        shape, under = self.world.shapes[item], self.world.shapes[base]
        top = placed[base][2] + under.centre[2] + under.half[2]
        spot = placed[base][:2] + self._rng.normal(0.0, 0.003, 2)
        placed[item] = placement.standing_at(shape, spot, top, float(self._rng.uniform(-np.pi, np.pi)))
        below[item] = base
        self._put(item, placed[item])

    def _disarrange(self, begin: bytes) -> None:
        """Sets everything up as at the start. Mostly, some of what carries nothing is then put somewhere else, one
        after the other."""
        self.world.restore(begin)
        if self._rng.random() < _AS_AT_START:
            return
        placed, below = {item: self._item_pose(item) for item in self.world.shapes}, self._below()
        for _ in range(int(self._rng.integers(1, len(placed) + 1))):
            item = str(self._rng.choice(sorted(set(placed) - set(below.values()))))
            below.pop(item, None)
            others = {other: pose for other, pose in placed.items() if other != item}
            open_ = self._open_bases(item, others, below)
            if open_ and self._rng.random() < _ATOP:
                self._put_atop(item, str(self._rng.choice(open_)), placed, below)
            else:
                placed[item] = self._spot(item, others, 0.02, None)
                self._put(item, placed[item])
        self._pass_time(0.5)

    def _free_items(self) -> list[str]:
        """The items that carry no other one."""
        return sorted(set(self.world.shapes) - set(self._below().values()))

    def _below(self) -> dict[str, str]:
        """The lower one of two items that touch, for each upper one."""
        roots = {self._model.body(item).id: item for item in self.world.shapes}
        below = {}
        for contact in self._data.contact[: self._data.ncon]:
            pair = [roots.get(int(self._model.body_rootid[self._model.geom_bodyid[geom]])) for geom in contact.geom]
            if pair[0] is not None and pair[1] is not None:
                lower, upper = sorted(map(str, pair), key=lambda item: (self._item_pose(item)[2], item))
                below[upper] = lower
        return below

    def _spot(self, item: str, others: dict[str, FloatArray], gap: float, favourite: int | None) -> FloatArray:
        rng, shape, tables = self._rng, self.world.shapes[item], tuple(self.world.places().values())
        tipped, radius = rng.random() < _TIPPED, placement.circle(shape)
        if rng.random() < _FLOOR:
            return self._on_floor(item)
        if rng.random() < _BESIDE and (beside := self._beside(item, others)) is not None:
            return beside
        if tipped:
            radius = float(np.linalg.norm(shape.half))
        for _ in range(60):
            table = tables[
                favourite if favourite is not None and rng.random() < 0.7 else int(rng.integers(len(tables)))
            ]
            spot = placement.random_point(table, 0.6 * radius + 0.005, rng)
            if self._regions and rng.random() < _IN_REGION:
                region = self._regions[int(rng.integers(len(self._regions)))]
                table = next(each for each in tables if each.name == region.table)
                spot = placement.random_point_in(region, table, rng)
            if spot is None or not placement.has_room(self.world.spec, shape, table, spot, tipped):
                continue
            if all(
                np.hypot(*(pose[:2] - spot)) >= radius + placement.circle(self.world.shapes[other]) + gap
                for other, pose in others.items()
            ):
                pose = placement.upright(shape, spot, table, float(rng.uniform(-np.pi, np.pi)))
                if tipped:
                    pose[3:] = _any_orientation(rng)
                    pose[2] = table.centre[2] + float(np.linalg.norm(shape.half)) + 0.005
                return pose
        return self._on_floor(item)

    def _beside(self, item: str, others: Mapping[str, FloatArray]) -> FloatArray | None:
        """A pose right beside one of the others, on its table or above it, from where it falls, or behind it, as far as
        a camera that looks over it does not see where it stands; None where there is no room."""
        rng, shapes = self._rng, self.world.shapes
        shape, radius = shapes[item], placement.circle(shapes[item])
        for other in rng.permutation(sorted(others)).tolist():
            at, next_to = others[other], shapes[other]
            bottom = at[2] + next_to.centre[2] - next_to.half[2]
            table = min(self.world.places().values(), key=lambda place: abs(place.centre[2] - bottom))
            if not _is_upright(at) or abs(table.centre[2] - bottom) > _AT_TABLE:
                continue
            how = str(rng.choice(["touches", "falls", "behind"]))
            away = radius + placement.circle(next_to)
            angle, turn = rng.uniform(-np.pi, np.pi, 2)
            if how == "behind":
                angle, shadow = self._behind(at, next_to)
                away += shadow * float(rng.random())
            else:
                away *= float(rng.uniform(0.5, 1.0) if how == "falls" else rng.uniform(1.0, 1.15))
            spot = at[:2] + away * np.array([np.cos(angle), np.sin(angle)])
            apart = (
                np.hypot(*(pose[:2] - spot)) >= radius + placement.circle(shapes[name])
                for name, pose in others.items()
                if name != other and np.hypot(*(pose[:2] - at[:2])) > _ATOP_WITHIN
            )
            x, y = about_vertical(-table.yaw)[:2, :2] @ (spot - np.asarray(table.centre[:2]))
            inside = abs(x) + radius <= 0.5 * table.size[0] and abs(y) + radius <= 0.5 * table.size[1]
            if inside and placement.has_room(self.world.spec, shape, table, spot, False) and all(apart):
                pose = placement.upright(shape, spot, table, float(turn))
                if how == "falls":
                    pose[2] += 2 * float(next_to.half[2]) + 0.01
                return pose
        return None

    def _behind(self, at: FloatArray, shape: ItemShape) -> tuple[float, float]:
        """The direction in rad that is behind an item as one of the cameras sees it, more or less, and how far in m
        the item hides the table there."""
        cameras = self.world.spec.cameras
        eye = np.asarray(cameras[int(self._rng.integers(len(cameras)))].position)
        sight = at[:3] + shape.centre - eye
        above = max(-float(sight[2]) - float(shape.half[2]), 1e-3)
        shadow = 2.0 * float(shape.half[2]) * float(np.hypot(*sight[:2])) / above
        angle = float(np.arctan2(sight[1], sight[0]) + self._rng.normal(0.0, _ASIDE))
        return angle, min(shadow, _FARTHEST)

    def _on_floor(self, item: str) -> FloatArray:
        rng, half = self._rng, self.world.shapes[item].half
        position = [rng.uniform(0.1, 1.0), rng.uniform(-0.9, 0.9), float(np.linalg.norm(half)) + 0.01]
        return np.array([*position, *_any_orientation(rng)])

    # The arm.

    def _pose(self, kind: str) -> bool:
        """Brings arm and gripper into a state of the given kind; False where this draw failed."""
        rng = self._rng
        if kind == "at home":
            return self._stand(self._home, float(rng.choice([0.0, rng.uniform(0.0, 0.8)], p=[0.85, 0.15])))
        if kind == "anywhere":
            q = self._home + rng.normal(0.0, [0.9, 0.3, 0.4, 0.4, 0.3, 1.0])
            return self._stand(q, float(rng.choice([0.0, rng.uniform(0.0, 0.8)], p=[0.7, 0.3])))
        towers = self._begin is not None or self._bases
        item = str(rng.choice(self._free_items() if towers else sorted(self.world.shapes)))
        grasp = self._grasp(item)
        if grasp is None:
            return False
        if kind == "above":
            rise = float(rng.choice([0.0, rng.uniform(0.0, 0.25)], p=[0.2, 0.8]))
            over = self._reach(transforms.translated(grasp, np.array([0.0, 0.0, rise])))
            return over is not None and self._stand(over, 0.0)
        if kind == "closing":
            around = self._reach(grasp)
            return around is not None and self._stand(around, 1.0, seconds=float(rng.uniform(0.02, 0.25)), ready=0.0)
        inside = transforms.inverse(grasp) @ transforms.matrix(self._item_pose(item))
        if kind == "holding at home":
            return self._hold(item, inside, self._home)
        there = self._reach(self._elsewhere(item, inside))
        if there is None or not self._hold(item, inside, there):
            return False
        if kind == "letting go":
            self.world.command_gripper(0.0)
            self._pass_time(float(rng.uniform(0.02, 0.5)))
        return True

    def _grasp(self, item: str) -> FloatArray | None:
        """A grasp of an item where it is, with a small random offset."""
        shape, pose = self.world.shapes[item], transforms.matrix(self._item_pose(item))
        height = min((place.centre[2] for place in self.world.places().values()), key=lambda z: abs(z - pose[2, 3]))
        found = grasps.candidates(pose, shape, height if pose[2, 3] > height - 0.05 else 0.0)
        if not found:
            return None
        grasp = found[int(self._rng.integers(min(24, len(found))))].copy()
        along, approach = grasp[:3, 1], grasp[:3, 2]
        grasp[:3, 3] += self._rng.normal(0.0, 0.008) * along + self._rng.normal(0.0, 0.004) * approach
        return grasp

    def _elsewhere(self, item: str, inside: FloatArray) -> FloatArray:
        """A pose of the grip point at which the held item is over a table, drawer or container, just above it or
        higher."""
        rng, tables = self._rng, tuple(self.world.places().values())
        table = tables[int(rng.integers(len(tables)))]
        shape, now = self.world.shapes[item], transforms.matrix(self._item_pose(item))
        turned = transforms.matrix(np.array([0, 0, 0, *_yaw(float(rng.uniform(-np.pi, np.pi)))])) @ now
        spot = placement.random_point(table, 0.06, rng)
        x, y = spot if spot is not None else table.centre[:2]
        low = shape.reach(turned[:3, :3].T @ np.array([0.0, 0.0, 1.0]))
        rise = float(rng.choice([rng.uniform(0.0, 0.02), rng.uniform(0.02, 0.3)], p=[0.35, 0.65]))
        turned[:3, 3] = np.array([x, y, table.centre[2] + low + rise]) - turned[:3, :3] @ shape.centre
        return np.asarray(turned @ transforms.inverse(inside))

    def _reach(self, target: FloatArray) -> FloatArray | None:
        for seed in self._kinematics.seeds(target, self._home):
            q = self._kinematics.solve(target, seed)
            if q is not None:
                return q
        return None

    def _stand(self, q: FloatArray, closed: float, seconds: float = 0.12, ready: float | None = None) -> bool:
        """Sets the arm to `q` and drives the fingers to `closed`, starting there or at `ready`."""
        self._set_arm(q)
        self._set_fingers(closed if ready is None else ready)
        self.world.command_gripper(closed)
        mujoco.mj_forward(self._model, self._data)
        if self._penetrates():
            return False
        self._pass_time(seconds)
        return True

    def _hold(self, item: str, inside: FloatArray, q: FloatArray) -> bool:
        """Closes the gripper around an item that is kept in place until the fingers press on it."""
        self._set_arm(q)
        self._put(item, transforms.pose(self._kinematics.forward(q) @ inside))
        half = self.world.shapes[item].half
        width = 2 * self.world.shapes[item].reach(inside[:3, :3].T @ np.array([1.0, 0.0, 0.0]))
        self._set_fingers(scene.FINGER_CLOSED * max(0.0, 1.0 - min(width, 2 * float(half.max())) / 0.085) - 0.06)
        self.world.command_gripper(1.0)
        mujoco.mj_forward(self._model, self._data)
        if self._penetrates():
            return False
        pose = self._item_pose(item)
        for _ in range(round(0.2 / _PERIOD)):
            self.world.advance()
            self._put(item, pose)
        mujoco.mj_forward(self._model, self._data)
        self._pass_time(float(self._rng.choice([0.05, 0.25])))
        return True

    def _penetrates(self) -> bool:
        """Whether any contact is deeper than `_TOUCH`."""
        return any(contact.dist < -_TOUCH for contact in self._data.contact[: self._data.ncon])

    def _item_pose(self, item: str) -> FloatArray:
        start = self._free[item].qposadr[0]
        return np.array(self._data.qpos[start : start + 7])

    def _put(self, item: str, pose: FloatArray) -> None:
        start, speed = self._free[item].qposadr[0], self._free[item].dofadr[0]
        self._data.qpos[start : start + 7] = pose
        self._data.qvel[speed : speed + 6] = 0.0

    def _set_arm(self, q: FloatArray) -> None:
        self._data.qpos[self._arm] = q
        self._data.qvel[:] = 0.0
        self.world.command(q, np.zeros(6))

    def _set_fingers(self, angle: float) -> None:
        self._data.qpos[self._fingers] = self._signs * float(np.clip(angle, 0.0, scene.FINGER_CLOSED))
        self.world.command_gripper(angle / scene.FINGER_CLOSED)

    def _pass_time(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / _PERIOD))):
            self.world.advance()


def _is_upright(pose: FloatArray) -> bool:
    return bool(np.abs(pose[4:6]).max() < _STRAIGHT)


def _any_orientation(rng: np.random.Generator) -> FloatArray:
    quaternion = rng.normal(size=4)
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def _yaw(angle: float) -> tuple[float, float, float, float]:
    return float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))
