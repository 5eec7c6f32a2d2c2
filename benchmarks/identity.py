"""Which of three identical cans is which: `python -m benchmarks.identity --scenes 50 --runs 10`.

A scene is filmed 5 times a second while someone moves or swaps cans in view, a few times in 1.5 to 3 seconds each; in
half of the scenes one camera measures nothing. In the end each label is looked for where the true can is. Then two cans
are swapped while nobody looks. A run is the domain's task with swaps and shoves after its actions, in view or not.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.kept import Kept, Row
from executive import RunConfig, run
from executive.app.localizer import estimate_poses
from executive.faults import FaultInjector
from executive.lab.campaign.intervals import wilson
from executive.perception import Capture, Localizer
from executive.sim.known_models import KnownScene
from executive.sim.world import MujocoWorld
from executive.types import PosesEstimated

SCENE = Path(__file__).parent.parent / "domains" / "cans" / "scene.toml"
PLACES = {"can-a": "left-table", "can-b": "middle-table", "can-c": "right-table"}
FIRST_SEED = 700_000
RIGHT_PLACE = 0.03
"""m from the true can within which a label is at the right place."""
CLAIMED = 0.9
"""The probability from which on a label is trusted (`executive.app.identity`)."""


@dataclass
class Tally:
    """What was measured of labels: how many, how many at the right place, the highest probability of any after a swap
    that nobody saw, and how many were trusted and wrong."""

    labels: int = 0
    right: int = 0
    trusted: int = 0
    false: int = 0
    highest: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __add__(self, other: Tally) -> Tally:
        return Tally(**{each.name: getattr(self, each.name) + getattr(other, each.name) for each in fields(self)})

    def add(self, note: str, world: MujocoWorld, found: PosesEstimated) -> None:
        for name in PLACES:
            pose = found.poses.get(name)
            is_right = pose is not None and bool(np.linalg.norm(pose.pose[:3] - world.pose(name)[:3]) < RIGHT_PLACE)
            is_trusted = pose is not None and found.identity[name][name] >= CLAIMED
            self.labels += 1
            self.right += is_right
            self.trusted += is_trusted
            self.false += is_trusted and not is_right
            if not (is_right and is_trusted):
                self.notes.append(f"{note}: {name} {'right' if is_right else 'elsewhere'}, {found.identity[name]}")
        self.highest.append(max(max(row.values()) for row in found.identity.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--runs", type=int, default=0, help="whole runs, in view and unseen, so many each")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first scene and run")
    parser.add_argument("--verbose", action="store_true", help="every label that is not trusted at the right place")
    parser.add_argument("--out", type=Path, help="a file that results are kept in, to go on with later")
    arguments = parser.parse_args()
    seen, unseen, runs = Tally(), Tally(), dict[str, list[Row]]()
    with Kept(arguments.out) as kept, contextlib.suppress(KeyboardInterrupt):  # what was measured until then is told
        for seed in range(arguments.seed, arguments.seed + arguments.scenes):
            row = kept.of(f"scene, seed {seed}", partial(play_scene, seed))
            seen, unseen = seen + Tally(**row["seen"]), unseen + Tally(**row["unseen"])
        for seed in range(arguments.seed, arguments.seed + arguments.runs):
            for way, film in (("in view", 5.0), ("unseen", 0.0)):
                row = kept.of(f"run, meddling {way}, seed {seed}", partial(play_run, film, seed))
                runs.setdefault(way, []).append(row)
    if unseen.highest:
        print(f"{len(unseen.highest)} scenes, three labels each")
        print(f"  filmed at 5 Hz: at the right place {share(seen.right, seen.labels)}, "
              f"trusted {share(seen.trusted, seen.labels)}, trusted and wrong {seen.false}")  # fmt: skip
        print(f"  after a swap that nobody saw: highest probability of a label {max(unseen.highest):.3f}, "
              f"trusted {unseen.trusted}, trusted and wrong {unseen.false}")  # fmt: skip
    for note in [*seen.notes, *(unseen.notes if unseen.trusted else [])] if arguments.verbose else []:
        print(f"  {note}")
    for way, rows in runs.items():
        true, claimed, false = (sum(row[name] for row in rows) for name in ("true", "claimed", "false"))
        print(f"{len(rows)} runs, meddling {way}: goal reached {share(true, len(rows))}, claimed {claimed}, "
              f"false claims {false}")  # fmt: skip


def play_scene(seed: int) -> Row:
    """Film someone who moves cans about, and look away while he swaps two; return what was seen of both."""
    seen, unseen = Tally(), Tally()
    rng = np.random.default_rng([seed, 2])
    objects = {**dict.fromkeys(PLACES, "can"), **dict.fromkeys(PLACES.values(), "table")}
    world = MujocoWorld(SCENE, objects, seed, PLACES, depth=True)
    estimate_poses(world, FaultInjector([], world, seed), PLACES, film=5.0)
    localizer = world.localizer
    assert isinstance(localizer, Localizer)
    if rng.random() < 0.5:
        blind(localizer, str(rng.choice([camera.name for camera in world.spec.cameras])))
    localizer.now()
    done = []
    for _ in range(int(rng.integers(2, 5))):
        seconds = f"{rng.uniform(1.5, 3.0):.2f}"
        one, other = (str(each) for each in rng.choice(sorted(PLACES), 2, replace=False))
        if rng.random() < 0.5:
            done.append(world.disturb("swap", rng, item=one, seconds=seconds, **{"with": other}))
        else:
            done.append(world.disturb("shove", rng, item=one, seconds=seconds))
        world.settle(0.4)
    seen.add(f"seed {seed}, {'; '.join(done)}", world, localizer.now())
    world.film_period = 0.0
    world.disturb("swap", rng, seconds="3")
    unseen.add(f"seed {seed}, unseen", world, localizer.now())
    known = localizer.known
    world.close()
    if isinstance(known, KnownScene):
        known.close()
    return {"seen": asdict(seen), "unseen": asdict(unseen)}


def blind(localizer: Localizer, camera: str) -> None:
    """Have a camera measure nothing."""
    sense = localizer.capture

    def without() -> Capture:
        sensed = sense()
        return replace(sensed, depth={name: depth for name, depth in sensed.depth.items() if name != camera})

    localizer.capture = without


def play_run(film: float, seed: int) -> Row:
    """Play a run by the oracle for all that is not about cans, with someone who meddles after one action in three;
    return whether the goal was reached, claimed, and claimed without being so."""
    meddling = ("swap:p=0.2,seconds=2", "shove:p=0.15,seconds=2")
    with tempfile.TemporaryDirectory() as folder:
        config = RunConfig(
            "cans",
            "one-can",
            seed=seed,
            estimator="oracle",
            faults=meddling,
            poses="depth",
            film=film,
            viewer=False,
            runs=Path(folder),
        )
        summary = run(config)
    claimed, true = bool(summary["goal_seen"]), summary["goal_true"] is True
    return {"true": true, "claimed": claimed, "false": claimed and not true}


def share(part: int, of: int) -> str:
    """A share with its 95 % interval."""
    interval = wilson(part, of)
    if interval is None:
        return "none"
    low, high = interval
    return f"{part} of {of} ({100 * part / of:.1f} %, {100 * low:.1f} to {100 * high:.1f})"


if __name__ == "__main__":
    main()
