"""The closed loop on public planning tasks, in the symbolic world with wrong answers: how many goals are reached, how
many claimed in error, and whether budgets are kept.

    python -m benchmarks.pddl.loop FOLDER [--out FOLDER] [--seconds 60] [--jobs 2]

FOLDER has `accepted.jsonl`, one task a line: {"domain", "problem", "status": length of some plan or a word}. It is a
campaign: what was played is kept in --out, and the same command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.played import StoppedError, play
from executive.cli.app import INTERRUPTED
from executive.domain.loader import load_domain
from executive.errors import DomainError
from executive.lab.campaign.design import Campaign, Configuration, Place
from executive.lab.campaign.episode import Row
from executive.types import OutcomeKind
from executive.util.threads import cores

FLUENTS, LARGER = 1_000, 10
"""Tasks with up to so many fluent atoms are played, and so many larger ones."""

SEEDS = 3
OVERRUN = 1.1
"""How far a budget may be exceeded."""


class Public(NamedTuple):
    """A public task: how many fluent atoms it has, and the length of some plan if one is known."""

    place: Place
    fluents: int
    length: int | None


def tasks(folder: Path) -> Iterator[Public]:
    """Yield the folder's tasks that are to be played, each once. Where the length of a plan is known, a run's budget is
    three times as many actions and some more."""
    larger, names = 0, set[str]()
    for line in (folder / "accepted.jsonl").read_text(encoding="utf-8").splitlines():
        task = json.loads(line)
        files = str(folder / task["domain"]), str(folder / task["problem"])
        length = task["status"] if isinstance(task["status"], int) else None
        most = 3 * (length or 100) + 50
        try:
            domain = load_domain(*files)
        except DomainError:
            continue
        digest = f"{domain.fingerprint()}, {most} actions"
        limits = {"max_actions": most, "max_cycles": 2 * most, "max_looks": 5 * most}
        place = Place(task["domain"].split("/")[0], Path(task["problem"]).stem, *files, digest, limits)
        fluents = len(domain.task.atoms)
        larger += fluents > FLUENTS
        if str(place) not in names and (fluents <= FLUENTS or larger <= LARGER):
            names.add(str(place))
            yield Public(place, fluents, length)


def campaign(found: Sequence[Public], seeds: int, options: Mapping[str, Any]) -> Campaign:
    """All tasks, each with so many seeds, in the symbolic world with the `options` of a run."""
    return Campaign(
        title="Public planning tasks",
        seeds=tuple(range(seeds)),
        places=tuple(task.place for task in found),
        configurations=(Configuration("oracle", "full"),),
        faults={"none": ()},
        options={"world": "symbolic", **options},
    )


def overran(row: Row, options: Mapping[str, Any]) -> bool:
    """Whether a run took more than it was allowed."""
    used = {"max_actions": row.actions, "max_looks": row.looks, "max_seconds": row.wall_seconds}
    return any(used[name] > OVERRUN * most for name, most in options.items() if name in used)


class Figures(NamedTuple):
    """What some runs come to: shares of the runs, numbers of them, and looks a run."""

    tasks: int
    runs: int
    success: float
    false_success: float
    overrun: int
    looks: float


def figures(rows: Sequence[Row], found: Mapping[tuple[str, ...], Public], options: Mapping[str, Any]) -> Figures:
    claims = [row for row in rows if row.outcome == OutcomeKind.GOAL_REACHED]
    late = [overran(row, {**options, **found[row.key[:2]].place.options}) for row in rows]
    return Figures(
        tasks=len({row.key[:2] for row in rows}),
        runs=len(rows),
        success=sum(row.goal_true for row in claims) / max(1, len(rows)),
        false_success=sum(not row.goal_true for row in claims) / max(1, len(rows)),
        overrun=sum(late),
        looks=sum(row.looks for row in rows) / max(1, len(rows)),
    )


def told(rows: Sequence[Row], found: Mapping[tuple[str, ...], Public], options: Mapping[str, Any]) -> str:
    """A table of the runs by the size of their tasks."""
    sizes = {"1 to 100": (0, 100), "101 to 300": (100, 300), f"301 to {FLUENTS}": (300, FLUENTS)}
    sizes |= {f"more than {FLUENTS}": (FLUENTS, sys.maxsize), "all": (0, sys.maxsize)}
    lines = [f"{'fluent atoms':<16}{'tasks':>6}{'runs':>6}{'success':>9}{'false':>7}{'overrun':>9}{'looks':>7}"]
    for name, (least, most) in sizes.items():
        some = [row for row in rows if least < found[row.key[:2]].fluents <= most]
        if some:
            each = figures(some, found, options)
            lines.append(
                f"{name:<16}{each.tasks:>6}{each.runs:>6}{each.success:>9.1%}{each.false_success:>7.1%}"
                f"{each.overrun:>9}{each.looks:>7.1f}"
            )
    outcomes = sorted({row.outcome for row in rows})
    lines.append(", ".join(f"{outcome} {sum(row.outcome == outcome for row in rows)}" for outcome in outcomes))
    known = [row for row in rows if found[row.key[:2]].length is not None]
    reached = sum(row.outcome == OutcomeKind.GOAL_REACHED and row.goal_true for row in known)
    return "\n".join([*lines, f"of {len(known)} runs of tasks for which a plan is known: {reached} reach the goal"])


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("campaigns/pddl-loop"))
    parser.add_argument("--flip", type=float, default=0.05)
    parser.add_argument("--no-effect", type=float, default=0.0)
    parser.add_argument("--exogenous", type=float, default=0.0)
    parser.add_argument("--seconds", dest="max_seconds", type=float, default=60.0, help="wall seconds of a run")
    parser.add_argument("--patience", type=float, default=20.0, help="wall seconds of a plan or a look")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--only", default="", help="tasks whose name has this in it")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args(argv)
    options = {name: vars(arguments)[name] for name in ("flip", "no_effect", "exogenous", "max_seconds", "patience")}
    wanted = [task for task in tasks(arguments.folder) if arguments.only in str(task.place)]
    try:
        rows = play(campaign(wanted, arguments.seeds, options), arguments.out, arguments.jobs)
    except StoppedError:
        return INTERRUPTED
    found: dict[tuple[str, ...], Public] = {(task.place.domain, task.place.problem): task for task in wanted}
    if arguments.json:
        made = figures(rows, found, options)
        print(json.dumps({"figures": made._asdict(), "rows": [asdict(row) for row in rows]}, indent=2))
    else:
        print(told(rows, found, options))
    return 0


if __name__ == "__main__":
    sys.exit(main())
