"""The relations that come along, on scenes made of boxes whose truth is plain."""

from __future__ import annotations

import numpy as np
import pytest

from executive.relations import Scene, Solid, gripper_empty, gripping, on


def cube(x: float, z: float, edge: float = 0.1, y: float = 0.0) -> Solid:
    return Solid.box(np.array([x, y, z]), np.full(3, 0.5 * edge))


TABLES = {"left": cube(-0.55, -0.5, 1.0), "right": cube(0.55, -0.5, 1.0)}  # tops at 0, 10 cm apart
AWAY = (cube(5.0, 1.0), cube(6.0, 1.0))


def scene(feels: bool = False, fingers: tuple[Solid, Solid] = AWAY, tolerance: float = 0.001, **items: Solid) -> Scene:
    return Scene(items, TABLES, fingers, feels, tolerance=tolerance)


def test_what_stands_on_a_stack_is_on_its_table() -> None:
    stack = scene(low=cube(0.5, 0.05), high=cube(0.52, 0.15), floating=cube(0.5, 0.3))
    assert on(stack, "low", "right")
    assert on(stack, "high", "right")
    assert not on(stack, "high", "left")
    assert not on(stack, "floating", "right")


@pytest.mark.parametrize(("x", "table"), [(-0.02, "left"), (0.02, "right")])
def test_across_two_edges_it_is_on_the_table_that_its_centre_is_nearest_to(x: float, table: str) -> None:
    bridge = scene(bridge=cube(x, 0.15, 0.3))
    assert [name for name in TABLES if on(bridge, "bridge", name)] == [table]


def test_a_gap_within_the_tolerance_is_contact() -> None:
    assert on(scene(cube=cube(0.5, 0.052), tolerance=0.003), "cube", "right")
    assert not on(scene(cube=cube(0.5, 0.054), tolerance=0.003), "cube", "right")


@pytest.mark.parametrize(("micrometres", "touches"), [(-30.0, True), (0.0, True), (1.0, False), (30.0, False)])
def test_what_bounces_is_on_nothing_though_it_is_close(micrometres: float, touches: bool) -> None:
    exact = Scene({"cube": cube(0.5, 0.05 + 1e-6 * micrometres)}, TABLES, AWAY, False)
    assert on(exact, "cube", "right") is touches


def test_something_unknown_in_between_carries() -> None:
    held_up = Scene({"cube": cube(0.5, 0.25)}, TABLES, AWAY, False, (cube(0.5, 0.1, 0.2),), 0.001)
    assert on(held_up, "cube", "right")


def test_what_both_fingers_touch_is_gripped_once_they_feel_it() -> None:
    fingers = (cube(0.45, 0.5, y=-0.1), cube(0.45, 0.5, y=0.1))
    closed, open_wide = scene(True, fingers, cube=cube(0.45, 0.5)), scene(False, fingers, cube=cube(0.45, 0.5))
    assert gripping(closed, "cube")
    assert not gripper_empty(closed)
    assert not on(
        scene(True, (cube(0.45, 0.05, y=-0.1), cube(0.45, 0.05, y=0.1)), cube=cube(0.45, 0.05)), "cube", "right"
    )
    assert not gripping(open_wide, "cube")
    assert gripper_empty(open_wide)
    assert not gripping(scene(True, (fingers[0], AWAY[0]), cube=cube(0.45, 0.5)), "cube")
