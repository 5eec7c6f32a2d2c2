"""Probabilities over time as a picture: a row for each thing that was estimated, what was seen above them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
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

_KEPT = 64
"""How many pictures are kept at most while it is not known how many there will be."""

_TALL = 0.85
"""How much of a row a probability of 1 fills."""


@dataclass(slots=True)
class Chart:
    """Collects what `add` is given, and draws it in the end."""

    times: list[float] = field(default_factory=list)
    pictures: dict[int, Image] = field(default_factory=dict)
    """By the number of the moment at which they were seen: one in `_every` moments."""
    rows: dict[tuple[str, str], dict[float, float | None]] = field(default_factory=dict)
    truth: dict[tuple[str, str], list[bool]] = field(default_factory=dict)
    marked: list[bool] = field(default_factory=list)
    _every: int = 1

    def add(
        self,
        time: float,
        picture: Image,
        curves: Mapping[str, Mapping[str, float | None]],
        truth: Mapping[str, Mapping[str, bool]] = MappingProxyType({}),
        is_marked: bool = False,
    ) -> None:
        """What was seen at `time` seconds, and what it was taken for: group -> name -> P(true), None where unknown.

        Args:
            truth: what was true, in the same way: of all rows at all times, or of none.
            is_marked: whether the moment is shaded.
        """
        self._keep(picture)
        self.times.append(time)
        self.marked.append(is_marked)
        for group, values in truth.items():
            for name, value in values.items():
                self.truth.setdefault((group, name), []).append(value)
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

    def _keep(self, picture: Image) -> None:
        """Keep a picture of this moment, and fewer of the others once there are many."""
        number = len(self.times)
        if number % self._every == 0:
            self.pictures[number] = _small(picture)
        if len(self.pictures) > _KEPT:
            self._every *= 2
            self.pictures = {at: each for at, each in self.pictures.items() if at % self._every == 0}

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
            number = int(np.searchsorted(self.times, left + 1e-6, side="right")) - 1
            picture = self.pictures[number - number % self._every]
            # As tall as it is wide, in inches: the strip is _STRIP high, and the rows beside the names about 8 wide.
            tall = min(1.0, 0.97 * 8.0 / places * picture.shape[0] / picture.shape[1] / _STRIP)
            right = left + 0.97 * (end - begin) / places
            axes.imshow(picture, extent=(left, right, 0.0, tall), aspect="auto", origin="upper")
        axes.set(xlim=(begin, end), ylim=(0, 1))
        axes.axis("off")

    def _draw_rows(self, axes: Axes, shown: Sequence[tuple[str, str]]) -> None:
        begin, end = self._span()
        edges = [*self.times, end]
        shaded = zip(self.marked, self.times, edges[1:], strict=True)
        spans = [(time, until - time) for is_marked, time, until in shaded if is_marked]
        axes.broken_barh(spans, (-len(shown), len(shown) + 1.0), color="0.93", linewidth=0)
        groups = list(dict.fromkeys(group for group, _ in shown))
        for number, row in enumerate(shown):
            base = -float(number)
            colour = f"C{groups.index(row[0]) % 10}"
            values = [self.rows[row].get(time) for time in self.times]
            curve = [np.nan if value is None else base + _TALL * value for value in values]
            whole = np.array([*curve, curve[-1]])
            axes.fill_between(edges, base, whole, step="post", color=colour, alpha=0.35, linewidth=0)
            axes.step(edges, whole, where="post", color=colour, linewidth=1.2)
            if row in self.truth:
                so = base + _TALL * np.array(self.truth[row], dtype=float)
                axes.step(edges, [*so, so[-1]], where="post", color="black", linewidth=0.9, linestyle=(0, (3, 1.5)))
            axes.plot([begin, end], [base + _TALL / 2] * 2, color="0.8", linewidth=0.5, linestyle=":")
            unknown = [time for time, value in zip(self.times, values, strict=True) if value is None]
            axes.plot(unknown, [base + 0.1] * len(unknown), "x", color="0.5", markersize=4, linestyle="none")
        left_out = len(self.rows) - len(shown)
        more = f"; {left_out} that changed least are left out" if left_out else ""
        axes.set_yticks([0.3 - number for number in range(len(shown))], [_short(name) for _, name in shown], fontsize=8)
        axes.set(ylim=(-len(shown) + 0.9, 1.0), xlim=(begin, end))
        true = ", dashed what is true" if self.truth else ""
        standing = ", grey: between actions" if any(self.marked) else ""
        axes.set_xlabel(f"seconds (each row from 0 to 1, dotted 0.5, x unanswered{true}{standing}{more})", fontsize=8)
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
