"""Calibration of answers that carry probabilities, and what earlier looks and visibility are worth.

A correction is learned on the other problems, and adopted where it earns its place (`executive.s3e.calibration`).

Memory and visibility are measured on the answers along a run, by four ways to add up what was said of an atom while it
did not change: the newest answer alone; all of them as if they erred independently; all with the measured correlation
of errors; and the same with error rates of their own for answers about what could not be seen, as far as the model's
own newest answers tell."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from benchmarks.viplan.decoding import BINS, Counts
from benchmarks.viplan.loop import habits
from benchmarks.viplan.recorded import Look, Run
from executive.belief import SensorModel
from executive.errors import InputError
from executive.s3e import calibration
from executive.s3e.reliability import expected_calibration_error
from executive.types import Atom, Belief

WAYS = ("newest", "independent", "correlated", "visible")

SEES = MappingProxyType(
    {
        "open": (("reachable", 0),),
        "inside": (("reachable", 1), ("open", 1)),
        "ontop": (("reachable", 1),),
        "nextto": (("reachable", 1),),
    }
)
"""What has to hold for an atom of the household's predicates to be seen: predicates of its arguments, by place."""

Scored = list[tuple[float, bool]]
"""Probabilities with the truth."""

Answered = tuple[bool, bool, bool]
"""Whether what an answer is about was hidden, whether it is true, and whether the answer is yes."""


