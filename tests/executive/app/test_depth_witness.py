"""What depth tells of atoms, and where it keeps silent: of what is remembered, and of what nobody knows in the hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from executive.app.depth_witness import ABSENT, IN_VIEW, DepthWitness
from executive.relations.kinds import read_relation_kinds
from executive.types import Atom, EstimatedPose, Lump, PosesEstimated
from tests.executive.perception.room import pose
from tests.executive.perception.test_estimated_scene import CLOSED, OPEN, SCENES

KINDS = read_relation_kinds({"at": "on", "held": "gripping", "free": "gripper-empty"}, {})
RIGHT, HELD, FREE = Atom("at", ("box", "right")), Atom("held", ("box",)), Atom("free")
LUMP = Lump(np.array([0.0, 0.0, 0.5]), np.full(3, 0.02))


def seen(source: str = "seen", x: float = 0.2, z: float = 0.05) -> PosesEstimated:
    return PosesEstimated({"box": EstimatedPose(pose(x, 0.0, z), 1e-6 * np.eye(6), 0.0, (), source)})


@pytest.mark.parametrize(
    ("poses", "width", "told"),
    [
        (seen(), OPEN, {RIGHT: 1.0, HELD: 0.0, FREE: 1.0}),
        (seen("held", 0.0, 0.5), CLOSED, {RIGHT: 0.0, HELD: 1.0, FREE: 0.0}),
        (seen("remembered"), OPEN, {FREE: 1.0}),
        (seen(), CLOSED, {RIGHT: 1.0, HELD: 0.0}),
        (PosesEstimated({}, ("box",)), OPEN, {RIGHT: ABSENT, HELD: ABSENT, FREE: 1.0}),
        (PosesEstimated({}, ("box",), (LUMP,)), OPEN, {FREE: 1.0}),
        (PosesEstimated({}, ("box",)), CLOSED, {}),
    ],
)
def test_it_tells_what_it_can(poses: PosesEstimated, width: float, told: dict[Atom, float]) -> None:
    world: Any = SimpleNamespace(
        items=("box",),
        spec=SimpleNamespace(tables=()),
        localizer=SimpleNamespace(now=lambda: poses),
        joints=lambda: np.zeros(6),
        gripper_joints=lambda: np.zeros(6),
        gripper_width=lambda: width,
    )
    look: Any = None
    assert DepthWitness(world, SCENES, KINDS).testify(look, [RIGHT, HELD, FREE]).probability == told


@pytest.mark.parametrize(("x", "alone"), [(0.2, False), (0.03, True), (-0.03, True), (-0.2, False)])
def test_it_alone_tells_on_which_of_two_tables_something_is_that_lies_across_their_edges(x: float, alone: bool) -> None:
    left = Atom("at", ("box", "left"))
    world: Any = SimpleNamespace(
        items=("box",),
        spec=SimpleNamespace(tables=()),
        localizer=SimpleNamespace(now=lambda: seen(x=x)),
        joints=lambda: np.zeros(6),
        gripper_joints=lambda: np.zeros(6),
        gripper_width=lambda: OPEN,
    )
    look: Any = None
    told = DepthWitness(world, SCENES, KINDS).testify(look, [RIGHT, left, HELD])
    assert told.probability == {RIGHT: float(x > 0.0), left: float(x < 0.0), HELD: 0.0}
    assert told.alone == ({RIGHT, left} if alone else set())


def test_what_may_be_something_unknown_on_one_table_is_on_no_other() -> None:
    left = Atom("at", ("box", "left"))
    lump = Lump(np.array([0.2, 0.0, 0.05]), np.array([0.01, 0.01, 0.05]))
    poses = PosesEstimated({}, ("box",), (lump,))
    tables = [
        SimpleNamespace(name=name, centre=(x, 0.0, 0.0), size=(0.5, 1.0, 0.1), yaw=0.0)
        for name, x in (("left", -0.255), ("right", 0.255))
    ]
    world: Any = SimpleNamespace(
        items=("box",),
        spec=SimpleNamespace(tables=tables),
        localizer=SimpleNamespace(now=lambda: poses, hiders=lambda item, spots: ()),
        joints=lambda: np.zeros(6),
        gripper_joints=lambda: np.zeros(6),
        gripper_width=lambda: OPEN,
        time=0.0,
    )
    look: Any = None
    told = DepthWitness(world, SCENES, KINDS).testify(look, [RIGHT, left, HELD]).probability
    assert told == {left: IN_VIEW}
