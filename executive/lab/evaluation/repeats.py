"""How much a repeated question repeats its mistake, from evaluations (with the truth) and from the records of runs
(without).

In an evaluation, questions repeat themselves from one look of an episode to the next, as long as their answer stays the
same; and between two evaluations of the same looks that differ in one thing: the cameras, the pictures or the words. In
a record, they repeat themselves between two actions. The truth is not known there, but two answers whose errors are
correlated disagree less often than independent ones with the model's error rates would."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from executive.app.sensor_fit import AGAIN, CAMERAS, PICTURE, WORDING
from executive.belief import SensorModel
from executive.belief.sensor_model import PRIOR, phi
from executive.errors import InputError
from executive.lab.evaluation.evaluate import Evaluation
from executive.s3e.calibration_file import CORRELATION
from executive.trace.record.log import read_events
from executive.types import Atom, Belief, Dispatched, Event, FaultInjected, Judged, Looked, Started

_CHANGED = {
    "cameras": CAMERAS, "per_image": CAMERAS,
    "disturb": PICTURE, "seed": PICTURE,
    "paraphrases": WORDING, "rename": WORDING, "translator": WORDING, "instructions": WORDING, "system_prompt": WORDING,
}  # fmt: skip
"""What it is that changes with an option of an evaluation."""

_SAME = ("domain", "problem", "data", "model", "calibrated", "abstention")


class Repeated(NamedTuple):
    """A measured correlation of errors, and how many mistakes it rests on."""

    correlation: float
    mistakes: float


Found = dict[tuple[str, str], list[Repeated]]
"""By predicate and by what was changed."""


def combined(found: Mapping[tuple[str, str], Sequence[Repeated]]) -> dict[str, dict[str, float]]:
    """Return the correlations by predicate and by what was changed, with `PRIOR` more mistakes at the assumed one."""
    told: dict[str, dict[str, float]] = {}
    for (predicate, change), parts in sorted(found.items()):
        mistakes = sum(part.mistakes for part in parts) + PRIOR
        weighted = sum(part.correlation * part.mistakes for part in parts) + CORRELATION * PRIOR
        told.setdefault(predicate, {})[change] = round(weighted / mistakes, 6)
    return told


def in_evaluations(evaluations: Sequence[Evaluation]) -> Found:
    """Return what the looks of evaluations say, each by itself and in pairs."""
    counts: dict[tuple[str, str], Counter[tuple[bool, bool]]] = {}
    for evaluation in evaluations:
        episodes = np.array([episode for episode, _ in evaluation.looks])
        follows = np.flatnonzero(episodes[1:] == episodes[:-1])
        _count(counts, evaluation, follows, evaluation, follows + 1, AGAIN)
    for one, other in itertools.combinations(evaluations, 2):
        change = changed(one.about, other.about)
        if change is not None and one.looks == other.looks and one.answers.atoms == other.answers.atoms:
            every = np.arange(len(one.looks))
            _count(counts, one, every, other, every, change)
    found: Found = {}
    for key, repeats in counts.items():
        correlation = phi(repeats)
        if correlation is not None:
            mistakes = repeats[True, True] + repeats[True, False]
            found.setdefault(key, []).append(Repeated(correlation, float(mistakes)))
    return found


def changed(one: Mapping[str, object], other: Mapping[str, object]) -> str | None:
    """Return the one thing that changed between two evaluations, by what is known about them; None for none or more."""
    if any(one.get(key) != other.get(key) for key in _SAME):
        return None
    changes = {change for key, change in _CHANGED.items() if one.get(key) != other.get(key)}
    return changes.pop() if len(changes) == 1 else None


def _count(
    counts: dict[tuple[str, str], Counter[tuple[bool, bool]]],
    one: Evaluation,
    first: np.ndarray[tuple[int], np.dtype[np.int64]],
    other: Evaluation,
    second: np.ndarray[tuple[int], np.dtype[np.int64]],
    change: str,
) -> None:
    """Count pairs of looks at the same truth, one of each evaluation: whether the answers were wrong."""
    said = one.answers.probability[first], other.answers.probability[second]
    truth = one.answers.truth[first], other.answers.truth[second]
    numbers = one.answers.numbers[first], other.answers.numbers[second]
    both = ~np.isnan(said[0]) & ~np.isnan(said[1]) & (truth[0] == truth[1]) & (numbers[0] == numbers[1])
    wrong = [(answers >= 0.5) != true for answers, true in zip(said, truth, strict=True)]
    predicates = np.array([atom.predicate for atom in one.answers.atoms])[numbers[0]]
    for predicate in one.answers.predicates:
        chosen = both & (predicates == predicate)
        pairs = zip(wrong[0][chosen].tolist(), wrong[1][chosen].tolist(), strict=True)
        counts.setdefault((predicate, change), Counter()).update(pairs)


def in_record(run: Path, domain: str, sensor: SensorModel) -> Found:
    """Return what a run's record says, with the error rates of a sensor model.

    Raises:
        InputError: it is no record, or one of another domain.
    """
    events = list(read_events(run, images=False))
    started = next((event.payload for event in events if isinstance(event.payload, Started)), None)
    if started is None or started.domain != domain:
        there = "no run" if started is None else f"a run in the domain {started.domain!r}"
        raise InputError(f"is {there}, and not one in the domain {domain!r}", file=run)
    sums: dict[tuple[str, str], list[float]] = {}
    for moment in _moments(events):
        for (before, _, cameras), (after, judged, shown) in itertools.pairwise(moment):
            change = AGAIN if cameras == shown else CAMERAS
            for atom in before.probability.keys() & after.probability.keys() & judged.keys():
                rates = sensor.error_models.get(atom.predicate, sensor.other)
                true = judged[atom]
                mistakes = true * rates.misses + (1.0 - true) * rates.false_alarms
                alone = 2.0 * (
                    true * rates.misses * (1.0 - rates.misses)
                    + (1.0 - true) * rates.false_alarms * (1.0 - rates.false_alarms)
                )
                disagree = (before.probability[atom] >= 0.5) != (after.probability[atom] >= 0.5)
                kept = sums.setdefault((atom.predicate, change), [0.0, 0.0, 0.0])
                for place, value in enumerate((float(disagree), alone, mistakes)):
                    kept[place] += value
    return {
        key: [Repeated(min(1.0, max(0.0, 1.0 - disagreed / alone)), mistakes)]
        for key, (disagreed, alone, mistakes) in sums.items()
        if alone > 0.0
    }


_Answered = tuple[Belief, Mapping[Atom, float], tuple[str, ...]]


def _moments(events: Iterable[Event]) -> list[list[_Answered]]:
    """Return the looks of each time between two actions: what was answered, what was believed after it, and through
    which cameras it looked."""
    moments: list[list[_Answered]] = [[]]
    belief: Belief | None = None
    cameras: tuple[str, ...] = ()
    for event in events:
        match event.payload:
            case Belief() as belief:
                pass
            case Looked() as looked:
                cameras = tuple(looked.cameras)
            case Judged(probability=judged) if belief is not None:
                moments[-1].append((belief, judged, cameras))
                belief = None
            case Dispatched() | FaultInjected():
                moments.append([])
    return moments
