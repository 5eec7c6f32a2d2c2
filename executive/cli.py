"""The command line: each command a few lines over the library.

Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 something is missing on the machine, 70 a bug in Executive,
130 interrupted. Whatever goes wrong is one line on stderr; `executive --debug ...` shows the traceback instead.

Everything heavy is imported inside the command that needs it, so that `executive --help` answers at once.
"""

from __future__ import annotations

import difflib
import errno
import json
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer

from executive import __version__, completion
from executive.errors import ExecutiveError, InputError, MissingError
from executive.types import OutcomeKind

REACHED, NOT_REACHED, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130

app = typer.Typer(
    help="Plan, do one thing, look, and ask whether the world is as expected.",
    epilog="Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 missing on this machine, 130 interrupted.",
    rich_markup_mode=None,
)


def _problems(ctx: typer.Context) -> completion.Offer:
    # While an option still lacks its value, arguments wait to be given their names.
    return completion.problems(ctx.params.get("domain") or next(iter(ctx.args), None))


# What several commands ask for in the same way.
DomainName = Annotated[
    str,
    typer.Argument(
        help="A domain's folder, or the name of one that comes with Executive.", autocompletion=completion.domains
    ),
]
ProblemName = Annotated[
    str | None,
    typer.Option(help="One of the domain's problems (see: executive domains).", autocompletion=_problems),
]

# Which model looks, and how it is asked: the same for every command that looks.
Model = Annotated[str | None, typer.Option(help="The model: a folder, a hub id, or its name at --server.")]
Server = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server that has the model.")]
TranslatorName = Annotated[
    str,
    typer.Option(help="Who words the questions: templates, llm or none.", autocompletion=completion.translators),
]
LanguageModel = Annotated[str | None, typer.Option(help="The language model for --translator llm.")]
Instructions = Annotated[bool, typer.Option("--instructions/--no-instructions", help="Tell it how things look.")]
PerImage = Annotated[bool, typer.Option("--per-image", help="Ask about each picture alone, and average.")]
CalibrationFile = Annotated[Path | None, typer.Option(help="A file that corrects the probabilities.")]


@dataclass
class Settings:
    """What holds for every command."""

    debug: bool = False


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (`sys.argv` unless `arguments` are given) and leave the process with its exit code."""
    sys.exit(exit_code(sys.argv[1:] if arguments is None else arguments))


def exit_code(arguments: Sequence[str]) -> int:
    """Run one command; every error becomes a line on stderr and an exit code."""
    settings = Settings()
    try:
        code = app(list(arguments) or ["--help"], prog_name="executive", standalone_mode=False, obj=settings)
        sys.stdout.flush()
        return int(code or 0)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _read_no_more()
        return NOT_REACHED
    except Exception as error:
        if settings.debug:
            raise
        code, message = _told(error, arguments)
        print(f"error: {message}", file=sys.stderr)
        return code


def _read_no_more() -> None:
    """Whoever read our output has seen enough; Python's own flush at exit shall not complain."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _told(error: Exception, arguments: Sequence[str]) -> tuple[int, str]:
    """The exit code for an error, and the one line that tells of it."""
    match error:
        case ExecutiveError():
            return error.exit_code, _one_line(str(error))
        case typer.TyperException():
            context = getattr(error, "ctx", None)
            command = context.command_path if context is not None else "executive"
            return BAD_INPUT, f"{_one_line(error.format_message()).rstrip('.')}; see: {command} --help"
        case OSError(errno=errno.ENOSPC | errno.EDQUOT):
            return BAD_INPUT, f"there is no room to write to: {_one_line(str(error))}"
    again = shlex.join(["executive", "--debug", *arguments])
    return BUG, f"this is a bug in Executive: {_one_line(f'{type(error).__name__}: {error}')}; traceback: {again}"


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"executive {__version__}")
        raise typer.Exit


