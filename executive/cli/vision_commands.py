"""Models that look: at pictures, at collections; how they err, and how they are grown."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from executive.app.config import EstimatorConfig
from executive.cli import completion
from executive.cli.app import NOT_REACHED, REACHED, SECONDS_TO_LEAVE, ctrl_c, one_line
from executive.cli.options import DomainName, ProblemName, with_options
from executive.cli.pool_options import PoolConfig
from executive.errors import InputError
from executive.lab.config import CollectConfig, EvalConfig, TrainConfig
from executive.util.files import check_writable


@with_options()
def estimate(
    domain: Annotated[
        str,
        typer.Argument(
            help="A folder with PDDL in it, or the name of a domain that comes along.",
            autocompletion=completion.domains,
        ),
    ],
    config: EstimatorConfig,
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
    truth: Annotated[
        Path | None, typer.Option(help="What is true in the video: frames.parquet of a film, or a CSV of intervals.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The folder for a video's plot and recording.")] = Path("."),
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON, with the prompts.")] = False,
) -> int:
    """Say how probable each atom of a domain is, judging by pictures or a video."""
    from executive.app import estimate as estimating
    from executive.s3e.video import read_frames

    if bool(image) == (video is not None):
        raise InputError("pass pictures with --image, or a video with --video", key="estimate")
    if truth is not None and (video is None or question):
        what = "goes with --video" if video is None else "is of atoms; questions of your own have none"
        raise InputError(what, key="--truth")
    images = estimating.read_images(image or [])
    frames = read_frames(video, every) if video is not None else iter(())
    if video is None:
        config.check_cameras(images)
    elif config.cameras:
        raise InputError("chooses among several pictures; a video has one", key="--cameras")
    if video is not None or out != Path("."):
        check_writable(out, "out")
    session = estimating.Session(domain, problem, config, atoms or (), question or ())
    for warning in session.warnings:
        print(f"warning: {one_line(warning)}", file=sys.stderr)
    if video is not None and truth is not None:
        from executive.lab.film.estimate import tell_scored_video

        answered = tell_scored_video(session, domain, problem, video, frames, truth, every, out, as_json)
    elif video is not None:
        answered = estimating.tell_video(session, video, frames, every, out, as_json)
    else:
        answered = estimating.tell_look(session, image or [], images, as_json)
    return REACHED if answered else NOT_REACHED


@with_options()
def collect(
    config: CollectConfig,
    pool_config: PoolConfig,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was collected as JSON.")] = False,
) -> int:
    """Collect pictures with ground truth, by random actions in the simulator (the paper's Appendix D)."""
    from executive.util import requirements

    requirements.require()

    from executive.lab.collection import collect as collecting
    from executive.lab.common.progress import show_progress, summary

    with (
        collecting.Collection(config, _warn) as collection,
        ctrl_c(collection.cancel, SECONDS_TO_LEAVE) as interrupted,
        show_progress(sys.stderr) as watch,
    ):
        manifest = collection.run(watch, lambda: pool_config.open(collection.player, config.jobs))
    if manifest is None:
        print(f"interrupted; finished episodes are kept, continue with: {config.command}", file=sys.stderr)
        return interrupted.code
    print(json.dumps(manifest, indent=2) if as_json else summary(manifest, config.out))
    return REACHED


@with_options()
def evaluate(
    config: EvalConfig,
    pool_config: PoolConfig,
    beside: Annotated[
        list[Path] | None, typer.Option(help="The folder of another evaluation, to show beside; repeat it for more.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The report's folder; in evaluations/ if not given.")] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="How many models look side by side; one if not given.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> int:
    """Measure a model on collected pictures or on films (Experiments 1 and 2 of the paper), and write a report."""
    from executive.lab.film.record import films_in

    if films_in(config.data):
        return _evaluate_films(config, pool_config, beside or (), out, jobs, as_json)

    from executive.lab.common.progress import show_progress
    from executive.lab.evaluation import report as reporting
    from executive.lab.evaluation import store
    from executive.lab.evaluation.evaluate import Evaluator
    from executive.trace.terminal.console import waiting

    others = [store.load(folder) for folder in beside or ()]
    again = shlex.join([*shlex.split(config.command), *(["--out", str(out)] if out is not None else [])])
    folder = out or store.default_folder(config)
    side_by_side = jobs or (1 if pool_config.engine == "processes" else None)
    with store.claimed(folder, again), Evaluator(config, _warn) as evaluator:
        with (
            ctrl_c(evaluator.cancel, SECONDS_TO_LEAVE) as interrupted,
            pool_config.open(evaluator.looker, side_by_side, single_threaded=(side_by_side or 0) > 1) as pool,
        ):
            with waiting(sys.stderr, "loading the model"):
                opened = evaluator.open(pool)
            with show_progress(sys.stderr, "looks") as watch:
                evaluation = evaluator.run(pool, opened, folder / store.KEPT, watch) if opened is not None else None
        if evaluation is None:
            print(f"interrupted; the looks that were taken are kept, continue with: {again}", file=sys.stderr)
            return interrupted.code
        document = reporting.write(folder, evaluation, evaluator.mistakes.sheet(), others, evaluator.published)
        (folder / store.KEPT).unlink(missing_ok=True)
    if as_json:
        print(json.dumps({**document, "report": str(folder / reporting.REPORT)}, indent=2))
    else:
        print(reporting.summary(document, folder))
    return REACHED if document["unanswered"] < document["asked"] else NOT_REACHED


def _evaluate_films(
    config: EvalConfig,
    pool_config: PoolConfig,
    beside: Sequence[Path],
    out: Path | None,
    jobs: int | None,
    as_json: bool,
) -> int:
    """Measure a model's accuracy on films (Experiment 2 of the paper)."""
    from executive.lab.common.progress import show_progress
    from executive.lab.evaluation import store
    from executive.lab.film.evaluate import FilmEvaluator, load_document

    others = [load_document(folder) for folder in beside]
    folder = out or store.default_folder(config)
    again = shlex.join([*shlex.split(config.command), "--out", str(folder)])
    evaluator = FilmEvaluator(config, folder)
    side_by_side = jobs or (1 if pool_config.engine == "processes" else None)
    with (
        store.claimed(folder, again),
        ctrl_c(evaluator.cancel, SECONDS_TO_LEAVE) as interrupted,
        pool_config.open(evaluator.watcher, side_by_side, single_threaded=(side_by_side or 0) > 1) as pool,
    ):
        with show_progress(sys.stderr, "frames") as watch:
            document = evaluator.run(pool, watch)
        if document is None:
            print(f"interrupted; films that were watched are kept, continue with: {again}", file=sys.stderr)
            return interrupted.code
        text = evaluator.tell(document, others)
    if as_json:
        print(json.dumps({**document, "report": str(folder)}, indent=2))
    else:
        print(f"{text}\n\nplots, recordings and answers: {folder}")
    asked = document["frames"]
    return REACHED if asked["unanswered"] < asked["asked"] else NOT_REACHED


def calibrate(
    domain: DomainName,
    evaluations: Annotated[
        list[Path],
        typer.Argument(
            help="Evaluations of one model (see: executive eval), ours or prediction sets of s3e 0.5; and folders of "
            "runs with it."
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="The model's folder, where runs find the file; or a file, for run --calibration.")
    ],
    problem: ProblemName = None,
    places: Annotated[
        bool, typer.Option("--places", help="Learn from runs where things usually are, for run --places.")
    ] = False,
    platt: Annotated[
        Path | None, typer.Option(help="Write the correction as a Platt profile of s3e 0.5, too, to this file.")
    ] = None,
    sets: Annotated[
        Path | None,
        typer.Option("--prediction-sets", help="Write the first evaluation as prediction sets of s3e 0.5, to a folder"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the fit as JSON.")] = False,
) -> None:
    """Learn from evaluations and runs how a model errs: for runs with it, and with --alpha."""
    if places:
        _learn_places(domain, evaluations, out, problem, as_json)
        return
    from executive.lab.evaluation import calibrate as calibrating
    from executive.lab.evaluation import prediction_sets

    file, fitted = calibrating.calibrate(domain, evaluations, out, problem)
    if platt is not None:
        calibrating.write_profile(file, platt)
    if sets is not None:
        prediction_sets.write(sets, calibrating.load_evaluation(evaluations[0]))
    if as_json:
        told = json.loads(file.read_text(encoding="utf-8"))
        print(json.dumps({"file": str(file), "calibration": told, "trust": told}, indent=2))  # trust: until 0.3
        return
    print(calibrating.summary(fitted))
    print(f"written to {file}")


@with_options()
def train(
    config: TrainConfig,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was made as JSON.")] = False,
) -> int:
    """Train a vision-language model for this domain on simulated pictures alone; says first how long that takes."""
    from executive.util import requirements

    requirements.require()

    from executive.lab.common.progress import expected, show_stages
    from executive.lab.training.train import Training

    training = Training(config)
    if not training.is_measured:
        print("measuring how fast this machine is", file=sys.stderr, flush=True)
    with ctrl_c(training.cancel, SECONDS_TO_LEAVE) as interrupted, show_stages(sys.stderr) as watch:
        model = training.run(watch, lambda seconds: print(expected(seconds), file=sys.stderr, flush=True))
    if model is None:
        print(f"interrupted; everything is kept, continue with: {config.command}", file=sys.stderr)
        return interrupted.code
    look = shlex.join(["executive", "run", config.domain, "--vlm", str(model)])
    print(json.dumps({"model": str(model), "run": look}, indent=2) if as_json else f"{model}; run with it: {look}")
    return REACHED


def _learn_places(domain: str, runs: list[Path], out: Path, problem: str | None, as_json: bool) -> None:
    from executive.lab.evaluation.places import learn_places

    check_writable(out.parent, "out")
    learned = learn_places(domain, runs, out, problem)
    if as_json:
        priors = {str(atom): value for atom, value in sorted(learned.priors.items())}
        print(json.dumps({"file": str(learned.file), "runs": learned.runs, "priors": priors}, indent=2))
        return
    for atom, value in sorted(learned.priors.items(), key=lambda each: (-each[1], each[0])):
        print(f"{value:6.3f}  {atom}")
    print(f"written to {learned.file}, from {learned.runs} run{'s' * (learned.runs != 1)}")


def _warn(line: str) -> None:
    print(f"warning: {one_line(line)}", file=sys.stderr)
