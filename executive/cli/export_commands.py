"""The commands that write a run, or a plan, in the formats of others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from executive.cli.options import RunName
from executive.cli.run_commands import run_folder

export = typer.Typer(help="Write a run or a plan in a format of others.", rich_markup_mode=None)

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


def _tell(document: dict[str, object], written: str, as_json: bool) -> None:
    print(json.dumps(document, indent=2) if as_json else document[written])
