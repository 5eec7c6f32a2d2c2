"""Items find a place wherever there is one, where they always did; and what is in the way is called by its name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from executive.errors import DomainError
from executive.sim import footprint, placement
from executive.sim.scene import ItemShape
from executive.sim.spec import SceneSpec, TableSpec, read_scene
from executive.types import FloatArray
from tests.executive.sim.stage import ITEMS, SCENE, grocery

FILE = Path("scene.toml")
CROWDED = dict.fromkeys(ITEMS, "white-table")


@pytest.fixture(scope="module")
def shapes() -> Mapping[str, ItemShape]:
    world = grocery(0)
    kept = {item: world.shapes[item] for item in ITEMS}
    world.close()
    return kept


@pytest.fixture(scope="module")
def spec() -> SceneSpec:
    return read_scene(SCENE)


def draw(
    spec: SceneSpec, shapes: Mapping[str, ItemShape], seed: int, placed: Mapping[str, str]
) -> dict[str, FloatArray]:
    return placement.draw(spec, shapes, placed, np.random.default_rng(seed), FILE)


def with_tables(spec: SceneSpec, *tables: TableSpec) -> SceneSpec:
    return spec.model_copy(update={"tables": tables})


def laid(spec: SceneSpec, shapes: Mapping[str, ItemShape], poses: Mapping[str, FloatArray]) -> None:
    """Hold a drawn scene to what is promised: apart by the gap, within the margin and the reach."""
    placed = []
    for item, pose in poses.items():
        yaw = 2.0 * float(np.arctan2(pose[6], pose[3]))
        cos, sin = np.cos(yaw), np.sin(yaw)
        centre = pose[:2] + np.array([[cos, -sin], [sin, cos]]) @ shapes[item].centre[:2]
        placed.append(footprint.Placed(footprint.standing(shapes[item]), centre, yaw))
        table = min(spec.tables, key=lambda each: float(np.hypot(*(np.asarray(each.centre[:2]) - centre))))
        room = 0.5 * np.asarray(table.size[:2]) - spec.placement.margin
        within = np.abs(centre - np.asarray(table.centre[:2])) + placed[-1].outline.extent(yaw - table.yaw)
        assert (within <= room + 1e-9).all(), item
        assert spec.robot.reach[0] <= np.hypot(*(centre - np.asarray(spec.robot.position[:2]))) <= spec.robot.reach[1]
    for number, one in enumerate(placed):
        assert all(one.apart(other) >= spec.placement.gap - 1e-9 for other in placed[:number])


def test_seeds_keep_their_scenes(spec: SceneSpec, shapes: Mapping[str, ItemShape]) -> None:
    drawn = draw(spec, shapes, 3, {"lemon": "black-table"})
    assert drawn["lemon"][:2] == pytest.approx([0.42439472, -0.09952953])
    assert drawn["water-bottle"][:2] == pytest.approx([0.34509597, 0.05653063])
    laid(spec, shapes, drawn)


@pytest.mark.parametrize("seed", [11, 23, 36, 62, 98, 145])
def test_a_crowded_table_takes_what_circles_say_it_does_not(
    seed: int, spec: SceneSpec, shapes: Mapping[str, ItemShape]
) -> None:
    first, again = (draw(spec, shapes, seed, CROWDED) for _ in range(2))
    assert all(np.array_equal(first[item], again[item]) for item in ITEMS)
    laid(spec, shapes, first)


def test_what_is_in_the_way_is_called_by_its_name(spec: SceneSpec, shapes: Mapping[str, ItemShape]) -> None:
    lemon = {"lemon": shapes["lemon"]}
    near, tiny, far = (
        spec.tables[1],
        TableSpec(name="tray", centre=(0.46, 0.0, 0.8), size=(0.1, 0.1, 0.02)),
        TableSpec(name="shelf", centre=(1.6, 0.0, 0.8), size=(0.4, 0.4, 0.02)),
    )

    def refused(scene: SceneSpec, items: Mapping[str, ItemShape]) -> DomainError:
        with pytest.raises(DomainError) as caught:
            draw(scene, items, 0, {})
        return caught.value

    small = refused(with_tables(spec, tiny), lemon)
    assert small.key == "table"
    assert "lemon, 8.4 x 5.0 cm, does not fit on tray, 10.0 x 10.0 cm" in small.message
    away = refused(with_tables(spec, far), lemon)
    assert away.key == "robot.reach"
    assert "shelf" in away.message
    assert refused(with_tables(spec, tiny, far), lemon).key == "robot.reach"
    narrow = near.model_copy(update={"size": (0.2, 0.2, 0.04)})
    full = refused(with_tables(spec, narrow), shapes)
    assert full.key == "placement.gap"
    assert "no room" in full.message
    assert "another seed" in full.message
