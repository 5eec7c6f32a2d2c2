"""A whole look by the shipped model, pictures and all questions, against one question at a time."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

from benchmarks.look import next_look
from benchmarks.speed.table import Row
from executive.domain.loader import load_domain
from executive.sim.rendering import sensed
from executive.types import Observation


def measure(everything: bool) -> list[Row]:
    from executive.app.config import EstimatorConfig
    from executive.app.estimators import open_estimator
    from executive.sim.world import MujocoWorld

    domain = load_domain("grocery")
    estimator, atoms = open_estimator(EstimatorConfig(), domain.subject), domain.task.atoms
    world = MujocoWorld(domain.scene, domain.task.objects)
    seen = world.observe()
    estimator.estimate(seen, atoms)

    def one_by_one(number: int) -> None:
        for index, atom in enumerate(atoms):
            # Other noise each time, or the estimator would know the pictures again.
            estimator.estimate(_noisy(seen, [number, index]), [atom])

    ours, theirs = [], []
    for number in range(10 if everything else 4):
        ours.append(_wall(lambda: estimator.estimate(next_look(world), atoms)))
        theirs.append(_wall(lambda number=number: one_by_one(number)))  # type: ignore[misc]
    world.close()
    mine, ratio = statistics.median(ours), statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    against = "one question at a time, pictures given"
    return [
        Row("look, all questions", mine, statistics.median(theirs), "s", "10 times", ratio >= 10.0, against,
            f"ratio {ratio:.1f}; {len(atoms)} questions, {len(seen.images)} pictures, wall time"),
        Row("look, with rendering", mine, None, "s", "0.3 s", mine <= 0.3, "two cores"),
    ]  # fmt: skip


def _noisy(seen: Observation, seed: list[int]) -> Observation:
    return replace(seen, images={name: sensed(image, seed) for name, image in seen.images.items()})


def _wall(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
