"""What is there is found where it is, and what is not there is not; what is hidden, held or unknown is told as such."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executive.perception import matching
from executive.perception.localizer import Localizer, matrix
from executive.perception.models import ItemModel
from executive.types import FloatArray, PosesEstimated
from tests.executive.perception.room import BLUE, RED, Room, box, camera, pose

BRICK = box("brick", (0.06, 0.10, 0.05), RED)
TOWER = box("tower", (0.05, 0.05, 0.16), BLUE)
PLANK = box("plank", (0.04, 0.20, 0.03))
WHERE = {"brick": pose(0.05, 0.15, 0.025, 0.4), "tower": pose(-0.05, -0.15, 0.08, 1.0)}


def away(found: PosesEstimated, room: Room, name: str) -> tuple[float, float]:
    """The error in m and in degrees."""
    one, other = matrix(room.where[name]), matrix(found.poses[name].pose)
    angle = room.shapes[name].angle(one[:3, :3], other[:3, :3])
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(np.degrees(angle))


def assert_found(found: PosesEstimated, room: Room, *names: str) -> None:
    for name in names:
        metres, degrees = away(found, room, name)
        assert metres < 0.003, name
        assert degrees < 3.0, name


def test_items_are_found_where_they_are() -> None:
    room = Room([BRICK, TOWER], WHERE)
    found = room.localizer().now()
    assert_found(found, room, "brick", "tower")
    assert not found.missing
    assert not found.lumps
    assert not found.left_out
    assert all(each.source == "seen" and len(each.views) >= 2 for each in found.poses.values())


@pytest.mark.parametrize("turn", [(90, 0, 0), (0, 90, 0), (35, 0, 0)])
def test_items_are_found_however_they_lie_or_lean(turn: tuple[float, float, float]) -> None:
    x, y, z, w = Rotation.from_euler("xyz", turn, degrees=True).as_quat()
    room = Room([TOWER], {"tower": np.array([0.0, 0.0, 0.09, w, x, y, z])})
    assert_found(room.localizer().now(), room, "tower")


def test_what_is_not_there_is_missing_and_not_taken_for_what_is() -> None:
    room = Room([BRICK, TOWER], {"brick": WHERE["brick"]})
    found = room.localizer().now()
    assert set(found.poses) == {"brick"}
    assert found.missing == ("tower",)


def test_what_is_there_and_unknown_is_a_lump() -> None:
    room = Room([BRICK, PLANK], {"brick": WHERE["brick"], "plank": pose(-0.1, -0.1, 0.015)})
    found = room.localizer(BRICK).now()
    assert set(found.poses) == {"brick"}
    (lump,) = found.lumps
    assert np.abs(lump.centre[:2] - [-0.1, -0.1]).max() < 0.01
    assert np.abs(lump.half[:2] - [0.02, 0.10]).max() < 0.01


def test_things_that_touch_are_told_apart() -> None:
    room = Room([BRICK, PLANK], {"brick": pose(0.0, 0.0, 0.025), "plank": pose(0.0505, 0.03, 0.015)})
    assert_found(room.localizer().now(), room, "brick", "plank")


def test_what_leans_on_another_thing_is_found_by_its_colour() -> None:
    carton, tin = box("carton", (0.07, 0.07, 0.16), (0.8, 0.8, 0.8)), box("tin", (0.066, 0.066, 0.10), RED)
    leaning = np.array([0.0, 0.0, 0.0904, -0.0654, -0.4615, 0.8512, 0.2413])
    beside = np.array([0.0448, 0.0438, 0.05, 0.2853, 0.0, 0.0, 0.9584])
    room = Room([carton, tin], {"carton": leaning, "tin": beside})
    assert_found(room.localizer().now(), room, "carton", "tin")


def test_the_spread_says_how_well_a_pose_is_known() -> None:
    near, far = (Room([TOWER], {"tower": pose(0.0, 0.0, 0.08)}, noise).localizer().now() for noise in (0.0005, 0.003))
    assert 0.0 < near.poses["tower"].spread < far.poses["tower"].spread < 0.01
    for found in (near, far):
        assert (np.linalg.eigvalsh(found.poses["tower"].covariance) > 0.0).all()


def test_nothing_is_measured_twice_at_one_moment() -> None:
    room = Room([TOWER], {"tower": pose(0.0, 0.0, 0.08)})
    localizer = room.localizer()
    first = localizer.now()
    assert localizer.now() is first
    room.time += 0.1
    assert localizer.now() is not first
    assert room.captures == 2


def later(localizer: Localizer, room: Room) -> PosesEstimated:
    room.time += 1.0
    return localizer.now()


def test_what_is_moved_is_found_again_and_what_is_taken_away_is_missing() -> None:
    room = Room([BRICK, TOWER], WHERE)
    localizer = room.localizer()
    localizer.now()
    room.where["brick"] = pose(0.1, -0.05, 0.025, 1.2)
    del room.where["tower"]
    found = later(localizer, room)
    assert_found(found, room, "brick")
    assert found.missing == ("tower",)


def test_what_is_hidden_stays_where_it_was() -> None:
    room = Room([BRICK, TOWER], WHERE)
    localizer = room.localizer()
    localizer.now()
    room.where["screen"] = pose(0.05, 0.15, 0.10)
    room.shapes["screen"] = box("screen", (0.15, 0.15, 0.19))
    found = later(localizer, room)
    assert found.poses["brick"].source == "remembered"
    assert found.poses["brick"].time == 0.0
    assert_found(found, room, "tower")


def held(room: Room, name: str, height: float) -> None:
    """Have the hand hold an item whose middle it grips, at a height."""
    room.width = 0.05
    room.grip = matrix(pose(0.0, 0.0, height)) @ np.diag([1.0, -1.0, -1.0, 1.0])
    room.where[name] = pose(0.0, 0.0, height)


@pytest.mark.parametrize(("gap", "is_told"), [(0.09, True), (0.075, False)])
def test_what_is_mostly_hidden_is_found_where_what_is_seen_of_it_tells_where_it_is(gap: float, is_told: bool) -> None:
    screen, low = box("screen", (0.04, 0.34, 0.16), BLUE), box("low", (0.04, 0.12, 0.08))
    where = {"brick": pose(0, 0, 0.025, np.pi / 2), "screen": pose(gap, 0, 0.08), "low": pose(-gap, 0, 0.04)}
    room = Room([BRICK, screen, low], where)
    found = room.localizer().now()
    assert_found(found, room, "screen", "low", *(["brick"] if is_told else []))
    assert found.missing == (() if is_told else ("brick",))
    assert bool(found.lumps) is not is_told


def test_what_is_in_the_hand_goes_where_the_hand_goes() -> None:
    room = Room([TOWER, BRICK], {**WHERE, "tower": pose(0.0, 0.0, 0.08)})
    localizer = room.localizer()
    localizer.now()
    held(room, "tower", 0.08)
    assert later(localizer, room).poses["tower"].source == "held"
    held(room, "tower", 0.25)
    found = later(localizer, room)
    assert found.poses["tower"].source == "held"
    assert_found(found, room, "tower", "brick")
    room.blind = set(room.cameras)  # nothing is measured any more
    held(room, "tower", 0.30)
    found = later(localizer, room)
    assert found.poses["tower"].source == "held"
    assert not found.poses["tower"].views
    assert_found(found, room, "tower")
    assert found.poses["brick"].source == "remembered"


def test_what_slips_in_the_hand_is_followed() -> None:
    room = Room([TOWER], {"tower": pose(0.0, 0.0, 0.08)})
    localizer = room.localizer()
    localizer.now()
    held(room, "tower", 0.08)
    later(localizer, room)
    held(room, "tower", 0.25)
    x, y, z, w = Rotation.from_euler("x", 0.5).as_quat()  # about the line from pad to pad
    room.where["tower"] = np.array([0.0, 0.0, 0.25, w, x, y, z])
    assert_found(later(localizer, room), room, "tower")


def test_what_was_let_go_of_is_looked_for() -> None:
    room = Room([TOWER], {"tower": pose(0.0, 0.0, 0.08)})
    localizer = room.localizer()
    localizer.now()
    held(room, "tower", 0.08)
    later(localizer, room)
    room.width, room.grip[2, 3] = 0.085, 0.4
    room.where["tower"] = pose(0.2, 0.1, 0.025, 0.3)
    del room.where["tower"]
    assert later(localizer, room).missing == ("tower",)


def test_a_camera_without_depth_is_left_out_and_the_others_do() -> None:
    room = Room([BRICK, TOWER], WHERE)
    room.blind = {"left"}
    found = room.localizer().now()
    assert set(found.left_out) == {"left"}
    assert_found(found, room, "brick", "tower")
    room.blind = set(room.cameras)
    nothing = room.localizer().now()
    assert not nothing.poses
    assert nothing.missing == ("brick", "tower")


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.02), (0.03, 0.0, 0.0), (-0.01, 0.02, 0.01)])
def test_a_camera_that_was_moved_spoils_nothing(by: tuple[float, float, float]) -> None:
    room = Room([BRICK, TOWER], WHERE)
    room.moved = {"right": np.array(by)}
    found = room.localizer().now()
    assert_found(found, room, "brick", "tower")
    assert not found.lumps


def test_poses_are_of_the_body_not_of_its_middle() -> None:
    vertices: FloatArray = BRICK.vertices + [0.0, 0.0, 0.025]
    footed = replace(BRICK, name="footed", vertices=vertices)
    assert np.allclose(footed.centre, [0.0, 0.0, 0.025])
    room = Room([BRICK], {"brick": WHERE["brick"]})
    found = room.localizer(footed).now()
    assert np.abs(found.poses["footed"].pose[:3] - [0.05, 0.15, 0.0]).max() < 0.003


def test_what_may_hide_an_item_is_what_stands_before_a_place_where_it_could_be() -> None:
    screen = box("screen", (0.02, 0.20, 0.20), BLUE)
    room = Room([screen, TOWER], {"screen": pose(0.1, 0.0, 0.10), "tower": WHERE["tower"]})
    room.cameras = {"front": camera("front", (0.9, 0.0, 0.25))}
    localizer = room.localizer(screen, TOWER, BRICK)
    assert "brick" in localizer.now().missing
    behind, before = np.array([[0.0, 0.0, 0.0]]), np.array([[0.22, 0.0, 0.0]])
    assert localizer.hiders("brick", behind) == ("screen",)
    assert localizer.hiders("brick", before) == ()  # it would be seen there
    assert localizer.hiders("brick", np.array([[0.1, 0.0, 0.05]])) == ()  # where another thing is, nothing else can be


def test_only_what_has_moved_is_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[set[str]] = []
    find = matching.match

    def watched(models: Sequence[ItemModel], *rest: Any) -> Any:
        searched.append({model.name for model in models})
        return find(models, *rest)

    monkeypatch.setattr(matching, "match", watched)
    room = Room([BRICK, TOWER], WHERE)
    localizer = room.localizer()
    localizer.now()
    assert searched[0] == {"brick", "tower"}
    searched.clear()
    room.where["tower"] = pose(0.1, -0.05, 0.08, 0.2)
    assert_found(later(localizer, room), room, "brick", "tower")
    assert searched[0] == {"tower"}
    searched.clear()
    assert_found(later(localizer, room), room, "brick", "tower")
    assert all(not names for names in searched)
    del room.where["brick"]  # and what is not there is not kept
    assert later(localizer, room).missing == ("brick",)
