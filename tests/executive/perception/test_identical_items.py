"""Items that nothing tells apart keep their names in what is estimated, as far as they were watched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executive.perception import Capture
from executive.perception.clouds import View
from executive.perception.localizer import Localizer, matrix
from executive.perception.models import identical
from executive.types import FloatArray
from tests.executive.perception.room import BLUE, RED, Room, box, pose

SIZE = (0.05, 0.05, 0.10)
TWINS = [box(name, SIZE, RED) for name in ("a", "b", "c")]
OTHER = box("other", (0.05, 0.10, 0.05), BLUE)
START = {"a": pose(0.1, -0.2, 0.05), "b": pose(-0.05, 0.0, 0.05), "c": pose(0.1, 0.2, 0.05)}


def at_start(label: str, position: FloatArray) -> float:
    return 1.0 if np.linalg.norm(position[:2] - START[label][:2]) < 0.05 else 1e-3


def watching(room: Room) -> Localizer:
    return Localizer(tuple(room.shapes.values()), room, room.capture, lambda: room.time, at_start)


def assert_named(localizer: Localizer, room: Room, *names: str) -> None:
    found = localizer.now()
    for name in names:
        assert np.linalg.norm(matrix(found.poses[name].pose)[:3, 3] - room.where[name][:3]) < 0.01, name


def test_only_what_has_one_shape_and_one_colour_is_identical() -> None:
    assert identical([*TWINS, OTHER, box("blue", SIZE, BLUE)]) == [("a", "b", "c")]
    assert identical([OTHER, TWINS[0]]) == []


def test_identical_items_are_all_found_and_named_by_what_is_known_beforehand() -> None:
    room = Room([*TWINS, OTHER], {**START, "other": pose(-0.2, 0.2, 0.025)})
    localizer = watching(room)
    assert_named(localizer, room, "a", "b", "c", "other")
    found = localizer.now()
    assert set(found.identity) == {"a", "b", "c"}
    assert found.identity["a"]["a"] > 0.99
    assert not found.lumps


def test_one_that_is_moved_in_view_keeps_its_name() -> None:
    room = Room(TWINS, START)
    localizer = watching(room)
    for x in np.linspace(0.1, -0.2, 6):
        room.where["a"] = pose(x, -0.2, 0.05)
        assert_named(localizer, room, "a", "b", "c")
        room.time += 0.2
    assert localizer.now().identity["a"]["a"] > 0.95


def test_after_a_while_in_which_nobody_looked_no_name_is_trusted() -> None:
    room = Room(TWINS, START)
    localizer = watching(room)
    localizer.now()
    room.time += 5.0
    room.where["a"], room.where["c"] = START["c"], START["a"]
    assert max(max(row.values()) for row in localizer.now().identity.values()) <= 0.6


def test_cameras_that_measure_nothing_watch_nothing() -> None:
    room = Room(TWINS, START)
    localizer = watching(room)
    localizer.now()
    room.blind = set(room.cameras)
    for _ in range(25):
        room.time += 0.2
        found = localizer.now()
    assert found.identity["a"]["a"] <= 0.6
    assert found.poses["a"].source == "remembered"


def test_the_one_in_the_hand_is_known_by_touch() -> None:
    room = Room(TWINS, START)
    localizer = watching(room)
    localizer.now()
    room.grip[:3, 3] = START["b"][:3]
    room.width = SIZE[0]
    for _ in range(5):
        room.time += 0.2
        room.grip[2, 3] += 0.03
        room.where["b"] = room.where["b"] + np.array([0, 0, 0.03, 0, 0, 0, 0])
        found = localizer.now()
    assert found.poses["b"].source == "held"
    assert found.identity["b"]["b"] == pytest.approx(1.0, abs=1e-3)
    room.where["b"] = pose(room.grip[0, 3], room.grip[1, 3], room.grip[2, 3])
    assert_named(localizer, room, "a", "b", "c")


def test_one_that_is_seen_in_two_pieces_is_not_found_twice() -> None:
    room = Room(TWINS, {"a": START["a"]})

    def capture() -> Capture:
        sensed, pieces = room.capture(), {}
        for name, depth in sensed.depth.items():  # of a strip down its middle, nothing is measured
            points = View.of(room.cameras[name], depth).points(np.arange(depth.size))
            beside = np.abs(points[:, 1] - START["a"][1]).reshape(depth.shape)
            pieces[name] = np.where(beside < 0.012, 0, depth).astype(np.uint16)
        return replace(sensed, depth=pieces)

    found = Localizer(TWINS, room, capture, lambda: room.time, at_start).now()
    assert set(found.poses) == {"a"}
    assert found.missing == ("b", "c")
