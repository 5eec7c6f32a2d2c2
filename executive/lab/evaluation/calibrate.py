"""From evaluations of a model, and from records of runs with it, to the file beside it that says how it errs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from executive.app.config import CONFIG
from executive.app.sensor_fit import CHANGES, SensorFit, fit, load, save
from executive.belief.conformal import Conformal
from executive.belief.mutex_inference import MutexNetwork
from executive.domain.loader import Domain, load_domain
from executive.errors import InputError
from executive.lab.evaluation import prediction_sets, store
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.repeats import Found, combined, in_evaluations, in_record
from executive.planning.mutex_groups import find_mutexes
from executive.s3e import PlattProfile, calibration, calibration_file
from executive.s3e.reliability import plot_reliability
from executive.types import Atom, Belief

RELIABILITY = "calibration.png"
"""The reliability diagram beside a calibration."""

ALPHAS = (0.2, 0.1, 0.05, 0.01)
"""The error rates that the summary shows."""

_ABOUT = ("model", "runtime", "quantisation")
"""What a calibration is about, and evaluations have to agree in."""


class Labelled(NamedTuple):
    """The looks of some evaluations: P(true) and the truth of each atom, and the episode that each look is of."""

    looks: list[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]
    units: list[tuple[Path, int]]


def calibrate(domain: str, folders: Sequence[Path], out: Path, problem: str | None = None) -> tuple[Path, SensorFit]:
    """Learn from some evaluations of one model, and from records of runs, write what was learned into `out` (a file, or
    a model's folder), and return the file and the fit.

    Evaluations of probabilities that nothing corrected say how to correct them, as far as that makes looks of other
    episodes better, with a reliability diagram of those beside the file; and the sensor model is fitted on corrected
    probabilities, as a run gets them. The two halves of the looks are not mixed up by that: a correction is two
    numbers a predicate, learned from thousands. Records say how much repeated questions repeat their mistakes.

    Raises:
        DomainError: the domain has a mistake.
        InputError: a folder holds neither an evaluation nor a record, or one of other atoms or another model; or `out`
            cannot be written, or lacks what records alone do not tell.
        MissingError: Fast Downward's translator is not installed.
    """
    loaded = load_domain(domain, problem)
    runs = [folder for folder in folders if os.path.isfile(folder / CONFIG)]
    evaluated = [folder for folder in folders if folder not in runs]
    if not evaluated:
        known = load(out, loaded.name)
        found: Found = {}
        _add_records(found, runs, loaded.name, known)
        repeats = {**known.repeats, **combined(found)}
        fitted = SensorFit(known.sensor_model, known.conformal, known.looks, repeats)
        return save(out, loaded.name, fitted), fitted
    evaluations = [load_evaluation(folder) for folder in evaluated]
    about, is_corrected = _checked(evaluations, evaluated, loaded, out)
    labelled = _labelled(evaluations, evaluated)
    correction = None
    if not is_corrected:
        correction = _corrected(labelled, about["model"], out)
        labelled = labelled._replace(
            looks=[
                ({atom: correction(atom, value) for atom, value in probability.items()}, truth)
                for probability, truth in labelled.looks
            ]
        )
    varies = any(not evaluation.answers.has_columns for evaluation in evaluations)
    network = None if varies else MutexNetwork(loaded.task.atoms, find_mutexes(loaded.parsed).groups)
    found = in_evaluations(evaluations)
    fitted = fit(labelled.looks, network, combined(found))
    if runs:
        _add_records(found, runs, loaded.name, fitted)
        fitted = fit(labelled.looks, network, combined(found))
    return save(out, loaded.name, fitted, correction, **about), fitted


def load_evaluation(folder: Path) -> Evaluation:
    """Load an evaluation, ours or as prediction sets of s3e 0.5.

    Raises:
        InputError: the folder holds neither, or a damaged one.
    """
    is_theirs = prediction_sets.is_folder_of_prediction_sets(folder)
    return prediction_sets.read(folder) if is_theirs else store.load(folder)


def write_profile(calibrated: Path, file: Path) -> Path:
    """Write the correction of a calibration as a Platt profile of s3e 0.5.

    Raises:
        InputError: it has no correction, or the file cannot be written.
    """
    correction = calibration.Calibration.of(calibration_file.read(calibrated), calibrated)
    if correction is None:
        raise InputError("has no correction of probabilities, which a Platt profile is", file=calibrated)
    return PlattProfile.of(correction).write(file)


def _checked(
    evaluations: Sequence[Evaluation], folders: Sequence[Path], domain: Domain, out: Path
) -> tuple[dict[str, str], bool]:
    """Return what the evaluations are about, and whether their probabilities were corrected."""
    first = evaluations[0].about
    about = {key: str(first.get(key) or "") for key in _ABOUT}
    is_corrected = bool(first.get("calibrated"))
    for evaluation, folder in zip(evaluations, folders, strict=True):
        if evaluation.answers.has_columns:
            odd = set(evaluation.answers.atoms) ^ set(domain.task.atoms)
        else:  # of other objects in each look
            known = {atom.predicate for atom in domain.task.atoms}
            odd = {atom for atom in evaluation.answers.atoms if atom.predicate not in known}
        if odd:
            raise InputError(f"is about other atoms than {domain.task.problem!r} ({min(odd)})", file=folder)
        for key, value in about.items():
            if (here := str(evaluation.about.get(key) or "")) != value:
                message = f"is of another {key} than those before it ({here or 'unknown'}, {value or 'unknown'})"
                raise InputError(message, file=folder)
        if bool(evaluation.about.get("calibrated")) != is_corrected:
            raise InputError(
                "was made with a correction of probabilities, and others without, or the opposite", file=folder
            )
    if is_corrected and not (calibration_file.is_in(out) if os.path.isdir(out) else os.path.isfile(out)):
        message = "was made with a correction of probabilities, which the file would lack: choose the one that has it"
        raise InputError(f"{message}, or the model's folder, with --out", file=folders[0])
    return about, is_corrected


def _labelled(evaluations: Sequence[Evaluation], folders: Sequence[Path]) -> Labelled:
    labelled = Labelled([], [])
    for evaluation, folder in zip(evaluations, folders, strict=True):
        answers = evaluation.answers
        for probability, truth, which in zip(answers.probability, answers.truth, answers.numbers, strict=True):
            asked = which >= 0
            atoms = [answers.atoms[number] for number in which[asked]]
            said = zip(atoms, probability[asked].tolist(), strict=True)
            answered = {atom: value for atom, value in said if not np.isnan(value)}
            labelled.looks.append((answered, dict(zip(atoms, truth[asked].tolist(), strict=True))))
        labelled.units.extend((folder, episode) for episode, _ in evaluation.looks)
    return labelled


def _corrected(labelled: Labelled, model: str, out: Path) -> calibration.Calibration:
    """Fit the correction, and draw what it is worth on held-out episodes."""
    looks = [(Belief(-1, probability), truth) for probability, truth in labelled.looks]
    if len(set(labelled.units)) >= calibration.LEAST_UNITS:
        before, after = calibration.held_out(looks, labelled.units)
        beside = out / RELIABILITY if os.path.isdir(out) else out.with_suffix(".png")
        plot_reliability(beside, {"as the model says": before, "calibrated, held out": after})
    return calibration.fit(looks, model=model, units=labelled.units)


def _add_records(found: Found, runs: Sequence[Path], domain: str, known: SensorFit) -> None:
    for run in runs:
        for key, parts in in_record(run, domain, known.sensor_model).items():
            found.setdefault(key, []).extend(parts)


def summary(fitted: SensorFit) -> str:
    """Return what was learned, as a table: how often answers are wrong, how much repeated questions repeat that, and
    between which probabilities nothing is told at an error rate."""
    changes = [change for change in CHANGES if any(change in told for told in fitted.repeats.values())]
    head = (
        f"{'predicate':<24}{'misses':>8}{'false alarms':>14}"
        + "".join(f"{change:>9}" for change in changes)
        + "".join(f"{f'alpha {a:g}':>16}" for a in ALPHAS)
    )
    rows = [
        f"{name:<24}{rates.misses:>8.3f}{rates.false_alarms:>14.3f}"
        + "".join(_share(fitted.repeats.get(name, {}).get(change)) for change in changes)
        + "".join(f"{_band(fitted.conformal, name, alpha):>16}" for alpha in ALPHAS)
        for name, rates in fitted.sensor_model.error_models.items()
    ]
    lines = [f"learned from {fitted.looks} looks; unknown is what lies between, at each error rate", head, *rows]
    if changes:
        lines.append(f"{', '.join(changes)}: how much mistakes are repeated when that is what changes (0 to 1)")
    return "\n".join(lines)


def _share(value: float | None) -> str:
    return f"{'-' if value is None else f'{value:.2f}':>9}"


def _band(conformal: Conformal, predicate: str, alpha: float) -> str:
    try:
        pair = Conformal({predicate: conformal.scores[predicate]}).thresholds(alpha)[predicate]
    except (KeyError, ValueError):
        return "too few looks"
    return "nothing" if pair.low == pair.high else f"{pair.low:.3f} .. {min(pair.high, 1.0):.3f}"
