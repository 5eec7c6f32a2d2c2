"""Plans for public planning tasks with `executive plan`, and has every plan judged by unified-planning's validator.

    python -m benchmarks.pddl.planning FOLDER [--out FILE] [--time 30] [--slice 0/4] [--optimal] [--planner NAME]

FOLDER has `accepted.jsonl`, the tasks that Fast Downward's translator accepts, one a line: {"domain", "problem",
"seconds" that it takes, "solved_s" that a greedy search of 4 s takes after it, or null}. What was planned is kept in
--out, one line a task; the same command goes on where it stopped. A plan is late where it took longer than 20 s and
longer than twice the two and 10 s together. A task that unified-planning cannot read is judged by our own reading
alone, and counted apart.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SURE, FACTOR, MORE = 20.0, 2.0, 10.0
"""Seconds within which a plan is expected: so many, or so many times what Fast Downward took and some more."""

_VALIDATE = """
import sys
from unified_planning.environment import get_environment
from unified_planning.io import PDDLReader
environment = get_environment()
environment.credits_stream = None
try:
    problem = PDDLReader(environment).parse_problem(sys.argv[1], sys.argv[2])
    plan = PDDLReader(environment).parse_plan(problem, sys.argv[3])
    with environment.factory.PlanValidator(name="sequential_plan_validator") as validator:
        validator.skip_checks = True  # it says of costs that it does not know them; they are not what it judges
        result = validator.validate(problem, plan)
except Exception as error:  # its reader raises of many kinds what it does not take
    print("unread", type(error).__name__, str(error)[:100].replace("\\n", " "))
else:
    print("valid" if result else "invalid")
"""


def plan(folder: Path, entry: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan for one task and have the plan judged."""
    files = [str(folder / entry["domain"]), str(folder / entry["problem"])]
    row: dict[str, Any] = {"task": f"{entry['domain'].split('/')[0]}/{Path(entry['problem']).stem}"}
    more = ["--optimal"] if arguments.optimal else []
    command = [sys.executable, "-m", "executive", "plan", *files, "--json", "--time", str(arguments.time), *more]
    began = time.monotonic()
    done = subprocess.run(
        [*command, "--planner", arguments.planner], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    spent = time.monotonic() - began
    try:
        told = json.loads(done.stdout)
    except ValueError:
        return {**row, "status": "bug", "reason": done.stderr.strip()[-500:], "seconds": spent}
    row |= {
        "status": told["status"],
        "reason": told.get("reason", ""),
        "cost": told["cost"],
        "seconds": round(spent, 2),
    }
    if entry["solved_s"] is not None:
        row["expected"] = round(max(SURE, FACTOR * (entry["seconds"] + entry["solved_s"]) + MORE), 2)
    if told["plan"] is not None:
        row["length"] = len(told["plan"])
        row["validator"] = _judged(files, told["plan"])
    return row


def _judged(files: Sequence[str], lines: Sequence[str]) -> str:
    if not lines:  # its reader takes no empty plan
        return "empty"
    with tempfile.TemporaryDirectory() as name:
        file, problem = Path(name) / "plan", Path(name) / "problem.pddl"
        file.write_text("\n".join(lines) + "\n")
        text, counted = Path(files[1]).read_text(), re.compile(r"\(\s*=\s*\(\s*total-cost\s*\)", re.I)
        if "total-cost" in Path(files[0]).read_text().lower() and not counted.search(text):
            # Costs are counted from 0; unified-planning wants to be told.
            text = re.sub(r"\(\s*:init", "(:init (= (total-cost) 0)", text, count=1, flags=re.I)
        problem.write_text(text)
        command = [sys.executable, "-c", _VALIDATE, files[0], str(problem), str(file)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        except subprocess.TimeoutExpired:
            return "unread: not within 120 s"
        return done.stdout.strip().splitlines()[-1] if done.stdout.strip() else f"unread: {done.stderr.strip()[-200:]}"


def told(rows: Sequence[dict[str, Any]]) -> str:
    """The table, and each task of which more should be known."""
    known = [row for row in rows if "expected" in row]
    in_time = sum(row["status"] == "solved" and row["seconds"] <= row["expected"] for row in known)
    judged = Counter(row["validator"].split()[0].rstrip(":") for row in rows if "validator" in row)
    seconds = sorted(row["seconds"] for row in rows if row["status"] == "solved")
    lines = [
        f"{len(rows)} tasks: {_listed(Counter(row['status'] for row in rows))}",
        f"plan expected for {len(known)}, there in time for {in_time}",
        f"plans: {_listed(judged)}",
    ]
    if seconds:
        lines.append(f"seconds to a plan: median {seconds[len(seconds) // 2]:.2f}, most {seconds[-1]:.2f}")
    for row in rows:
        late = "expected" in row and (row["status"] != "solved" or row["seconds"] > row["expected"])
        if late or row["status"] in ("bug", "crashed") or row.get("validator") == "invalid":
            words = f"{row['reason']} {row.get('validator', '')}".strip()
            lines.append(f"{row['task']}: {row['status']} after {row['seconds']:.1f} s, {words}")
    return "\n".join(lines)


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.most_common())


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("build/pddl-planning.jsonl"))
    parser.add_argument("--time", type=float, default=30.0, help="seconds that a plan may take")
    parser.add_argument("--slice", default="0/1", help="which part of the tasks: 1/4 is the second of four")
    parser.add_argument("--planner", default="fast-downward")
    parser.add_argument("--optimal", action="store_true")
    parser.add_argument("--only", help="tasks with this in their name")
    arguments = parser.parse_args(argv)
    number, parts = map(int, arguments.slice.split("/"))
    entries = [json.loads(line) for line in (arguments.folder / "accepted.jsonl").read_text().splitlines()]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in arguments.out.read_text().splitlines()] if arguments.out.exists() else []
    done = {row["task"] for row in rows}
    with arguments.out.open("a") as out:
        for entry in entries[number::parts]:
            name = f"{entry['domain'].split('/')[0]}/{Path(entry['problem']).stem}"
            if name not in done and (arguments.only or "") in name:
                rows.append(plan(arguments.folder, entry, arguments))
                out.write(json.dumps(rows[-1]) + "\n")
                out.flush()
    print(told(rows))
    return int(any(row["status"] in ("bug", "crashed") or row.get("validator") == "invalid" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
