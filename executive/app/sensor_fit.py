"""Fits an estimator's sensor model and conformal thresholds in a domain, and reads and writes them.

Both are fitted on labelled looks (an evaluation's, see `executive calibrate`) and kept in `calibration.json` beside the
model, by domain.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from executive.belief.action_model import Chances
from executive.belief.bayes_filter import BayesMonitor
from executive.belief.conformal import Conformal
from executive.belief.mutex_inference import MutexNetwork
from executive.belief.sensor_model import ErrorModel, SensorModel
from executive.errors import DomainError, InputError, nearest
from executive.s3e import calibration_file
from executive.s3e.calibration_file import CORRELATION, Document, DomainTable, ErrorTable, PredicateTable
from executive.types import Atom, Belief, SkillStatus
from executive.util.files import caseless, home, read_toml

if TYPE_CHECKING:
    from executive.s3e.calibration import Calibration, Scaling

PRIOR = 10.0
"""The weight of the assumed error rates, in answers."""


@dataclass(frozen=True, slots=True)
class SensorFit:
    """An estimator's sensor model and conformal scores in one domain, fitted on `looks` looks.

    `repeats` are the measured correlations of the errors of repeated questions by predicate and by what was changed,
    one of `CHANGES`.
    """

    sensor_model: SensorModel
    conformal: Conformal
    looks: int
    repeats: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: MappingProxyType({}))


AGAIN, CAMERAS, PICTURE, WORDING = CHANGES = ("again", "cameras", "picture", "wording")
"""What may change between two askings of the same question: nothing but the moment, the cameras, the picture (its
light, its noise), or the words. The order of questions changes nothing: each is asked by itself."""

Look = tuple[Mapping[Atom, float], Mapping[Atom, bool]]
"""A labelled look: the probability of each answered atom, as a run would get it, and the truth."""


def fit(
    looks: Sequence[Look],
    network: MutexNetwork | None,
    repeats: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> SensorFit:
    """Fit a sensor model and conformal scores on labelled looks.

    The error models are fitted on half of the looks, drawn by a fixed seed (not every other look: they alternate, as
    picks and places do): one for each predicate, and one for each atom, shrunk towards its predicate's. The other half
    is for the thresholds: each look is made consistent by the mutex groups of `network`, as in a run, and scored. The
    order of the looks only decides which half each is in.

    Args:
        network: None where objects change from look to look: nothing is fitted for single atoms then, which no other
            problem has, and each answer is scored by itself.
        repeats: the measured correlations of repeated questions (`SensorFit.repeats`); without one, it is assumed.

    Raises:
        InputError: there are fewer than two looks with answers.
    """
    labelled = [(probability, truth) for probability, truth in looks if probability.keys() & truth.keys()]
    if len(labelled) < 2:
        raise InputError("fewer than two looks have answers and labels: there is nothing to fit")
    shuffled = random.Random(0).sample(labelled, len(labelled))
    for_model, for_thresholds = shuffled[::2], shuffled[1::2]
    atoms = sorted({atom for probability, truth in for_model for atom in probability if atom in truth})
    error_models = _fit_error_models(for_model, {atom: atom.predicate for atom in atoms}, ErrorModel())
    single: dict[Atom, ErrorModel] = {}
    for predicate, model in error_models.items() if network is not None else ():
        names = {atom: f"{predicate}-{number}" for number, atom in enumerate(atoms) if atom.predicate == predicate}
        if len(names) > 1:
            found = _fit_error_models(for_model, names, model)
            single |= {atom: found[name] for atom, name in names.items()}
    correlations = {name: told[AGAIN] for name, told in repeats.items() if AGAIN in told}
    sensor = SensorModel(
        error_models,
        correlation_within=CORRELATION,
        correlation_across=CORRELATION,
        atoms=single,
        correlations=correlations,
    )
    same = None if network is None else BayesMonitor(network, sensor, actions=None)
    judged = []
    for probability, truth in for_thresholds:
        monitor = same or BayesMonitor(MutexNetwork(tuple(probability)), sensor, actions=None)
        judged.append((monitor.looked(monitor.begin(), Belief(-1, probability), 0)[1].belief.probability, truth))
    return SensorFit(sensor, Conformal.of(judged), len(labelled), repeats)


def _fit_error_models(looks: Sequence[Look], names: Mapping[Atom, str], assumed: ErrorModel) -> dict[str, ErrorModel]:
    """Fit an error model for each class of atoms, by the class's name in `names`. With few answers, error rates are
    shrunk towards the `assumed` ones, slope and bias towards those of all classes together."""
    from executive.s3e.calibration import fit as fit_calibration

    renamed, pairs = [], {name: list[tuple[float, bool]]() for name in names.values()}
    for probability, truth in looks:
        answers = {atom: value for atom, value in probability.items() if atom in names and atom in truth}
        for atom, value in answers.items():
            pairs[names[atom]].append((value, truth[atom]))
        new = {atom: Atom(names[atom], atom.args) for atom in answers}
        renamed.append((Belief(-1, {new[a]: p for a, p in answers.items()}), {new[a]: truth[a] for a in answers}))
    scaling = fit_calibration(renamed)
    error_models = {}
    for name, correction in scaling.predicates.items():
        misses = _rate([value < 0.5 for value, true in pairs[name] if true], assumed.misses)
        false_alarms = _rate([value >= 0.5 for value, true in pairs[name] if not true], assumed.false_alarms)
        if misses + false_alarms >= 0.99:  # the answers are uninformative, or inverted
            misses = false_alarms = 0.495
        # The correction includes the base rate of true atoms, which is no part of a likelihood ratio. A class with few
        # true or few false atoms was shrunk towards all of them there, and so is its base rate here.
        rarer = min(correction.true, correction.false)
        own, shared = _log_odds(correction), _log_odds(scaling.shared)
        bias = correction.bias - (rarer * own + PRIOR * shared) / (rarer + PRIOR)
        error_models[name] = ErrorModel(false_alarms, misses, correction.slope, bias)
    return error_models


def _log_odds(labels: Scaling) -> float:
    """Return the log-odds of an atom's being true among these labels."""
    return math.log((labels.true + 1) / (labels.false + 1))


