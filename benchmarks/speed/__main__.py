"""How fast every stage is, each row beside its baseline in the same run: `python -m benchmarks.speed`.

    python -m benchmarks.speed                          # every row, a few minutes
    python -m benchmarks.speed --only collision replan  # some of them
    python -m benchmarks.speed --all                    # with all recorded motions and 100,000 configurations
    python -m benchmarks.speed --out benchmarks/speed/results
    python -m benchmarks.speed --against benchmarks/speed/results/2026-11-22.json

Ours and the baseline are timed by turns, so that both meet the same load; what counts are the ratios. With `--out`, the
table is kept as a file of text and one of JSON, by the date; with `--against`, what such a file has of each row is
printed beside it.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import os
from pathlib import Path

from benchmarks.speed.table import Row, machine, plot, printed, read_former

ROWS = (
    "collision",
    "motion",
    "trajectory",
    "simulation",
    "picture",
    "look",
    "belief",
    "replan",
    "start",
    "task",
    "growth",
)
"""Each a module here with a function `measure`."""

ON_REQUEST = ("coal",)
"""The same, for what has to be installed first."""


def main() -> None:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("MUJOCO_GL", "egl")  # before the first import of mujoco
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=(*ROWS, *ON_REQUEST), default=ROWS, help="some of the rows")
    parser.add_argument("--all", action="store_true", help="measure on everything there is; takes a long time")
    parser.add_argument("--json", action="store_true", help="print the table for programs")
    parser.add_argument("--out", type=Path, help="a folder to keep the table in")
    parser.add_argument("--against", type=Path, metavar="JSON", help="a former table, to be printed beside this one")
    arguments = parser.parse_args()
    former = None if arguments.against is None else read_former(arguments.against)
    where, rows = machine(), list[Row]()
    for name in arguments.only:
        rows += importlib.import_module(f"benchmarks.speed.{name}").measure(arguments.all)
    kept = {"machine": where, "rows": [{**dataclasses.asdict(row), "ratio": row.ratio} for row in rows]}
    text, data = printed(rows, where, former), json.dumps(kept, indent=2)
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        (arguments.out / f"{where['date']}.txt").write_text(text + "\n")
        (arguments.out / f"{where['date']}.json").write_text(data + "\n")
        if any(row.series for row in rows):
            plot(rows, arguments.out / f"{where['date']}.png")
    print(data if arguments.json else text)


if __name__ == "__main__":
    main()
