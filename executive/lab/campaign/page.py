"""The report of a campaign as one HTML file that opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape

from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.plots import MISTAKEN, end_of
from executive.lab.campaign.results import HOW, METRICS, NO_VALUE, Cell, Results
from executive.lab.campaign.tables import by_place, head, heads, value_of
from executive.lab.common import html

LISTED = 15
"""The largest number of listed episodes of each kind."""


def page(results: Results, figures: Mapping[str, tuple[str, bytes]]) -> str:
    """The whole file; `figures` are heading -> (description, PNG)."""
    manifest, rows = results.manifest, results.rows
    parts = [
        f"<p>{html.prose(manifest['about'])}</p>" if manifest["about"] else "",
        html.tags(_remarks(results)),
        *_tables(results),
        *(html.figure(heading, text, png) for heading, (text, png) in figures.items()),
        _definitions(),
        _listed("Episodes that claim what is not so", [row for row in rows if end_of(row) == MISTAKEN]),
        _listed("Episodes that could not be played to an end", [row for row in rows if row.outcome == FAILED]),
        _method(results),
    ]
    return html.page(manifest["title"], parts)


def _remarks(results: Results) -> list[str]:
    manifest, rows = results.manifest, results.rows
    failed, hours = sum(row.outcome == FAILED for row in rows), sum(row.wall_seconds for row in rows) / 3600
    said = [f"{len(rows):,} of {manifest['episodes']:,} episodes", f"{len(manifest['seeds']):,} seeds"]
    said += [f"{failed:,} failed"] if failed else []
    return [*said, f"{hours:.1f} hours of one core"]


def _tables(results: Results) -> list[str]:
    parts = []
    for place, cells in by_place(results.cells).items():
        rows = [
            [escape(cell.faults), escape(cell.configuration), f"{len(cell.rows):,}"]
            + [_cell(*value_of(metric, cell)) for metric in METRICS]
            for cell in cells
        ]
        parts += [
            f"<h2>{escape(place)}</h2>",
            _successes(cells),
            f"<p>{escape(HOW)} {escape(NO_VALUE)}</p>",
            html.table(heads(), rows, texts=2, grouped=True),
        ]
    return parts


def _successes(cells: Sequence[Cell]) -> str:
    """The share of successes per configuration and list of faults, in large print."""
    faults = list(dict.fromkeys(cell.faults for cell in cells))
    success, said = METRICS[0], dict[str, dict[str, str]]()
    for cell in cells:
        said.setdefault(cell.configuration, {})[cell.faults] = _cell(*value_of(success, cell))
    rows = [[escape(name), *(by_faults.get(each, html.DASH) for each in faults)] for name, by_faults in said.items()]
    return f'<div class="large">{html.table([head(success), *faults], rows)}</div>'


def _cell(value: str, interval: str) -> str:
    return f"{escape(value)}<small>{escape(interval)}</small>" if interval else escape(value)


def _definitions() -> str:
    rows = [[escape(head(metric)), escape(metric.definition), metric.interval] for metric in METRICS]
    return f"<h2>What the metrics are</h2>{html.table(('metric', 'what it is', 'interval'), rows, texts=3)}"


def _listed(heading: str, rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    shown = "".join(
        f"<p><b>{escape(row.faults)}, seed {row.seed}</b> {escape(row.error)}</p><pre>{escape(row.command)}</pre>"
        for row in rows[:LISTED]
    )
    more = f"<p>and {len(rows) - LISTED:,} more</p>" if len(rows) > LISTED else ""
    return f"<h2>{heading}</h2><p>{len(rows):,} of them. Each command plays one again.</p>{shown}{more}"


def _method(results: Results) -> str:
    manifest = results.manifest
    what = escape(json.dumps(manifest["campaign"], indent=2))
    return f"<h2>How this was measured</h2><pre>{escape(manifest['command'])}</pre><pre>{what}</pre>"
