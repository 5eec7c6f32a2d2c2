"""The figures of a campaign: every metric under every condition, and the outcomes of the episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.results import METRICS, Cell, Metric, claimed
from executive.lab.campaign.tables import head
from executive.lab.common import figures
from executive.types import OutcomeKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ACROSS = 3
_BESIDE = 0.7
"""The share of the distance between two conditions that the configurations' marks take up."""

MISTAKEN = "taken to be reached, but it is not"
ENDS: Mapping[str, str] = {
    OutcomeKind.GOAL_REACHED.value: "#3d8b5f",
    OutcomeKind.PLAN_COMPLETED.value: "#7fb596",
    MISTAKEN: "#c0341d",
    OutcomeKind.PARTIAL.value: "#d9a441",
    OutcomeKind.GAVE_UP.value: "#8d99a6",
    OutcomeKind.NO_PLAN.value: "#b9c2cb",
    OutcomeKind.INTERRUPTED.value: "#dfe3e8",
    OutcomeKind.CRASHED.value: "#6b4f9b",
    FAILED: "#22262b",
}
"""The ways in which an episode can end, each with its colour."""


def metrics(cells: Sequence[Cell]) -> bytes:
    """A PNG: a panel for each metric that these cells (of one problem) say anything about; from left to right the
    faults, a colour for each configuration, and 95 % intervals."""
    shown = [metric for metric in METRICS if any(cell.values[metric.name].episodes for cell in cells)]
    faults = list(dict.fromkeys(cell.faults for cell in cells))
    configurations = list(dict.fromkeys(cell.configuration for cell in cells))
    across = min(_ACROSS, max(1, len(shown)))
    rows = math.ceil(max(1, len(shown)) / across)
    figure = figures.figure(max(3.3, 1.2 + 0.62 * len(faults)) * across, 2.5 * rows + 0.25)
    grid = figure.subplots(rows, across, squeeze=False)
    for axes, metric in zip(grid.flat, shown, strict=False):
        _panel(axes, metric, cells, faults, configurations)
    for axes in grid.flat[len(shown) :]:
        axes.axis("off")
    figures.legend(figure, configurations, columns=min(6, len(configurations)))
    return figures.png(figure)


def outcomes(cells: Sequence[Cell]) -> bytes:
    """A PNG: a bar for each of these cells (of one problem) with the shares of episodes that ended in each way."""
    figure = figures.figure(9.2, 0.6 + 0.28 * len(cells) + 0.18 * len({cell.faults for cell in cells}))
    axes, place, places = figure.subplots(), 0.0, list[float]()
    used: dict[str, None] = {}
    for number, cell in enumerate(cells):
        place += 1.0 + (0.6 if number and cells[number - 1].faults != cell.faults else 0.0)
        places.append(place)
        left = 0.0
        ends = [end_of(row) for row in cell.rows]
        for end, colour in ENDS.items():
            share = ends.count(end) / len(ends)
            if share:
                used[end] = None
                axes.barh(place, share, left=left, height=0.72, color=colour)
                if share >= 0.06:
                    ink = "white" if end != OutcomeKind.INTERRUPTED else figures.INK
                    middle, text = left + share / 2, f"{100 * share:.0f}"
                    axes.text(middle, place, text, ha="center", va="center", color=ink, fontsize=7)
            left += share
    axes.set_yticks(places, [f"{_plain(cell.faults)}, {_plain(cell.configuration)}" for cell in cells], fontsize=7.5)
    axes.set(xlim=(0.0, 1.0), ylim=(places[-1] + 0.7, 0.3), xticks=(0, 0.25, 0.5, 0.75, 1))
    axes.set_xticklabels(["0", "25", "50", "75", "100 %"], fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    from matplotlib.patches import Patch

    handles = [Patch(color=ENDS[end], label=end) for end in ENDS if end in used]
    figure.legend(handles=handles, loc="outside upper left", frameon=False, fontsize=8, ncols=4)
    return figures.png(figure)


def end_of(row: Row) -> str:
    """The way in which an episode ended: its outcome, or `MISTAKEN` where it claimed a goal that does not hold."""
    return MISTAKEN if claimed(row) and not row.goal_true else row.outcome


def _panel(
    axes: Axes, metric: Metric, cells: Sequence[Cell], faults: Sequence[str], configurations: Sequence[str]
) -> None:
    axes.set_title(head(metric), fontsize=8.5, loc="left", color=figures.INK)
    scale = 100.0 if metric.share else 1.0
    for number, name in enumerate(configurations):
        points = []
        for cell in cells:
            told = cell.values[metric.name]
            if cell.configuration == name and told.value is not None:
                offset = _BESIDE * ((number + 0.5) / len(configurations) - 0.5)
                low, high = told.interval or (told.value, told.value)
                points.append((faults.index(cell.faults) + offset, told.value, told.value - low, high - told.value))
        if points:
            x, y, below, above = zip(*points, strict=True)
            spread = [[max(0.0, scale * each) for each in side] for side in (below, above)]
            colour = figures.COLOURS[number % len(figures.COLOURS)]
            marks = [scale * each for each in y]
            axes.errorbar(
                x, marks, yerr=spread, color=colour, fmt="o", markersize=4.2, capsize=2.5, linewidth=1.2, clip_on=False
            )
    for line in range(1, len(faults)):
        axes.axvline(line - 0.5, color="#eceff3", linewidth=0.8, zorder=0)
    axes.set_xticks(range(len(faults)), [_plain(name) for name in faults], fontsize=7.5)
    if max(map(len, faults)) * len(faults) > 44:
        axes.tick_params(axis="x", rotation=25)
    axes.set_xlim(-0.5, len(faults) - 0.5)
    axes.set_ylim(0.0, 100.0 if metric.share else None)
    axes.tick_params(axis="y", labelsize=7.5, color=figures.GREY)
    axes.tick_params(axis="x", length=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#eceff3", linewidth=0.8)
    axes.set_axisbelow(True)


def _plain(name: str) -> str:
    """A name in which matplotlib finds no mathematics."""
    return name.replace("$", r"\$")
