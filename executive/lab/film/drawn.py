"""What an estimated film looks like: a plot, and a recording that plays the film beside its probabilities."""

from __future__ import annotations

import math
from pathlib import Path
from types import TracebackType

from executive.lab.film.frames import Frames
from executive.lab.film.watch import Seen
from executive.trace.report.chart import Chart
from executive.trace.viewer.video import Film
from executive.types import FloatArray

ALONE, REMEMBERED, TRUTH = "frame alone", "with memory", "truth"

_COLOURS = {ALONE: (90, 160, 230), REMEMBERED: (230, 130, 40), TRUTH: (120, 120, 120)}


class DrawnFilm:
    """Draws an estimated film as it is watched; a context manager that writes the plot at its end.

    Args:
        plot: the PNG file.
        recording: the Rerun recording.

    Raises:
        InputError: a file cannot be written.
    """

    def __init__(self, plot: Path, recording: Path, frames: Frames, camera: str) -> None:
        self._plot, self._chart, self._frames, self._camera = plot, Chart(), frames, camera
        self._film = Film(recording, _COLOURS)

    def __enter__(self) -> DrawnFilm:
        self._film.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._film.__exit__(kind, error, trace)
        if self._chart.times:
            self._chart.draw(self._plot)

    def add(self, seen: Seen) -> None:
        """Draw a frame with its estimates and the truth."""
        frames, truth = self._frames, self._frames.truth[seen.row]
        best = seen.probability if all(map(math.isnan, seen.remembered)) else seen.remembered
        rows: dict[str, dict[str, float | None]] = {}
        true: dict[str, dict[str, bool]] = {}
        curves = {}
        for index, atom in enumerate(frames.atoms):
            rows.setdefault(atom.predicate, {})[str(atom)] = _known(best, index)
            true.setdefault(atom.predicate, {})[str(atom)] = bool(truth[index])
            curve = {TRUTH: float(truth[index]), ALONE: _known(seen.probability, index)}
            if best is seen.remembered:
                curve[REMEMBERED] = _known(seen.remembered, index)
            curves[str(atom)] = curve
        self._chart.add(seen.time, seen.image, rows, true, bool(frames.mid_pose[seen.row]))
        self._film.add(seen.time, {self._camera: seen.image}, curves)


def _known(values: FloatArray, index: int) -> float | None:
    value = float(values[index])
    return None if math.isnan(value) else value
