"""What a robot knows without looking: itself and its room as they are, the shapes of items, and nothing of where they
are."""

from __future__ import annotations

import numpy as np
import pytest

from executive.app.localizer import item_models, open_localizer
from executive.errors import DomainError
from executive.perception.localizer import matrix
from executive.sim.known_models import KnownScene
from executive.types import Observation
from tests.executive.sim.stage import ITEMS, grocery


def test_robot_and_furniture_are_where_they_are_seen_when_there_is_nothing_else() -> None:
    world = grocery(1, items=("lemon",))
    world.put("lemon", np.array([0.0, 0.0, 9.0, 1.0, 0.0, 0.0, 0.0]))
    home = world.joints()
    world.command(home + [0.2, -0.1, 0.1, 0.0, 0.1, 0.0], np.zeros(6))
    world.command_gripper(0.5)
    world.settle(1.0)
    known = KnownScene(world.spec)
    seen = known.expected(world.joints(), world.gripper_joints(), ["front", "hand"])
    assert list(seen) == ["front", "hand"]
    for name, depth in seen.items():
        camera = next(camera for camera in world.spec.cameras if camera.name == name)
        world.render(name)
        assert np.abs(depth - world.cameras.drawing.depth(world.data, camera)).max() < 1e-3
    hand = known.hand(world.joints())
    assert np.allclose(hand[:3, 3], world.data.site("grip_site").xpos, atol=1e-6)
    low, high = known.bounds
    for table in world.spec.tables:
        assert (low < np.array(table.centre)).all()
        assert (np.array(table.centre) < high).all()


def test_shapes_are_those_of_the_items() -> None:
    world = grocery(1)
    models = {model.name: model for model in item_models(world.spec)}
    assert set(models) == set(ITEMS)
    for name, model in models.items():
        assert np.allclose(model.centre, world.shapes[name].centre, atol=1e-4)
        assert np.allclose(model.half, world.shapes[name].half, atol=2e-4)
        assert model.axis == world.shapes[name].axis
        assert np.abs(model.distances(model.points)[0]).mean() < 2e-4


def test_items_are_found_by_depth_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    world = grocery(4, depth=True)
    true = world.obstacles()

    def forbidden(item: str) -> None:
        raise AssertionError("perception asks the simulator")

    monkeypatch.setattr(world, "pose", forbidden)
    found = open_localizer(world).now()
    assert not found.missing
    assert not found.lumps
    models = {model.name: model for model in item_models(world.spec)}
    for name, pose in found.poses.items():
        one, other = matrix(true[name]), matrix(pose.pose)
        middle = models[name].centre
        away = one[:3, :3] @ middle + one[:3, 3] - other[:3, :3] @ middle - other[:3, 3]
        assert np.linalg.norm(away) < 0.004, name


def test_a_camera_that_was_moved_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    world = grocery(4, items=("lemon", "soda-can"), depth=True)
    world.move_camera("front", np.array([0.0, 0.01, 0.0]))
    localizer = open_localizer(world)
    assert set(localizer.now().left_out) == {"front"}
    world.move_camera("front", np.zeros(3))
    world.settle(0.1)
    assert not localizer.now().left_out


def test_what_senses_can_be_another() -> None:
    world = grocery(4, items=("lemon",), depth=True)
    asked: list[float] = []

    def sense() -> Observation:
        asked.append(world.time)
        return world.sense()

    localizer = open_localizer(world, sense)
    assert set(localizer.now().poses) == {"lemon"}
    assert asked == [world.time]


def test_without_a_camera_that_measures_depth_there_is_no_localizer() -> None:
    world = grocery(1, items=("lemon",))
    world.spec = world.spec.model_copy(
        update={"cameras": tuple(c.model_copy(update={"depth": False}) for c in world.spec.cameras)}
    )
    with pytest.raises(DomainError):
        open_localizer(world)
