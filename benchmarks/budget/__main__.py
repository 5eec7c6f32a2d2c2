"""What a person waits for, against a budget for each: `python -m benchmarks.budget`.

    python -m benchmarks.budget                         # all rows but those below, about 20 minutes
    python -m benchmarks.budget --only start memory     # some of them
    python -m benchmarks.budget --only tests training renamed   # each takes as long as all the others
    python -m benchmarks.budget --out benchmarks/budget/results

Beside each figure stands whether the machine was quiet: how much of its processor time others took meanwhile. Where it
was busy, wall times tell of the others, too; the processor time of all processes that took part stands beside them.
With `--out`, the table is kept by the date. A row that cannot be measured says why.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from benchmarks.budget.figures import Figure, Measured, printed, watched

ON_REQUEST = ("tests", "training", "renamed")
"""Rows each of which takes as long as all others together."""


def main() -> None:
    os.environ.setdefault("MUJOCO_GL", "egl")  # before the first import of mujoco
    import executive.util.threads  # noqa: F401  # before torch and numpy, which read what it sets
    from benchmarks.budget import cycles, parts, runs
    from benchmarks.speed.table import machine

    stages = {
        "looks": parts.looks, "start": runs.start, "memory": runs.memory, "whole": runs.whole, "cycles": cycles.cycles,
        "replan": parts.replan, "grounding": parts.grounding, "pictures": parts.pictures, "poses": parts.poses,
        "campaign": runs.campaign, "training": parts.training, "renamed": parts.renamed, "quick": parts.quick,
        "tests": parts.tests,
    }  # fmt: skip
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--only", nargs="+", choices=stages, default=[name for name in stages if name not in ON_REQUEST]
    )
    parser.add_argument("--json", action="store_true", help="print the table for programs")
    parser.add_argument("--out", type=Path, help="a folder to keep the table in")
    arguments = parser.parse_args()
    where, rows = machine(), list[Measured]()
    for name in arguments.only:
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            rows += watched(stages[name])
        except Exception as error:  # the other rows are worth having all the same
            failed = Figure(name, "", None, None, note=f"failed: {type(error).__name__}: {error}")
            rows.append(Measured(failed, 0.0))
    text = printed(rows, where)
    data = json.dumps({"machine": where, "rows": [row.to_dict() for row in rows]}, indent=2)
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        (arguments.out / f"{where['date']}.md").write_text(text + "\n")
        (arguments.out / f"{where['date']}.json").write_text(data + "\n")
    print(data if arguments.json else text)


if __name__ == "__main__":
    main()
