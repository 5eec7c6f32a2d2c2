"""Pick and place on random scenes: `python -m benchmarks.pick_and_place --scenes 100` prints the rates per item.

Each scene draws all six items at random, picks one, and places it on another table; the verdict is the simulator's.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np

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
MEANING = {"on-table": "on", "robot-gripping": "gripping", "robot-gripper-empty": "gripper-empty"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=100, help="random scenes per item")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--grasp-noise", type=float, default=0.0)
    parser.add_argument("--poses", choices=("oracle", "depth"), default="oracle")
    parser.add_argument("--items", nargs="*", default=ITEMS)
    arguments = parser.parse_args()
    scene = Path(__file__).parent.parent / "domains" / "grocery" / "scene.toml"
    objects = {**dict.fromkeys(ITEMS, "item"), **dict.fromkeys(TABLES, "table")}
    tally: dict[str, collections.Counter[str]] = {item: collections.Counter() for item in arguments.items}
    failures: list[str] = []
    began, simulated, actions = time.perf_counter(), 0.0, 0
    known: tuple[KnownScene, list[ItemModel]] | None = None
    for item in arguments.items:
        for index in range(arguments.scenes):
            seed = arguments.seed + 1000 * ITEMS.index(item) + index
            by_depth = arguments.poses == "depth"
            world = MujocoWorld(scene, objects, seed, grasp_noise=arguments.grasp_noise, depth=by_depth)
            if by_depth:
                known = known or (KnownScene(world.spec), item_models(world.spec))
                world.localizer = open_localizer(world, None, known[1], known[0])
            with closing(world):
                results = _carry(world, item, np.random.default_rng(seed))
            for (result, holds), name in zip(results, ("picked", "placed"), strict=False):
                tally[item][name] += holds
                simulated, actions = simulated + result.seconds, actions + 1
                if not holds:
                    failures.append(f"seed {seed}: {result.step}: {result.status} {result.reason}")
        print(f"{item}: {dict(tally[item])}", file=sys.stderr)
    if known is not None:
        known[0].close()
    wall = time.perf_counter() - began
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
