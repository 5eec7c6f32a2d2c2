"""Measures calibration: reliability bins, the expected calibration error, and a reliability diagram."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executive.errors import InputError
from executive.types import Atom, Belief

BINS = 10
"""Bins of equal width over P(true): [0, 0.1), [0.1, 0.2), ... [0.9, 1]."""


@dataclass(frozen=True, slots=True)
class Bin:
    """Answers whose probability lies in [low, high): how many, their mean probability, and the share that is true."""

    low: float
    high: float
    count: int
    mean: float
    rate: float


def pairs(belief: Belief, truth: Mapping[Atom, bool]) -> list[tuple[float, bool]]:
    """Return the probability and the label of each atom that has both."""
    return [(probability, truth[atom]) for atom, probability in belief.probability.items() if atom in truth]


def reliability(answers: Sequence[tuple[float, bool]], bins: int = BINS) -> tuple[Bin, ...]:
    """Return the non-empty bins in order. `answers` are probabilities with labels; 1.0 is in the last bin."""
    if bins < 1:
        raise ValueError(f"{bins} bins hold nothing")
    if not answers:
        return ()
    probability, label = (np.array(column, dtype=np.float64) for column in zip(*answers, strict=True))
    number = np.minimum((probability * bins).astype(int), bins - 1)
    return tuple(
        Bin(
            index / bins,
            (index + 1) / bins,
            int((number == index).sum()),
            float(probability[number == index].mean()),
            float(label[number == index].mean()),
        )
        for index in np.unique(number).tolist()
    )


def expected_calibration_error(answers: Sequence[tuple[float, bool]], bins: int = BINS) -> float:
    """The mean over all answers of the distance between the mean probability and the share of true in their bin
    (Naeini et al. 2015, for P(true)). 0 is perfect; without answers, 0.

    Of n answers that are perfectly calibrated, about sqrt(bins / n) / 3 is left by chance alone.
    """
    binned = reliability(answers, bins)
    total = sum(entry.count for entry in binned)
    return sum(entry.count * abs(entry.mean - entry.rate) for entry in binned) / total if total else 0.0


def plot_reliability(path: Path | str, series: Mapping[str, Sequence[tuple[float, bool]]], bins: int = BINS) -> Path:
    """Draw a PNG: for each named series the share of true over the probability, its ECE, and how many there were.

    Raises:
        InputError: the file cannot be written, or there is nothing to draw.
    """
    from matplotlib.figure import Figure

    if not any(series.values()):
        raise InputError("there are no answers to draw")
    figure = Figure(figsize=(5.0, 6.0), layout="constrained")
    curve, counts = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    curve.plot([0, 1], [0, 1], color="0.6", linewidth=1, linestyle="--", label="as said")
    for index, (name, answers) in enumerate(series.items()):
        binned = reliability(answers, bins)
        error = expected_calibration_error(answers, bins)
        curve.plot(
            [entry.mean for entry in binned],
            [entry.rate for entry in binned],
            marker="o",
            markersize=4,
            label=f"{name} (ECE {error:.3f})",
        )
        width = 1 / bins / (len(series) + 0.5)
        counts.bar(
            [entry.low + (index + 0.75) * width for entry in binned], [entry.count for entry in binned], width=width
        )
    curve.set(ylabel="share that is true", xlim=(0, 1), ylim=(0, 1))
    counts.set(xlabel="probability of true", ylabel="answers")
    counts.set_yscale("symlog")
    figure.legend(loc="outside upper left", frameon=False, fontsize=9)  # above: names may be long
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_bytes(buffer.getvalue())
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=path) from None
    return Path(path)
