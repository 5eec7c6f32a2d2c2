"""The report of a campaign as one HTML file that opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from executive.lab.campaign.episode import FAILED
from executive.lab.campaign.plots import MISTAKEN, end_of
from executive.lab.campaign.results import HOW, METRICS, NO_VALUE, Cell, Results
from executive.lab.campaign.tables import by_place, head, heads, value_of
from executive.lab.common.html import DASH, render

if TYPE_CHECKING:
    from markupsafe import Markup

LISTED = 15
"""The largest number of listed episodes of each kind."""


def page(results: Results, figures: Mapping[str, tuple[str, bytes]]) -> str:
    """Return the whole file; `figures` are heading -> (description, PNG)."""
    manifest, rows = results.manifest, results.rows
    return render(
        "campaign",
        title=manifest["title"],
        about=manifest["about"],
        remarks=_remarks(results),
        places=[_place(name, cells) for name, cells in by_place(results.cells).items()],
        metrics=METRICS,
        head=head,
        heads=heads(),
        how=HOW,
        no_value=NO_VALUE,
        figures=figures,
        definitions=[(head(metric), metric.definition, metric.interval) for metric in METRICS],
        mistaken=[row for row in rows if end_of(row) == MISTAKEN],
        failed=[row for row in rows if row.outcome == FAILED],
        most=LISTED,
        command=manifest["command"],
        campaign=json.dumps(manifest["campaign"], indent=2),
    )


def _remarks(results: Results) -> list[str]:
    manifest, rows = results.manifest, results.rows
    failed, hours = sum(row.outcome == FAILED for row in rows), sum(row.wall_seconds for row in rows) / 3600
    said = [f"{len(rows):,} of {manifest['episodes']:,} episodes", f"{len(manifest['seeds']):,} seeds"]
    said += [f"{failed:,} failed"] if failed else []
    return [*said, f"{hours:.1f} hours of one core"]


def _place(name: str, cells: Sequence[Cell]) -> dict[str, Any]:
    """Return a problem's two tables: the share of successes per configuration and faults, and all metrics."""
    faults = list(dict.fromkeys(cell.faults for cell in cells))
    said: dict[str, dict[str, Markup]] = {}
    for cell in cells:
        said.setdefault(cell.configuration, {})[cell.faults] = _cell(*value_of(METRICS[0], cell))
    rows = [
        [cell.faults, cell.configuration, f"{len(cell.rows):,}", *(_cell(*value_of(each, cell)) for each in METRICS)]
        for cell in cells
    ]
    successes = [[who, *(by_faults.get(each, DASH) for each in faults)] for who, by_faults in said.items()]
    return {"name": name, "faults": faults, "successes": successes, "rows": rows}


def _cell(value: str, interval: str) -> Markup:
    from markupsafe import Markup, escape

    return Markup("{}<small>{}</small>").format(value, interval) if interval else escape(value)
