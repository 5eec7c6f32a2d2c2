"""The command that replays a run's decisions from its record."""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from executive.app.config import MONITORS, MonitorConfig, preset
from executive.cli.app import NOT_REACHED, REACHED, one_line
from executive.cli.options import RunName, with_options
from executive.cli.run_commands import run_folder
from executive.errors import InputError

if TYPE_CHECKING:
    from executive.replay import Comparison


@with_options()
def replay(
    run: RunName,
    options: MonitorConfig,
    monitor: Annotated[
        str | None,
        typer.Option(
            help="The monitor: plain, consistent or full; the run's own if not given.",
            autocompletion=lambda: list(MONITORS.items()),
        ),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Show the decisions that are the same, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print both sides as JSON.")] = False,
) -> int:
    """Replay a run's decisions from its record, without model or simulator, with its own or another monitor.

    The exit code is 0 if both decide the same, 1 if they differ.
    """
    from executive.replay import compare_run

    began = time.perf_counter()
    folder = run_folder(run)
    comparison = compare_run(folder, _wanted(monitor, options))
    seconds = time.perf_counter() - began
    if as_json:
        print(json.dumps({"run": str(folder), **_document(comparison), "seconds": round(seconds, 3)}, indent=2))
    else:
        _print(comparison, every, seconds)
    return REACHED if comparison.agree else NOT_REACHED


def _wanted(monitor: str | None, options: MonitorConfig) -> MonitorConfig | None:
    """Return the requested monitor; None for the run's own."""
    given = options != MonitorConfig()
    if monitor is None:
        return options if given else None
    if given:
        raise InputError("names a preset, and excludes the options that set a monitor up", key="--monitor")
    return preset(monitor)


def _print(comparison: Comparison, every: bool, seconds: float) -> None:
    from executive.trace.terminal.comparison import Pair, print_pairs

    rows = comparison.rows
    shown = [Pair(*row, row.agree, row.same) for row in rows if every or not row.same]
    if shown:
        recorded, replayed = comparison.names
        print_pairs(shown, (f"recorded ({recorded})", f"replayed ({replayed})"), sys.stdout)
    for line in comparison.ends:
        print(one_line(line))
    same, agree = sum(row.same for row in rows), sum(row.agree for row in rows)
    counts = [f"{same} of {comparison.decisions} decisions are the same"]
    counts += [f"{agree - same} for another reason"] if agree > same else []
    counts += [f"{len(rows) - agree} different"] if agree < len(rows) else []
    counts += [f"{comparison.left} not come to"] if comparison.left else []
    print(f"{', '.join(counts)}; {seconds:.2f} s")


def _document(comparison: Comparison) -> dict[str, Any]:
    from executive.trace.record.codec import encode

    return {
        "recorded": comparison.names[0],
        "replayed": comparison.names[1],
        "agree": comparison.agree,
        "ends": list(comparison.ends),
        "left": comparison.left,
        "decisions": [
            {
                "cycle": row.cycle,
                "agree": row.agree,
                "same": row.same,
                "recorded": encode(row.recorded),
                "replayed": encode(row.replayed),
            }
            for row in comparison.rows
        ],
    }
