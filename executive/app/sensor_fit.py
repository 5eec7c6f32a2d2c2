"""How far an eye can be trusted in a domain: what its answers are worth, and how sure it has to be for an error rate.

Both are learned from looks whose truth is known (an evaluation's, see `executive calibrate`) and lie in a file beside
the model, `trust.json`, domain by domain.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import random
import tempfile
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
from executive.util.files import caseless, home, read_json, read_toml

if TYPE_CHECKING:
    from executive.s3e.calibration import Scaling

FILE = "trust.json"
"""What the file is called that lies beside a model."""

PRIOR = 10.0
"""Rates are what they would be with so many more answers at the rates that are assumed where nothing was measured."""

TOGETHER = 0.8
"""How much a model's looks at the same thing are assumed to err together, at one moment and from one to the next (see
`SensorModel`): a model that is asked about the same thing once more answers the same."""

_FORMAT = 1
_LARGEST = 20_000_000
_ABOUT = (
    "How far this model's answers can be trusted (executive.app.sensor_fit), by domain, predicate and atom: the "
    "evidence of an answer is slope * log-odds + bias, and no more than false_alarms and misses allow; scores are"
    " the nonconformity of calibration looks (executive.belief.conformal)."
)


@dataclass(frozen=True, slots=True)
class Trust:
    """What was learned of one eye in one domain, from `looks` looks."""

    eye: SensorModel
    conformal: Conformal
    looks: int


Look = tuple[Mapping[Atom, float], Mapping[Atom, bool]]
"""The probability of each answered atom, as a run would get it, and the truth."""


def fit(looks: Sequence[Look], network: MutexNetwork) -> Trust:
    """Learn from labelled looks.

    What answers are worth is learned from half of the looks, drawn by a seed (not every other one: looks alternate, as
    picks and places do): by predicate and, leaning on that where there are few, for each atom alone. The rest is for
    thresholds: each of these looks is made consistent by the mutex groups of `network`, as in a run, and scored. Their
    order matters only for which goes where.

    Raises:
        InputError: there are fewer than two looks with answers.
    """
    kept = [(probability, truth) for probability, truth in looks if probability.keys() & truth.keys()]
    if len(kept) < 2:
        raise InputError("there is nothing to learn from: fewer than two looks have answers and labels")
    shuffled = random.Random(0).sample(kept, len(kept))
    for_eye, for_thresholds = shuffled[::2], shuffled[1::2]
    there = sorted({atom for probability, truth in for_eye for atom in probability if atom in truth})
    error_models = _readings(for_eye, {atom: atom.predicate for atom in there}, ErrorModel())
    single: dict[Atom, ErrorModel] = {}
    for predicate, reading in error_models.items():
        of_it = {atom: f"{predicate}-{number}" for number, atom in enumerate(there) if atom.predicate == predicate}
        if len(of_it) > 1:
            found = _readings(for_eye, of_it, reading)
            single |= {atom: found[name] for atom, name in of_it.items()}
    eye = SensorModel(error_models, alike=TOGETHER, lasting=TOGETHER, atoms=single)
    monitor = BayesMonitor(network, eye, actions=None)
    judged = [
        (monitor.looked(monitor.begin(), Belief(-1, probability), 0)[1].belief.probability, truth)
        for probability, truth in for_thresholds
    ]
    return Trust(eye, Conformal.of(judged), len(kept))


def _readings(looks: Sequence[Look], names: Mapping[Atom, str], assumed: ErrorModel) -> dict[str, ErrorModel]:
    """What answers are worth in each group of atoms, by the name that its atoms have. Where few were measured, rates
    lean on those that are assumed, the rest on what all groups have in common."""
    from executive.s3e.calibration import PRIOR as LEANING
    from executive.s3e.calibration import fit as fit_calibration

    renamed, pairs = [], {name: list[tuple[float, bool]]() for name in names.values()}
    for probability, truth in looks:
        told = {atom: value for atom, value in probability.items() if atom in names and atom in truth}
        for atom, value in told.items():
            pairs[names[atom]].append((value, truth[atom]))
        new = {atom: Atom(names[atom], atom.args) for atom in told}
        renamed.append((Belief(-1, {new[atom]: p for atom, p in told.items()}), {new[a]: truth[a] for a in told}))
    scaling = fit_calibration(renamed)
    error_models = {}
    for name, correction in scaling.predicates.items():
        misses = _rate([value < 0.5 for value, true in pairs[name] if true], assumed.misses)
        false_alarms = _rate([value >= 0.5 for value, true in pairs[name] if not true], assumed.false_alarms)
        if misses + false_alarms >= 0.99:  # the answers say nothing, or the opposite
            misses = false_alarms = 0.495
        # How often atoms were true is in the correction, and no part of what an answer is worth. A group that has few
        # of either kind leans on all of them there, and so it does here.
        rarer = min(correction.true, correction.false)
        own, shared = _log_odds(correction), _log_odds(scaling.shared)
        bias = correction.bias - (rarer * own + LEANING * shared) / (rarer + LEANING)
        error_models[name] = ErrorModel(false_alarms, misses, correction.slope, bias)
    return error_models


def _log_odds(labels: Scaling) -> float:
    """Of an atom's being true, among these labels."""
    return math.log((labels.true + 1) / (labels.false + 1))


