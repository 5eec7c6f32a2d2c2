"""Drawers and containers of a scene: what their specification may say, that a closed drawer hides what is in it, that
what slides is in snapshots and frames, and what can be wrong with a drawer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.errors import DomainError
from executive.sim.fixtures import DrawerSpec
from executive.sim.placement import places
from executive.sim.spec import read_scene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom
from tests.executive.sim.stage import ROOT

SCENE = ROOT / "domains" / "kitchen" / "scene.toml"
ITEMS = ("lemon", "can", "butter", "salt")
LEFT, MIDDLE, RIGHT = DRAWERS = ("left-drawer", "middle-drawer", "right-drawer")
MEANING = {"in": "inside", "on": "on", "open": "open", "holding": "gripping"}


def kitchen(seed: int = 0, items: tuple[str, ...] = ITEMS, **options: Any) -> MujocoWorld:
    return MujocoWorld(SCENE, dict.fromkeys(items, "item"), seed, **options)


def true(world: MujocoWorld, *atoms: str) -> list[bool]:
    """Whether each atom is true."""
    parsed = [Atom.parse(atom) for atom in atoms]
    facts = Truth(world, MEANING).of(parsed)
    return [bool(facts[atom]) for atom in parsed]


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, 0.21]", "drawer[0].size", "is missing"),
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, -0.21, 0.075]", "drawer[0].size[1]", "greater than 0"),
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, 0.21, 0.075]\ntravel = 0.3", "drawer[0]", "fall out"),
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, 0.21, 0.075]\nopen = 2", "drawer[0].open", "less than or equal"),
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, 0.06, 0.075]", "drawer[0]", "'handle.width'"),
        ("size = [0.19, 0.21, 0.075]", "size = [0.19, 0.21, 0.075]\nhandel = 1", "drawer[0].handel", "'handle'"),
        ("height = 0.012", "height = 0.0", "container[0].height", "greater than 0"),
        ("height = 0.012", "hight = 0.012", "container[0]", "height"),
        ('name = "tray"', 'name = "lemon"', "(whole file)", "named twice"),
    ],
)
def test_a_mistake_is_told_in_one_line_with_its_key(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    good, file = SCENE.read_text(encoding="utf-8"), tmp_path / "scene.toml"
    assert old in good
    file.write_text(good.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DomainError) as caught:
        read_scene(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: {key}")
    assert words in message
    assert "\n" not in message


def test_the_case_closes_a_drawer_on_all_sides() -> None:
    """From the middle of the room in it, every line in whatever direction meets a part of the drawer or its case."""
    drawer = DrawerSpec(name="any", front=(0.0, 0.0, 0.0), size=(0.2, 0.2, 0.08))
    blocks = (*drawer.blocks(), *drawer.case())
    depth, _, height = drawer.size
    middle = np.array([drawer.wall + 0.5 * depth, 0.0, 0.5 * height + drawer.wall])
    rng = np.random.default_rng(0)
    for way in rng.normal(size=(2000, 3)):
        way /= np.linalg.norm(way)
        near = []
        for block in blocks:
            with np.errstate(divide="ignore"):
                one, other = (
                    (np.array(block.centre) + side * np.array(block.half) - middle) / way for side in (-1.0, 1.0)
                )
            enter, leave = np.minimum(one, other).max(), np.maximum(one, other).min()
            near += [enter] if 0.0 <= enter <= leave else []
        assert near, way


def test_what_is_in_a_closed_drawer_no_camera_sees() -> None:
    world = kitchen(placed=dict.fromkeys(("lemon", "can"), LEFT) | {"butter": MIDDLE, "salt": RIGHT})
    hidden = world.masks()
    assert all(not mask.any() for mask in hidden.values())
    assert true(world, f"in(lemon,{LEFT})", f"open({LEFT})", "on(lemon,worktop)") == [True, False, False]
    opened = kitchen(placed={"lemon": LEFT}, items=("lemon",), opened={LEFT: True})
    assert sum(int((mask == 1).sum()) for mask in opened.masks().values()) > 100
    assert true(opened, f"in(lemon,{LEFT})", f"open({LEFT})", f"open({RIGHT})") == [True, True, False]


def test_items_are_drawn_into_drawers_and_onto_the_worktop_and_keep_clear_of_what_slides() -> None:
    spec, where = read_scene(SCENE), set()
    for seed in range(12):
        world = kitchen(seed)
        places_now = [f"in({item},{d})" for item in ITEMS for d in DRAWERS] + [f"on({i},worktop)" for i in ITEMS]
        held = [atom for atom, so in zip(places_now, true(world, *places_now), strict=True) if so]
        assert len(held) == len(ITEMS)
        where |= {atom.partition(",")[2].rstrip(")") for atom in held}
        for item in ITEMS:
            if f"on({item},worktop)" in held:
                assert min(each.beside(world.pose(item)[:2]) for each in spec.covered) > 0.02
    assert where == {*DRAWERS, "worktop"}


def test_a_snapshot_has_how_far_drawers_are_open_and_which_are_stuck() -> None:
    world, other = kitchen(items=("lemon",), placed={"lemon": LEFT}), kitchen(items=("lemon",), seed=3)
    world.drawers.slide(LEFT, 0.1)
    world.disturb("jam", np.random.default_rng(0), about=f"x {LEFT}", seconds="50")
    other.restore(world.snapshot())
    assert other.openings() == world.openings() == {LEFT: pytest.approx(0.1), MIDDLE: 0.0, RIGHT: 0.0}
    assert other.disturb("roll", np.random.default_rng(0)) == f"{LEFT} rolled, and was stopped"
    assert other.openings()[LEFT] == pytest.approx(0.1, abs=0.005)


def test_a_frame_shows_a_drawer_where_it_was() -> None:
    world = kitchen(items=("lemon",), placed={"lemon": RIGHT})
    world.drawers.slide(RIGHT, 0.12)
    world.settle(0.1)
    frame = world.frame()
    world.drawers.slide(RIGHT, 0.0)
    world.show(frame)
    assert world.openings()[RIGHT] == pytest.approx(0.12, abs=1e-3)


def test_a_drawer_is_told_apart_from_the_worktop_it_stands_on_and_a_tray_too() -> None:
    world = kitchen(items=("lemon", "salt"), placed={"lemon": "tray", "salt": "worktop"})
    assert true(world, "on(lemon,tray)", "on(lemon,worktop)", "on(salt,worktop)") == [True, False, True]
    assert {*places(world.spec)} == {"worktop", "tray", *DRAWERS}


def test_an_open_drawer_rolls_shut_and_takes_what_is_in_it_along() -> None:
    world = kitchen(items=("can",), placed={"can": MIDDLE}, opened={MIDDLE: True})
    rng = np.random.default_rng(0)
    world.disturb("roll", rng, drawer=LEFT)
    assert true(world, f"open({LEFT})", f"open({MIDDLE})") == [False, True]
    assert world.disturb("roll", rng) == f"{MIDDLE} rolled shut"
    assert true(world, f"in(can,{MIDDLE})", f"open({MIDDLE})") == [True, False]
    assert "no drawer" in world.disturb("roll", rng)


def test_someone_moves_an_item_to_another_drawer_while_both_are_closed() -> None:
    world = kitchen(items=("lemon",), placed={"lemon": LEFT})
    assert world.disturb("shove", np.random.default_rng(1), item="lemon", table=RIGHT) == (
        f"someone moved lemon into {RIGHT}"
    )
    assert true(world, f"in(lemon,{RIGHT})", f"in(lemon,{LEFT})") == [True, False]


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_drawer_is_as_far_open_at_first_as_its_scene_says(share: float) -> None:
    spec = read_scene(SCENE).with_drawers({LEFT: share})
    drawer = spec.drawers[0]
    closed = np.array(drawer.floor(0.0).centre)
    assert spec.floors[LEFT].centre == pytest.approx(closed + share * drawer.stroke * drawer.axis)