def measure(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return a row for each model."""
    models = sorted({run.model for run in runs})
    return [_row(model, [run for run in runs if run.model == model]) for model in models]


def _row(model: str, runs: Sequence[Run]) -> dict[str, Any]:
    row: dict[str, Any] = {"model": model, "problems": len({run.unit for run in runs}), **_calibrated(runs)}
    judged, hidden = _judged(runs)
    row |= {way: {"brier": _brier(judged[way]), "wrong_and_sure": _sure(judged[way])} for way in WAYS}
    row["informedness"] = {
        name: _informedness(hidden, is_hidden) for name, is_hidden in (("seen", False), ("hidden", True))
    }
    row["hidden"] = sum(number for (is_hidden, _, _), number in hidden.items() if is_hidden)
    repeats = habits([run.looks for run in runs]).repeats
    row["repeats"] = {name: round(value, 3) for name, value in sorted(repeats.items())}
    return row


def _calibrated(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the calibration error and the Brier score before and after, None for too few problems, and the error that
    chance alone leaves. Each problem's answers are corrected by what was learned of all other problems."""
    looks, units = [], []
    for run in runs:
        for look in run.looks:
            said = {atom: answer for atom, answer in look.answers.items() if answer.probability is not None}
            if said:
                belief = Belief(look.step, {atom: float(answer.probability or 0.0) for atom, answer in said.items()})
                looks.append((belief, {atom: answer.truth for atom, answer in said.items()}))
                units.append(run.unit)
    row: dict[str, Any] = {"answers": sum(len(truth) for _, truth in looks)}
    try:
        before, after = calibration.held_out(looks, units, parts=len(set(units)))
    except (ValueError, InputError):
        return row | dict.fromkeys(("ece_before", "ece_after", "ece_by_chance", "brier_before", "brier_after"))
    questions = [
        (unit, atom, truth[atom])
        for (belief, truth), unit in zip(looks, units, strict=True)
        for atom in belief.probability
    ]
    return row | {
        "ece_before": expected_calibration_error(before, BINS),
        "ece_after": expected_calibration_error(after, BINS),
        "ece_by_chance": by_chance([probability for probability, _ in after], questions),
        "brier_before": _brier(before),
        "brier_after": _brier(after),
    }


def by_chance(probability: Sequence[float], questions: Sequence[object], draws: int = 50) -> float:
    """Return the mean calibration error of answers that are perfectly calibrated: truths are drawn with the answers'
    own probabilities, one for all answers to the same question, as a question that is asked thirty times has one truth
    and not thirty."""
    rng = np.random.default_rng(0)
    place = {question: number for number, question in enumerate(dict.fromkeys(questions))}
    own = np.array([place[question] for question in questions])
    errors = [
        expected_calibration_error(
            list(zip(probability, (rng.random(len(place))[own] < np.asarray(probability)).tolist(), strict=True)), BINS
        )
        for _ in range(draws)
    ]
    return float(np.mean(errors))


def _judged(runs: Sequence[Run]) -> tuple[Mapping[str, Scored], Counter[Answered]]:
    """Add up the answers along each run, with error rates and correlations of the other problems. Return the
    probabilities by each way, and the counts of `Answered`."""
    counts = Counts((run, run.looks) for run in runs)
    units = sorted({run.unit for run in runs})
    by_unit = {unit: habits([run.looks for run in runs if run.unit == unit]) for unit in units}
    known = habits([run.looks for run in runs])
    scored: dict[str, Scored] = {way: [] for way in WAYS}
    hidden: Counter[Answered] = Counter()
    segments = {id(run): _segments(run, hidden) for run in runs}
    apart = Counts((run, [_split(look, newest) for look, newest in _walked(run)]) for run in runs)
    for unit in units:
        own = [run for run in runs if run.unit == unit]
        elsewhere, split = counts.elsewhere(unit), apart.elsewhere(unit)
        names = {atom.predicate for run in own for look in run.looks for atom in look.answers}
        models = {name: elsewhere.error_model(name) for name in names}
        sensor = SensorModel(models, correlations=(known - by_unit[unit]).repeats)
        evidence = {(name, yes): models[name].evidence(float(yes)) for name in names for yes in (False, True)}
        by_sight = {
            (name, yes, is_seen): split.error_model(_apart(name, is_seen), models[name]).evidence(float(yes))
            for name, yes in evidence
            for is_seen in (False, True)
        }
        prior = {name: elsewhere.log_odds(name) for name in names}
        for run in own:
            for atom, truth, said in segments[id(run)]:
                name = atom.predicate
                weights = [evidence[name, yes] for yes, _ in said]
                seen = [by_sight[name, yes, is_seen] for yes, is_seen in said]
                sums = weights[-1], math.fsum(weights), sensor.pooled(weights, name), sensor.pooled(seen, name)
                for way, sum_ in zip(WAYS, sums, strict=True):
                    odds = max(-500.0, min(500.0, prior[atom.predicate] + sum_))
                    scored[way].append((1.0 / (1.0 + math.exp(-odds)), truth))
    return scored, hidden


def _segments(run: Run, hidden: Counter[Answered]) -> list[tuple[Atom, bool, list[tuple[bool, bool]]]]:
    """Return each atom of a run with its last truth and what was said since it is so: yes or no, and whether it could
    be seen. `hidden` counts the answers."""
    truth: dict[Atom, bool] = {}
    said: dict[Atom, list[tuple[bool, bool]]] = {}
    for look, newest in _walked(run):
        for atom, answer in look.answers.items():
            if answer.yes is None:
                continue
            if truth.get(atom) is not answer.truth:
                said[atom] = []
            truth[atom] = answer.truth
            is_seen = can_be_seen(atom, newest)
            hidden[not is_seen, answer.truth, answer.yes] += 1
            said[atom].append((answer.yes, is_seen))
    return [(atom, truth[atom], answers) for atom, answers in said.items()]


def _walked(run: Run) -> Iterator[tuple[Look, Mapping[Atom, bool]]]:
    """Yield each look, with the newest answers then."""
    newest: dict[Atom, bool] = {}
    for look in run.looks:
        newest.update({atom: answer.yes for atom, answer in look.answers.items() if answer.yes is not None})
        yield look, newest


def _split(look: Look, newest: Mapping[Atom, bool]) -> Look:
    """Return the look with predicates of their own for what could be seen and what could not."""
    answers = {
        Atom(_apart(atom.predicate, can_be_seen(atom, newest)), atom.args): answer
        for atom, answer in look.answers.items()
    }
    return look._replace(answers=answers)


def _apart(predicate: str, is_seen: bool) -> str:
    return f"{predicate}-{'seen' if is_seen else 'hidden'}"


def can_be_seen(atom: Atom, newest: Mapping[Atom, bool]) -> bool:
    """Return whether no newest answer denies what an atom needs to be seen."""
    needed = (Atom(name, (atom.args[place],)) for name, place in SEES.get(atom.predicate, ()))
    return all(newest.get(condition) is not False for condition in needed)


def _informedness(answered: Mapping[Answered, int], is_hidden: bool) -> float | None:
    """Return the share of true atoms whose answer is yes less that of false ones (Youden's J): 0 for answers that say
    nothing; None without answers of either kind."""
    shares = []
    for truth in (True, False):
        yes, no = (answered.get((is_hidden, truth, said), 0) for said in (True, False))
        if not yes + no:
            return None
        shares.append(yes / (yes + no))
    return shares[0] - shares[1]


def _brier(answered: Scored) -> float:
    return float(np.mean([(probability - truth) ** 2 for probability, truth in answered]))


def _sure(answered: Scored) -> float:
    """Return the share of answers that are wrong at a probability of 98 % and more."""
    wrong = [(probability >= 0.98 and not truth) or (probability <= 0.02 and truth) for probability, truth in answered]
    return float(np.mean(wrong))


def printed(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as text."""
    lines = [
        f"{'model':<36}{'answers':>8}{'ECE before':>11}{'after':>7}{'chance':>7} | Brier"
        + "".join(f"{way[:7]:>8}" for way in WAYS)
        + " | wrong and sure"
        + "".join(f"{way[:7]:>8}" for way in WAYS)
        + " | informed: seen hidden"
    ]
    for row in found:
        numbers = [_number(row[key]) for key in ("ece_before", "ece_after", "ece_by_chance")]
        brier = "".join(f"{row[way]['brier']:>8.3f}" for way in WAYS)
        sure = "".join(f"{row[way]['wrong_and_sure']:>8.3f}" for way in WAYS)
        right = [_number(row["informedness"][name]) for name in ("seen", "hidden")]
        lines.append(
            f"{row['model']:<36}{row['answers']:>8}{numbers[0]:>11}{numbers[1]:>7}{numbers[2]:>7} |      {brier}"
            f" |               {sure} |{right[0]:>14}{right[1]:>7}"
        )
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
