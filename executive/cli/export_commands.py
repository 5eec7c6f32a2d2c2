"""The commands that write a run, or a plan, in the formats of others."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from executive.cli import completion
from executive.cli.app import NOT_REACHED, REACHED
from executive.cli.options import ProblemName, RunName
from executive.cli.run_commands import run_folder
from executive.errors import InputError
from executive.util.files import check_writable

export = typer.Typer(help="Write a run or a plan in a format of others.", rich_markup_mode=None)

RUNS = Path("runs")
AsJson = Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")]


@export.command()
def mcap(
    run: RunName,
    out: Annotated[Path, typer.Option(help="The MCAP file to write.")],
    as_json: AsJson = False,
) -> None:
    """Write a run as MCAP: pictures, joint states, transforms and diagnostics as ROS 2 messages, and all events."""
    from executive.export import export_mcap

    folder = run_folder(run)
    _tell({"run": str(folder), "mcap": str(export_mcap(folder, out))}, "mcap", as_json)


@export.command()
def bt(
    source: Annotated[
        str, typer.Argument(help="A run's folder or its name in runs/; or a domain.", autocompletion=completion.runs)
    ],
    out: Annotated[Path, typer.Option(help="The XML file to write.")],
    plan: Annotated[int, typer.Option(min=1, help="Which of a run's plans.")] = 1,
    problem: ProblemName = None,
    as_json: AsJson = False,
) -> int:
    """Write a plan with its monitoring as a behaviour tree, in the XML of BehaviorTree.CPP 4."""
    from executive.export.btcpp import write_btcpp
    from executive.export.plans import tree_of_problem, tree_of_run
    from executive.trace.record.log import EVENTS_FILE
    from executive.types import NoPlan

    folder = next((each for each in (Path(source), RUNS / source) if os.path.exists(each / EVENTS_FILE)), None)
    if folder is not None and problem is not None:
        raise InputError("goes with a domain; a run has its problem", key="--problem")
    tree = tree_of_problem(source, problem) if folder is None else tree_of_run(folder, plan)
    if isinstance(tree, NoPlan):
        print(f"no plan: {tree.reason.value}: {tree.detail}", file=sys.stderr)
        return NOT_REACHED
    if not out.parent.is_dir():
        raise InputError("there is no such folder", file=out.parent)
    check_writable(out.parent, "out")
    written = write_btcpp(out, *tree)
    _tell({"source": source if folder is None else str(folder), "bt": str(written)}, "bt", as_json)
    return REACHED


@export.command()
def lerobot(
    sources: Annotated[
        list[str],
        typer.Argument(
            help="Runs' folders, or their names in runs/; or collections with demonstrations.",
            autocompletion=completion.runs,
        ),
    ],
    out: Annotated[Path, typer.Option(help="The folder to make.")],
    fps: Annotated[int, typer.Option(min=1, max=100, help="Rows a second of the world's clock.")] = 10,
    cameras: Annotated[str, typer.Option(help="Cameras, with commas between them; all if not given.")] = "",
    task: Annotated[
        str | None, typer.Option(help="What the robot is to do, in words; each run's goal or action if not given.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write runs in the simulator, or a collection's demonstrations, as a data set of LeRobot (v3.0), with pictures
    drawn anew: an episode a run, or an action."""
    from executive.export import export_lerobot
    from executive.export.lerobot import MANIFEST
    from executive.trace.terminal.console import waiting

    folders = [Path(each) if os.path.exists(Path(each) / MANIFEST) else run_folder(each) for each in sources]
    named = [camera.strip() for camera in cameras.split(",") if camera.strip()]
    with waiting(sys.stderr, "drawing"):
        written = export_lerobot(folders, out, fps, named, task)
    _tell({"runs": [str(folder) for folder in folders], "lerobot": str(written)}, "lerobot", as_json)


def _tell(document: dict[str, object], written: str, as_json: bool) -> None:
    print(json.dumps(document, indent=2) if as_json else document[written])
