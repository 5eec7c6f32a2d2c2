"""From evaluations of a model to the files beside it: one that corrects its probabilities (`executive.s3e.calibration`)
and one that says how far it can be trusted (`executive.app.sensor_fit`)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from executive.app.sensor_fit import SensorFit, fit, save
from executive.belief.conformal import Conformal
from executive.belief.mutex_inference import MutexNetwork
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.evaluation import store
from executive.planning.mutex_groups import find_mutexes
from executive.s3e import calibration
from executive.s3e.reliability import plot_reliability
from executive.types import Atom, Belief

RELIABILITY = "calibration.png"
"""The reliability diagram beside a calibration."""

ALPHAS = (0.2, 0.1, 0.05, 0.01)
"""The error rates that the summary shows."""


def calibrate(domain: str, folders: Sequence[Path], out: Path, problem: str | None = None) -> tuple[Path, SensorFit]:
    """Learn from the looks of some evaluations of one model, write what was learned into `out` (a model's folder, or a
    file for the trust alone), and say where the trust is.

    Into a folder, evaluations of probabilities that nothing corrected write a correction, too, as far as it makes
    looks of other episodes better, with a reliability diagram of those; and trust is learned of corrected
    probabilities, as a run gets them. The two halves of the looks are not mixed up by that: a correction is
    two numbers a predicate, learned from thousands.

    Raises:
        DomainError: the domain has a mistake.
        InputError: a folder holds no evaluation, or one of other atoms or another model; or `out` cannot be written.
        MissingError: Fast Downward's translator is not installed.
    """
    loaded = load_domain(domain, problem)
    looks: list[tuple[Mapping[Atom, float], Mapping[Atom, bool]]] = []
    units: list[tuple[Path, int]] = []
    models: set[str] = set()
    corrected: set[bool] = set()
    for folder in folders:
        evaluation = store.load(folder)
        answers = evaluation.answers
        if odd := set(answers.atoms) ^ set(loaded.task.atoms):
            raise InputError(f"is about other atoms than {loaded.task.problem!r} ({min(odd)})", file=folder)
        models.add(str(evaluation.about.get("model")))
        corrected.add(bool(evaluation.about.get("calibrated")))
        if len(models) > 1:
            raise InputError(f"is of another model than those before it ({', '.join(sorted(models))})", file=folder)
        if len(corrected) > 1:
            raise InputError(
                "was made with a correction of probabilities, and others without, or the opposite", file=folder
            )
        for probability, truth in zip(answers.probability, answers.truth, strict=True):
            answered = {
                atom: float(value)
                for atom, value in zip(answers.atoms, probability, strict=True)
                if not np.isnan(value)
            }
            looks.append((answered, dict(zip(answers.atoms, map(bool, truth), strict=True))))
        units += [(folder, episode) for episode, _ in evaluation.looks]
    if os.path.isdir(out) and corrected == {False}:
        labelled = [(Belief(-1, probability), truth) for probability, truth in looks]
        correction = calibration.fit(labelled, model=min(models), units=units)
        if len(set(units)) >= calibration.LEAST_UNITS:
            before, after = calibration.held_out(labelled, units)
            plot_reliability(out / RELIABILITY, {"as the model says": before, "calibrated, held out": after})
        correction.save(out)
        looks = [
            ({atom: correction(atom, value) for atom, value in probability.items()}, truth)
            for probability, truth in looks
        ]
    network = MutexNetwork(loaded.task.atoms, find_mutexes(loaded.parsed).groups)
    trust = fit(looks, network)
    return save(out, loaded.name, trust), trust


def summary(trust: SensorFit) -> str:
    """What was learned, as a table: how often answers are wrong, and between which probabilities nothing is told at an
    error rate."""
    head = f"{'predicate':<24}{'misses':>8}{'false alarms':>14}" + "".join(f"{f'alpha {a:g}':>16}" for a in ALPHAS)
    rows = [
        f"{name:<24}{reading.misses:>8.3f}{reading.false_alarms:>14.3f}"
        + "".join(f"{_band(trust.conformal, name, alpha):>16}" for alpha in ALPHAS)
        for name, reading in trust.sensor_model.error_models.items()
    ]
    return "\n".join(
        [f"learned from {trust.looks} looks; unknown is what lies between, at each error rate", head, *rows]
    )


def _band(conformal: Conformal, predicate: str, alpha: float) -> str:
    try:
        pair = Conformal({predicate: conformal.scores[predicate]}).thresholds(alpha)[predicate]
    except (KeyError, ValueError):
        return "too few looks"
    return "nothing" if pair.low == pair.high else f"{pair.low:.3f} .. {min(pair.high, 1.0):.3f}"
