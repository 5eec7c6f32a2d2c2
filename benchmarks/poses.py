"""Poses by depth on scenes that nobody has tuned anything on: `python -m benchmarks.poses --scenes 100`.

Each scene draws items at random and tips about half of them; with `--absent`, one or two of the items that are looked
for are not there. Errors are those of the middle of an item's box, and of its orientation as far as its shape tells;
"in 90 %" is the share of them inside the ellipsoid that should hold nine of ten.
"""

from __future__ import annotations

import argparse
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.kept import Kept, Row
from executive.app.localizer import item_models, open_localizer
from executive.perception import ItemModel
from executive.perception.localizer import matrix
from executive.sim.known_models import KnownScene
from executive.sim.spec import read_scene
from executive.sim.world import MujocoWorld
from executive.types import EstimatedPose, FloatArray

SCENE = Path(__file__).parent.parent / "domains" / "grocery" / "scene.toml"
FIRST_SEED = 900_000
WRONG = 0.015
"""m from which on a pose is wrong: a grasp that aims at it misses."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first scene")
    parser.add_argument("--absent", action="store_true", help="one or two items of each scene are not there")
    parser.add_argument("--moved", type=float, default=0.0, help="cm by which one camera of each scene was moved")
    parser.add_argument("--verbose", action="store_true", help="every error above 3 mm or 6 degrees")
    parser.add_argument("--out", type=Path, help="a file that results are kept in, to go on with later")
    arguments = parser.parse_args()
    rows = []
    with closing(Scenes(arguments.absent, arguments.moved)) as scenes, Kept(arguments.out) as kept:
        for seed in range(arguments.seed, arguments.seed + arguments.scenes):
            name = f"seed {seed}, absent {arguments.absent}, moved {arguments.moved}"
            rows.append(kept.of(name, partial(scenes.measure, seed)))
            if arguments.verbose:
                for line in rows[-1]["notes"]:
                    print(line, flush=True)
    report(rows)


class Scenes:
    """Scenes in which items are looked for.

    Args:
        absent: whether one or two items of each scene are not there.
        moved: cm by which one camera of each scene was moved.
    """

    def __init__(self, absent: bool = False, moved: float = 0.0) -> None:
        self._absent, self._moved = absent, moved
        self._spec = read_scene(SCENE)
        self._models = {model.name: model for model in item_models(self._spec)}
        for model in self._models.values():
            _ = model.field, model.orientations, model.lookalikes
        self._known = KnownScene(self._spec)

    def close(self) -> None:
        self._known.close()

    def measure(self, seed: int) -> Row:
        """Return what is found in the scene of a seed, and by how much that is wrong."""
        rng, models = np.random.default_rng([seed, 1]), self._models
        absent = set(rng.choice(sorted(models), 1 + int(rng.integers(2)), replace=False)) if self._absent else set()
        world = drawn(seed, [name for name in models if name not in absent], rng)
        with closing(world):
            if self._moved:
                camera = str(rng.choice([camera.name for camera in self._spec.cameras]))
                way = rng.normal(size=3)
                world.move_camera(camera, 0.01 * self._moved * way / np.linalg.norm(way))
            localizer = open_localizer(world, models=list(models.values()), known=self._known)
            sensed = localizer.capture()
            wall, cpu = time.perf_counter(), time.process_time()
            estimate = localizer.estimate(sensed)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            row: Row = {"items": {}, "unseen": [], "invented": [], "notes": [], "wall": wall, "cpu": cpu}
            row |= {"lumps": len(estimate.lumps), "left out": len(estimate.left_out)}
            for name, model in models.items():
                here, found = name in world.items, estimate.poses.get(name)
                if found is None or not here:
                    if here or found is not None:
                        row["unseen" if here else "invented"].append(f"seed {seed}: {name}")
                    continue
                away, angle = error(model, world.pose(name), found.pose)
                row["items"][name] = [1e3 * away, angle, *inside(model, world.pose(name), found)]
                if away > 0.003 or angle > 6.0:
                    row["notes"].append(
                        f"seed {seed}: {name} {1e3 * away:.1f} mm {angle:.1f} degrees, misfit "
                        f"{1e3 * found.misfit:.2f} mm, spread {1e3 * found.spread:.2f} mm, {found.views}"
                    )
        return row


def drawn(seed: int, items: list[str], rng: np.random.Generator) -> MujocoWorld:
    """A world in which about half of the items have fallen over."""
    spec = read_scene(SCENE)
    objects = {**dict.fromkeys(items, "item"), **{table.name: "table" for table in spec.tables}}
    world = MujocoWorld(SCENE, objects, seed, depth=True)
    for item in items:
        if rng.random() < 0.5:
            world.disturb("tip", rng, item=item)
    world.settle(1.0)
    return world


def report(rows: list[Row]) -> None:
    """Print what was measured in all scenes."""
    print(f"{'item':<14}{'found':>7}{'median':>9}{'90 %':>8}{'max mm':>9}{'median':>9}{'90 %':>8}{'max deg':>9}"
          f"{'wrong':>7}{'in 90 %: mm':>13}{'deg':>6}")  # fmt: skip
    measured: dict[str, list[list[float]]] = {}
    for row in rows:
        for name, numbers in row["items"].items():
            measured.setdefault(name, []).append(numbers)
    for name, found in {**measured, "all": [each for some in measured.values() for each in some]}.items():
        away, angles, *shares = (np.array(column, float) for column in zip(*found, strict=True))
        print(
            f"{name:<14}{len(away):>7}{np.median(away):>9.2f}{np.quantile(away, 0.9):>8.2f}{max(away):>9.1f}"
            f"{np.median(angles):>9.2f}{np.quantile(angles, 0.9):>8.2f}{max(angles):>9.1f}"
            f"{(away > 1e3 * WRONG).sum():>7}{shares[0].mean():>13.0%}{shares[1].mean():>6.0%}"
        )
    unseen, invented = ([line for row in rows for line in row[name]] for name in ("unseen", "invented"))
    lumps, left_out = (sum(row[name] for row in rows) for name in ("lumps", "left out"))
    print(f"{len(rows)} scenes: {len(unseen)} items not found, {len(invented)} reported that are not there, "
          f"{lumps} unknown lumps, {left_out} cameras left out")  # fmt: skip
    cpu, wall = ([row[name] for row in rows] for name in ("cpu", "wall"))
    print(f"a scene takes {np.median(cpu):.2f} s of processor time and {np.median(wall):.2f} s (medians; "
          f"90 %: {np.quantile(cpu, 0.9):.2f} and {np.quantile(wall, 0.9):.2f})")  # fmt: skip
    for line in (*unseen, *invented):
        print(line)


def error(model: ItemModel, true: FloatArray, found: FloatArray) -> tuple[float, float]:
    """How far the middles of an item's box are apart in m, and the orientations in degrees."""
    one, other = matrix(true), matrix(found)
    middles = [body[:3, :3] @ model.centre + body[:3, 3] for body in (one, other)]
    away = float(np.linalg.norm(middles[0] - middles[1]))
    return away, float(np.degrees(model.angle(one[:3, :3], other[:3, :3])))


