"""What the belief makes of real models' answers: recorded answers of vision-language models, in ViPlan's form.

    python -m benchmarks.viplan ANSWERS.jsonl.gz --pddl PDDL.json.gz [--json]

ANSWERS has one run of a model a line, PDDL maps the names of files to their texts. Which parts apply depends on the
answers: whole states are decoded where first looks ask about everything (`--only decoding`), the closed loop is played
where actions' names are the domain's (`--only loop`, which takes long; `--model`, `--seeds`, `--problems`), calibration
and visibility are looked at wherever answers carry probabilities (`--only household`).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.viplan import decoding, household, loop
from benchmarks.viplan.recorded import Tasks, read_runs
from executive.errors import ExecutiveError

PARTS = ("decoding", "loop", "household")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("answers", type=Path, help="recorded runs, JSON lines, compressed")
    parser.add_argument("--pddl", type=Path, required=True, help="the domain and its problems, compressed JSON")
    parser.add_argument("--only", action="append", choices=PARTS, help="this part; repeat it for more")
    parser.add_argument("--model", action="append", help="only this model; repeat it for more")
    parser.add_argument("--seeds", type=int, default=4, help="runs of the closed loop for each problem")
    parser.add_argument("--problems", type=int, help="how many problems the closed loop plays; all by default")
    parser.add_argument(
        "--out", type=Path, help="a file of JSON lines where the closed loop's runs are kept: it goes on"
    )
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        runs, tasks = read_runs(arguments.answers), Tasks(arguments.pddl)
        document = measure(arguments, runs, tasks)
    except ExecutiveError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    if arguments.json:
        print(json.dumps(document, indent=2))
    return 0


def measure(arguments: argparse.Namespace, runs: list[Any], tasks: Tasks) -> dict[str, Any]:
    """Return the figures of each part, and print its table unless JSON is asked for."""
    parts, show = arguments.only or PARTS, not arguments.json
    chosen = [run for run in runs if arguments.model is None or run.model in arguments.model]
    document: dict[str, Any] = {}
    is_complete = any(run.looks and run.looks[0].kind == "all" and run.looks[0].step == 0 for run in runs)
    if "decoding" in parts and is_complete:
        decoded = list(decoding.decode(chosen, tasks))
        document["decoded"] = {**decoding.figures(decoded), "rows": decoding.table(decoded)}
        if show:
            print(f"== whole states\n{decoding.printed(decoded)}\n")
    if "household" in parts:
        document["household"] = household.measure(chosen)
        if show:
            print(f"== calibration and visibility\n{household.printed(document['household'])}\n")
    if "loop" in parts and is_complete:
        document["loop"] = loop.measure(chosen, tasks, arguments.seeds, arguments.out, arguments.problems)
        if show:
            print(f"== closed loop (simulated: answers are drawn)\n{loop.printed(document['loop'])}\n")
    return document


if __name__ == "__main__":
    sys.exit(main())
