"""Whether two checkouts decide the same: `python -m benchmarks.same_decisions BASE_CHECKOUT`.

    git worktree add /tmp/base 458d223
    python -m benchmarks.same_decisions /tmp/base --out /tmp/decisions   # goes on where it was stopped
    python -m benchmarks.same_decisions /tmp/base --only 0 12            # some of the runs

Twenty runs, by sight and by ground truth, with faults of each kind and other monitors, are played by the code of the
base and by that of this checkout, each in processes of their own, and their records are held against each other event
by event: plans, steps, results, faults, looks, what was compared and judged, decisions with their causes, the end.
Numbers may differ by `TOLERANCE`; wall times, and how a motion was drawn, do not count. Each run's first difference is
printed. Exits with 1 where there is one.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

ORACLE, SIGHT = ("--estimator", "oracle"), ("--estimator", "vlm")

RUNS: tuple[tuple[str, ...], ...] = (
    ("grocery", *ORACLE),
    ("grocery", *ORACLE, "--fault", "drop@4"),
    ("grocery", *ORACLE, "--fault", "drop:p=0.3", "--seed", "1"),
    ("grocery", *ORACLE, "--fault", "miss:p=0.3", "--seed", "2"),
    ("grocery", *ORACLE, "--fault", "slip:p=0.3", "--seed", "3"),
    ("grocery", *ORACLE, "--fault", "shove:p=0.3", "--seed", "4"),
    ("grocery", *ORACLE, "--fault", "drop:p=0.5", "--seed", "5", "--max-replans", "3"),
    ("grocery", *ORACLE, "--poses", "depth", "--seed", "6"),
    ("grocery", *ORACLE, "--no-guard", "--fault", "drop@2", "--seed", "7"),
    ("grocery", "--estimator", "none", "--fault", "drop@2", "--seed", "8"),
    ("grocery", *SIGHT, "--fault", "drop@4"),
    ("grocery", *SIGHT, "--fault", "drop:p=0.3", "--seed", "10"),
    ("grocery", *SIGHT, "--fault", "shove:p=0.3", "--seed", "11"),
    ("grocery", *SIGHT, "--fault", "camera:front=black@3-5", "--seed", "12"),
    ("grocery", *SIGHT, "--threshold", "0.5", "--fault", "drop@4", "--seed", "13"),
    ("grocery", *SIGHT, "--no-memory", "--fault", "drop@6", "--seed", "14"),
    ("grocery", *SIGHT, "--per-image", "--max-questions", "12", "--seed", "15"),
    ("grocery", *SIGHT, "--alpha", "0.05", "--fault", "slip:p=0.3", "--seed", "16"),
    ("blocksworld", *ORACLE, "--problem", "tower-5", "--fault", "topple:p=0.2", "--seed", "17"),
    ("blocksworld", "--world", "symbolic", "--problem", "tower-5", "--flip", "0.1", "--no-effect", "0.2"),
)
"""What follows `executive run`."""

NOT_DECIDED = frozenset({"Timing", "Phase", "Motion", "PosesEstimated", "Observation", "Questions", "Moved"})
"""Events of which nothing is compared: how long it took, what it looked like, and how it was worded."""

CLOCKS = frozenset({"wall", "seconds", "run"})
"""Fields that differ from run to run."""

TOLERANCE = 1e-5
"""Of numbers: sums of a model's answers are rounded by how many threads add them up."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("base", type=Path, help="a checkout of the code to hold this one against")
    parser.add_argument("--only", type=int, nargs="+", choices=range(len(RUNS)), metavar="N", default=range(len(RUNS)))
    parser.add_argument("--out", type=Path, help="where the runs are kept: what is there already is not played again")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        out = arguments.out or Path(scratch)
        differing = 0
        for number in arguments.only:
            records = [
                record(played(code, out / side, number))
                for side, code in (("base", arguments.base), ("here", Path(__file__).parent.parent))
            ]
            told = first_difference(*records)
            differing += told is not None
            print(
                f"{number:>3}  {len(records[0]):>4} events  {told or 'the same'}  {' '.join(RUNS[number])}", flush=True
            )
    print(f"{len(arguments.only) - differing} of {len(arguments.only)} decide the same")
    sys.exit(differing > 0)


def played(checkout: Path, runs: Path, number: int) -> Path:
    """The folder of a run by a checkout's code, played unless it is there to its end."""
    folder = runs / str(number)
    if not (folder / "summary.json").exists():
        words = ("run", *RUNS[number], "--runs", str(runs.resolve()), "--name", str(number), "--no-trace-viewer")
        done = subprocess.run(
            [sys.executable, "-m", "executive", *words, "--quiet"],
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": str(checkout.resolve())},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode not in (0, 1):  # neither reached nor not reached
            sys.exit(f"{checkout}: executive {' '.join(words)}: exit code {done.returncode}: {done.stderr.strip()}")
    return folder


def record(folder: Path) -> list[dict[str, Any]]:
    """The events of a run that are compared, as they stand in its record."""
    lines = (folder / "events.jsonl").read_text().splitlines()
    return [event for event in map(json.loads, lines) if event["type"] not in NOT_DECIDED]


def first_difference(base: Sequence[dict[str, Any]], here: Sequence[dict[str, Any]]) -> str | None:
    """Where two records part, or None."""
    for number, (one, other) in enumerate(zip_longest(base, here)):
        if one is None or other is None:
            return f"event {number}: {'base' if other is None else 'here'} goes on with {(one or other)['type']}"
        for where, left, right in differences(one, other):
            return f"event {number} ({one['type']}, cycle {one['cycle']}): {where}: {left!r} and {right!r}"
    return None


def differences(one: Any, other: Any, where: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Each place in which two values of JSON differ, with what stands there; clocks and rounding left out."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys((*one, *other)):
            if key not in CLOCKS:
                yield from differences(one.get(key), other.get(key), f"{where}.{key}" if where else key)
    elif isinstance(one, list) and isinstance(other, list):
        for index, (left, right) in enumerate(zip_longest(one, other)):
            yield from differences(left, right, f"{where}[{index}]")
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=TOLERANCE):
            yield where, one, other
    elif one != other:
        yield where, one, other


if __name__ == "__main__":
    main()
