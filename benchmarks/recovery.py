"""The loop against blind execution, seed by seed: `python -m benchmarks.recovery --seeds 20 --fault drop:p=0.3`.

Both meet the same scenes and, action by action, the same chance of a fault. `goal` is the simulator's verdict; "out of
reach" lists the items that ended on no table and in no hand, whose goals nobody could reach any more.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from executive.assemble import Run, RunConfig
from executive.trace.report import Summary

ESTIMATORS = ("oracle", "none")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--problem", default=None)
    parser.add_argument("--fault", action="append", default=None)
    arguments = parser.parse_args()
    faults = tuple(arguments.fault or ["drop:p=0.3"])
    began = time.perf_counter()
    print(f"grocery, faults {', '.join(faults)}")
    print(f"{'seed':>4}  {'oracle':<14}{'goal':<6}{'actions':>8}{'replans':>8}{'looks':>7}{'faults':>8}   "
          f"{'none: goal':<12}{'actions':>8}{'faults':>8}   out of reach")  # fmt: skip
    tally = dict.fromkeys(ESTIMATORS, 0)
    lost_runs = unexplained = 0
    for seed in range(arguments.seeds):
        rows: dict[str, Summary] = {}
        lost: list[str] = []
        for estimator in ESTIMATORS:
            with tempfile.TemporaryDirectory() as runs:
                config = RunConfig(
                    "grocery", arguments.problem, seed, estimator, faults, runs=Path(runs), viewer=False
                )  # fmt: skip
                with Run(config) as run:
                    rows[estimator] = run.execute()
                    if estimator == "oracle":
                        lost = out_of_reach(run)
            tally[estimator] += bool(rows[estimator]["goal_true"])
        seen, blind = rows["oracle"], rows["none"]
        lost_runs += bool(lost)
        unexplained += not seen["goal_true"] and not lost
        print(f"{seed:>4}  {seen['outcome']:<14}{_yes(seen):<6}{seen['actions']:>8}{seen['replans']:>8}"
              f"{seen['looks']:>7}{len(seen['faults']):>8}   "
              f"{_yes(blind):<12}{blind['actions']:>8}{len(blind['faults']):>8}   {', '.join(lost)}")  # fmt: skip
        sys.stdout.flush()
    print(f"goal reached: oracle {tally['oracle']} of {arguments.seeds}, none {tally['none']} of {arguments.seeds}; "
          f"{lost_runs} oracle runs lost an item out of reach, {unexplained} failed without that; "
          f"{time.perf_counter() - began:.0f} s")  # fmt: skip


def out_of_reach(run: Run) -> list[str]:
    """The items that are on no table and not in the hand, by the simulator."""
    facts = run.truth.of(run.domain.task.atoms)
    items = [name for name, kind in run.domain.task.objects.items() if kind == "item"]
    placed = {atom.args[0] for atom in facts.true if atom.args}
    return [item for item in items if item not in placed]


def _yes(summary: Summary) -> str:
    return "yes" if summary["goal_true"] else "no"


if __name__ == "__main__":
    main()
