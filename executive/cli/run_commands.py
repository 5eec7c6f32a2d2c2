"""The commands about runs: execute, resume, explain, inspect."""

from __future__ import annotations

import difflib
import json
import os
import re
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from executive.cli import completion, streams
from executive.cli.app import NOT_REACHED, REACHED, ctrl_c, one_line
from executive.cli.options import (
    Abstention,
    CalibrationFile,
    Cameras,
    DomainName,
    Instructions,
    LanguageModel,
    Model,
    NoInstructions,
    PerImage,
    ProblemFile,
    ProblemName,
    RunName,
    Server,
    TranslatorName,
    chosen_problem,
    estimator_config,
)
from executive.errors import InputError
from executive.types import OutcomeKind
from executive.util.files import check_writable, reason

if TYPE_CHECKING:
    from executive.app.run import Run


def run(
    domain: DomainName,
    problem_file: ProblemFile = None,
    problem: ProblemName = None,
    world: Annotated[
        str,
        typer.Option(
            help="mujoco (the simulator), or symbolic: no simulator, actions have the effects that the PDDL gives them."
        ),
    ] = "",
    no_effect: Annotated[
        float, typer.Option(help="With --world symbolic: the share of actions that do nothing.", metavar="SHARE")
    ] = 0.0,
    exogenous: Annotated[
        float, typer.Option(help="With --world symbolic: how often another agent acts, too.", metavar="SHARE")
    ] = 0.0,
    flip: Annotated[
        float, typer.Option(help="With --world symbolic: the share of answers that are wrong.", metavar="SHARE")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Fixes the scene and every random number.")] = 0,
    estimator: Annotated[
        str,
        typer.Option(
            help="What estimates the state: vlm (a model), oracle (ground truth), or none (open loop).",
            show_default="vlm; oracle in the symbolic world",
            autocompletion=completion.estimators,
        ),
    ] = "",
    vlm: Model = None,
    server: Server = None,
    translator: TranslatorName = "templates",
    llm: LanguageModel = None,
    instructions: Instructions = None,
    no_instructions: NoInstructions = False,
    per_image: PerImage = False,
    cameras: Cameras = None,
    abstention: Abstention = True,
    calibration: CalibrationFile = None,
    alpha: Annotated[
        float | None,
        typer.Option(help="Error rate: the share of looks that may have a wrong value; the rest is unknown."),
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Threshold each answer on its own, without unknowns; 0.5 as in the paper.")
    ] = None,
    memory: Annotated[bool, typer.Option("--memory/--no-memory", help="Combine looks with earlier ones.")] = True,
    trust: Annotated[Path | None, typer.Option(help="A file with the model's error rates.")] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(help="Break something: drop@4, shove:p=0.3 (see: executive faults); repeat it for more."),
    ] = None,
    faults: Annotated[
        Path | None, typer.Option(help="A TOML file with a list of faults, such as faults = [...].")
    ] = None,
    home_pose: Annotated[bool, typer.Option("--home-pose/--no-home-pose", help="Go home after each action.")] = True,
    grasp_noise: Annotated[float, typer.Option(min=0.0, help="Standard deviation of the grasp, in m.")] = 0.0,
    max_replans: Annotated[int | None, typer.Option(min=0, help="Give up after so many.")] = None,
    max_actions: Annotated[int | None, typer.Option(min=1, help="Give up after so many.")] = None,
    max_cycles: Annotated[int | None, typer.Option(min=1, help="Give up after so many.")] = None,
    max_looks: Annotated[int | None, typer.Option(min=1, help="Give up after so many.")] = None,
    max_seconds: Annotated[float | None, typer.Option(min=0.0, help="Give up after so many wall seconds.")] = None,
    patience: Annotated[
        float, typer.Option(help="Time limit of a look, a plan or an action, in wall seconds.")
    ] = 900.0,
    max_looks_again: Annotated[
        int | None, typer.Option(min=0, help="Looks again at uncertain atoms, in a row.")
    ] = None,
    max_questions: Annotated[int | None, typer.Option(min=1, help="Atoms that a look may ask about.")] = None,
    guard: Annotated[
        bool, typer.Option("--guard/--no-guard", help="Look at what is carried while it is carried.")
    ] = True,
    runs: Annotated[Path, typer.Option(help="Where the run's folder is made.")] = Path("runs"),
    name: Annotated[str | None, typer.Option(help="The name of the run's folder.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary on stdout, all else on stderr.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and --json.")] = False,
    viewer: Annotated[bool, typer.Option("--trace-viewer/--no-trace-viewer", help="Write trace.rrd, too.")] = True,
    view: Annotated[bool, typer.Option("--view", help="Watch it in the Rerun viewer while it goes on.")] = False,
    tree: Annotated[bool, typer.Option("--tree", help="Show the search trees of motion planning.")] = False,
) -> int:
    """Reach a problem's goal in the simulator or the symbolic world, and record everything that happens."""
    from executive.app.config import MUJOCO, RunConfig
    from executive.app.estimators import EstimatorConfig
    from executive.app.monitors import MonitorConfig
    from executive.faults import read_faults
    from executive.util import requirements

    if view and not viewer:
        raise InputError("needs the viewer's trace, which --no-trace-viewer turns off", key="--view")
    broken = (*(fault or ()), *(read_faults(faults) if faults is not None else ()))
    eye = estimator_config(
        vlm, server, translator, llm, instructions, no_instructions, per_image, cameras, abstention, calibration
    )
    config = RunConfig(
        domain=domain,
        problem=chosen_problem(problem_file, problem),
        world=world,
        no_effect=no_effect,
        exogenous=exogenous,
        flip=flip,
        seed=seed,
        estimator=estimator,
        faults=broken,
        home_pose=home_pose,
        grasp_noise=grasp_noise,
        max_replans=max_replans,
        max_actions=max_actions,
        max_cycles=max_cycles,
        max_looks=max_looks,
        max_seconds=max_seconds,
        patience=patience,
        max_looks_again=max_looks_again,
        max_questions=max_questions,
        guard=guard,
        runs=runs,
        name=name,
        viewer=viewer,
        tree=tree,
        eye=eye if eye != EstimatorConfig() else None,
        monitor=MonitorConfig(alpha, threshold, memory, trust),
    )
    requirements.require(config.world == MUJOCO)

    from executive.app import run as assemble
    from executive.trace.terminal.console import waiting
    from executive.trace.terminal.sink import TerminalSink
    from executive.trace.viewer.process import open_window

    stream = sys.stderr if as_json else sys.stdout
    with nullcontext() if quiet else waiting(stream, "loading planner and world"):
        window = open_window() if view else None
        prepared = assemble.Run(config, [] if quiet else [TerminalSink(stream)], view=window)
    return _carried_out(prepared, quiet, as_json)


