"""A scene file is read whole, or refused in one line that names file and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import DomainError
from executive.sim.spec import read_scene
from tests.executive.sim.stage import OBJECTS, SCENE

GOOD = SCENE.read_text(encoding="utf-8")


def test_grocery_scene_is_read() -> None:
    spec = read_scene(SCENE)
    assert len(spec.items) == 6
    assert len(spec.tables) == 3
    assert len(spec.cameras) >= 3


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("speed = 0.5", "sped = 0.5", "robot.sped", "did you mean 'speed'"),
        ("speed = 0.5", "speed = 5", "robot.speed", "less than or equal to 1"),
        ("speed = 0.5", "speed = nan", "robot.speed", "finite"),
        ('asset = "milk"', 'asset = "mlik"', "item[0]", "did you mean 'milk'"),
        ('asset = "milk"', 'shape = "box"', "item[0]", "'size'"),
        ("home = [-0.3169,", "home = [", "robot.home", "at least 6"),
        ('texture = "wood"', 'texture = "gold"', "table[0].texture", "'wood'"),
        ('name = "lemon"', 'name = "wood-table"', "(whole file)", "named twice"),
        ("[robot]", "[robt]", "robt", "did you mean 'robot'"),
        ("reach = [0.30, 0.74]", "reach = [0.74, 0.30]", "robot", "the first below the second"),
        ("target = [0.36, 0.0, 0.97]", "target = [1.62, 0.0, 1.62]", "camera[0]", "looks nowhere"),
        ('asset = "lemon"', 'shape = "box"\nsize = [0.05, 0.05, 0.05]', "item[2]", "'scale' is for an 'asset'"),
        ('asset = "lemon"', 'asset = "lemon"\nsize = [0.05, 0.05, 0.05]', "item[2]", "'size' is for a 'shape'"),
        ("scale = 1.25", "scale = [1, 1]", "item[2].scale", "valid number"),
        ("[robot]", "timestep = 1e-300\n[robot]", "timestep", "greater than or equal to 0.0001"),
        ("fovy_degrees = 48", "fovy_degrees = 480", "camera[0].fovy_degrees", "less than 150"),
    ],
)
def test_mistake_is_named_with_its_key(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    assert old in GOOD
    file = tmp_path / "scene.toml"
    file.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DomainError) as caught:
        read_scene(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: {key}: ")
    assert words in message
    assert "\n" not in message


def test_broken_toml_and_missing_file(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    with pytest.raises(DomainError, match=r"scene\.toml: there is no such file"):
        read_scene(file)
    file.write_text("[robot\n", encoding="utf-8")
    with pytest.raises(DomainError, match=r"is not TOML: .*line 1"):
        read_scene(file)


def test_object_without_a_body_is_named() -> None:
    with pytest.raises(DomainError, match=r"'lemmon' has no body.*did you mean 'lemon'"):
        read_scene(SCENE).restricted_to({**OBJECTS, "lemmon": "item"}, SCENE)
