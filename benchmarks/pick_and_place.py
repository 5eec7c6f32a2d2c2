"""Pick and place on random scenes: `python -m benchmarks.pick_and_place --scenes 100` prints the rates per item.

Each scene draws all six items at random, picks one, and places it on another table; the verdict is the simulator's.
"""

from __future__ import annotations

import argparse
import collections
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.kept import Kept, Row
from executive.app.localizer import item_models, open_localizer
from executive.perception import ItemModel
from executive.protocols import Skill, SkillContext
from executive.sim.known_models import KnownScene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills.pick import pick
from executive.skills.place import place
from executive.types import Atom, SkillResult, Step

ITEMS = ("milk-carton", "bread-loaf", "lemon", "soda-can", "cereal-box", "water-bottle")
TABLES = ("wood-table", "black-table", "white-table")
SCENE = Path(__file__).parent.parent / "domains" / "grocery" / "scene.toml"
OBJECTS = {**dict.fromkeys(ITEMS, "item"), **dict.fromkeys(TABLES, "table")}
MEANING = {"on-table": "on", "robot-gripping": "gripping", "robot-gripper-empty": "gripper-empty"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=100, help="random scenes per item")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--grasp-noise", type=float, default=0.0)
    parser.add_argument("--poses", choices=("oracle", "depth"), default="oracle")
    parser.add_argument("--items", nargs="*", default=ITEMS)
    parser.add_argument("--out", type=Path, help="a file that results are kept in, to go on with later")
    arguments = parser.parse_args()
    tally: dict[str, collections.Counter[str]] = {item: collections.Counter() for item in arguments.items}
    failures: list[str] = []
    simulated, wall, actions = 0.0, 0.0, 0
    scene = Scene(arguments.poses == "depth", arguments.grasp_noise)
    with closing(scene), Kept(arguments.out) as kept:
        for index in range(arguments.scenes):
            for item in arguments.items:
                seed = arguments.seed + 1000 * ITEMS.index(item) + index
                name = f"{item}, seed {seed}, by {arguments.poses}, noise {arguments.grasp_noise}"
                row = kept.of(name, partial(scene.carry, item, seed))
                tally[item].update(row["held"])
                simulated, wall, actions = simulated + row["simulated"], wall + row["wall"], actions + row["actions"]
                failures += row["failures"]
    print(f"{'item':<14}{'scenes':>8}{'picked':>8}{'placed':>8}")
    for item, count in tally.items():
        print(f"{item:<14}{arguments.scenes:>8}{count['picked']:>8}{count['placed']:>8}")
    total = arguments.scenes * len(tally)
    taken, put = sum(c["picked"] for c in tally.values()), sum(c["placed"] for c in tally.values())
    print(f"{'all':<14}{total:>8}{taken:>8}{put:>8}")
    print(
        f"pick {taken / total:.1%} of scenes, place {put / max(taken, 1):.1%} of what was picked; "
        f"{simulated / actions:.1f} simulated and {wall / actions:.2f} wall seconds an action"
    )
    for line in failures:
        print(line)


class Scene:
    """The grocery scene in which things are carried, with poses that are estimated or the simulator's.

    Args:
        depth: whether they are estimated.
        grasp_noise: see `MujocoWorld`.
    """

    def __init__(self, depth: bool, grasp_noise: float) -> None:
        self._depth, self._grasp_noise = depth, grasp_noise
        self._known: tuple[KnownScene, list[ItemModel]] | None = None

    def close(self) -> None:
        if self._known is not None:
            self._known[0].close()

    def carry(self, item: str, seed: int) -> Row:
        """Return what came of carrying an item in the scene of a seed."""
        began = time.perf_counter()
        world = MujocoWorld(SCENE, OBJECTS, seed, grasp_noise=self._grasp_noise, depth=self._depth)
        if self._depth:
            self._known = self._known or (KnownScene(world.spec), item_models(world.spec))
            world.localizer = open_localizer(world, None, self._known[1], self._known[0])
        with closing(world):
            results = _carry(world, item, np.random.default_rng(seed))
        named = list(zip(results, ("picked", "placed"), strict=False))
        return {
            "held": {name: int(holds) for (_, holds), name in named},
            "failures": [f"seed {seed}: {r.step}: {r.status} {r.reason}" for r, holds in results if not holds],
            "simulated": sum(result.seconds for result, _ in results),
            "actions": len(results),
            "wall": time.perf_counter() - began,
        }


def _carry(world: MujocoWorld, item: str, rng: np.random.Generator) -> list[tuple[SkillResult, bool]]:
    """Pick an item, and place it on another table if that worked: what each skill reports, and whether it is true."""
    truth = Truth(world, MEANING)
    source = next(t for t in TABLES if truth.of([Atom("on-table", (item, t))]).true)
    target = TABLES[(TABLES.index(source) + 1 + int(rng.integers(2))) % 3]
    results = []
    for skill, name, table, goal in (
        (pick, "pick", source, Atom("robot-gripping", (item,))),
        (place, "place", target, Atom("on-table", (item, target))),
    ):
        result = _do(world, skill, Step(name, (item, table)), rng)
        results.append((result, result.done and bool(truth.of([goal]).true)))
        if not results[-1][1]:
            break
    return results


def _do(world: MujocoWorld, skill: Skill, step: Step, rng: np.random.Generator) -> SkillResult:
    context = SkillContext(world.handle, rng, lambda _: None, lambda: False)
    return skill(step, context)


if __name__ == "__main__":
    main()
