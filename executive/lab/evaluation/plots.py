"""The pictures of an evaluation: precision and recall (as the paper's Fig. 6), and the average precision of each atom
(as its Figs. 7 and 9). Several evaluations are drawn into one picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from executive.lab.common import figures
from executive.lab.evaluation.metrics import Answers, average_precision, curve
from executive.types import Atom

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANELS = 12
_ACROSS = 4


def precision_recall(series: Mapping[str, Answers], atoms: Sequence[Atom] = ()) -> bytes:
    """A PNG: precision over recall of all answers, of each predicate's, and of some atoms'. `series` are evaluations by
    name, the one that is shown most first."""
    first = next(iter(series.values()))
    wanted: list[tuple[str, str | Atom | None]] = [("all atoms", None)]
    wanted += [(f"{name}(...)" if len(first.of(name).atoms) > 1 else f"{name}()", name) for name in first.predicates]
    wanted += [(str(atom), atom) for atom in atoms]
    wanted = wanted[:PANELS]
    rows, across = math.ceil(len(wanted) / _ACROSS), min(_ACROSS, len(wanted))
    figure = figures.figure(2.75 * across, 2.95 * rows + 0.3 * len(series))
    grid = figure.subplots(rows, across, squeeze=False)
    for axes, (title, what) in zip(grid.flat, wanted, strict=False):
        _panel(axes, title, [answers if what is None else answers.of(what) for answers in series.values()])
    for axes in grid.flat[len(wanted) :]:
        axes.axis("off")
    for axes in grid[:, 0]:
        axes.set_ylabel("precision", fontsize=8)
    for axes in grid.flat[max(0, len(wanted) - across) : len(wanted)]:
        axes.set_xlabel("recall", fontsize=8)
    figures.legend(figure, list(series))
    return figures.png(figure)


def average_precisions(series: Mapping[str, Answers]) -> bytes:
    """A PNG: a row for each atom, with its average precision in every evaluation, and what chance would reach (the
    share of looks in which it is true)."""
    first = next(iter(series.values()))
    rows = [atom for name in first.predicates for atom in first.of(name).atoms]
    height = 0.21 * len(rows) + 0.16 * len(first.predicates) + 0.6 + 0.25 * len(series)
    figure = figures.figure(9.2, height)
    axes = figure.subplots()
    places, place = [], 0.0
    for index, atom in enumerate(rows):
        place += 1.0 + (0.7 if index and rows[index - 1].predicate != atom.predicate else 0.0)
        places.append(place)
    chance = [float(first.of(atom).truth.mean()) if first.looks else 0.0 for atom in rows]
    axes.barh(places, 1.0, color="#f2f4f7", height=0.62, zorder=0)
    axes.plot(chance, places, "|", color="#8a939d", markersize=9, zorder=2)
    for number, answers in enumerate(series.values()):
        values = [average_precision(answers.of(atom)) for atom in rows]
        known = [(value, where) for value, where in zip(values, places, strict=True) if value is not None]
        colour = figures.COLOURS[number % len(figures.COLOURS)]
        if number == 0:
            axes.barh([y for _, y in known], [x for x, _ in known], color=colour, alpha=0.28, height=0.62, zorder=1)
            for value, where in zip(values, places, strict=True):
                text = "never true" if value is None else f"{value:.3f}"
                axes.text(1.015, where, text, va="center", fontsize=7.5, color=figures.INK, family="monospace")
        axes.plot(
            [x for x, _ in known],
            [y for _, y in known],
            "o",
            color=colour,
            markersize=4.5,
            zorder=9 - number,
            clip_on=False,
        )
    axes.set_yticks(places, [str(atom) for atom in rows], fontsize=7.5)
    axes.set(ylim=(places[-1] + 0.8, 0.2), xlim=(0.0, 1.0))
    axes.set_xlabel("average precision (grey mark: by chance)", fontsize=8)
    axes.tick_params(axis="x", labelsize=8)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    figures.legend(figure, list(series))
    return figures.png(figure)


def _panel(axes: Axes, title: str, lines: Sequence[Answers]) -> None:
    axes.set_title(title, fontsize=8.5, loc="left", color=figures.INK)
    for level in (0.25, 0.5, 0.75):
        axes.axhline(level, color="#eceff3", linewidth=0.8, zorder=0)
        axes.axvline(level, color="#eceff3", linewidth=0.8, zorder=0)
    for number, answers in enumerate(lines):
        value, (recall, precision) = average_precision(answers), curve(answers)
        colour = figures.COLOURS[number % len(figures.COLOURS)]
        axes.plot(recall, precision, color=colour, linewidth=1.6, drawstyle="steps-pre", clip_on=False)
        text = "never true" if value is None else f"AP {value:.3f}"
        height = 0.06 + 0.085 * (len(lines) - 1 - number)
        axes.text(0.05, height, text, color=colour, fontsize=8, transform=axes.transAxes)
    axes.set(xlim=(0, 1), ylim=(0, 1), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1), aspect="equal")
    axes.tick_params(labelsize=7.5, color=figures.GREY)
