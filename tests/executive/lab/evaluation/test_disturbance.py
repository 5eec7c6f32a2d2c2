"""Looks are made harder as they are told to be, the same way every time, and no other way."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.collection.dataset import Point
from executive.lab.evaluation.disturbance import Disturbance, Disturber
from executive.types import Facts, Image
from tests.executive.sim.stage import grocery

DOMAIN = load_domain("grocery")
VALID = re.compile(r"lights|cameras|jpeg=0*([1-9]|[1-8][0-9]|9[0-5])|(blurred|noisy|dark)=[0-9].*")


@pytest.fixture(scope="module")
def point() -> Point:
    world = grocery(seed=4)
    look = world.observe()
    return Point(4, 2, 5, "pick(lemon,wood-table)", 1.0, look.joints, world.data.qpos.copy(), look.images, Facts())


def apart(some: Image, other: Image) -> float:
    return float(np.abs(some.astype(int) - other).mean())


@pytest.mark.parametrize(
    ("specs", "meant"),
    [
        ([], Disturbance()),
        (["lights"], Disturbance(lights=True)),
        (["jpeg=40", "cameras"], Disturbance(cameras=True, jpeg=40)),
        (["jpeg=1"], Disturbance(jpeg=1)),
    ],
)
def test_specs_are_read(specs: list[str], meant: Disturbance) -> None:
    assert Disturbance.parse(specs) == meant


@given(st.text(max_size=12).filter(lambda spec: not VALID.fullmatch(spec)))
def test_whatever_else_is_refused_in_a_line(spec: str) -> None:
    with pytest.raises(InputError, match=r"^disturb") as told:
        Disturbance.parse([spec])
    assert str(told.value).isprintable()


@pytest.mark.parametrize("specs", [["light"], ["jpeg"], ["lights=2"], ["jpeg=0"], ["jpeg=96"], ["cameras"] * 2])
def test_mistakes_are_named(specs: list[str]) -> None:
    with pytest.raises(InputError, match=r"^disturb"):
        Disturbance.parse(specs)


def test_a_number_without_end_is_no_quality() -> None:
    with pytest.raises(InputError, match="is not a quality from 1 to 95"):
        Disturbance.parse([f"jpeg={'9' * 5_000}"])


def test_nothing_changes_when_nothing_is_told(point: Point) -> None:
    with Disturber(Disturbance(), None, None, 0) as disturber:
        assert disturber.pictures(point) is point.images


def test_compression_loses_the_more_the_lower_its_quality(point: Point) -> None:
    lost = []
    for quality in (90, 40, 5):
        with Disturber(Disturbance(jpeg=quality), None, None, 0) as disturber:
            pictures = disturber.pictures(point)
        assert pictures.keys() == point.images.keys()
        lost.append(apart(pictures["front"], point.images["front"]))
    assert 0.0 < lost[0] < lost[1] < lost[2] < 30.0


@pytest.mark.parametrize("what", [Disturbance(lights=True), Disturbance(cameras=True)])
def test_a_point_is_drawn_anew_by_its_positions_seed_and_number(what: Disturbance, point: Point) -> None:
    bare = replace(point, images={})  # no picture of the collection is needed
    with Disturber(what, DOMAIN, None, 0) as disturber, Disturber(what, DOMAIN, ("front",), 1) as other:
        drawn = disturber.pictures(bare)["front"]
        others = [disturber.pictures(each)["front"] for each in (replace(bare, step=6), replace(bare, episode=3))]
        others.append(other.pictures(bare)["front"])
        assert np.array_equal(disturber.pictures(bare)["front"], drawn)
    assert all(apart(each, drawn) > 1.0 for each in (*others, point.images["front"]))
    with Disturber(what, DOMAIN, ("front",), 0) as alone:
        assert np.array_equal(alone.pictures(bare)["front"], drawn)


def test_only_the_wanted_cameras_are_drawn(point: Point) -> None:
    with Disturber(Disturbance(lights=True), DOMAIN, ("hand", "wood"), 0) as disturber:
        assert list(disturber.pictures(point)) == ["wood", "hand"]


def test_positions_of_another_scene_are_an_error(point: Point) -> None:
    with (
        Disturber(Disturbance(cameras=True), DOMAIN, None, 0) as disturber,
        pytest.raises(InputError, match="another scene"),
    ):
        disturber.pictures(replace(point, qpos=np.zeros(7)))


@pytest.mark.parametrize("spec", ["blurred", "noisy=", "dark=1.5", "noisy=-3", "noisy=nan", "blurred=1001"])
def test_pictures_are_not_spoiled_by_what_is_no_amount(spec: str) -> None:
    with pytest.raises(InputError, match=r"^disturb"):
        Disturbance.parse([spec])


@pytest.mark.parametrize(("way", "little", "much"), [("blurred", 1, 4), ("noisy", 5, 40), ("dark", 0.2, 0.8)])
def test_pictures_are_spoiled_by_the_amount_and_each_look_in_its_own_way(
    way: str, little: float, much: float, point: Point
) -> None:
    def shown(amount: float, seed: int = 0, **changes: int) -> Image:
        with Disturber(Disturbance.parse([f"{way}={amount}"]), None, None, seed) as disturber:
            return disturber.pictures(replace(point, **changes))["front"]  # type: ignore[arg-type]

    kept = point.images["front"].copy()
    away = [apart(shown(amount), point.images["front"]) for amount in (0, little, much)]
    assert away[0] == 0.0 if way != "blurred" else away[0] < away[1]
    assert 0.0 < away[1] < away[2]
    assert np.array_equal(point.images["front"], kept)
    assert np.array_equal(shown(much), shown(much))
    by_chance = [not np.array_equal(shown(much), other) for other in (shown(much, step=6), shown(much, 1))]
    assert by_chance == [way == "noisy"] * 2
