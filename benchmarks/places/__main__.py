"""Where to look first for what cannot be seen: `python -m benchmarks.places [--seeds 200] [--out FILE] [--json]`.

Two things are wanted, which are in three drawers or in view. In each setting the executive decides in two ways where to
look first, on the same worlds; beside them is the best order for the true distribution, worked out exactly. The worlds
are symbolic: an action does what the domain says, and what can be seen is seen as it is.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.places.best import BestOrder
from benchmarks.places.playing import Arena
from benchmarks.places.settings import SETTINGS, Setting
from executive.app.config import SEARCHES
from executive.util.atomic_write import write_atomic


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, help="worlds in each setting")
    parser.add_argument("--out", type=Path, help="a file for the table, too")
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    arguments = parser.parse_args()
    rows = [measured(setting, search, arguments.seeds) for setting in SETTINGS for search in SEARCHES]
    head = f"python -m benchmarks.places --seeds {arguments.seeds}\n{time.strftime('%Y-%m-%d')}, {platform.machine()}."
    text = f"{head} Simulated: worlds of atoms.\n\n{table(rows)}\n"
    if arguments.out is not None:
        write_atomic(arguments.out, text.encode())
    print(json.dumps(rows, indent=2) if arguments.json else text, end="")


def measured(setting: Setting, search: str, seeds: int) -> dict[str, Any]:
    """Play a setting in one way, and return its row."""
    arena = Arena(setting, search)
    order = BestOrder(setting.truth, arena.costs())
    best = [order.played(setting.draw(seed)) for seed in range(seeds)]
    played = [arena.play(seed) for seed in range(seeds)]
    return {
        "setting": setting.name,
        "search": search,
        "worlds": seeds,
        "success": _mean([each.claimed and each.true for each in played]),
        "false claims": sum(each.claimed and not each.true for each in played),
        "opened": _mean([each.opened for each in played]),
        "opened at best": _mean([each.drawers for each in best]),
        "cost": _mean([each.cost for each in played]),
        "cost at best": _mean([each.cost for each in best]),
        "twice for nothing": sum(each.twice for each in played),
        "actions": _mean([each.actions for each in played]),
        "decision, median of the longest": statistics.median([each.decision for each in played]),
        "decision, longest": max(each.decision for each in played),
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as text."""
    lines = [
        f"{'setting':33}{'search':11}{'success':>8}{'false':>6}{'opened':>8}{'best':>6}{'cost':>7}{'best':>6}"
        f"{'twice':>6}{'actions':>8}{'decision: median, longest (s)':>31}"
    ]
    for row in rows:
        lines.append(
            f"{row['setting']:33}{row['search']:11}{row['success']:8.3f}{row['false claims']:6}{row['opened']:8.2f}"
            f"{row['opened at best']:6.2f}{row['cost']:7.2f}{row['cost at best']:6.2f}{row['twice for nothing']:6}"
            f"{row['actions']:8.2f}{row['decision, median of the longest']:22.3f}{row['decision, longest']:9.3f}"
        )
    return "\n".join(lines)


def _mean(values: Sequence[float]) -> float:
    return round(sum(values) / len(values), 4)


if __name__ == "__main__":
    main()
