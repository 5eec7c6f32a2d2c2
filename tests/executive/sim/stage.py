"""The grocery scene for tests, without a domain around it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executive.sim.world import MujocoWorld

ROOT = Path(__file__).resolve().parents[3]
SCENE = ROOT / "domains" / "grocery" / "scene.toml"
ITEMS = ("milk-carton", "bread-loaf", "lemon", "soda-can", "cereal-box", "water-bottle")
TABLES = ("wood-table", "black-table", "white-table")
OBJECTS = {**dict.fromkeys(ITEMS, "item"), **dict.fromkeys(TABLES, "table")}
MEANING = {"on-table": "on", "robot-gripping": "gripping", "robot-gripper-empty": "gripper-empty"}


def grocery(seed: int = 0, items: tuple[str, ...] = ITEMS, **options: Any) -> MujocoWorld:
    """A world of the grocery scene with some of its items."""
    objects = {name: kind for name, kind in OBJECTS.items() if kind == "table" or name in items}
    return MujocoWorld(SCENE, objects, seed, **options)