@app.callback()
def executive(
    context: typer.Context,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    context.obj.debug = debug


@app.command()
def run(
    domain: DomainName,
    problem: ProblemName = None,
    seed: Annotated[int, typer.Option(min=0, help="Fixes the scene and every chance after it.")] = 0,
    estimator: Annotated[
        str,
        typer.Option(
            help="Who says what is true: oracle, vlm (a model looks), or none (go on blindly).",
            autocompletion=completion.estimators,
        ),
    ] = "oracle",
    vlm: Model = None,
    server: Server = None,
    translator: TranslatorName = "templates",
    llm: LanguageModel = None,
    instructions: Instructions = True,
    per_image: PerImage = False,
    calibration: CalibrationFile = None,
    alpha: Annotated[
        float | None, typer.Option(help="Tell something wrongly in at most this share of looks; doubt the rest.")
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Take each answer alone at its word, above or below; 0.5 is the paper's way.")
    ] = None,
    memory: Annotated[bool, typer.Option("--memory/--no-memory", help="Weigh looks with what was seen before.")] = True,
    trust: Annotated[Path | None, typer.Option(help="A file that says how often the model errs.")] = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="Break something: drop@4, drop:p=0.3, miss@3, shove@3.")
    ] = None,
    home_pose: Annotated[bool, typer.Option("--home-pose/--no-home-pose", help="Go home after each action.")] = True,
    grasp_noise: Annotated[float, typer.Option(min=0.0, help="Standard deviation of the grasp, in m.")] = 0.0,
    max_replans: Annotated[int | None, typer.Option(min=0, help="Give up after so many.")] = None,
    max_actions: Annotated[int | None, typer.Option(min=1, help="Give up after so many.")] = None,
    runs: Annotated[Path, typer.Option(help="Where the run's folder is made.")] = Path("runs"),
    name: Annotated[str | None, typer.Option(help="The name of the run's folder.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary on stdout, all else on stderr.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and --json.")] = False,
    viewer: Annotated[bool, typer.Option("--trace-viewer/--no-trace-viewer", help="Write trace.rrd, too.")] = True,
) -> int:
    """Reach a problem's goal in the simulator, and write down all that happens."""
    from executive import machine

    machine.require()

    from executive import assemble
    from executive.eye import EyeConfig
    from executive.faults import parse_fault
    from executive.monitoring import MonitorConfig
    from executive.trace.console import waiting
    from executive.trace.report import print_summary
    from executive.trace.terminal import TerminalSink

    looking = estimator == "vlm" or vlm is not None or server is not None
    config = assemble.RunConfig(
        domain=domain,
        problem=problem,
        seed=seed,
        estimator=estimator,
        faults=tuple(fault or ()),
        home_pose=home_pose,
        grasp_noise=grasp_noise,
        max_replans=max_replans,
        max_actions=max_actions,
        runs=runs,
        name=name,
        viewer=viewer,
        eye=EyeConfig(vlm, server, translator, llm, instructions, per_image, calibration) if looking else None,
        monitor=MonitorConfig(alpha, threshold, memory, trust),
    )
    stream = sys.stderr if as_json else sys.stdout
    with nullcontext() if quiet else waiting(stream, "loading planner and simulator"):
        prepared = assemble.Run(config, [] if quiet else [TerminalSink(stream)])
    with prepared, _ctrl_c(prepared.cancel):
        summary = prepared.execute()
    struck = {each["spec"] for each in summary["faults"]}
    for spec in config.faults:
        if "@" in spec and str(parse_fault(spec)) not in struck and not quiet:
            print(f"warning: the fault {spec} never struck in {summary['actions']} actions", file=sys.stderr)
    try:
        if not quiet:
            print_summary(summary, prepared.folder, stream)
        if as_json:
            print(json.dumps(summary, indent=2), flush=True)
    except BrokenPipeError:  # how the run ended does not hang on who reads it
        _read_no_more()
    if summary["outcome"] == OutcomeKind.INTERRUPTED:
        return INTERRUPTED
    # A goal that nobody saw is not reported as reached, whatever a blind robot believes.
    return REACHED if summary["goal_seen"] else NOT_REACHED


