"""The results of a campaign: each metric with its interval per condition and configuration. The metrics are defined in
`METRICS`, and in every report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from executive.lab.campaign.campaign_folder import read_manifest
from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.intervals import RESAMPLES, Interval, bootstrap, wilson
from executive.lab.campaign.rows import read_rows
from executive.lab.common.html import DASH
from executive.types import OutcomeKind


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric. `of` returns its value for one episode, or None where it has none: 0 or 1 for a share, a number in
    `unit` for any other."""

    name: str
    head: str
    definition: str
    of: Callable[[Row], float | None]
    share: bool = True
    unit: str = ""
    of_looks: bool = False
    """Whether it is undefined for a configuration that does not look."""

    @property
    def interval(self) -> str:
        """The name of the method of its interval."""
        return "Wilson" if self.share else "bootstrap"


def claimed(row: Row) -> bool:
    """Whether the run ended with the belief that the goal holds: observed, or assumed by one that does not look."""
    return row.outcome in (OutcomeKind.GOAL_REACHED, OutcomeKind.PLAN_COMPLETED)


def succeeded(row: Row) -> bool:
    return claimed(row) and row.goal_true


def _delay(row: Row) -> float | None:
    noticed = [strike.noticed for strike in row.strikes if strike.noticed is not None]
    return fmean(noticed) if noticed else None


def _played(row: Row, value: float) -> float | None:
    return None if row.outcome == FAILED else value


METRICS = (
    Metric(
        "success",
        "success",
        "Of all episodes: the run ends as goal-reached (one that does not look: as plan-completed), and in truth the "
        "goal holds.",
        lambda row: float(succeeded(row)),
    ),
    Metric(
        "recovery",
        "recovery",
        "Success, of the episodes in which at least one fault struck. One that does not look has none: it can notice "
        "no fault, and where it succeeds all the same, the fault did no harm.",
        lambda row: float(succeeded(row)) if row.strikes and row.looks else None,
        of_looks=True,
    ),
    Metric(
        "false_success",
        "false success",
        "Of all episodes: the run ends as goal-reached (one that does not look: as plan-completed), and in truth the "
        "goal does not hold.",
        lambda row: float(claimed(row) and not row.goal_true),
    ),
    Metric(
        "false_alarm",
        "false alarm",
        "Of the episodes with an action whose outcome was looked at and was in truth as expected: after at least one "
        "of these actions it was taken to be otherwise, all looks at it considered.",
        lambda row: float(row.alarms > 0) if row.quiet else None,
        of_looks=True,
    ),
    Metric(
        "missed",
        "missed",
        "Of the episodes with an action whose outcome was looked at and was in truth not as expected: after at least "
        "one of these actions nothing of that was noticed.",
        lambda row: float(row.missed > 0) if row.failed else None,
        of_looks=True,
    ),
    Metric(
        "lost",
        "item lost",
        "Of all episodes: at the end an item lies where no atom is true of it (on the floor), out of everyone's reach.",
        lambda row: _played(row, float(bool(row.lost))),
    ),
    Metric(
        "replans",
        "replans",
        "Plans that were taken up after the first, an episode.",
        lambda row: _played(row, row.replans),
        share=False,
    ),
    Metric(
        "needless",
        "needless",
        "Decisions to plan anew, an episode, when what was left of the plan led to the goal from what was true.",
        lambda row: None if row.needless is None else _played(row, row.needless),
        share=False,
    ),
    Metric(
        "delay",
        "detection delay",
        "From a fault's striking to the first true sign of trouble (a skill that reports it, what is carried seen to "
        "be gone, a camera left out, no plan, an atom rightly seen to be not as expected), in simulated seconds: the "
        "mean over an episode's faults that were noticed. One that does not look notices nothing.",
        _delay,
        share=False,
        unit="s",
        of_looks=True,
    ),
    Metric(
        "time",
        "time",
        "An episode's length in simulated seconds, whatever its outcome.",
        lambda row: _played(row, row.sim_seconds),
        share=False,
        unit="s",
    ),
)
"""In the order in which they are shown."""

HOW = (
    "Every number has a 95 % interval in brackets. That of a share is Wilson's; that of a mean over episodes is a "
    f"percentile bootstrap with {RESAMPLES:,} resamples of the episodes, and has no width where all of them say the "
    "same. An episode that could not be played to an end (failed) is no success, and counts for nothing else."
)
NO_VALUE = f"n/a: undefined for a configuration that does not look. {DASH}: no episode has a value."


class Value(NamedTuple):
    """A metric's value over some episodes: a mean, of a share of zeros and ones; None where none says anything."""

    value: float | None
    interval: Interval | None
    episodes: int


