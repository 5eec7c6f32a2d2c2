"""What the simulator says is so, on states whose truth is plain."""

from __future__ import annotations

import numpy as np
import pytest

from executive.errors import DomainError
from executive.sim.truth import Oracle, Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom, Facts
from tests.executive.sim.stage import ITEMS, MEANING, TABLES, grocery

ATOMS = [
    *(Atom("on-table", (item, table)) for item in ITEMS for table in TABLES),
    *(Atom("robot-gripping", (item,)) for item in ITEMS),
    Atom("robot-gripper-empty"),
]


def put(world: MujocoWorld, item: str, pose: list[float]) -> None:
    start = world._places[item]
    world.data.qpos[start : start + 7] = pose
    dof = world.model.joint(f"{item}/free").dofadr[0]
    world.data.qvel[dof : dof + 6] = 0.0


def test_an_item_on_another_is_on_its_table() -> None:
    world = grocery(0)
    centre = world.handle.tables["white-table"].centre
    put(world, "bread-loaf", [centre[0], centre[1], 0.833, 1, 0, 0, 0])
    put(world, "lemon", [centre[0], centre[1], 0.892, 1, 0, 0, 0])
    world.settle(0.05)
    facts = Truth(world, MEANING).of(ATOMS)
    assert facts[Atom.parse("on-table(bread-loaf,white-table)")]
    assert facts[Atom.parse("on-table(lemon,white-table)")]
    assert not facts[Atom.parse("on-table(lemon,black-table)")]


def test_an_item_on_the_floor_is_on_no_table() -> None:
    world = grocery(0)
    put(world, "lemon", [1.5, 1.0, 0.03, 1, 0, 0, 0])
    world.settle(0.3)
    facts = Truth(world, MEANING).of(ATOMS)
    assert not any(facts[Atom("on-table", ("lemon", table))] for table in TABLES)
    assert facts[Atom("robot-gripper-empty")]


def test_between_closed_fingers_is_gripped() -> None:
    world = grocery(0, items=("soda-can",))
    grip = world.data.site("grip_site").xpos
    put(world, "soda-can", [*grip, 1, 0, 0, 0])
    world.command_gripper(1.0)
    for _ in range(40):  # held up while the fingers close
        put(world, "soda-can", [*grip, 1, 0, 0, 0])
        world.advance()
    facts = Truth(world, MEANING).of([Atom("robot-gripping", ("soda-can",)), Atom("robot-gripper-empty")])
    assert facts == Facts.parse("robot-gripping(soda-can)", "not robot-gripper-empty()")


def test_oracle_believes_the_truth_and_nothing_else() -> None:
    world = grocery(4)
    truth = Truth(world, MEANING)
    belief = Oracle(truth).estimate(world.observe(), ATOMS)
    assert belief.facts() == truth.of(ATOMS)
    assert set(belief.probability) == set(ATOMS)
    assert np.isin(list(belief.probability.values()), [0.0, 1.0]).all()
    world.close()


def test_relation_about_another_number_of_objects_is_named() -> None:
    world, parameters = grocery(0), {"on-table": ("item", "table"), "robot-gripper-empty": ()}
    Truth(world, MEANING, parameters)
    with pytest.raises(DomainError, match=r"predicates\.robot-gripper-empty\.relation: 'gripping' needs 1 object, "):
        Truth(world, {**MEANING, "robot-gripper-empty": "gripping"}, parameters)


def test_unknown_relation_is_named() -> None:
    with pytest.raises(DomainError, match="did you mean 'gripping'"):
        Truth(grocery(0), {**MEANING, "robot-gripping": "griping"})
