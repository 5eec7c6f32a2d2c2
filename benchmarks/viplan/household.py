"""Calibration of answers that carry probabilities, and what earlier looks are worth.

A correction is learned on the other problems, and adopted where it earns its place (`executive.s3e.calibration`).
Memory is measured on the answers along a run, by three ways to add up what was said of an atom while it did not change:
the newest answer alone, all of them as if they erred independently, and all with the measured correlation of errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.viplan.decoding import BINS, Counts
from benchmarks.viplan.loop import habits
from benchmarks.viplan.recorded import Run
from executive.belief import SensorModel
from executive.errors import InputError
from executive.s3e import calibration
from executive.s3e.reliability import expected_calibration_error
from executive.types import Atom, Belief

WAYS = ("newest", "independent", "correlated")


class Judged(NamedTuple):
    """Probabilities with the truth, by each way to add answers up."""

    newest: list[tuple[float, bool]]
    independent: list[tuple[float, bool]]
    correlated: list[tuple[float, bool]]


def measure(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return a row for each model."""
    models = sorted({run.model for run in runs})
    return [_row(model, [run for run in runs if run.model == model]) for model in models]


def _row(model: str, runs: Sequence[Run]) -> dict[str, Any]:
    row: dict[str, Any] = {"model": model, "problems": len({run.unit for run in runs})}
    looks, units = [], []
    for run in runs:
        for look in run.looks:
            said = {atom: answer for atom, answer in look.answers.items() if answer.probability is not None}
            if said:
                belief = Belief(look.step, {atom: float(answer.probability or 0.0) for atom, answer in said.items()})
                looks.append((belief, {atom: answer.truth for atom, answer in said.items()}))
                units.append(run.unit)
    row["answers"] = sum(len(truth) for _, truth in looks)
    try:
        before, after = calibration.held_out(looks, units)
        row["ece_before"] = expected_calibration_error(before, BINS)
        row["ece_after"] = expected_calibration_error(after, BINS)
        row["brier_before"], row["brier_after"] = _brier(before), _brier(after)
    except (ValueError, InputError):  # too few problems
        row |= dict.fromkeys(("ece_before", "ece_after", "brier_before", "brier_after"))
    judged = _judged(runs)
    for way, answered in zip(WAYS, judged, strict=True):
        row[way] = {"brier": _brier(answered), "wrong_and_sure": _sure(answered)}
    row["repeats"] = {
        name: round(value, 3) for name, value in sorted(habits([run.looks for run in runs]).repeats.items())
    }
    return row


def _judged(runs: Sequence[Run]) -> Judged:
    """Add up the answers along each run, with error rates and correlations of the other problems."""
    counts = Counts((run, run.looks) for run in runs)
    found = Judged([], [], [])
    for unit in sorted({run.unit for run in runs}):
        own = [run for run in runs if run.unit == unit]
        known = habits([run.looks for run in runs if run.unit != unit])
        elsewhere = counts.elsewhere(unit)
        predicates = {atom.predicate for run in own for look in run.looks for atom in look.answers}
        sensor = SensorModel({name: elsewhere.error_model(name) for name in predicates}, correlations=known.repeats)
        odds = {name: elsewhere.log_odds(name) for name in predicates}
        for run in own:
            said: dict[Atom, list[float]] = {}
            truth: dict[Atom, bool] = {}
            for look in run.looks:
                for atom, answer in look.answers.items():
                    if answer.yes is None:
                        continue
                    if truth.get(atom) is not answer.truth:
                        said[atom] = []
                    truth[atom] = answer.truth
                    said[atom].append(sensor.evidence(atom, float(answer.yes)))
            for atom, evidence in said.items():
                prior = odds[atom.predicate]
                for way, sum_ in zip(
                    found, (evidence[-1], math.fsum(evidence), sensor.pooled(evidence, atom.predicate)), strict=True
                ):
                    way.append((1.0 / (1.0 + math.exp(-max(-500.0, min(500.0, prior + sum_)))), truth[atom]))
    return found


def _brier(answered: Iterable[tuple[float, bool]]) -> float:
    return float(np.mean([(probability - truth) ** 2 for probability, truth in answered]))


def _sure(answered: Sequence[tuple[float, bool]]) -> float:
    """Return the share of atoms that are wrong by 98 % and more."""
    return float(
        np.mean(
            [(probability >= 0.98 and not truth) or (probability <= 0.02 and truth) for probability, truth in answered]
        )
    )


def printed(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as text."""
    lines = [
        f"{'model':<36}{'answers':>8}{'ECE before':>11}{'after':>7} | Brier {'newest':>8}{'indep.':>8}{'corr.':>8}"
        f" | wrong and sure {'newest':>8}{'indep.':>8}{'corr.':>8}"
    ]
    for row in found:
        brier = "".join(f"{row[way]['brier']:>8.3f}" for way in WAYS)
        sure = "".join(f"{row[way]['wrong_and_sure']:>8.3f}" for way in WAYS)
        ece = [f"{row[key]:.3f}" if row[key] is not None else "-" for key in ("ece_before", "ece_after")]
        lines.append(
            f"{row['model']:<36}{row['answers']:>8}{ece[0]:>11}{ece[1]:>7} |       {brier} |                {sure}"
        )
    return "\n".join(lines)
