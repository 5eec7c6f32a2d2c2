"""The closed loop on public planning tasks, in the symbolic world with wrong answers: how many goals are reached, how
many claimed in error, and whether budgets are kept.

    python -m benchmarks.pddl.loop FOLDER [--out FILE] [--seconds 60] [--slice 0/4]

FOLDER has `accepted.jsonl`, one task a line: {"domain", "problem", "status": length of some plan or a word}. What was
played is kept in --out, one line a run; the same command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from executive.app.config import RunConfig
from executive.app.run import Run
from executive.domain.loader import load_domain
from executive.errors import DomainError
from executive.trace.phrases import why
from executive.types import Ended, Event, OutcomeKind

FLUENTS, LARGER = 1_000, 10
"""Tasks with up to so many fluent atoms are played, and so many larger ones."""

SEEDS = 3
OVERRUN = 1.1
"""How far a budget may be exceeded."""


def tasks(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the folder's tasks with the number of their fluent atoms: those to be played, and those that are refused
    with the reason."""
    larger = 0
    for line in (folder / "accepted.jsonl").read_text(encoding="utf-8").splitlines():
        task = json.loads(line)
        name = f"{task['domain'].split('/')[0]}/{Path(task['problem']).stem}"
        entry: dict[str, Any] = {"task": name, "length": task["status"] if isinstance(task["status"], int) else None}
        entry |= {"domain": str(folder / task["domain"]), "problem": str(folder / task["problem"])}
        try:
            fluents = len(load_domain(entry["domain"], entry["problem"]).task.atoms)
        except DomainError as error:
            yield {**entry, "refused": str(error)}
            continue
        larger += fluents > FLUENTS
        if fluents <= FLUENTS or larger <= LARGER:
            yield {**entry, "fluents": fluents}


def play(entry: dict[str, Any], seed: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Play one run. Where the length of a plan is known, its budget is three times as many actions and some more."""
    most = 3 * (entry["length"] or 100) + 50
    row = {"task": entry["task"], "fluents": entry["fluents"], "length": entry["length"], "seed": seed}
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="executive-loop-") as folder:
        config = RunConfig(
            entry["domain"],
            entry["problem"],
            seed=seed,
            world="symbolic",
            flip=arguments.flip,
            no_effect=arguments.no_effect,
            exogenous=arguments.exogenous,
            max_actions=most,
            max_cycles=2 * most,
            max_looks=5 * most,
            max_seconds=arguments.seconds,
            patience=arguments.patience,
            runs=Path(folder),
            viewer=False,
        )
        try:
            ends = _Ends()
            with Run(config, [ends]) as run:
                ready = time.monotonic() - began
                summary = run.execute()
                settings = config.settings()
                state = run.executive.run_state
        except Exception as error:  # what it is, is what is to be found out
            return {**row, "outcome": "failed", "error": f"{type(error).__name__}: {error}", "seconds": _since(began)}
    used = {
        "cycles": summary["cycles"] / settings.max_cycles,
        "actions": summary["actions"] / settings.max_actions,
        "looks": summary["looks"] / settings.max_looks,
        "replans": summary["replans"] / settings.max_replans,
        "seconds": summary["wall_seconds"]["total"] / settings.max_seconds,
    }
    return {
        **row,
        "outcome": summary["outcome"],
        "reason": ends.reason,
        "goal_true": bool(summary["goal_true"]),
        **{name: summary[name] for name in ("cycles", "actions", "replans", "looks")},
        "questions": summary["looking"]["questions"],
        "overrun": [name for name, share in used.items() if share > OVERRUN],
        "groups": len(getattr(getattr(run.monitor, "network", None), "groups", ())),
        "given_up": why(state.given_up_why),
        "ready": round(ready, 2),
        "wall": summary["wall_seconds"],
        "seconds": _since(began),
    }


class _Ends:
    """A sink that keeps why the run ended."""

    reason = ""

    def write(self, event: Event) -> None:
        if isinstance(event.payload, Ended):
            self.reason = why(event.payload)

    def close(self) -> None:
        """Nothing is open."""


def _since(began: float) -> float:
    return round(time.monotonic() - began, 2)


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What some runs come to."""
    claims = [row for row in rows if row["outcome"] == OutcomeKind.GOAL_REACHED]
    false = [row for row in claims if not row["goal_true"]]
    outcomes = sorted({row["outcome"] for row in rows})
    return {
        "tasks": len({row["task"] for row in rows}),
        "runs": len(rows),
        "success": sum(row["goal_true"] for row in claims) / max(1, len(rows)),
        "false_success": len(false) / max(1, len(rows)),
        "overrun": sum(bool(row.get("overrun")) for row in rows),
        "outcomes": {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in outcomes},
        "cycles": sum(row.get("cycles", 0) for row in rows) / max(1, len(rows)),
        "looks": sum(row.get("looks", 0) for row in rows) / max(1, len(rows)),
    }


def told(rows: Sequence[dict[str, Any]]) -> str:
    """A table of the runs by the size of their tasks."""
    lines = [
        f"{'fluent atoms':<16}{'tasks':>6}{'runs':>6}{'success':>9}{'false':>7}{'overrun':>9}{'cycles':>8}{'looks':>7}"
    ]
    for least, most in ((0, 100), (100, 300), (300, FLUENTS), (FLUENTS, 10**9), (0, 10**9)):
        some = [row for row in rows if least < row["fluents"] <= most]
        if some:
            each, name = figures(some), "all" if (least, most) == (0, 10**9) else f"{least + 1} to {most}"
            name = name if most < 10**9 or least == 0 else f"more than {least}"
            lines.append(
                f"{name:<16}{each['tasks']:>6}{each['runs']:>6}{each['success']:>9.1%}{each['false_success']:>7.1%}"
                f"{each['overrun']:>9}{each['cycles']:>8.1f}{each['looks']:>7.1f}"
            )
    return "\n".join([*lines, ", ".join(f"{name} {count}" for name, count in figures(rows)["outcomes"].items())])


def read(file: Path) -> list[dict[str, Any]]:
    """Read the runs that were played."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("campaigns/pddl-loop.jsonl"))
    parser.add_argument("--flip", type=float, default=0.05)
    parser.add_argument("--no-effect", type=float, default=0.0)
    parser.add_argument("--exogenous", type=float, default=0.0)
    parser.add_argument("--seconds", type=float, default=60.0, help="wall seconds of a run")
    parser.add_argument("--patience", type=float, default=20.0, help="wall seconds of a plan or a look")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--slice", default="0/1", help="K/N: every N-th task, from the K-th on")
    parser.add_argument("--only", help="tasks whose name has this in it")
    parser.add_argument("--for", dest="limit", type=float, default=float("inf"), help="stop after so many seconds")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args(argv)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows, began = read(arguments.out), time.monotonic()
    done = {(row["task"], row["seed"]) for row in rows}
    first, each = map(int, arguments.slice.split("/"))
    for number, entry in enumerate(tasks(arguments.folder)):
        wanted = number % each == first and (arguments.only or "") in entry["task"] and "refused" not in entry
        for seed in range(arguments.seeds if wanted else 0):
            if time.monotonic() - began > arguments.limit:
                break
            if (entry["task"], seed) not in done:
                rows.append(play(entry, seed, arguments))
                with arguments.out.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
                print(json.dumps({k: v for k, v in rows[-1].items() if k != "wall"}), file=sys.stderr, flush=True)
    print(json.dumps({"figures": figures(rows), "rows": rows}, indent=2) if arguments.json else told(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
