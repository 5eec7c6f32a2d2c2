"""Motions that the grocery task asked for, kept in a file, so that planners can be held against each other on them.

    python -m benchmarks.speed.queries

carries out the task, each time with another seed, by turns with and without a home pose to go to after each action, and
writes down every query whose straight edge is not free until there are 200 of them. Most edges are; how many queries
there were in all is written down, too. The file is a part of the repository; the command makes it anew.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executive.sim.world import MujocoWorld
from executive.skills.arm import Arm, Attempt
from executive.skills.collision import Held
from executive.types import FloatArray

FILE = Path(__file__).parent / "data" / "queries.npz"
SCENE = Path(__file__).parents[2] / "domains" / "grocery" / "scene.toml"
ITEMS = ("milk-carton", "bread-loaf", "lemon", "soda-can", "cereal-box", "water-bottle")
TABLES = ("wood-table", "black-table", "white-table")
OBJECTS = {**dict.fromkeys(ITEMS, "item"), **dict.fromkeys(TABLES, "table")}


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """From where (6,) to where (6,), with the items where they were (7,) each, the fingers as they were (6,), and what
    the hand held."""

    start: FloatArray
    goal: FloatArray
    items: dict[str, FloatArray]
    fingers: FloatArray
    held: Held | None

    def set_up(self, arm: Arm) -> None:
        arm.collision.update(self.items, self.fingers, self.held)


def read() -> tuple[list[Query], int]:
    """The recorded queries whose straight edge is not free, and how many there were in all while they came up."""
    with np.load(FILE) as saved:
        asked = int(saved["asked"])
        columns = [saved[name] for name in ("start", "goal", "poses", "fingers", "held", "in_hand")]
    queries = []
    for start, goal, poses, fingers, held, in_hand in zip(*columns, strict=True):
        in_it = Held(ITEMS[held], in_hand) if held >= 0 else None
        queries.append(Query(start, goal, dict(zip(ITEMS, poses, strict=True)), fingers, in_it))
    return queries, asked


def stage(seed: int = 0) -> MujocoWorld:
    """The scene that the queries were asked in."""
    return MujocoWorld(SCENE, OBJECTS, seed)


def _asked(seeds: range) -> Iterator[tuple[Query, bool]]:
    """Every query of the task, and whether it took planning."""
    from executive.app.run import RunConfig, run

    said: list[tuple[Query, bool]] = []
    plan = Attempt.plan

    def told(self: Attempt, goals: list[FloatArray], held: Held | None = None) -> FloatArray | None:
        start, fingers = self.body.joints(), self.body.gripper_joints()
        path = plan(self, goals, held)
        for goal in goals:
            straight = self.arm.collision.edge_free(start, goal)
            said.append((Query(start, np.array(goal), self.body.obstacles(), fingers, held), not straight))
        return path

    Attempt.plan = told  # type: ignore[method-assign,assignment]
    try:
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                home_pose = seed % 2 == 0
                config = RunConfig("grocery", seed=seed, estimator="oracle", viewer=False, home_pose=home_pose)
                run(dataclasses.replace(config, runs=Path(folder)))
            yield from said
            said.clear()
    finally:
        Attempt.plan = plan  # type: ignore[method-assign]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=240)
    parser.add_argument("--queries", type=int, default=200)
    arguments = parser.parse_args()
    kept: list[Query] = []
    for asked, (query, hard) in enumerate(_asked(range(arguments.seeds)), start=1):
        if hard:
            kept.append(query)
            print(f"{len(kept)} of {asked}", flush=True)
            _write(kept, asked)
        if len(kept) == arguments.queries:
            break


def _write(kept: list[Query], asked: int) -> None:
    FILE.parent.mkdir(exist_ok=True)
    np.savez_compressed(
        FILE,
        asked=asked,
        start=[query.start for query in kept],
        goal=[query.goal for query in kept],
        poses=[[query.items[item] for item in ITEMS] for query in kept],
        fingers=[query.fingers for query in kept],
        held=[-1 if query.held is None else ITEMS.index(query.held.item) for query in kept],
        in_hand=[np.eye(4) if query.held is None else query.held.in_hand for query in kept],
    )


if __name__ == "__main__":
    main()