def inside(model: ItemModel, true: FloatArray, found: EstimatedPose) -> tuple[bool, bool]:
    """Whether the errors of position and of orientation lie in the ellipsoids that should hold nine of ten. What is
    round has no error about its axis, and what is symmetric the smallest that it can have."""
    one, other = matrix(true)[:3, :3], matrix(found.pose)[:3, :3]
    moved = (matrix(true)[:3, 3] + one @ model.centre) - (matrix(found.pose)[:3, 3] + other @ model.centre)
    kept = np.eye(3)
    if model.axis is None:
        turns = [Rotation.from_matrix(one @ turn @ other.T).as_rotvec() for turn in model.symmetries]
        turned = min(turns, key=lambda turn: float(np.linalg.norm(turn)))
    else:
        along, wanted = other[:, model.axis], one[:, model.axis]
        flips = any(turn[model.axis, model.axis] < -0.5 for turn in model.symmetries)
        wanted = -wanted if flips and float(along @ wanted) < 0.0 else wanted
        across = np.cross(along, wanted)
        sine = float(np.linalg.norm(across))
        turned = across / max(sine, 1e-12) * np.arctan2(sine, float(along @ wanted))
        kept = np.linalg.svd(along[None])[2][1:]
    found_in = []
    for error_of, covariance in (
        (moved, found.covariance[:3, :3]),
        (kept @ turned, kept @ found.covariance[3:, 3:] @ kept.T),
    ):
        square = float(error_of @ np.linalg.solve(covariance, error_of))
        found_in.append(square <= float(chi2.ppf(0.9, len(error_of))))
    return found_in[0], found_in[1]


if __name__ == "__main__":
    main()
