"""Items that problems describe, towers and regions: made, set up, and told apart by the truth."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from executive.errors import DomainError
from executive.sim.described import attributes_of
from executive.sim.scene import paint
from executive.sim.spec import SceneSpec, read_scene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom

SCENE = Path(__file__).parents[3] / "domains" / "blocksworld" / "scene.toml"

BASE, MIDDLE, TOP, BALL = "large-blue-metal-cube", "small-red-rubber-cylinder", "small-cyan-metal-sphere", "ball"

PAINTED = """
[[item]]
name = "ball"
attributes = ["gray", "small", "rubber", "sphere"]
mass = 0.2

[[region]]
name = "left"
table = "table"
centre = [0.0, 0.25]
size = [0.3, 0.2]
rgba = [0.2, 0.3, 0.9, 1.0]
"""

RELATIONS = {"on": "directly-on", "clear": "clear", "in": "in-region", "rests": "on"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("blocks") / "scene.toml"
    file.write_text(SCENE.read_text(encoding="utf-8") + PAINTED, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def spec(scene: Path) -> SceneSpec:
    return read_scene(scene)


def test_an_item_is_made_from_its_name_or_from_its_attributes(spec: SceneSpec, scene: Path) -> None:
    made = {item.name: item for item in spec.restricted_to({BASE: "cube", BALL: "sphere"}, scene).items}
    assert list(made) == [BALL, BASE]
    cube, ball = made[BASE], made[BALL]
    assert (cube.shape, cube.size, cube.material) == ("box", (0.052, 0.052, 0.052), "chrome")
    assert cube.attributes == {"size": "large", "colour": "blue", "material": "metal", "shape": "cube"}
    assert (ball.shape, ball.mass, ball.attributes["colour"]) == ("sphere", 0.2, "gray"), "its own mass counts for more"


@pytest.mark.parametrize("shape", ["cube", "cylinder", "sphere"])
def test_metal_is_told_from_rubber_and_what_is_painted_looks_as_what_is_made_so(scene: Path, shape: str) -> None:
    def look(made: str, painted: str) -> np.ndarray:
        world = MujocoWorld(scene, {made: shape}, seed=2)
        try:
            (wanted,) = read_scene(scene).restricted_to({painted: shape}, scene).items
            paint(world.model, wanted.model_copy(update={"name": made}))
            return world.render("front").astype(int)
        finally:
            world.close()

    metal, rubber = f"large-green-metal-{shape}", f"large-green-rubber-{shape}"
    apart = np.abs(look(metal, metal) - look(rubber, rubber)).max(axis=2)
    assert (apart > 15).sum() > 100, "pixels"
    assert np.array_equal(look(metal, rubber), look(rubber, rubber))
    assert np.array_equal(look(rubber, metal), look(metal, metal))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("large-blu-metal-cube", "did you mean 'blue'"),
        ("large-blue-cube", "no value of 'material'"),
        ("large-small-blue-metal-cube", "'large' and 'small' are two values of 'size'"),
    ],
)
def test_a_name_that_describes_no_item_is_refused(spec: SceneSpec, scene: Path, name: str, words: str) -> None:
    with pytest.raises(DomainError, match=r"scene\.toml: item: ") as caught:
        spec.restricted_to({name: "cube"}, scene)
    assert words in str(caught.value)


def test_attributes_come_in_any_order() -> None:
    known: dict[str, dict[str, dict[str, str]]] = {"size": {"small": {}}, "colour": {"red": {}, "blue": {}}}
    assert attributes_of(["blue", "small"], known) == {"size": "small", "colour": "blue"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('table = "table"', 'table = "tabel"', "did you mean 'table'"),
        ('"sphere"]', '"spheer"]', "item 'ball': 'spheer' is no value"),
        ('name = "left"', 'name = "ball"', "'ball' is named twice"),
        ("size = [0.3, 0.2]", "size = [0.3, 0.0]", "greater than 0"),
    ],
)
def test_mistakes_in_regions_and_attributes_are_named(
    scene: Path, tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = scene.read_text(encoding="utf-8")
    head, tail = text[: text.index("[[item]]")], text[text.index("[[item]]") :]
    assert old in tail
    file = tmp_path / "scene.toml"
    file.write_text(head + tail.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DomainError) as caught:
        read_scene(file)
    assert words in str(caught.value)


def test_a_tower_in_a_region_stands_as_it_is_declared_and_the_truth_tells_its_storeys_apart(scene: Path) -> None:
    world = MujocoWorld(
        scene,
        dict.fromkeys((BASE, MIDDLE, TOP, BALL), "block") | {"left": "place"},
        seed=3,
        stacked={MIDDLE: BASE, TOP: MIDDLE},
        regions={BASE: "left"},
    )
    try:
        truth = Truth(world, RELATIONS, {"on": ("item", "thing")})
        pairs = [(MIDDLE, BASE), (TOP, MIDDLE), (TOP, BASE), (BASE, "table"), (MIDDLE, "table"), (BALL, "table")]
        facts = truth.of([Atom("on", pair) for pair in pairs])
        assert [facts[Atom("on", pair)] for pair in pairs] == [True, True, False, True, False, True]
        assert all(truth.of([Atom("rests", (item, "table")) for item in (BASE, MIDDLE, TOP)]).values())
        clear = truth.of([Atom("clear", (item,)) for item in (BASE, MIDDLE, TOP, BALL)])
        assert clear.true == {Atom("clear", (TOP,)), Atom("clear", (BALL,))}
        inside = truth.of([Atom("in", (item, "left")) for item in (BASE, MIDDLE, TOP)])
        assert all(inside.values())
        # Beside the region, and then off the tower.
        world.put(TOP, np.array([0.52, -0.25, 0.83, 1.0, 0.0, 0.0, 0.0]))
        world.settle(0.3)
        now = truth.of([Atom("in", (TOP, "left")), Atom("on", (TOP, MIDDLE)), Atom("on", (TOP, "table"))])
        assert now.true == {Atom("on", (TOP, "table"))}
    finally:
        world.close()


def test_a_cylinder_on_its_side_rests_on_the_table_wherever_it_was_rolled_to(scene: Path) -> None:
    world = MujocoWorld(scene, {MIDDLE: "block"}, seed=0)
    try:
        truth, rests = Truth(world, RELATIONS, {"on": ("item", "thing")}), Atom("rests", (MIDDLE, "table"))
        table, start = world.handle.tables["table"], world._places[MIDDLE]
        radius = float(world.model.geom_size[world.model.body_geomadr[world.model.body(MIDDLE).id]][0])
        for rolled in np.linspace(0.0, 0.1, 9):
            half, quarter = 0.5 * rolled, np.sqrt(0.5)
            lying = quarter * np.array([np.cos(half), np.sin(half), np.cos(half), np.sin(half)])
            height = table.centre[2] + radius
            for above, expected in ((-3e-6, True), (20e-6, False)):
                world.data.qpos[start : start + 7] = [*table.centre[:2], height + above, *lying]
                mujoco.mj_forward(world.model, world.data)
                assert truth.of([rests])[rests] is expected
    finally:
        world.close()
