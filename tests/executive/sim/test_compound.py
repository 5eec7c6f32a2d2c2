"""Items of several parts: closed meshes of the right size, one body of the right weight, taken where they say."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import DomainError
from executive.sim.compound import SIDES, Mesh, lathe, torus
from executive.sim.spec import read_scene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills import grasps, transforms
from executive.types import Atom
from tests.executive.sim.stage import ROOT

SCENE = ROOT / "domains" / "tabletop" / "scene.toml"
ITEMS = ("green-mug", "water-bottle", "soda-can", "spray-bottle")
OBJECTS = {**dict.fromkeys(ITEMS, "item"), "blue": "section", "white": "section"}
RELATIONS = {"in": "in-region", "held": "gripping"}

lengths = st.floats(0.005, 0.5)


def check_closed(mesh: Mesh) -> None:
    """Every edge belongs to two faces, which run along it in opposite directions."""
    edges = Counter(
        (int(face[i]), int(face[(i + 1) % 3])) for face in mesh.faces for i in range(3) if face[i] != face[(i + 1) % 3]
    )
    assert all(count == 1 and edges[b, a] == 1 for (a, b), count in edges.items())


@given(radius=lengths, height=lengths)
def test_a_lathe_turns_an_upright_line_into_a_cylinder(radius: float, height: float) -> None:
    mesh = lathe([(radius, 0.0), (radius, height)])
    check_closed(mesh)
    base = 0.5 * SIDES * math.sin(2 * math.pi / SIDES) * radius**2
    assert mesh.volume == pytest.approx(base * height)
    assert np.allclose(mesh.vertices.min(axis=0), [-radius, -radius, 0.0])
    assert np.allclose(mesh.vertices.max(axis=0), [radius, radius, height])


@given(radius=lengths, height=lengths, share=st.floats(0.3, 0.9))
def test_what_a_profile_leaves_out_inside_is_hollow(radius: float, height: float, share: float) -> None:
    cup = [(0.0, 0.0), (radius, 0.0), (radius, height), (share * radius, height), (share * radius, 0.5 * height)]
    mesh = lathe([*cup, (0.0, 0.5 * height)])
    check_closed(mesh)
    full = lathe([(radius, 0.0), (radius, height)]).volume
    assert mesh.volume == pytest.approx(full * (1 - 0.5 * share**2))
    assert lathe([*cup, (0.0, 0.5 * height)][::-1]).volume == pytest.approx(mesh.volume), "either way round"


@given(x=st.floats(0.05, 0.5), y=st.floats(0.05, 0.5), share=st.floats(0.05, 0.45))
def test_a_torus_has_its_outer_extents(x: float, y: float, share: float) -> None:
    thick = share * min(x, y)
    mesh = torus((x, y, thick))
    check_closed(mesh)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [x, y, thick])
    if x == y:
        assert mesh.volume == pytest.approx(2 * math.pi**2 * (0.5 * (x - thick)) * (0.5 * thick) ** 2, rel=0.1)


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    regions = dict(zip(ITEMS, ("white", "white", "blue", "blue"), strict=True))
    return MujocoWorld(SCENE, OBJECTS, seed=4, regions=regions)


def test_parts_are_one_body_of_the_items_weight(world: MujocoWorld) -> None:
    for item in world.spec.items:
        body = world.model.body(item.name)
        assert body.mass[0] == pytest.approx(item.mass)
        assert len(item.parts) == np.count_nonzero(world.model.geom_bodyid == body.id)


def test_an_item_is_round_if_what_is_not_is_within_what_is(world: MujocoWorld) -> None:
    assert {name: shape.axis for name, shape in world.shapes.items()} == {
        "green-mug": None, "water-bottle": 2, "soda-can": 2, "spray-bottle": None,
    }  # fmt: skip


def test_items_stand_in_the_sections_they_were_put_into(world: MujocoWorld) -> None:
    truth = Truth(world, RELATIONS)
    for item, section in zip(ITEMS, ("white", "white", "blue", "blue"), strict=True):
        there = {name: truth.of([Atom("in", (item, name))])[Atom("in", (item, name))] for name in ("blue", "white")}
        assert there == {"blue": section == "blue", "white": section == "white"}


def test_a_mug_is_taken_by_its_body_across_its_handle(world: MujocoWorld) -> None:
    shape, pose = world.shapes["green-mug"], transforms.matrix(world.pose("green-mug"))
    found = grasps.candidates(pose, shape, 0.80)
    assert found
    for grasp in found:
        local = pose[:3, :3].T @ (grasp[:3, 3] - pose[:3, 3])
        assert abs(float(pose[:3, 0] @ grasp[:3, 0])) < 0.01, "the handle is beside the fingers, not between them"
        assert abs(float(local[1])) < 1e-6
        above = pose[:3, 3] + pose[:3, :3] @ [0.0, 0.0, local[2]] - grasp[:3, 3]
        assert np.linalg.norm(above) < 0.06


def test_the_robot_can_be_given_what_has_a_handle() -> None:
    world = MujocoWorld(SCENE, OBJECTS, seed=0, held="green-mug")
    atom = Atom("held", ("green-mug",))
    assert Truth(world, RELATIONS).of([atom])[atom] is True
    world.close()


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ('shape = "torus"', 'shape = "tours"', "item[0].part[1].shape", "'torus'"),
        ("size = [0.042, 0.058, 0.010]", "size = [0.042, 0.058, 0.030]", "item[0].part[1]", "leaves a hole"),
        ("size = [0.042, 0.058, 0.010]", "profile = [[0.01, 0.0], [0.01, 0.1]]", "item[0].part[1]", "for a lathe"),
        ("profile = [[0.0314, 0.064], [0.0314, 0.106]]", "size = [1, 1, 1]", "item[1].part[1]", "needs 'profile'"),
        ("[[0.0314, 0.064], [0.0314, 0.106]]", "[[0.0, 0.064], [0.0, 0.106]]", "item[1].part[1]", "encloses nothing"),
        ("[[0.0314, 0.064], [0.0314, 0.106]]", "[[-0.1, 0.0], [0.1, 0.1]]", "item[1].part[1].profile", "0"),
        ("grip = [0.0, 0.0]", 'asset = "can"', "item[0]", "one of 'asset'"),
        ("grip = [0.0, 0.0]", "rgba = [1, 0, 0, 1]", "item[0]", "each [[item.part]]"),
    ],
)
def test_a_mistake_in_a_part_is_named_with_its_key(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    file = tmp_path / "scene.toml"
    text = SCENE.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DomainError) as told:
        read_scene(file)
    assert key in str(told.value)
    assert words in str(told.value)


def test_the_planners_model_has_every_part(world: MujocoWorld) -> None:
    from executive.sim import scene

    model = scene.build(world.spec, visuals=False).compile()
    parts = [f"{item.name}/part-{number}" for item in world.spec.items for number in range(len(item.parts))]
    assert all(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) >= 0 for name in parts)
