"""A small collection of blocksworld with other blocks in each episode, made up rather than simulated."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from executive.lab.collection import dataset
from executive.lab.collection.dataset import Attempt, Ending, Log, Point
from executive.types import Atom, Facts

EPISODES: Sequence[Sequence[str]] = (
    ("small-red-metal-cube", "large-blue-rubber-cylinder"),
    ("small-gray-metal-sphere", "large-pink-rubber-cube", "large-brown-rubber-cube", "small-green-rubber-cylinder"),
)
"""The second one has a brown cube, which is held out of training."""


def facts_of(names: Sequence[str]) -> dict[Atom, bool]:
    """Every atom: the first object stands on the second one, the others on the table."""
    flat = [name for name in names if not name.endswith("sphere")]
    facts = {Atom("on", (one, other)): False for one in names for other in flat if one != other}
    facts |= {Atom("on-table", (name,)): name != names[0] for name in names}
    facts |= {Atom("holding", (name,)): False for name in names}
    return {**facts, Atom("on", (names[0], names[1])): True, Atom("hand-empty"): True}


def objects_of(names: Sequence[str]) -> Mapping[str, Sequence[str]]:
    return {name: name.split("-") for name in names}


def write(folder: Path, episodes: Sequence[Sequence[str]] = EPISODES, **collection: object) -> Path:
    """A folder as a collection with --objects and --masks leaves it, two points an episode."""
    rng = np.random.default_rng(0)
    (folder / dataset.SHARDS).mkdir(parents=True)
    for number, names in enumerate(episodes):
        facts = facts_of(names)
        points = [
            Point(
                seed=3,
                episode=number,
                step=step,
                action=f"put-down({names[1]})",
                time=1.0,
                joints=np.zeros(6),
                qpos=np.zeros(20),
                images={"front": rng.integers(0, 256, (36, 48, 3), dtype=np.uint8)},
                masks={"front": rng.integers(0, len(names) + 1, (36, 48), dtype=np.uint8)},
                facts=Facts(facts),
            )
            for step in (1, 2)
        ]
        log = Log(number, 2, (Attempt(points[0].action, "done", ""),) * 2, Ending.FULL)
        content = dataset.shard_bytes(
            "this", log, points, tuple(facts), ("front",), objects_of(names), masks=True, varying=True
        )
        dataset.write_atomically(dataset.shard(folder, number), content)
    told = {"domain": "blocksworld", "seed": 3, "objects": "2-4", "masks": True, "home_pose": True, **collection}
    manifest = {
        "format": dataset.FORMAT,
        "command": "executive collect",
        "collection": told,
        "points": 2 * len(episodes),
        "finished": True,
        "cameras": {"front": [48, 36]},
        "atoms": [],
        "statistics": {"episodes": len(episodes), "points": 2 * len(episodes), "attempts": {}},
    }
    (folder / dataset.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    return folder
