"""What parts of the product take by themselves: looks on a busy machine, plans anew and in time, poses, photorealistic
pictures, and the project's own checks."""

from __future__ import annotations

import json
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.budget.figures import Figure
from benchmarks.budget.tree import Spent, run_watched
from benchmarks.look import next_look

_BUSY = 3


def looks() -> Iterator[Figure]:
    spent = run_watched([sys.executable, "-m", "benchmarks.look", "--busy", str(_BUSY), "--json"])
    told = json.loads(spent.said)
    quiet, busy = told["quiet look"], told[f"look beside {_BUSY} busy"]
    yield Figure(f"a look beside {_BUSY} busy processes, against a quiet one", "10 to 25 times", 2.5, told["ratio"],
                 "times", note=f"{quiet:.3f} s quiet, {busy:.3f} s busy")  # fmt: skip


def replan() -> Iterator[Figure]:
    from benchmarks.speed.replan import large

    row = large(1)
    assert row.baseline is not None
    yield Figure("a replan above 20,000 grounded actions, against the search alone", "15 s a one-step plan", 2.0,
                 row.ours / row.baseline, "times", cpu=row.ours, note=row.note)  # fmt: skip


def grounding() -> Iterator[Figure]:
    """A task whose grounding takes much longer than the planner has."""
    from benchmarks.speed.replan import PARCELS
    from executive.domain.pddl import read_task
    from executive.planning.fast_downward import FastDownwardPlanner
    from executive.types import Facts

    limit, choose = 4.0, random.Random(0)
    parcels, vans, cities = ([f"{name}{n}" for n in range(many)] for name, many in (("p", 400), ("v", 12), ("c", 60)))
    at = [f"(at {parcel} {choose.choice(cities)})" for parcel in parcels]
    at += [f"(van-at {van} {choose.choice(cities)})" for van in vans]
    goal = " ".join(f"(at {parcel} {choose.choice(cities)})" for parcel in parcels)
    with tempfile.TemporaryDirectory() as name:
        domain, problem = Path(name) / "domain.pddl", Path(name) / "problem.pddl"
        domain.write_text(PARCELS)
        objects = f"{' '.join(parcels)} - parcel {' '.join(vans)} - van {' '.join(cities)} - city"
        problem.write_text(f"(define (problem many) (:domain parcels) (:objects {objects})"
                           f" (:init {' '.join(at)}) (:goal (and {goal})))")  # fmt: skip
        schema = read_task(domain, problem)
    planner = FastDownwardPlanner(schema, timeout=limit)
    began = time.perf_counter()
    answer = planner.plan(Facts.closed(schema.task.declared, schema.task.atoms), schema.task.goal)
    late = time.perf_counter() - began - limit
    yield Figure("grounding, over the planner's time limit", "26 s over 12", 0.5, late,
                 note=f"limit {limit:g} s: {getattr(answer, 'reason', 'a plan')}")  # fmt: skip


def poses() -> Iterator[Figure]:
    from benchmarks.poses import FIRST_SEED, Scenes

    with closing(Scenes()) as scenes:
        rows = [scenes.measure(seed) for seed in range(FIRST_SEED, FIRST_SEED + 5)]
    worst = max(numbers[0] for row in rows for numbers in row["items"].values())
    yield Figure("poses of six items, five depth cameras, nothing known before", "2 CPU s", 0.3,
                 statistics.median(row["wall"] for row in rows), cpu=statistics.median(row["cpu"] for row in rows),
                 note=f"median of 5 scenes, half of the items tipped; the largest error {worst:.1f} mm")  # fmt: skip


def pictures() -> Iterator[Figure]:
    stage, former = "a photorealistic picture of 320x240, CPU seconds", ""
    if find_spec("mitsuba") is None:
        yield Figure(stage, former, 0.7, None, note="Mitsuba is not installed (the extra photoreal)")
        return
    from executive.domain.loader import load_domain
    from executive.sim.world import MujocoWorld

    domain = load_domain("blocksworld")
    world = MujocoWorld(domain.scene, domain.task.objects, renderer="mitsuba")
    world.observe()
    taken, pixels = [], 0
    for _ in range(5):
        began = time.process_time()
        seen = next_look(world)
        taken.append((time.process_time() - began) / len(seen.images))
        pixels = int(np.prod(next(iter(seen.images.values())).shape[:2]))
    world.close()
    share = 320 * 240 / pixels
    yield Figure(stage, former, 0.7, statistics.median(taken) * share,
                 note=f"{statistics.median(taken):.2f} s for {pixels:,} pixels, in proportion")  # fmt: skip


