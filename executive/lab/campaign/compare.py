"""Paired comparison of two configurations: the same problem, seed and faults on both sides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from executive.errors import OptionError, nearest
from executive.lab.campaign.episode import Row
from executive.lab.campaign.intervals import RESAMPLES, Interval, bootstrap, mcnemar
from executive.lab.campaign.results import METRICS, Metric, Results, load_results

HOW = (
    "Each number is over the pairs of episodes with the same domain, problem, seed and faults of which both sides say "
    "something. A difference is the second side's minus the first's; its 95 % interval is a percentile bootstrap with "
    f"{RESAMPLES:,} resamples of the pairs, and has no width where all of them differ alike. p is that of McNemar's "
    "exact test of the pairs in which the two differ; it is not corrected for the number of comparisons."
)


class Paired(NamedTuple):
    """One metric under one condition. `only` counts the pairs in which only the first or only the second side has what
    a share is of; it and `p` are None for other metrics."""

    condition: tuple[str, str, str]
    metric: Metric
    pairs: int
    first: float
    second: float
    difference: Interval | None
    only: tuple[int, int] | None
    p: float | None


class Side(NamedTuple):
    """One side of a comparison."""

    name: str
    rows: dict[tuple[str, str, str, int], Row]


def compare(first: str, second: str) -> list[tuple[Side, Side, list[Paired]]]:
    """Compare two campaigns, or two configurations: `FOLDER` or `FOLDER:CONFIGURATION`.

    Where no configuration is named, those that both folders have are compared, each with itself; or the one of each, if
    that is all there is.

    Raises:
        InputError: a folder holds no campaign, or there are no pairs.
    """
    found = []
    for one, other in _sides(_opened(first), _opened(second)):
        pairs = paired(one, other)
        if pairs:
            found.append((one, other, pairs))
    if not found:
        raise OptionError(
            f"{first} and {second} have no episode in common: same problem, seed and faults", option="compare"
        )
    return found


def paired(first: Side, second: Side) -> list[Paired]:
    """Every metric under every condition of which there are pairs, in the order of the first side's rows."""
    conditions: dict[tuple[str, str, str], list[tuple[Row, Row]]] = {}
    for key, row in first.rows.items():
        if key in second.rows:
            conditions.setdefault(key[:3], []).append((row, second.rows[key]))
    made = []
    for condition, pairs in conditions.items():
        for metric in METRICS:
            told = [(metric.of(one), metric.of(other)) for one, other in pairs]
            both = [(a, b) for a, b in told if a is not None and b is not None]
            if both:
                made.append(_paired(condition, metric, both))
    return made


def document(compared: Sequence[tuple[Side, Side, Sequence[Paired]]]) -> dict[str, Any]:
    """Everything as JSON."""
    return {
        "how": HOW,
        "comparisons": [
            {
                "first": first.name,
                "second": second.name,
                "conditions": [
                    {
                        "domain": each.condition[0],
                        "problem": each.condition[1],
                        "faults": each.condition[2],
                        "metric": each.metric.name,
                        "pairs": each.pairs,
                        "first": each.first,
                        "second": each.second,
                        "difference": each.second - each.first,
                        "low": each.difference.low if each.difference else None,
                        "high": each.difference.high if each.difference else None,
                        "only_first": each.only[0] if each.only else None,
                        "only_second": each.only[1] if each.only else None,
                        "p": each.p,
                    }
                    for each in pairs
                ],
            }
            for first, second, pairs in compared
        ],
    }


def _paired(condition: tuple[str, str, str], metric: Metric, both: Sequence[tuple[float, float]]) -> Paired:
    firsts, seconds = zip(*both, strict=True)
    only = p = None
    if metric.share:
        only = (sum(a > b for a, b in both), sum(b > a for a, b in both))
        p = mcnemar(*only)
    difference = bootstrap([b - a for a, b in both])
    return Paired(condition, metric, len(both), fmean(firsts), fmean(seconds), difference, only, p)


class _Opened(NamedTuple):
    folder: str
    results: Results
    configuration: str | None

    def side(self, configuration: str) -> Side:
        rows = [row for cell in self.results.cells if cell.configuration == configuration for row in cell.rows]
        keyed = {(row.domain, row.problem, row.faults, row.seed): row for row in rows}
        return Side(f"{self.folder}:{configuration}", keyed)


def _opened(what: str) -> _Opened:
    folder, configuration = what, None
    if not os.path.isdir(what) and ":" in what:
        folder, _, configuration = what.rpartition(":")
    results = load_results(Path(folder))
    if configuration is not None and configuration not in results.configurations:
        hint = nearest(configuration, results.configurations)
        raise OptionError(f"no configuration {configuration!r}; {hint}", file=folder, option="compare")
    if not results.cells:
        raise OptionError("has no episodes yet", file=folder, option="compare")
    return _Opened(folder, results, configuration)


def _sides(first: _Opened, second: _Opened) -> list[tuple[Side, Side]]:
    mine = [first.configuration] if first.configuration else first.results.configurations
    theirs = [second.configuration] if second.configuration else second.results.configurations
    if len(mine) == len(theirs) == 1:
        return [(first.side(mine[0]), second.side(theirs[0]))]
    common = [name for name in mine if name in theirs]
    if not common:
        message = (
            f"say which configurations: {first.folder}:{mine[0]} {second.folder}:{theirs[0]}, for example; "
            f"the first folder has {', '.join(mine)}, the second {', '.join(theirs)}"
        )
        raise OptionError(message, option="compare")
    return [(first.side(name), second.side(name)) for name in common]
