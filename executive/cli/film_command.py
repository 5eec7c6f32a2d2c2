"""The command that films runs."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from executive.cli.app import REACHED, SECONDS_TO_LEAVE, ctrl_c
from executive.cli.options import with_options
from executive.cli.pool_options import Jobs, PoolConfig
from executive.cli.run_commands import run_folder
from executive.errors import InputError
from executive.lab.film.config import FilmConfig


@with_options()
def film(
    config: FilmConfig,
    pool_config: PoolConfig,
    jobs: Jobs = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was filmed as JSON.")] = False,
) -> int:
    """Film a run in the simulator: a video, and the truth of each of its frames (Experiment 2 of the paper)."""
    from executive.util import requirements

    requirements.require()

    from executive.lab.common.progress import show_progress
    from executive.lab.film.filming import Filming
    from executive.lab.film.record import TRUTH, VIDEO, film_recording, read_about

    if config.run is not None:
        from executive.trace.record.recording import Recording
        from executive.trace.terminal.console import waiting

        folder = run_folder(str(config.run))
        if (domain := Recording(folder).started.domain) != config.domain:
            raise InputError(f"is of the domain {domain!r}, and not of {config.domain!r}", file=folder)
        with waiting(sys.stderr, "drawing"):
            film_recording(folder, config)
        folders = [config.out]
    else:
        filming = Filming(config)
        with (
            ctrl_c(filming.cancel, SECONDS_TO_LEAVE) as interrupted,
            pool_config.open(filming.filmer, jobs) as pool,
            show_progress(sys.stderr, "films") as watch,
        ):
            if filming.run(pool, watch) is None:
                print("interrupted; finished films are kept, continue with the same command", file=sys.stderr)
                return interrupted.code
        folders = [take.folder for take in filming.takes]
    made = [{"film": str(each / VIDEO), "truth": str(each / TRUTH), **read_about(each)} for each in folders]
    if as_json:
        print(json.dumps(made if config.films is not None else made[0], indent=2))
    else:
        for each in made:
            print(f"{each['film']}: {each['frames']} frames in {each['seconds']:.1f} s, {each['mid_poses']} mid-poses")
    return REACHED
