"""A campaign that a benchmark makes up, played and kept as one of `executive bench` is: the same command goes on."""

from __future__ import annotations

import shlex
import sys
from functools import partial
from pathlib import Path

from executive.cli.app import ctrl_c
from executive.lab.campaign.campaign_folder import CampaignFolder
from executive.lab.campaign.design import Campaign
from executive.lab.campaign.episode import Row, Simulated
from executive.lab.campaign.rows import read_rows
from executive.lab.common.process_pool import ProcessPool
from executive.lab.common.progress import show_progress


class StoppedError(Exception):
    """Somebody pressed Ctrl-C; what was found is kept."""


def play(campaign: Campaign, out: Path, jobs: int, name: str = "episodes") -> list[Row]:
    """The rows of a campaign's episodes, in their order; those that are missing in its folder are played.

    Raises:
        InputError: the folder holds something else.
        StoppedError: somebody pressed Ctrl-C.
    """
    with CampaignFolder(campaign, out, shlex.join(sys.argv), lambda line: print(line, file=sys.stderr)) as work:
        wanted = work.wanted()
        if work.missing(wanted):
            limit = 60 * campaign.minutes
            pool = ProcessPool(partial(Simulated, work.work), jobs, limit, single_threaded=True)
            with pool, ctrl_c(work.cancel), show_progress(sys.stderr, name) as watch:
                if not work.play(wanted, pool, watch):
                    raise StoppedError
    rows = read_rows(out, lambda line: None)
    return [rows[episode.key] for episode in wanted]