def quick() -> Iterator[Figure]:
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "-m", "quick", "-n", "2", "-p", "no:cacheprovider"],
                          capture_output=True, text=True, check=False)  # fmt: skip
    yield Figure("the quick tests", "none", 60.0, time.perf_counter() - began, note=_last(done.stdout))


def tests() -> Iterator[Figure]:
    began = time.perf_counter()
    done = subprocess.run(["make", "test"], capture_output=True, text=True, check=False)
    yield Figure("`make test`", "6:30", 360.0, time.perf_counter() - began, note=_last(done.stdout))


_RENAMED = {
    "red-block": "green-crate",
    "blue-tin": "orange-mug",
    "dark-table": "desk",
    "light-table": "bench",
    'green-crate = ["block", "red cube", "red box", "small red block", "block that is red"]':
        'green-crate = ["crate", "green box", "green chest", "small green crate", "crate that is green"]',
    'orange-mug = ["tin", "blue can", "blue cylinder", "tin can", "can", "tin that is blue"]':
        'orange-mug = ["mug", "orange beaker", "orange cylinder", "drinking mug", "beaker", "mug that is orange"]',
    'desk = ["table of dark wood", "brown table", "dark wooden table", "table that is dark"]':
        'desk = ["desk of white stone", "white desk", "ceramic desk", "desk that is white"]',
    'bench = ["white table", "pale table", "bright table", "table that is light"]':
        'bench = ["red bench", "brick-red bench", "painted bench", "bench that is red"]',
    'orange-mug = "blue tin can"': 'orange-mug = "orange drinking mug"',
    "The dark table is made of brown wood, and the light table is grey.": "The desk is white, the bench is dark red.",
    "The red block is a small red cube.": "The green crate is a box.",
    "The blue tin can is a cylinder.": "The orange drinking mug is a cylinder.",
    "size = [0.045, 0.045, 0.045]": "size = [0.055, 0.040, 0.060]",
    "rgba = [0.80, 0.15, 0.12, 1.0]": "rgba = [0.15, 0.50, 0.20, 1.0]",
    "size = [0.052, 0.052, 0.09]": "size = [0.062, 0.062, 0.072]",
    "rgba = [0.12, 0.30, 0.75, 1.0]": "rgba = [0.92, 0.50, 0.10, 1.0]",
    'texture = "dark-wood"': 'texture = "ceramic"',
    "rgba = [0.85, 0.87, 0.90, 1.0]": "rgba = [0.45, 0.20, 0.16, 1.0]",
}  # fmt: skip
"""What a copy of the domain has other than the domain that `executive new` makes: names, sizes and colours."""


def training() -> Iterator[Figure]:
    """A model for the domain that `executive new` makes, from the one that comes with the groceries."""
    yield _growing("a new domain", {})


def renamed() -> Iterator[Figure]:
    """The same for a copy of that domain with other names, sizes and colours."""
    yield _growing("a copy of it with other names, sizes and colours", _RENAMED)


def _growing(name: str, changes: Mapping[str, str]) -> Figure:
    """How long a model takes, and how good it is on pictures that it has not seen."""
    with tempfile.TemporaryDirectory() as folder:
        spent, found = _grown(Path(folder), changes)
    return Figure(f"growing an eye for {name}", "a night", 60.0, spent.wall / 60.0, "minutes", cpu=spent.cpu,
                  note=f"the whole state in {found['exact_state']:.1%} of 200 unseen looks, as believed in "
                       f"{found['posterior']['exact_state']:.1%}")  # fmt: skip


def _grown(here: Path, changes: Mapping[str, str]) -> tuple[Spent, dict[str, Any]]:
    """What a model for the new domain, changed so, took, and its evaluation."""
    python = [sys.executable, "-m", "executive"]
    subprocess.run([*python, "new", "shop"], cwd=here, capture_output=True, check=True)
    for file in [path for path in (here / "shop").rglob("*") if path.is_file()]:
        text = file.read_text(encoding="utf-8")
        for old, new in changes.items():
            text = text.replace(old, new)
        file.write_text(text, encoding="utf-8")
    domain, model, data = str(here / "shop"), str(here / "shop-eye"), str(here / "data")
    spent = run_watched([*python, "train", domain, "--from", "grocery", "--out", model])
    subprocess.run([*python, "collect", domain, "--points", "200", "--seed", "9001", "--out", data], check=True,
                   capture_output=True)  # fmt: skip
    subprocess.run([*python, "eval", domain, data, "--vlm", f"{model}/model", "--out", str(here / "found")],
                   check=True, capture_output=True)  # fmt: skip
    return spent, json.loads((here / "found" / "evaluation.json").read_text(encoding="utf-8"))


def _last(text: str) -> str:
    return next((line.strip("= ") for line in reversed(text.splitlines()) if "passed" in line or "failed" in line), "")
