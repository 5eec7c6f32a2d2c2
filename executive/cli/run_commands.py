"""The commands about runs: execute, resume, explain, inspect."""

from __future__ import annotations

import difflib
import json
import os
import re
import shlex
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from executive.app.config import MUJOCO, RunConfig, read_config
from executive.cli import completion, streams
from executive.cli.app import NOT_REACHED, REACHED, ctrl_c, one_line
from executive.cli.options import ProblemFile, RunName, chosen_problem, with_options
from executive.errors import InputError
from executive.util.files import check_writable, reason

if TYPE_CHECKING:
    from executive.app.run import Run


Json = Annotated[bool, typer.Option("--json", help="Print the summary on stdout, all else on stderr.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and --json.")]
Profile = Annotated[bool, typer.Option("--profile", help="End with where the time went, by stage and by import.")]
View = Annotated[bool, typer.Option("--view", help="Watch it in the Rerun viewer while it goes on.")]


@with_options(file=True)
def run(
    config: RunConfig,
    problem_file: ProblemFile = None,
    faults_file: Annotated[
        Path | None, typer.Option("--faults", help="A TOML file with a list of faults, such as faults = [...].")
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
    view: View = False,
    profile: Profile = False,
) -> int:
    """Reach a problem's goal in the simulator or the symbolic world, and record everything that happens."""
    from executive.util import profile as profiling
    from executive.util import requirements

    if profile:
        profiling.start()
    from executive.faults import read_faults

    if view and not config.viewer:
        raise InputError("needs the viewer's trace, which --no-trace-viewer turns off", key="--view")
    faults = read_faults(faults_file) if faults_file is not None else ()
    problem = chosen_problem(problem_file, config.problem)
    config = replace(config, problem=problem, faults=(*config.faults, *faults))
    requirements.require(config.world == MUJOCO)

    from executive.app import run as assemble
    from executive.trace.terminal.console import waiting
    from executive.trace.terminal.sink import TerminalSink
    from executive.trace.viewer.process import open_window

    stream = sys.stderr if as_json else sys.stdout
    with nullcontext() if quiet else waiting(stream, "loading planner and world"):
        window = open_window() if view else None
        prepared = assemble.Run(config, [] if quiet else [TerminalSink(stream)], view=window)
    return _carried_out(prepared, quiet, as_json, profile)


def resume(
    run: RunName,
    as_json: Json = False,
    quiet: Quiet = False,
    view: View = False,
) -> int:
    """Go on with a run whose process was killed, that crashed, or that was interrupted: look first, repeat nothing."""
    from executive.util import requirements

    folder = run_folder(run)
    requirements.require(read_config(folder).world == MUJOCO)

    from executive.app import run as assemble
    from executive.trace.terminal.console import waiting
    from executive.trace.terminal.sink import TerminalSink
    from executive.trace.viewer.process import open_window

    stream = sys.stderr if as_json else sys.stdout
    with nullcontext() if quiet else waiting(stream, "loading planner and world"):
        window = open_window() if view else None
        prepared = assemble.resume(folder, [] if quiet else [TerminalSink(stream)], window)
    return _carried_out(prepared, quiet, as_json)


def _carried_out(prepared: Run, quiet: bool, as_json: bool, profiled: bool = False) -> int:
    """Execute a run, print its result and, if it was `profiled`, where its time went; return the exit code."""
    from executive.faults import parse_fault
    from executive.trace.report.profile import print_profile
    from executive.trace.report.summary import print_summary
    from executive.types import OutcomeKind
    from executive.util import profile as profiling

    stream = sys.stderr if as_json else sys.stdout
    with prepared, ctrl_c(prepared.cancel) as interrupted:
        summary = prepared.execute()
    struck = {each["spec"] for each in summary["faults"]}
    for spec in prepared.config.faults:
        if "@" in spec and str(parse_fault(spec)) not in struck and not quiet:
            print(f"warning: the fault {spec} never struck in {summary['actions']} actions", file=sys.stderr)
    if summary["outcome"] == OutcomeKind.INTERRUPTED and not quiet:
        print(f"continue with: executive resume {shlex.quote(str(prepared.folder))}", file=sys.stderr)
    spent = profiling.read() if profiled else None
    try:
        if not quiet:
            print_summary(summary, prepared.folder, stream)
        if spent is not None and not quiet:
            print_profile(spent, stream)
        if as_json:
            more = {} if spent is None else {"profile": spent.to_dict()}
            print(json.dumps({**summary, **more}, indent=2), flush=True)
        stream.flush()
    except OSError as error:  # how the run ended does not hang on whether that can be printed
        unprinted = f"the result could not be printed ({reason(error)}), and is in {prepared.folder}"
        print(f"warning: {one_line(unprinted)}", file=sys.stderr)
        streams.flush_quietly()
    if summary["outcome"] == OutcomeKind.INTERRUPTED:
        return interrupted.code
    # A goal that nobody saw is not reported as reached, whatever a blind robot believes.
    return REACHED if summary["goal_seen"] else NOT_REACHED


def explain(
    run: RunName,
    cycle: Annotated[int | None, typer.Option(min=0, help="Only this cycle, with all that is known of it.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the lines as JSON.")] = False,
) -> None:
    """Tell what a run did, saw and decided, and why, from its record alone."""
    from executive.trace.record.log import read_events
    from executive.trace.report.explain import explain as told
    from executive.trace.report.explain import print_lines

    folder = run_folder(run)
    lines = told(read_events(folder, images=False), cycle)
    if as_json:
        print(json.dumps({"run": str(folder), "lines": lines}, indent=2))
    else:
        print_lines(lines, sys.stdout)


def inspect(
    run: RunName,
    web: Annotated[bool, typer.Option("--web", help="In a browser on this machine, instead of a window.")] = False,
    png: Annotated[Path | None, typer.Option(help="Write a picture to this file instead; needs no screen.")] = None,
    at: Annotated[
        str | None,
        typer.Option(help="What --png shows: the end of a cycle (4), or a moment of the world's clock (13.4s)."),
    ] = None,
    panel: Annotated[str | None, typer.Option(help="The panel that --png shows alone, by its title.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what is shown where as JSON.")] = False,
) -> None:
    """Show a run in the Rerun viewer."""
    from executive.trace.terminal.console import waiting
    from executive.trace.viewer.process import inspect as open_viewer
    from executive.trace.viewer.rebuild import ensure_trace
    from executive.trace.viewer.screenshot import screenshot

    if at is not None and png is None:
        raise InputError("goes with --png; the viewer itself has a time line", key="--at")
    if panel is not None and png is None:
        raise InputError("goes with --png; in the viewer itself, double-click a panel's title", key="--panel")
    if web and png is not None:
        raise InputError("is one way to look, --png is another", key="--web")
    cycle, seconds = (None, None) if at is None else _moment(at)
    folder = run_folder(run)

    def tell(address: str) -> None:
        document = {"run": str(folder), "address": address}
        print(json.dumps(document) if as_json else f"{address}   (Ctrl-C ends it)", flush=True)

    if png is not None and not os.path.isdir(png.parent):
        raise InputError("there is no such folder", file="--png", key=str(png.parent))
    if png is not None:
        check_writable(png.parent, "png")
    with waiting(sys.stderr, "reading the events"):
        ensure_trace(folder)
    if png is None:
        open_viewer(folder, web, tell)
        return
    with waiting(sys.stderr, "drawing"):
        complaints = screenshot(folder, png, at_cycle=cycle, at_time=seconds, panel=panel)
    for complaint in complaints:
        print(f"warning: {complaint}", file=sys.stderr)
    if as_json:
        print(json.dumps({"run": str(folder), "png": str(png), "warnings": complaints}))


def _moment(text: str) -> tuple[int | None, float | None]:
    """`4` is the end of a cycle, `13.4s` the world's clock."""
    if re.fullmatch(r"\d{1,9}", text):
        return int(text), None
    if re.fullmatch(r"\d{1,9}(\.\d+)?s", text):
        return None, float(text[:-1])
    raise InputError(f"a cycle such as 4, or seconds of the world's clock such as 13.4s, not {text!r}", key="--at")


def run_folder(run: str, runs: Path = Path("runs")) -> Path:
    """The folder of a run, given that folder or its name in `runs`."""
    for folder in (Path(run), runs / run):
        if os.path.exists(folder):
            return folder
    made = [folder.name for folder in completion.latest(runs)]
    if not made:
        raise InputError(f"there is no such run; {runs} has none", file=run)
    close = difflib.get_close_matches(Path(run).name, made, n=1, cutoff=0.6)
    hint = f"did you mean {close[0]!r}? " if close and close[0] != made[0] else ""
    raise InputError(f"there is no such run; {hint}the latest in {runs} is {made[0]}", file=run)