class Cell(NamedTuple):
    """The episodes and metrics of one configuration under one condition."""

    domain: str
    problem: str
    faults: str
    estimator: str
    monitor: str
    rows: tuple[Row, ...]
    values: Mapping[str, Value]

    @property
    def configuration(self) -> str:
        return configuration_name(self.estimator, self.monitor)

    @property
    def is_blind(self) -> bool:
        """Whether there was no look in any of its episodes that could be played."""
        played = [row for row in self.rows if row.outcome != FAILED]
        return bool(played) and not any(row.looks for row in played)

    @property
    def condition(self) -> tuple[str, str, str]:
        return (self.domain, self.problem, self.faults)


class Results(NamedTuple):
    """A campaign's manifest, and its cells in the order of its file."""

    manifest: Mapping[str, Any]
    cells: tuple[Cell, ...]

    @property
    def rows(self) -> list[Row]:
        return [row for cell in self.cells for row in cell.rows]

    @property
    def configurations(self) -> list[str]:
        return list(dict.fromkeys(cell.configuration for cell in self.cells))

    def document(self) -> dict[str, Any]:
        """Everything as JSON."""
        rows, manifest = self.rows, self.manifest
        return {
            "title": manifest["title"],
            "about": manifest["about"],
            "command": manifest["command"],
            "episodes": len(rows),
            "wanted": manifest["episodes"],
            "failed": sum(row.outcome == FAILED for row in rows),
            "intervals": HOW,
            "metrics": {
                metric.name: {
                    "definition": metric.definition,
                    "share": metric.share,
                    "unit": metric.unit,
                    "interval": metric.interval,
                }
                for metric in METRICS
            },
            "cells": [_cell(cell) for cell in self.cells],
            "campaign": manifest["campaign"],
        }


def load_results(folder: Path, warn: Callable[[str], None] = lambda line: None) -> Results:
    """What there is of a campaign in its folder. Rows of what is not in its file any more are left out.

    Raises:
        InputError: there is no campaign, or its files cannot be read.
    """
    manifest = read_manifest(folder)
    return results(manifest, list(read_rows(folder, warn).values()))


def results(manifest: Mapping[str, Any], rows: Sequence[Row]) -> Results:
    """The cells that have rows, in the order of the campaign's file; their rows in the order of their seeds."""
    what, seeds = manifest["campaign"], {seed: place for place, seed in enumerate(manifest["seeds"])}
    places, faults, configurations = (
        {name: place for place, name in enumerate(what[key])} for key in ("places", "faults", "contenders")
    )
    groups: dict[tuple[str, str, str, str, str], list[Row]] = {}
    for row in rows:
        known = f"{row.domain}/{row.problem}" in places and row.faults in faults
        if known and configuration_name(row.estimator, row.monitor) in configurations and row.seed in seeds:
            key = (row.domain, row.problem, row.faults, row.estimator, row.monitor)
            groups.setdefault(key, []).append(row)

    def order(key: tuple[str, str, str, str, str]) -> tuple[int, int, int]:
        domain, problem, fault, *who = key
        return places[f"{domain}/{problem}"], faults[fault], configurations[configuration_name(*who)]

    cells = []
    for key in sorted(groups, key=order):
        members = tuple(sorted(groups[key], key=lambda row: seeds[row.seed]))
        cells.append(Cell(*key, members, {metric.name: value(metric, members) for metric in METRICS}))
    return Results(manifest, tuple(cells))


def value(metric: Metric, rows: Sequence[Row]) -> Value:
    """A metric's value over some episodes."""
    said = [number for row in rows if (number := metric.of(row)) is not None]
    if not said:
        return Value(None, None, 0)
    interval = wilson(round(sum(said)), len(said)) if metric.share else bootstrap(said)
    return Value(fmean(said), interval, len(said))


def configuration_name(estimator: str, monitor: str) -> str:
    """The name of an estimator with a monitor; see `executive.lab.campaign.design.Configuration`."""
    return f"{estimator}, {monitor}" if monitor else estimator


def _cell(cell: Cell) -> dict[str, Any]:
    return {
        "domain": cell.domain,
        "problem": cell.problem,
        "faults": cell.faults,
        "contender": cell.configuration,
        "episodes": len(cell.rows),
        "outcomes": dict(sorted(Counter(row.outcome for row in cell.rows).items())),
        "values": {
            name: {
                "value": each.value,
                "low": each.interval.low if each.interval else None,
                "high": each.interval.high if each.interval else None,
                "episodes": each.episodes,
            }
            for name, each in cell.values.items()
        },
    }
