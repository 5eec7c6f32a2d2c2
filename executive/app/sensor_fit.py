"""Fits an estimator's sensor model and conformal thresholds in a domain, and reads and writes them.

Both are fitted on labelled looks (an evaluation's, see `executive calibrate`) and kept in a file beside the model,
`trust.json`, by domain.
"""

from __future__ import annotations

import json
import math
import os
import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.belief.action_model import Chances
from executive.belief.bayes_filter import BayesMonitor
from executive.belief.conformal import Conformal
from executive.belief.mutex_inference import MutexNetwork
from executive.belief.sensor_model import ErrorModel, SensorModel
from executive.errors import DomainError, InputError, nearest
from executive.types import Atom, Belief, SkillStatus
from executive.util.atomic_write import write_atomic
from executive.util.files import caseless, home, read_json, read_toml
from executive.util.validation import first_mistake

if TYPE_CHECKING:
    from executive.s3e.calibration import Scaling

FILE = "trust.json"
"""The name of the file beside a model."""

PRIOR = 10.0
"""The weight of the assumed error rates, in answers."""

CORRELATION = 0.8
"""The assumed correlation of a model's errors about the same thing, within a moment and across moments (see
`SensorModel`): asked about the same thing again, a model answers the same."""

_FORMAT = 1
_LARGEST = 20_000_000
_ABOUT = (
    "The model's error rates (executive.app.sensor_fit), by domain, predicate and atom: the evidence of an answer is "
    "slope * log-odds + bias, within the bounds that false_alarms and misses set; scores are the nonconformity of "
    "calibration looks (executive.belief.conformal); alike and lasting are the correlations of errors within and "
    "across moments."
)


@dataclass(frozen=True, slots=True)
class SensorFit:
    """An estimator's sensor model and conformal scores in one domain, fitted on `looks` looks."""

    sensor_model: SensorModel
    conformal: Conformal
    looks: int


Look = tuple[Mapping[Atom, float], Mapping[Atom, bool]]
"""A labelled look: the probability of each answered atom, as a run would get it, and the truth."""


def fit(looks: Sequence[Look], network: MutexNetwork) -> SensorFit:
    """Fit a sensor model and conformal scores on labelled looks.

    The error models are fitted on half of the looks, drawn by a fixed seed (not every other look: they alternate, as
    picks and places do): one for each predicate, and one for each atom, shrunk towards its predicate's. The other half
    is for the thresholds: each look is made consistent by the mutex groups of `network`, as in a run, and scored. The
    order of the looks only decides which half each is in.

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
    for predicate, model in error_models.items():
        names = {atom: f"{predicate}-{number}" for number, atom in enumerate(atoms) if atom.predicate == predicate}
        if len(names) > 1:
            found = _fit_error_models(for_model, names, model)
            single |= {atom: found[name] for atom, name in names.items()}
    sensor = SensorModel(error_models, correlation_within=CORRELATION, correlation_across=CORRELATION, atoms=single)
    monitor = BayesMonitor(network, sensor, actions=None)
    judged = [
        (monitor.looked(monitor.begin(), Belief(-1, probability), 0)[1].belief.probability, truth)
        for probability, truth in for_thresholds
    ]
    return SensorFit(sensor, Conformal.of(judged), len(labelled))


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


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _ErrorModel(_Table):
    false_alarms: float
    misses: float
    slope: float
    bias: float


class _Predicate(_ErrorModel):
    scores: list[float] = []


class _Domain(_Table):
    looks: int = Field(ge=0)
    alike: float = Field(ge=0, le=1)
    lasting: float = Field(CORRELATION, ge=0, le=1)
    predicates: dict[str, _Predicate]
    atoms: dict[str, _ErrorModel] = {}


class _Document(_Table):
    about: str = ""
    format: int
    domains: dict[str, _Domain]


def save(path: Path, domain: str, fitted: SensorFit) -> Path:
    """Write a domain's fit into the file, atomically, and keep those of other domains. Given a folder (a model's), the
    file is `trust.json` in it.

    Raises:
        InputError: it cannot be written, or what is there is no such file.
    """
    file = path / FILE if os.path.isdir(path) else path
    domains = dict(_read(file).domains) if os.path.exists(file) else {}
    predicates = {
        name: _Predicate(**asdict(model), scores=[round(score, 9) for score in fitted.conformal.scores.get(name, ())])
        for name, model in sorted(fitted.sensor_model.error_models.items())
    }
    domains[domain] = _Domain(
        looks=fitted.looks,
        alike=fitted.sensor_model.correlation_within,
        lasting=fitted.sensor_model.correlation_across,
        predicates=predicates,
        atoms={str(atom): _ErrorModel(**asdict(model)) for atom, model in sorted(fitted.sensor_model.atoms.items())},
    )
    document = _Document(about=_ABOUT, format=_FORMAT, domains=dict(sorted(domains.items())))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        return write_atomic(file, (json.dumps(document.model_dump(), indent=1) + "\n").encode())
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=file) from None


def load(path: Path, domain: str) -> SensorFit:
    """Read a domain's fit; given a folder, from `trust.json` in it.

    Raises:
        InputError: the first mistake, in one line with file and key, or the file has no fit for that domain.
    """
    file = path / FILE if os.path.isdir(path) else path
    domains = _read(file).domains
    if domain not in domains:
        raise InputError(f"has no fit for the domain {domain!r}; {nearest(domain, domains)}", file=file, key="domains")
    table = domains[domain]
    error_models, scores, atoms = {}, {}, {}
    for name, kept in table.predicates.items():
        try:
            error_models[name] = _error_model(kept)
            if kept.scores:
                scores[name] = Conformal({name: tuple(kept.scores)}).scores[name]
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.predicates.{name}") from None
    for name, single in table.atoms.items():
        try:
            atoms[Atom.parse(name)] = _error_model(single)
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.atoms.{name}") from None
    try:
        sensor = SensorModel(
            error_models, correlation_within=table.alike, correlation_across=table.lasting, atoms=atoms
        )
        return SensorFit(sensor, Conformal(scores), table.looks)
    except ValueError as error:
        raise InputError(str(error), file=file, key=f"domains.{domain}") from None


def default_file(vlm: str | None) -> Path | None:
    """Return the file in a model's folder, if there is one."""
    file = None if vlm is None else home(vlm) / FILE
    return file if file is not None and os.path.isfile(file) else None


def _error_model(kept: _ErrorModel) -> ErrorModel:
    return ErrorModel(kept.false_alarms, kept.misses, kept.slope, kept.bias)


def _read(file: Path) -> _Document:
    content = read_json(file, largest=_LARGEST)
    if isinstance(content, dict) and {"shared", "method"} & content.keys():
        message = "has a calibration of probabilities, not a sensor model: it is for --calibration"
        raise InputError(message, file=file)
    try:
        document = _Document.model_validate(content)
    except ValidationError as error:
        key, message = first_mistake(error, _Document)
        raise InputError(
            f"is not a file that Executive wrote: {message}", file=file, key=".".join(key) or None
        ) from None
    if document.format != _FORMAT:
        raise InputError(f"expected {_FORMAT}, got {document.format}", file=file, key="format")
    return document
