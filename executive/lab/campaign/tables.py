"""Campaigns and comparisons as Markdown: for a README, a terminal, a file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from executive.lab.campaign.compare import HOW as PAIRED
from executive.lab.campaign.compare import Paired, Side
from executive.lab.campaign.intervals import Interval
from executive.lab.campaign.results import HOW, METRICS, NO_VALUE, Cell, Metric, Results, value
from executive.lab.common.html import DASH


def markdown(results: Results) -> str:
    """The whole report as text."""
    manifest, rows = results.manifest, results.rows
    parts = [f"# {manifest['title']}", manifest["about"]]
    for place, cells in by_place(results.cells).items():
        parts += [
            f"## {place}" if len(manifest["campaign"]["places"]) > 1 else "",
            _table(heads(), map(cells_of, cells)),
        ]
    left = manifest["episodes"] - len(rows)
    parts += [f"{left:,} of {manifest['episodes']:,} episodes are missing." if left else ""]
    parts += ["\n".join(f"- **{head(metric)}** ({metric.interval}): {metric.definition}" for metric in METRICS)]
    parts += [HOW, NO_VALUE, f"    {manifest['command']}"]
    return "\n\n".join(part for part in parts if part) + "\n"


MANY = 12
"""Problems, beyond which only what they have in common is shown: each is in the JSON."""


def by_place(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """The cells of each problem, by its name; after those of all problems together, where there are several."""
    places: dict[str, list[Cell]] = {}
    for cell in cells:
        places.setdefault(f"{cell.domain}/{cell.problem}", []).append(cell)
    if len(places) < 2:
        return places
    together = {f"all {len(places)} problems": pooled(cells)}
    return together if len(places) > MANY else {**together, **places}


def pooled(cells: Sequence[Cell]) -> list[Cell]:
    """The episodes of all problems, by faults and configuration, in the order of the cells."""
    groups: dict[tuple[str, str, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.faults, cell.estimator, cell.monitor), []).append(cell)
    domains = ", ".join(dict.fromkeys(cell.domain for cell in cells))
    made = []
    for key, members in groups.items():
        rows = tuple(row for cell in members for row in cell.rows)
        made.append(Cell(domains, "", *key, rows, {metric.name: value(metric, rows) for metric in METRICS}))
    return made


def heads() -> list[str]:
    """What the columns of a table of cells are called."""
    return ["faults", "configuration", "episodes", *map(head, METRICS)]


def head(metric: Metric) -> str:
    """A metric's name, with its unit."""
    unit = "%" if metric.share else metric.unit
    return f"{metric.head} ({unit})" if unit else metric.head


def cells_of(cell: Cell) -> list[str]:
    """A line of such a table."""
    said = [f"{value} {interval}".rstrip() for value, interval in (value_of(metric, cell) for metric in METRICS)]
    return [cell.faults, cell.configuration, f"{len(cell.rows):,}", *said]


def value_of(metric: Metric, cell: Cell) -> tuple[str, str]:
    """A value, or what stands in its place, and its interval."""
    value, interval, _ = cell.values[metric.name]
    if value is None:
        return ("n/a" if metric.of_looks and cell.is_blind else DASH), ""
    return _number(metric, value), _interval(metric, interval).strip()


def compared(comparisons: Sequence[tuple[Side, Side, Sequence[Paired]]]) -> str:
    """A comparison as text."""
    parts = []
    for first, second, pairs in comparisons:
        many = len({each.condition[:2] for each in pairs}) > 1
        columns = ["faults", "metric", "pairs", "first", "second", "difference", "only first", "only second", "p"]
        lines = []
        for each in pairs:
            where = "/".join(each.condition[:2])
            spread = each.second - each.first
            only = [str(count) for count in each.only] if each.only else [DASH, DASH]
            lines.append(
                [
                    f"{where}: {each.condition[2]}" if many else each.condition[2],
                    head(each.metric),
                    str(each.pairs),
                    _number(each.metric, each.first),
                    _number(each.metric, each.second),
                    f"{_number(each.metric, spread, '+')}{_interval(each.metric, each.difference, '+')}",
                    *only,
                    DASH if each.p is None else f"{each.p:.3g}",
                ]
            )
        parts += [f"first: {first.name}\nsecond: {second.name}", _table(columns, lines)]
    return "\n\n".join([*parts, PAIRED]) + "\n"


def _number(metric: Metric, value: float, sign: str = "") -> str:
    return f"{100 * value:{sign}.0f}" if metric.share else f"{value:{sign}.{_digits(metric)}f}"


def _interval(metric: Metric, interval: Interval | None, sign: str = "") -> str:
    if interval is None:
        return ""
    low, high = (_number(metric, value, sign) for value in interval)
    return f" [{low}, {high}]"


def _digits(metric: Metric) -> int:
    return 1 if metric.unit else 2


def _table(columns: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rule = ["---"] * len(columns)
    rows = [[cell.replace("|", "\\|") for cell in row] for row in (columns, rule, *lines)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
