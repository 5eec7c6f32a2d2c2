"""Probabilities over time as a picture: a row for each thing that was estimated, what was seen above them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from executive.errors import InputError
from executive.types import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROWS = 60
"""The most rows that are drawn: those whose probability changed most."""

_PICTURES, _HEIGHT, _STRIP = 8, 120, 1.2
"""How many pictures are shown at most, how many pixels high they are kept, and how many inches high the strip is."""

_TALL = 0.85
"""How much of a row a probability of 1 fills."""


@dataclass(slots=True)
class Chart:
    """Collects what `add` is given, and draws it in the end."""

    times: list[float] = field(default_factory=list)
    pictures: list[Image] = field(default_factory=list)
    rows: dict[tuple[str, str], dict[float, float | None]] = field(default_factory=dict)

    def add(self, time: float, picture: Image, curves: Mapping[str, Mapping[str, float | None]]) -> None:
        """What was seen at `time` seconds, and what it was taken for: group -> name -> P(true), None where unknown."""
        self.times.append(time)
        self.pictures.append(_small(picture))
        for group, members in curves.items():
            for name, probability in members.items():
                self.rows.setdefault((group, name), {})[time] = probability

    def draw(self, file: Path | str) -> Path:
        """Write a PNG.

        Raises:
            InputError: nothing was added, or the file cannot be written.
        """
        from matplotlib.figure import Figure

        if not self.times:
            raise InputError("there is nothing to draw", file=file)
        shown = self._shown()
        height = max(0.6, 0.32 * len(shown))
        figure = Figure(figsize=(10.0, _STRIP + height + 0.6), layout="constrained")
        strip, rows = figure.subplots(2, 1, sharex=True, height_ratios=[_STRIP, height])
        self._draw_strip(strip)
        self._draw_rows(rows, shown)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=110)
        try:
            Path(file).write_bytes(buffer.getvalue())
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=file) from None
        return Path(file)

    def _shown(self) -> list[tuple[str, str]]:
        """The rows that are drawn, in the order in which they were added."""

        def change(row: tuple[str, str]) -> float:
            known = [value for value in self.rows[row].values() if value is not None]
            return max(known) - min(known) if known else -1.0

        most = set(sorted(self.rows, key=change, reverse=True)[:ROWS])
        return [row for row in self.rows if row in most]

    def _span(self) -> tuple[float, float]:
        """From the first moment to the last one's end, which is as long as the moments are apart."""
        step = (self.times[-1] - self.times[0]) / (len(self.times) - 1) if len(self.times) > 1 else 1.0
        return self.times[0], self.times[-1] + (step or 1.0)

    def _draw_strip(self, axes: Axes) -> None:
        """Pictures side by side, each the one that was seen where its left edge is."""
        begin, end = self._span()
        places = min(_PICTURES, len(self.times))
        for left in np.linspace(begin, end, places, endpoint=False):
            picture = self.pictures[int(np.searchsorted(self.times, left + 1e-6, side="right")) - 1]
            # As tall as it is wide, in inches: the strip is _STRIP high, and the rows beside the names about 8 wide.
            tall = min(1.0, 0.97 * 8.0 / places * picture.shape[0] / picture.shape[1] / _STRIP)
            right = left + 0.97 * (end - begin) / places
            axes.imshow(picture, extent=(left, right, 0.0, tall), aspect="auto", origin="upper")
        axes.set(xlim=(begin, end), ylim=(0, 1))
        axes.axis("off")

    def _draw_rows(self, axes: Axes, shown: Sequence[tuple[str, str]]) -> None:
        begin, end = self._span()
        edges = [*self.times, end]
        groups = list(dict.fromkeys(group for group, _ in shown))
        for number, row in enumerate(shown):
            base = -float(number)
            colour = f"C{groups.index(row[0]) % 10}"
            values = [self.rows[row].get(time) for time in self.times]
            curve = [np.nan if value is None else base + _TALL * value for value in values]
            spans = zip(self.times, values, edges[1:], strict=True)
            known = [(time, _TALL * value, until - time) for time, value, until in spans if value is not None]
            if known:
                lefts, heights, widths = zip(*known, strict=True)
                axes.bar(lefts, heights, widths, base, align="edge", color=colour, alpha=0.35)
            axes.step(edges, [*curve, curve[-1]], where="post", color=colour, linewidth=1.2)
            axes.plot([begin, end], [base + _TALL / 2] * 2, color="0.8", linewidth=0.5, linestyle=":")
            unknown = [time for time, value in zip(self.times, values, strict=True) if value is None]
            axes.plot(unknown, [base + 0.1] * len(unknown), "x", color="0.5", markersize=4, linestyle="none")
        left_out = len(self.rows) - len(shown)
        more = f"; {left_out} that changed least are left out" if left_out else ""
        axes.set_yticks([0.3 - number for number in range(len(shown))], [_short(name) for _, name in shown], fontsize=8)
        axes.set(ylim=(-len(shown) + 0.9, 1.0), xlim=(begin, end))
        axes.set_xlabel(f"seconds (each row from 0 to 1, dotted 0.5, x unanswered{more})", fontsize=8)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)


def _small(picture: Image) -> Image:
    """A copy that is small enough to keep one of each frame."""
    step = max(1, picture.shape[0] // _HEIGHT)
    return np.ascontiguousarray(picture[::step, ::step])


def _short(name: str) -> str:
    """Return a name that leaves room for the curves, and means itself alone to matplotlib."""
    cut = name if len(name) <= 48 else f"{name[:45]}..."
    return cut.replace("$", r"\$")
