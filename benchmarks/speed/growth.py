"""How the time of a look and of a plan anew grows with the number of items: 6, 12, 24, 48, on three tables.

The shipped model is asked as many questions as a problem of so many items has atoms, about pictures as large as they
always are: its own questions, over and over. The planner gets problems with items of made-up names.
"""

from __future__ import annotations

import random
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.speed.table import Row
from executive.app.config import EstimatorConfig
from executive.app.estimators import open_estimator
from executive.domain.loader import load_domain
from executive.domain.pddl import read_task
from executive.planning.fast_downward import FastDownwardPlanner
from executive.types import Atom, Facts

ITEMS = (6, 12, 24, 48)
TABLES = ("wood-table", "black-table", "white-table")
_SLACK = 1.1
"""An exponent that still passes for linear: times are measured."""


def measure(everything: bool) -> list[Row]:
    counts = [len(TABLES) * items + items + 1 for items in ITEMS]
    rounds = 5 if everything else 3
    looks = [_look(count, rounds) for count in counts]
    plans = [_replan(items, rounds) for items in ITEMS]
    rows = []
    for stage, times in (("look", looks), ("replan", plans)):
        exponent = float(np.polyfit(np.log(counts), np.log(times), 1)[0])
        series = tuple(zip(counts, times, strict=True))
        note = ", ".join(f"{items} items {seconds:.3f} s" for items, seconds in zip(ITEMS, times, strict=True))
        rows.append(
            Row(f"growth of a {stage}, exponent", exponent, None, "", "1", exponent <= _SLACK,
                f"{counts[0]} to {counts[-1]} atoms", note, series)
        )  # fmt: skip
    return rows


def _look(count: int, rounds: int) -> float:
    """Seconds for `count` questions about five pictures, taking them in included."""
    domain = load_domain("grocery")
    estimator = open_estimator(EstimatorConfig(), domain.subject)
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, (384, 384, 3), dtype=np.uint8) for _ in range(5)]
    own = [estimator.questions.text[atom] for atom in domain.task.atoms]
    questions = [own[index % len(own)] for index in range(count)]

    def look() -> None:
        estimator.backend.look(images, estimator.questions.system).ask(questions)

    look()
    return _median(look, rounds)


def _replan(items: int, rounds: int) -> float:
    """Seconds from a state in which items stand anywhere to one in which each is on a table of its own choice."""
    domain = load_domain("grocery")
    names, choose = [f"thing-{number}" for number in range(items)], random.Random(items)
    goal = " ".join(f"(on-table {name} {choose.choice(TABLES)})" for name in names)
    with tempfile.TemporaryDirectory() as folder:
        problem = Path(folder) / "problem.pddl"
        problem.write_text(
            f"(define (problem many) (:domain grocery) (:objects {' '.join(names)} - item {' '.join(TABLES)} - table)"
            f" (:init (robot-gripper-empty)) (:goal (and {goal})))"
        )
        schema = read_task(domain.folder / "domain.pddl", problem)
    planner = FastDownwardPlanner(schema, timeout=120.0)
    true = {Atom("on-table", (name, choose.choice(TABLES))) for name in names} | {Atom("robot-gripper-empty", ())}
    state = Facts.closed(frozenset(true), schema.task.atoms)
    planner.plan(state, schema.task.goal)
    return _median(lambda: planner.plan(state, schema.task.goal), rounds)


def _median(work: Callable[[], object], rounds: int) -> float:
    taken = []
    for _ in range(rounds):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)
