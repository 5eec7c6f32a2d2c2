"""Figures of reports: colours, and PNG files that are identical on each run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = tuple(f"C{number}" for number in range(10))
"""Matplotlib's own, as in `executive.s3e.reliability`."""

GREY, INK = "#d9dde3", "#22262b"


def figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def legend(figure: Figure, names: Sequence[str], columns: int = 1) -> None:
    """A legend of the colours above everything, if there is more than one."""
    from matplotlib.lines import Line2D

    if len(names) > 1:
        handles = [Line2D([], [], color=COLOURS[n % len(COLOURS)], marker="o", markersize=4) for n in range(len(names))]
        figure.legend(handles, names, loc="outside upper left", frameon=False, fontsize=8, ncols=columns)


def png(figure: Figure) -> bytes:
    """The figure as the content of a PNG file."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {"metadata": {"Software": None}}
    for axes in figure.axes:
        for spine in axes.spines.values():
            spine.set_color(GREY)
    figure.savefig(buffer, format="png", dpi=144, **options)
    return buffer.getvalue()
