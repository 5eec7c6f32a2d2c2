"""Poses by depth on scenes that nobody has tuned anything on: `python -m benchmarks.poses --scenes 100`.

Each scene draws items at random and tips about half of them; with `--absent`, one or two of the items that are looked
for are not there. Errors are those of the middle of an item's box, and of its orientation as far as its shape tells;
"in 90 %" is the share of them inside the ellipsoid that should hold nine of ten.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from executive.app.localizer import item_models, open_localizer
from executive.perception import ItemModel, Localizer
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
    arguments = parser.parse_args()
    spec = read_scene(SCENE)
    models = {model.name: model for model in item_models(spec)}
    for model in models.values():
        _ = model.field, model.orientations, model.lookalikes
    known = KnownScene(spec)
    tally = Tally(arguments.verbose)
    for index in range(arguments.scenes):
        seed = arguments.seed + index
        rng = np.random.default_rng([seed, 1])
        absent = set(rng.choice(sorted(models), 1 + int(rng.integers(2)), replace=False)) if arguments.absent else set()
        world = drawn(seed, [name for name in models if name not in absent], rng)
        if arguments.moved:
            camera = str(rng.choice([camera.name for camera in spec.cameras]))
            way = rng.normal(size=3)
            world.move_camera(camera, 0.01 * arguments.moved * way / np.linalg.norm(way))
        localizer = open_localizer(world, models=list(models.values()), known=known)
        tally.add(seed, world, localizer, models)
        world.close()
    known.close()
    tally.report(arguments.scenes)


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


class Tally:
    """What was measured."""

    def __init__(self, verbose: bool) -> None:
        self.verbose = verbose
        self.millimetres: dict[str, list[float]] = {}
        self.degrees: dict[str, list[float]] = {}
        self.inside: dict[str, list[tuple[bool, bool]]] = {}
        self.unseen: list[str] = []
        self.invented: list[str] = []
        self.lumps = 0
        self.left_out = 0
        self.wall: list[float] = []
        self.cpu: list[float] = []

    def add(self, seed: int, world: MujocoWorld, localizer: Localizer, models: dict[str, ItemModel]) -> None:
        sensed = localizer.capture()
        wall, cpu = time.perf_counter(), time.process_time()
        estimate = localizer.estimate(sensed)
        self.wall.append(time.perf_counter() - wall)
        self.cpu.append(time.process_time() - cpu)
        self.lumps += len(estimate.lumps)
        self.left_out += len(estimate.left_out)
        for name, model in models.items():
            here, found = name in world.items, estimate.poses.get(name)
            if found is None:
                if here:
                    self.unseen.append(f"seed {seed}: {name}")
            elif not here:
                self.invented.append(f"seed {seed}: {name}")
            else:
                away, angle = error(model, world.pose(name), found.pose)
                self.millimetres.setdefault(name, []).append(1e3 * away)
                self.degrees.setdefault(name, []).append(angle)
                self.inside.setdefault(name, []).append(inside(model, world.pose(name), found))
                if self.verbose and (away > 0.003 or angle > 6.0):
                    print(
                        f"seed {seed}: {name} {1e3 * away:.1f} mm {angle:.1f} degrees, misfit "
                        f"{1e3 * found.misfit:.2f} mm, spread {1e3 * found.spread:.2f} mm, {found.views}"
                    )

    def report(self, scenes: int) -> None:
        print(f"{'item':<14}{'found':>7}{'median':>9}{'90 %':>8}{'max mm':>9}{'median':>9}{'90 %':>8}{'max deg':>9}"
              f"{'wrong':>7}{'in 90 %: mm':>13}{'deg':>6}")  # fmt: skip
        rows = {**self.millimetres, "all": [each for some in self.millimetres.values() for each in some]}
        turns = {**self.degrees, "all": [each for some in self.degrees.values() for each in some]}
        told = {**self.inside, "all": [each for some in self.inside.values() for each in some]}
        for name, away in rows.items():
            angles = turns[name]
            shares = [float(np.mean(column)) for column in zip(*told[name], strict=True)]
            print(
                f"{name:<14}{len(away):>7}{np.median(away):>9.2f}{np.quantile(away, 0.9):>8.2f}{max(away):>9.1f}"
                f"{np.median(angles):>9.2f}{np.quantile(angles, 0.9):>8.2f}{max(angles):>9.1f}"
                f"{sum(each > 1e3 * WRONG for each in away):>7}{shares[0]:>13.0%}{shares[1]:>6.0%}"
            )
        print(f"{scenes} scenes: {len(self.unseen)} items not found, {len(self.invented)} reported that are not there, "
              f"{self.lumps} unknown lumps, {self.left_out} cameras left out")  # fmt: skip
        print(f"a scene takes {np.median(self.cpu):.2f} s of processor time and {np.median(self.wall):.2f} s (medians; "
              f"90 %: {np.quantile(self.cpu, 0.9):.2f} and {np.quantile(self.wall, 0.9):.2f})")  # fmt: skip
        for line in (*self.unseen, *self.invented):
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