def resume(
    run: RunName,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary on stdout, all else on stderr.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and --json.")] = False,
    view: Annotated[bool, typer.Option("--view", help="Watch it in the Rerun viewer while it goes on.")] = False,
) -> int:
    """Go on with a run whose process was killed, that crashed, or that was interrupted: look first, repeat nothing."""
    from executive.app.config import MUJOCO, read_config
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


def _carried_out(prepared: Run, quiet: bool, as_json: bool) -> int:
    """Execute a run, tell what it came to, and return the exit code."""
    from executive.faults import parse_fault
    from executive.trace.report.summary import print_summary

    stream = sys.stderr if as_json else sys.stdout
    with prepared, ctrl_c(prepared.cancel) as interrupted:
        summary = prepared.execute()
    struck = {each["spec"] for each in summary["faults"]}
    for spec in prepared.config.faults:
        if "@" in spec and str(parse_fault(spec)) not in struck and not quiet:
            print(f"warning: the fault {spec} never struck in {summary['actions']} actions", file=sys.stderr)
    if summary["outcome"] == OutcomeKind.INTERRUPTED and not quiet:
        print(f"go on with: executive resume {shlex.quote(str(prepared.folder))}", file=sys.stderr)
    try:
        if not quiet:
            print_summary(summary, prepared.folder, stream)
        if as_json:
            print(json.dumps(summary, indent=2), flush=True)
        stream.flush()
    except OSError as error:  # how the run ended does not hang on whether that can be printed
        unprinted = f"what it came to could not be printed ({reason(error)}), and is in {prepared.folder}"
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
        check_writable(png.parent, "--png")
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