@app.command()
def estimate(
    domain: Annotated[
        str,
        typer.Argument(
            help="A folder with PDDL in it, or the name of a domain that comes along.",
            autocompletion=completion.domains,
        ),
    ],
    problem: ProblemName = None,
    image: Annotated[list[Path] | None, typer.Option(help="A picture; repeat it to show several together.")] = None,
    video: Annotated[Path | None, typer.Option(help="A video instead of pictures.")] = None,
    every: Annotated[float, typer.Option(help="Seconds between the video's frames that are looked at.")] = 0.5,
    atoms: Annotated[
        list[str] | None, typer.Option(help="Only these, such as 'on-table(*,wood-table)' or robot-gripping.")
    ] = None,
    question: Annotated[
        list[str] | None, typer.Option(help="A question of your own, instead of all atoms; repeat it for more.")
    ] = None,
    vlm: Model = None,
    server: Server = None,
    translator: TranslatorName = "templates",
    llm: LanguageModel = None,
    instructions: Instructions = True,
    per_image: PerImage = False,
    calibration: CalibrationFile = None,
    out: Annotated[Path, typer.Option(help="The folder for a video's plot and recording.")] = Path("."),
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON, with the prompts.")] = False,
) -> int:
    """Say how probable each atom of a domain is, judging by pictures or a video."""
    from executive import estimate as estimating
    from executive.eye import EyeConfig
    from executive.s3e.video import read_frames

    if bool(image) == (video is not None):
        raise InputError("pass pictures with --image, or a video with --video", key="estimate")
    images = estimating.read_images(image or [])
    frames = read_frames(video, every) if video is not None else iter(())
    config = EyeConfig(vlm, server, translator, llm, instructions, per_image, calibration)
    if not out.is_dir():
        raise InputError("there is no such folder", file="--out", key=str(out))
    session = estimating.Session(domain, problem, config, atoms or (), question or ())
    for warning in session.warnings:
        print(f"warning: {_one_line(warning)}", file=sys.stderr)
    if video is not None:
        answered = estimating.tell_video(session, video, frames, every, out, as_json)
    else:
        answered = estimating.tell_look(session, image or [], images, as_json)
    return REACHED if answered else NOT_REACHED


@app.command()
def collect(
    domain: DomainName,
    out: Annotated[Path, typer.Option(help="The folder for the data; one that was begun is gone on with.")],
    points: Annotated[int, typer.Option(min=1, help="How many completed actions to picture.")] = 2000,
    problem: ProblemName = None,
    seed: Annotated[int, typer.Option(min=0, help="Fixes everything, however many processes share the work.")] = 0,
    home_pose: Annotated[bool, typer.Option("--home-pose/--no-home-pose", help="Go home after each action.")] = True,
    grasp_noise: Annotated[float, typer.Option(min=0.0, help="Standard deviation of the grasp, in m.")] = 0.010,
    slips: Annotated[float, typer.Option(min=0.0, max=1.0, help="Chance of losing what is carried.")] = 0.05,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; as many as there are cores if not given.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was collected as JSON.")] = False,
) -> int:
    """Collect pictures and the truth about them, by random actions in the simulator (the paper's Appendix D)."""
    from executive import machine

    machine.require()

    from executive.lab import collect as collecting
    from executive.lab.progress import summary, told

    config = collecting.CollectConfig(domain, out, points, problem, seed, home_pose, grasp_noise, slips, jobs)
    with (
        collecting.Collection(config, lambda line: print(f"warning: {_one_line(line)}", file=sys.stderr)) as collection,
        _ctrl_c(collection.cancel),
        told(sys.stderr) as watch,
    ):
        manifest = collection.run(watch)
    if manifest is None:
        print(f"interrupted; finished episodes are kept, go on with: {config.command}", file=sys.stderr)
        return INTERRUPTED
    print(json.dumps(manifest, indent=2) if as_json else summary(manifest, out))
    return REACHED