def _rate(wrong: Sequence[bool], assumed: float) -> float:
    return (sum(wrong) + PRIOR * assumed) / (len(wrong) + PRIOR)


def load_outcomes(file: Path, actions: Collection[str]) -> Mapping[tuple[str, SkillStatus], Chances]:
    """Read a domain's `outcomes.toml`: how often each outcome was counted, by action and reported status.

    Raises:
        DomainError: the first mistake, in one line with file and key.
    """
    document = read_toml(file, mistake=DomainError)
    statuses = [status.value for status in SkillStatus]
    counts = {}
    for action, table in caseless(document, file, "", mistake=DomainError).items():
        if action not in actions:
            raise DomainError(f"there is no action {action!r}; {nearest(action, actions)}", file=file, key=action)
        if not isinstance(table, dict):
            raise DomainError(f"expected a table, got {table!r:.40}", file=file, key=action)
        for status, numbers in table.items():
            key = f"{action}.{status}"
            if status not in statuses:
                raise DomainError(f"no skill reports {status!r}; {nearest(status, statuses)}", file=file, key=key)
            if (
                not isinstance(numbers, list)
                or len(numbers) != len(Chances._fields)
                or not all(type(number) is int and number >= 0 for number in numbers)
            ):
                raise DomainError(
                    f"expected three counts (all effects, nothing, something else), got {numbers!r:.40}",
                    file=file,
                    key=key,
                )
            counts[action, SkillStatus(status)] = Chances(*numbers)
    return counts


def save(path: Path, domain: str, fitted: SensorFit, calibration: Calibration | None = None, **about: str) -> Path:
    """Write a domain's fit into the file, atomically, and keep those of other domains, and the correction. Given a
    folder (a model's), the file is `calibration.json` in it.

    Args:
        calibration: the correction of the probabilities that the fit is of, in place of the file's.
        about: the model, the runtime and the quantisation, as far as they are known.

    Raises:
        InputError: it cannot be written, or what is there is no such file, or one of another model.
    """
    is_there = calibration_file.is_in(path) if os.path.isdir(path) else os.path.exists(path)
    document = calibration_file.read(path) if is_there else Document()
    for key, value in about.items():
        if (known := getattr(document, key)) and value and known != value:
            raise InputError(f"is {known!r} there and {value!r} here", file=calibration_file.place(path), key=key)
    sensor = fitted.sensor_model
    predicates = {
        name: PredicateTable(
            **asdict(model),
            scores=[round(score, 9) for score in fitted.conformal.scores.get(name, ())],
            repeats=dict(fitted.repeats.get(name, {})),
        )
        for name, model in sorted(sensor.error_models.items())
    }
    table = DomainTable(
        looks=fitted.looks,
        correlation_within=sensor.correlation_within,
        correlation_across=sensor.correlation_across,
        predicates=predicates,
        atoms={str(atom): ErrorTable(**asdict(model)) for atom, model in sorted(sensor.atoms.items())},
    )
    changed: dict[str, Any] = {key: value for key, value in about.items() if value}
    changed["domains"] = dict(sorted({**document.domains, domain: table}.items()))
    if calibration is not None:
        changed["correction"] = calibration.table()
    return calibration_file.write(path, document.model_copy(update=changed))


def load(path: Path, domain: str) -> SensorFit:
    """Read a domain's fit; given a folder, from `calibration.json` in it.

    Raises:
        InputError: the first mistake, in one line with file and key, or the file has no fit for that domain.
    """
    return of(calibration_file.read(path), domain, calibration_file.place(path))


def of(document: Document, domain: str, file: Path) -> SensorFit:
    """Return a domain's fit in the contents of a file.

    Raises:
        InputError: the first mistake, in one line with file and key, or there is no fit for that domain.
    """
    domains = document.domains
    if domain not in domains:
        raise InputError(f"has no fit for the domain {domain!r}; {nearest(domain, domains)}", file=file, key="domains")
    table = domains[domain]
    error_models, scores, atoms, repeats = {}, {}, {}, dict[str, Mapping[str, float]]()
    for name, kept in table.predicates.items():
        try:
            error_models[name] = _error_model(kept)
            if kept.scores:
                scores[name] = Conformal({name: tuple(kept.scores)}).scores[name]
            if kept.repeats:
                repeats[name] = kept.repeats
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.predicates.{name}") from None
    for name, single in table.atoms.items():
        try:
            atoms[Atom.parse(name)] = _error_model(single)
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.atoms.{name}") from None
    try:
        sensor = SensorModel(
            error_models,
            correlation_within=table.correlation_within,
            correlation_across=table.correlation_across,
            atoms=atoms,
            correlations={name: told[AGAIN] for name, told in repeats.items() if AGAIN in told},
        )
        return SensorFit(sensor, Conformal(scores), table.looks, repeats)
    except ValueError as error:
        raise InputError(str(error), file=file, key=f"domains.{domain}") from None


def default_file(vlm: str | None) -> Path | None:
    """Return a model's folder if there is such a file in it."""
    folder = None if vlm is None else home(vlm)
    return folder if folder is not None and calibration_file.is_in(folder) else None


def _error_model(kept: ErrorTable) -> ErrorModel:
    return ErrorModel(kept.false_alarms, kept.misses, kept.slope, kept.bias)
