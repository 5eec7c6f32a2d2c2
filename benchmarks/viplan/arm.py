"""ViPlan's blocksworld problems as a campaign of the arm: writes the problems and the campaign's file into a folder.

    python -m benchmarks.viplan.arm blocksworld-pddl.json.gz FOLDER
    executive bench FOLDER/viplan.toml --out RESULTS
    python -m benchmarks.viplan.arm blocksworld-pddl.json.gz FOLDER --results RESULTS

The last one prints the shares of each split. The columns are places on a table, and the domain is
`blocksworld/columns`. `oracle` sees what is true after each action, `vlm` is the model that comes with the domain, or
that of `--vlm MODEL`. ViPlan's own closed loop has rendered pictures and no arm: its success is quoted beside, and is
of another world.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from pathlib import Path

from benchmarks.viplan.recorded import Tasks
from executive.errors import ExecutiveError
from executive.lab.campaign.intervals import wilson
from executive.lab.campaign.results import claimed, load_results, succeeded
from executive.util.atomic_write import write_atomic

SPLITS = ("simple", "medium", "hard")

_CAMPAIGN = '''title = "ViPlan's blocksworld, by the arm"
about = """
The {count} problems of ViPlan's blocksworld, each column a place on the table. `vlm` sees pictures, `oracle` what is
true after each action.
"""
seeds = 1
minutes = 30

[[domains]]
domain = "blocksworld/columns"
problems = ["problems/*.pddl"]

[estimators]
oracle = {{}}
vlm = {model}
'''


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pddl", type=Path, help="the domain and its problems, compressed JSON")
    parser.add_argument("out", type=Path, help="a folder for the problems and the campaign's file")
    parser.add_argument("--vlm", type=Path, help="another model than the domain's own")
    parser.add_argument("--results", type=Path, help="the folder of the campaign that was played: print its shares")
    arguments = parser.parse_args()
    try:
        if arguments.results is not None:
            return report(arguments.results)
        texts = Tasks(arguments.pddl).texts
    except ExecutiveError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    chosen = {
        f"{split}-{int(name.removesuffix('.pddl').rsplit('_', 1)[1]):02d}.pddl": text
        for split in SPLITS
        for name, text in texts.items()
        if f"{split}/" in name
    }
    folder = arguments.out / "problems"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in chosen.items():
        write_atomic(folder / name, text.encode())
    model = "{}" if arguments.vlm is None else f"{{ vlm = {json.dumps(str(arguments.vlm.resolve()))} }}"
    campaign = _CAMPAIGN.format(count=len(chosen), model=model)
    write_atomic(arguments.out / "viplan.toml", campaign.encode())
    print(f"{len(chosen)} problems; now: executive bench {arguments.out / 'viplan.toml'}")
    return 0


def report(folder: Path) -> int:
    """Print how many problems of each split ended with their goal, and how many with a false claim."""
    rows = load_results(folder, lambda line: print(line, file=sys.stderr)).rows
    head = f"{'problems':>9}{'solved':>8}  {'95 % interval':<18}{'false claims':>12}{'seconds':>9}"
    print(f"{'estimator':<11}{'split':<8}{head}")
    for estimator, split in product(sorted({row.estimator for row in rows}), SPLITS):
        of = [row for row in rows if row.problem.startswith(split) and row.estimator == estimator]
        solved = [row for row in of if succeeded(row)]
        false = sum(claimed(row) and not row.goal_true for row in of)
        interval = wilson(len(solved), len(of))
        said = "-" if interval is None else f"{100 * interval.low:.0f} to {100 * interval.high:.0f} %"
        seconds = sum(row.wall_seconds for row in of) / max(len(of), 1)
        print(f"{estimator:<11}{split:<8}{len(of):>9}{len(solved):>8}  {said:<18}{false:>12}{seconds:>9.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
