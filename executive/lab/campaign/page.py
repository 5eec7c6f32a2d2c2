"""The report of a campaign as one HTML file that opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape

from executive.lab import pages
from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.plots import MISTAKEN, end_of
from executive.lab.campaign.results import HOW, METRICS, Results, succeeded
from executive.lab.campaign.tables import by_place, cells_of, head, heads

LISTED = 15
"""Episodes of each kind that are listed as worth a look."""


def page(results: Results, figures: Mapping[str, tuple[str, bytes]]) -> str:
    """The whole file; `figures` are heading -> (what is to be seen, PNG)."""
    manifest, rows = results.manifest, results.rows
    parts = [
        f"<p>{escape(manifest['about'])}</p>" if manifest["about"] else "",
        pages.tags(_remarks(results)),
        pages.tiles(_tiles(results)),
        *_tables(results),
        *(pages.figure(heading, text, png) for heading, (text, png) in figures.items()),
        _definitions(),
        _listed("Episodes that claim what is not so", [row for row in rows if end_of(row) == MISTAKEN]),
        _listed("Episodes that could not be played to an end", [row for row in rows if row.outcome == FAILED]),
        _method(results),
    ]
    return pages.page(manifest["title"], parts)


def _remarks(results: Results) -> list[str]:
    manifest, rows = results.manifest, results.rows
    failed, hours = sum(row.outcome == FAILED for row in rows), sum(row.wall_seconds for row in rows) / 3600
    said = [f"{len(rows):,} of {manifest['episodes']:,} episodes", f"{len(manifest['seeds']):,} seeds"]
    said += [f"{failed:,} failed"] if failed else []
    return [*said, f"{hours:.1f} hours of one core"]


def _tiles(results: Results) -> list[tuple[str, str]]:
    """Each contender's share of successes, over all conditions."""
    made = []
    for name in results.contenders[:6]:
        rows = [row for cell in results.cells if cell.contender == name for row in cell.rows]
        made.append((pages.share(sum(map(succeeded, rows)) / len(rows)), f"success, {escape(name)}"))
    return made


def _tables(results: Results) -> list[str]:
    parts = []
    for place, cells in by_place(results.cells).items():
        rows = [[escape(text) for text in cells_of(cell)] for cell in cells]
        parts += [f"<h2>{escape(place)}</h2><p>{escape(HOW)}</p>", pages.table(heads(), rows)]
    return parts


def _definitions() -> str:
    rows = "".join(
        f'<tr><td>{escape(head(metric))}</td><td class="prose">{escape(metric.definition)}</td>'
        f"<td>{metric.interval}</td></tr>"
        for metric in METRICS
    )
    top = "<tr><th>metric</th><th>what it is</th><th>interval</th></tr>"
    return f'<h2>What the metrics are</h2><div class="wide"><table>{top}{rows}</table></div>'


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
