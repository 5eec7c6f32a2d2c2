"""Campaigns: many runs under many conditions, scored and compared."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from executive.cli.app import NOT_REACHED, REACHED, SECONDS_TO_LEAVE, ctrl_c, one_line
from executive.cli.options import with_options
from executive.cli.pool_options import Jobs, PoolConfig
from executive.errors import InputError

if TYPE_CHECKING:
    from executive.lab.campaign.design import Episode
    from executive.lab.campaign.episode import Row
    from executive.lab.common.process_pool import WorkerPool


@with_options()
def bench(
    pool_config: PoolConfig,
    campaign: Annotated[
        Path | None, typer.Argument(help="A campaign's file, such as benchmarks/campaigns/grasp-drop.toml.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The folder for everything, which can be continued later; campaigns/NAME if not given."),
    ] = None,
    only: Annotated[list[str] | None, typer.Option(help="Only this configuration; repeat it for more.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Only the first so many seeds.")] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed episodes again.")] = False,
    jobs: Jobs = None,
    share_model: Annotated[
        bool | None,
        typer.Option(
            "--share-model/--no-share-model",
            help="One process holds the model for all; by default where there is a GPU and more than one job.",
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Run nothing: report what there is in this folder.")] = None,
    compare: Annotated[
        tuple[str, str] | None,
        typer.Option(help="Run nothing: compare two folders, or FOLDER:CONFIGURATION with another.", metavar="A B"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> int:
    """Run a campaign: problems, seeds and faults, with several estimators and monitors; scored by ground truth.

    The exit code is 0 if all episodes were run, 1 if some failed.
    """
    if (campaign is not None) + (report is not None) + (compare is not None) != 1:
        raise InputError("name a campaign's file, or a folder with --report, or two with --compare", key="bench")
    if compare is not None:
        return _compare(*compare, as_json)
    if report is not None:
        return _report(report, as_json)
    assert campaign is not None
    if share_model is not None and pool_config.engine == "ray":
        key = "--share-model" if share_model else "--no-share-model"
        raise InputError("goes with --engine processes; with Ray, each process holds a model of its own", key=key)

    from executive.util import requirements

    requirements.require()

    from executive.lab.campaign.campaign_folder import CampaignFolder
    from executive.lab.campaign.config_file import check, read_campaign
    from executive.lab.campaign.episode import Simulated
    from executive.lab.common.progress import show_progress
    from executive.lab.common.ray_pool import RayPool

    design = read_campaign(campaign)
    folder = out or Path("campaigns") / campaign.stem
    again = ["executive", "bench", str(campaign), *(["--out", str(out)] if out is not None else [])]
    with CampaignFolder(design, folder, shlex.join(again), _warn) as work:
        wanted = work.wanted(only or (), seeds)
        if retry:
            work.retry()
        if missing := work.missing(wanted):
            check(missing)
            limit = 60 * design.minutes
            if pool_config.engine == "ray":
                opened: AbstractContextManager[WorkerPool[Episode, Row]] = RayPool(
                    Simulated, jobs, limit, pool_config.address
                )
            else:
                opened = _processes(work.work, missing, jobs, limit, share_model)
            with (
                ctrl_c(work.cancel, SECONDS_TO_LEAVE) as interrupted,
                opened as pool,
                show_progress(sys.stderr, "episodes") as watch,
            ):
                whole = work.play(wanted, pool, watch)
            if not whole:
                print(f"interrupted; finished episodes are kept, continue with: {shlex.join(again)}", file=sys.stderr)
                return interrupted.code
    return _report(folder, as_json)


@contextmanager
def _processes(
    work: Path, episodes: Sequence[Episode], jobs: int | None, limit: float, share: bool | None
) -> Iterator[WorkerPool[Episode, Row]]:
    """Open worker processes of this machine, and one more that holds the model for all of them if `share` says so; by
    default, if a GPU would otherwise hold it several times."""
    from executive.lab.campaign.episode import Simulated, loads_model
    from executive.lab.common.process_pool import ProcessPool
    from executive.s3e.backends.loading import has_gpu
    from executive.s3e.backends.shared_host import ModelHost
    from executive.util.threads import cores

    if not any(map(loads_model, episodes)):
        share = False
    elif share is None:
        share = (jobs or cores()) > 1 and has_gpu()
    if not share:
        with ProcessPool(partial(Simulated, work), jobs, limit, single_threaded=True) as pool:
            yield pool
        return
    with (
        ModelHost() as host,
        ProcessPool(partial(Simulated, work, host.address), jobs, limit, host.revive, single_threaded=True) as pool,
    ):
        yield pool


def _report(folder: Path, as_json: bool) -> int:
    from executive.lab.campaign import report
    from executive.lab.campaign.results import load_results
    from executive.lab.campaign.tables import markdown

    results = load_results(folder, _warn)
    document = report.write(folder, results)
    if as_json:
        print(json.dumps({**document, "report": str(folder / report.PAGE)}, indent=2))
    else:
        print(f"{markdown(results)}\nreport: {folder / report.PAGE}")
    return NOT_REACHED if document["failed"] else REACHED


def _compare(first: str, second: str, as_json: bool) -> int:
    from executive.lab.campaign import compare
    from executive.lab.campaign.tables import compared

    pairs = compare.compare(first, second)
    print(json.dumps(compare.document(pairs), indent=2) if as_json else compared(pairs))
    return REACHED


def _warn(line: str) -> None:
    print(f"warning: {one_line(line)}", file=sys.stderr)
