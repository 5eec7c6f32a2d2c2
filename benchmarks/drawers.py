"""An item anywhere in an open drawer can be taken out: `python -m benchmarks.drawers --places 200` prints how often.

Each place is drawn in one of the kitchen's drawers: the item as it stands or on a side of it, turned anyhow, and on two
axes of three at a wall, since that is where it is hard. Whether it was taken is the simulator's truth.
"""

from __future__ import annotations

import argparse
import collections
import time
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from executive.protocols import SkillContext
from executive.sim.world import MujocoWorld
from executive.skills.pick import pick
from executive.types import FloatArray, Phase, SkillResult, Step

ITEMS = ("lemon", "can", "butter", "salt")
DRAWERS = ("left-drawer", "middle-drawer", "right-drawer")
SCENE = Path(__file__).parent.parent / "domains" / "kitchen" / "scene.toml"

TRIES = 3
"""How often an item is tried to be taken."""

_BEYOND = 1.6
"""What is drawn beyond a wall is put at it: with 1.6, three places of eight along either axis."""


class Place(NamedTuple):
    """Where an item lies: in which drawer, on which side (0: as it stands), how it is turned about the vertical in rad,
    and where its outline is, from -1 to 1 between the walls, (2,)."""

    item: str
    drawer: str
    side: int
    yaw: float
    share: FloatArray


def draw(number: int) -> Place:
    """Draws a place."""
    rng = np.random.default_rng(number)
    share = np.clip(rng.uniform(-_BEYOND, _BEYOND, 2), -1.0, 1.0)
    yaw = float(rng.uniform(-np.pi, np.pi))
    return Place(ITEMS[number % len(ITEMS)], DRAWERS[int(rng.integers(3))], int(rng.integers(3)), yaw, share)


class Taken(NamedTuple):
    """How an item was taken: at which try (0: at none of `TRIES`), whether it had to be dragged off a wall before, and
    what the skill reported in the end."""

    tries: int
    dragged: bool
    result: SkillResult


def taken(place: Place) -> Taken:
    """Puts an item there and takes it, again where that fails, as the loop does; what is held is the simulator's
    truth."""
    item, drawer = place.item, place.drawer
    world = MujocoWorld(SCENE, {item: "item"}, 0, placed={item: drawer}, opened={drawer: True})
    with closing(world):
        world.put(item, _pose(world, place))
        world.settle(0.5)
        phases: list[str] = []
        context = SkillContext(
            world.handle,
            np.random.default_rng(0),
            lambda news: phases.append(news.name) if isinstance(news, Phase) else None,
            lambda: False,
        )
        tries, held = 0, False
        while not held and tries < TRIES:
            result, tries = pick(Step("take", (item, drawer)), context), tries + 1
            held = world.gripped() == item
        return Taken(tries if held else 0, "nudge" in phases, result)


def _pose(world: MujocoWorld, place: Place) -> FloatArray:
    shape, floor = world.shapes[place.item], world.drawers.floors()[place.drawer]
    side = Rotation.from_euler("xyz", [(0, 0, 0), (90, 0, 0), (0, 90, 0)][place.side], degrees=True)
    turned = Rotation.from_euler("z", place.yaw) * side
    rotation = turned.as_matrix()
    extent = np.array([shape.reach(rotation.T @ axis) for axis in np.eye(3)])
    free = np.maximum(0.5 * np.array(floor.size) - extent[:2] - 0.001, 0.0)
    middle = np.array(floor.centre) + [*(place.share * free), extent[2] + 0.0005]
    return np.array([*(middle - rotation @ shape.centre), *np.roll(turned.as_quat(), 1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", type=int, default=200)
    arguments = parser.parse_args()
    counts: dict[str, collections.Counter[str]] = {item: collections.Counter() for item in ITEMS}
    failures: list[str] = []
    for number in range(arguments.places):
        place = draw(number)
        tries, dragged, result = taken(place)
        counts[place.item].update(places=1, first=tries == 1, taken=tries > 0, dragged=dragged)
        if not tries:
            failures.append(f"{number}: {place.item}, {place.share.round(2)}: {result.status}: {result.reason}")
    print(f"python -m benchmarks.drawers --places {arguments.places}\n{time.strftime('%Y-%m-%d')}. Simulated.\n")
    print(f"{'item':10}{'places':>8}{'at once':>9}{'taken':>8}{'dragged':>9}")
    for item, count in counts.items():
        print(f"{item:10}{count['places']:8}{count['first']:9}{count['taken']:8}{count['dragged']:9}")
    print("\n".join(failures))


if __name__ == "__main__":
    main()