@app.command("eval")
def evaluate(
    domain: DomainName,
    data: Annotated[Path, typer.Argument(help="A finished collection (see: executive collect).")],
    problem: ProblemName = None,
    vlm: Model = None,
    server: Server = None,
    translator: TranslatorName = "templates",
    llm: LanguageModel = None,
    instructions: Instructions = True,
    per_image: PerImage = False,
    calibration: CalibrationFile = None,
    looks: Annotated[int | None, typer.Option(min=1, help="Only the first ones.")] = None,
    paraphrases: Annotated[Path | None, typer.Option(help="A file with other wordings of the questions.")] = None,
    rename: Annotated[bool, typer.Option("--rename/--no-rename", help="Use that file's names of objects, too.")] = True,
    disturb: Annotated[
        list[str] | None, typer.Option(help="Make looks harder: lights, cameras, jpeg=40; repeat it for more.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Fixes which wording and what disturbance a look gets.")] = 0,
    beside: Annotated[
        list[Path] | None, typer.Option(help="The folder of another evaluation, to show beside; repeat it for more.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The report's folder; in evaluations/ if not given.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what it came to as JSON.")] = False,
) -> int:
    """Measure how well a model sees, on collected pictures (Experiment 1 of the paper), and write a report."""
    from executive.eye import EyeConfig
    from executive.lab import evaluation_report as reporting
    from executive.lab import evaluation_store as store
    from executive.lab.evaluate import EvalConfig, Evaluator
    from executive.lab.progress import told
    from executive.trace.console import waiting

    eye = EyeConfig(vlm, server, translator, llm, instructions, per_image, calibration)
    config = EvalConfig(domain, data, eye, problem, looks, paraphrases, rename, tuple(disturb or ()), seed)
    others = [store.load(folder) for folder in beside or ()]
    with store.claimed(out or store.default_folder(config)) as folder:
        with waiting(sys.stderr, "loading the model"):
            evaluator = Evaluator(config, lambda line: print(f"warning: {_one_line(line)}", file=sys.stderr))
        with evaluator, _ctrl_c(evaluator.cancel), told(sys.stderr, "looks") as watch:
            evaluation = evaluator.run(watch)
        if evaluation is None:
            print("interrupted; nothing was written", file=sys.stderr)
            return INTERRUPTED
        document = reporting.write(folder, evaluation, evaluator.mistakes.sheet(), others, evaluator.published)
    if as_json:
        print(json.dumps({**document, "report": str(folder / reporting.REPORT)}, indent=2))
    else:
        print(reporting.summary(document, folder))
    return REACHED if document["unanswered"] < document["asked"] else NOT_REACHED


@app.command()
def calibrate(
    domain: DomainName,
    evaluations: Annotated[list[Path], typer.Argument(help="Evaluations of one model (see: executive eval).")],
    out: Annotated[Path, typer.Option(help="The model's folder, where runs find it; or a file, for run --trust.")],
    problem: ProblemName = None,
) -> None:
    """Learn from evaluations how far a model can be trusted, for runs with it, and with --alpha."""
    from executive.lab import calibrate as calibrating

    file, trust = calibrating.calibrate(domain, evaluations, out, problem)
    print(calibrating.summary(trust))
    print(f"written to {file}")