def _rate(wrong: Sequence[bool], assumed: float) -> float:
    return (sum(wrong) + PRIOR * assumed) / (len(wrong) + PRIOR)


def load_outcomes(file: Path, actions: Collection[str]) -> Mapping[tuple[str, SkillStatus], Chances]:
    """How often the actions came to what, by action and by what the skill reported: a domain's `outcomes.toml`.

    Raises:
        DomainError: the first mistake, in one line with file and key.
    """
    said = read_toml(file, mistake=DomainError)
    statuses = [status.value for status in SkillStatus]
    counts = {}
    for action, table in caseless(said, file, "", mistake=DomainError).items():
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


class _Reading(_Table):
    false_alarms: float
    misses: float
    slope: float
    bias: float


class _Predicate(_Reading):
    scores: list[float] = []


class _Domain(_Table):
    looks: int = Field(ge=0)
    alike: float
    lasting: float = TOGETHER
    predicates: dict[str, _Predicate]
    atoms: dict[str, _Reading] = {}


class _Document(_Table):
    about: str = ""
    format: int
    domains: dict[str, _Domain]


def save(path: Path, domain: str, trust: Trust) -> Path:
    """Write what was learned about a domain beside what the file says of others; given a folder (a model's),
    `trust.json` in it. The file is whole or as it was.

    Raises:
        InputError: it cannot be written, or what is there is no such file.
    """
    file = path / FILE if os.path.isdir(path) else path
    domains = dict(_read(file).domains) if os.path.exists(file) else {}
    predicates = {
        name: _Predicate(**asdict(reading), scores=[round(score, 9) for score in trust.conformal.scores.get(name, ())])
        for name, reading in sorted(trust.eye.error_models.items())
    }
    domains[domain] = _Domain(
        looks=trust.looks,
        alike=trust.eye.alike,
        lasting=trust.eye.lasting,
        predicates=predicates,
        atoms={str(atom): _Reading(**asdict(reading)) for atom, reading in sorted(trust.eye.atoms.items())},
    )
    document = _Document(about=_ABOUT, format=_FORMAT, domains=dict(sorted(domains.items())))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
        try:
            with open(handle, "w", encoding="utf-8") as stream:
                stream.write(json.dumps(document.model_dump(), indent=1) + "\n")
            os.chmod(name, 0o644)
            os.replace(name, file)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(name)
            raise
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=file) from None
    return file


def load(path: Path, domain: str) -> Trust:
    """What was learned about a domain; given a folder, from `trust.json` in it.

    Raises:
        InputError: the first mistake, in one line with file and key, or nothing was learned about that domain.
    """
    file = path / FILE if os.path.isdir(path) else path
    domains = _read(file).domains
    if domain not in domains:
        raise InputError(f"says nothing of the domain {domain!r}; {nearest(domain, domains)}", file=file, key="domains")
    table = domains[domain]
    error_models, scores, atoms = {}, {}, {}
    for name, said in table.predicates.items():
        try:
            error_models[name] = _reading(said)
            if said.scores:
                scores[name] = Conformal({name: tuple(said.scores)}).scores[name]
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.predicates.{name}") from None
    for name, single in table.atoms.items():
        try:
            atoms[Atom.parse(name)] = _reading(single)
        except ValueError as error:
            raise InputError(str(error), file=file, key=f"domains.{domain}.atoms.{name}") from None
    try:
        eye = SensorModel(error_models, alike=table.alike, lasting=table.lasting, atoms=atoms)
        return Trust(eye, Conformal(scores), table.looks)
    except ValueError as error:
        raise InputError(str(error), file=file, key=f"domains.{domain}") from None


def beside(vlm: str | None) -> Path | None:
    """The file beside a model's folder, if there is one."""
    file = None if vlm is None else home(vlm) / FILE
    return file if file is not None and os.path.isfile(file) else None


def _reading(said: _Reading) -> ErrorModel:
    return ErrorModel(said.false_alarms, said.misses, said.slope, said.bias)


def _read(file: Path) -> _Document:
    said = read_json(file, largest=_LARGEST)
    if isinstance(said, dict) and {"shared", "method"} & said.keys():
        message = "corrects probabilities, and says nothing of trust: it is for --calibration"
        raise InputError(message, file=file)
    try:
        document = _Document.model_validate(said)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or None
        raise InputError(f"is not what Executive wrote ({first['msg']})", file=file, key=key) from None
    if document.format != _FORMAT:
        raise InputError(f"expected {_FORMAT}, got {document.format}", file=file, key="format")
    return document
