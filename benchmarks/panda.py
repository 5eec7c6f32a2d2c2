"""The Panda example over many seeds: `python -m benchmarks.panda --seeds 50 --out FOLDER`.

robosuite places the cubes by the seed, and in each action that carries a cube it slips out of the fingers with some
chance. Each of these is played twice: without looking, by the plan alone, and with the loop around it, by the true
relations. Whether the cubes are stacked says robosuite's own check of its task. What is done is in FOLDER, one line an
episode, and is not done again.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import executive as ex
from examples.robosuite_panda.panda import CUBES, FOLDER, RELATIONS, Panda, skill
from executive.lab.campaign.intervals import wilson

FAULTS: Mapping[str, Sequence[str]] = {
    "no faults": (),
    "drop, p = 0.3": ("drop:p=0.3",),
    "drop, p = 0.6": ("drop:p=0.6",),
}
WAYS = ("plan alone", "loop")
FILE = "episodes.jsonl"


def episode(seed: int, faults: Sequence[str], looks: bool) -> dict[str, Any]:
    """Play one, and say how it ended."""
    began, panda = time.perf_counter(), Panda(seed)
    schema = ex.read_task(FOLDER / "domain.pddl", FOLDER / "problem.pddl")
    eye = ex.RelationEstimator(lambda: panda, RELATIONS)
    broken = ex.FaultInjector([ex.parse_fault(fault, list(CUBES)) for fault in faults], panda, seed)
    ended = ex.make_executive(
        schema.task,
        ex.FastDownwardPlanner(schema),
        panda,
        {"take": skill, "stack": skill},
        eye if looks else None,
        faults=broken,
        initial=None if looks else eye.of(schema.task.atoms),
    ).run()
    stacked = bool(panda.env._check_success())
    panda.env.close()
    told = {"outcome": str(ended.outcome), "goal_seen": ended.goal_seen, "stacked": stacked}
    return {**told, "actions": ended.actions, "replans": ended.replans, "seconds": time.perf_counter() - began}


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table, in Markdown."""
    lines = [
        "| faults | way | episodes | stacked | 95 % interval | claimed and not so | actions |",
        "|---|---|---|---|---|---|---|",
    ]
    for fault in FAULTS:
        for way in WAYS:
            some = [row for row in rows if (row["faults"], row["way"]) == (fault, way)]
            good = sum(row["stacked"] for row in some)
            false = sum(row["goal_seen"] and not row["stacked"] for row in some)
            if some and (interval := wilson(good, len(some))):
                share, actions = good / len(some), sum(row["actions"] for row in some) / len(some)
                shown = f"{interval.low:.0%} to {interval.high:.0%}"
                lines.append(f"| {fault} | {way} | {len(some)} | {share:.0%} | {shown} | {false} | {actions:.1f} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="The Panda example over many seeds, with and without the loop.")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--out", type=Path, required=True, help="the folder that keeps what is done")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / FILE
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {(row["seed"], row["faults"], row["way"]) for row in rows}
    for seed in range(arguments.seeds):
        for fault, specs in FAULTS.items():
            for way in WAYS:
                if (seed, fault, way) not in done:
                    with open(os.devnull, "w") as quiet, contextlib.redirect_stdout(quiet):
                        row = episode(seed, specs, way == "loop")
                    rows.append({"seed": seed, "faults": fault, "way": way, **row})
                    with file.open("a") as journal:
                        journal.write(json.dumps(rows[-1]) + "\n")
    rows = [row for row in rows if row["seed"] < arguments.seeds]
    print(f"{arguments.seeds} seeds, {platform.machine()}, {os.cpu_count()} cores\n\n{report(rows)}")


if __name__ == "__main__":
    main()