@app.command()
def train(
    domain: DomainName,
    out: Annotated[Path, typer.Option(help="The folder for everything; a training that was begun is gone on with.")],
    problem: ProblemName = None,
    recipe: Annotated[str, typer.Option(help="How large an eye, and how long: small, or smallest to try it out.")] = (
        "small"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Fixes everything but rounding.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes and threads; all cores if not given.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was made as JSON.")] = False,
) -> int:
    """Grow a vision-language model that sees this domain, from simulated pictures alone; takes a night."""
    from executive import machine

    machine.require()

    from executive.lab.progress import stages
    from executive.lab.train import TrainConfig, Training

    training = Training(TrainConfig(domain, out, problem, recipe, seed, jobs))
    with _ctrl_c(training.cancel), stages(sys.stderr) as watch:
        model = training.run(watch)
    if model is None:
        print(f"interrupted; everything is kept, go on with: {training.config.command}", file=sys.stderr)
        return INTERRUPTED
    look = shlex.join(["executive", "run", domain, "--vlm", str(model)])
    print(json.dumps({"model": str(model), "run": look}, indent=2) if as_json else f"{model}; look through it: {look}")
    return REACHED


@contextmanager
def _ctrl_c(cancel: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C once cancels, which leaves the arm at rest and the trace whole; a second one leaves at once."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        cancel()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@app.command()
def explain(
    run: Annotated[str, typer.Argument(help="A run's folder, or its name in runs/.", autocompletion=completion.runs)],
    cycle: Annotated[int | None, typer.Option(min=0, help="Only this cycle, with all that is known of it.")] = None,
) -> None:
    """Tell what a run did, saw and decided, and why, from its record alone."""
    from executive.trace.events import read_events
    from executive.trace.explain import explain as told
    from executive.trace.explain import print_lines

    print_lines(told(read_events(_run_folder(run), images=False), cycle), sys.stdout)


@app.command()
def inspect(
    run: Annotated[str, typer.Argument(help="A run's folder, or its name in runs/.", autocompletion=completion.runs)],
    web: Annotated[bool, typer.Option("--web", help="In a browser on this machine, instead of a window.")] = False,
    png: Annotated[Path | None, typer.Option(help="Write a picture to this file instead; needs no screen.")] = None,
    at: Annotated[
        int | None, typer.Option(min=0, help="The cycle that --png shows; the last one if not given.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what is shown where as JSON.")] = False,
) -> None:
    """Show a run in the Rerun viewer."""
    from executive.trace.console import waiting
    from executive.trace.rebuild import ensure_trace
    from executive.trace.screenshot import screenshot
    from executive.trace.viewer_process import inspect as open_viewer

    if at is not None and png is None:
        raise InputError("goes with --png; the viewer itself has a time line", key="--at")
    if web and png is not None:
        raise InputError("is one way to look, --png is another", key="--web")
    folder = _run_folder(run)

    def tell(address: str) -> None:
        document = {"run": str(folder), "address": address}
        print(json.dumps(document) if as_json else f"{address}   (Ctrl-C ends it)", flush=True)

    if png is not None and not png.resolve().parent.is_dir():
        raise InputError("there is no such folder", file="--png", key=str(png.parent))
    with waiting(sys.stderr, "reading the events"):
        ensure_trace(folder)
    if png is None:
        open_viewer(folder, web, tell)
        return
    complaints = screenshot(folder, png, at_cycle=at)
    for complaint in complaints:
        print(f"warning: {complaint}", file=sys.stderr)
    if as_json:
        print(json.dumps({"run": str(folder), "png": str(png), "warnings": complaints}))


def _run_folder(run: str, runs: Path = Path("runs")) -> Path:
    """The folder of a run, given that folder or its name in `runs`."""
    for folder in (Path(run), runs / run):
        if folder.exists():
            return folder
    made = [folder.name for folder in completion.latest(runs)]
    if not made:
        raise InputError(f"there is no such run; {runs} has none", file=run)
    close = difflib.get_close_matches(Path(run).name, made, n=1, cutoff=0.6)
    hint = f"did you mean {close[0]!r}? " if close and close[0] != made[0] else ""
    raise InputError(f"there is no such run; {hint}the latest in {runs} is {made[0]}", file=run)


@app.command()
def domains(
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON.")] = False,
) -> None:
    """List the domains that come with Executive, and their problems."""
    from executive.domain import list_domains, load_domain

    listed: list[dict[str, Any]] = []
    for name in list_domains():
        domain = load_domain(name)
        default = {"name": domain.task.problem, "command": f"executive run {name}"}
        others = [
            {"name": problem.stem, "command": f"executive run {name} --problem {problem.stem}"}
            for problem in sorted((domain.folder / "problems").glob("*.pddl"))
        ]
        listed.append({"name": name, "description": domain.description or domain.title, "problems": [default, *others]})
    if as_json:
        print(json.dumps(listed, indent=2))
        return
    for entry in listed:
        print(f"{entry['name']}: {entry['description']}")
        for index, problem in enumerate(entry["problems"]):
            print(f"    {problem['command']}" + (f"    # {problem['name']}" if index == 0 else ""))


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="What the domain is called, such as my-domain; its folder, too.")],
    parent: Annotated[Path, typer.Option("--in", help="Where that folder is made.")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="Print what was made as JSON.")] = False,
) -> None:
    """Make a domain of your own: a folder that runs at once, with every key in it explained."""
    from executive.scaffold import create

    made = create(name, parent)
    if as_json:
        files = [str(file) for file in made.files]
        print(json.dumps({"folder": str(made.folder), "files": files, "commands": made.commands}, indent=2))
        return
    print(f"made {made.folder}, {len(made.files)} files that explain themselves; now try")
    for command in made.commands:
        print(f"    {command}")


@app.command()
def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print it as a block for a bug report.")] = False,
) -> int:
    """Say what this machine has and lacks, each with the command that mends it."""
    from executive import doctor as examination

    if as_json and markdown:
        raise InputError("is one way to print it, --json is another", key="--markdown")
    if as_json or markdown:
        findings = list(examination.examine())
        print(json.dumps(examination.as_json(findings), indent=2) if as_json else examination.as_markdown(findings))
    else:
        findings = examination.tell(examination.examine(), sys.stdout)
    return REACHED if examination.ready(findings) else MissingError.exit_code
