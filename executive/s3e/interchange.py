"""The files of the package `s3e` 0.5, by the authors of the S3E paper: prediction sets and Platt profiles. They are
read and written without that package.

    profile = PlattProfile.read("platt.json")
    estimator = S3E(backend, questions, calibrate=profile)      # a profile corrects as it does there
    PredictionSet.of(belief, questions).write("predictions.json")

What has no answer there (the null option out-masses the others, or no option has any mass) has a probability of 0.5
there, and is unanswered here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.errors import InputError
from executive.s3e.backends.interface import AnswerWords
from executive.s3e.calibration import Calibration, Scaling
from executive.types import Atom, Belief, Evidence, Questions
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json
from executive.util.validation import first_mistake

VERSION = 1
"""The version of both formats in s3e 0.5."""

GLOBAL, LIFTED, GROUNDED = SCOPES = ("global", "lifted", "grounded")
"""What a profile has a correction for: all atoms, each predicate, or each atom."""

_EVERY = "__global__"
_EPS = 1e-12
_LARGEST = 100_000_000


M = TypeVar("M", bound=BaseModel)


class _Table(BaseModel):
    """Contents of these files: what later versions may add is left alone."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True)


class _Option(_Table):
    label: str
    tokens: list[str] = Field(min_length=1)


class _Answers(_Table):
    type: str = "binary"
    options: list[_Option] = Field(min_length=2)
    null_option: _Option | None = None
    true_label: str
    false_label: str


class _Prediction(_Table):
    query: str
    masses: dict[str, float]
    null_mass: float = Field(ge=0.0)
    unassigned_mass: float = Field(ge=0.0)
    text: str | None = None
    argmax_in_interest: bool | None = None
    probability_override: float | None = Field(None, ge=0.0, le=1.0)
    answers: _Answers


class _Predictions(_Table):
    format_version: int
    predictions: dict[str, _Prediction]


class _Group(_Table):
    a: float = Field(allow_inf_nan=False)
    b: float = Field(allow_inf_nan=False)
    sample_count: int = Field(0, ge=0)
    positive_count: int = Field(0, ge=0)
    negative_count: int = Field(0, ge=0)


class _Platt(_Table):
    format_version: int
    kind: str = "platt"
    scope: str
    meta: dict[str, Any] = {}
    groups: dict[str, _Group]


@dataclass(frozen=True, slots=True)
class Prediction:
    """The answer to the question about an atom: the probability masses on the true, the false and the null answer, and
    the rest; `calibrated` is the corrected probability, if there is one."""

    query: str
    true_mass: float
    false_mass: float
    null_mass: float = 0.0
    unassigned_mass: float = 0.0
    calibrated: float | None = None

    @property
    def probability(self) -> float | None:
        """P(true); None where there is no answer."""
        asserted = self.true_mass + self.false_mass
        if asserted <= 0.0 or self.null_mass > max(self.true_mass, self.false_mass):
            return None
        return self.true_mass / asserted if self.calibrated is None else self.calibrated


@dataclass(frozen=True, slots=True)
class PredictionSet:
    """Predictions by atom, in the words of their answers."""

    predictions: Mapping[Atom, Prediction]
    words: AnswerWords

    @classmethod
    def of(cls, belief: Belief, questions: Questions) -> PredictionSet:
        """Make a prediction set of what `S3E` estimated: masses are the means over the views, as there. Probabilities
        that were corrected are kept beside the masses."""
        found = {}
        for atom, evidence in belief.evidence.items():
            true, false = (_mean(getattr(each, name) for each in evidence) for name in ("yes_mass", "no_mass"))
            rest = max(0.0, 1.0 - true - false)
            plain = Prediction(questions.text.get(atom, ""), true, false, 0.0, rest)
            told = belief.probability.get(atom)
            if told is not None and told != plain.probability:
                plain = Prediction(plain.query, true, false, 0.0, rest, told)
            found[atom] = plain
        return cls(MappingProxyType(found), AnswerWords(*questions.answers))

    def belief(self, observation_id: int = 0, source: str = "s3e") -> Belief:
        """Return the probabilities as an estimator's, with the masses as evidence."""
        told = {atom: each.probability for atom, each in self.predictions.items()}
        return Belief(
            observation_id,
            {atom: probability for atom, probability in told.items() if probability is not None},
            frozenset(atom for atom, probability in told.items() if probability is None),
            source,
            {atom: (Evidence((), each.true_mass, each.false_mass),) for atom, each in self.predictions.items()},
        )

    @classmethod
    def read(cls, path: Path | str) -> PredictionSet:
        """Read what s3e's `PredictionSet.to_dict` makes, as JSON.

        Raises:
            InputError: the first mistake, in one line with file and key; or the answers are not two.
        """
        file = Path(path)
        document = _read(file, _Predictions)
        found: dict[Atom, Prediction] = {}
        words = AnswerWords("yes", "no")
        for name, each in document.predictions.items():
            key = f"predictions.{name}"
            if each.answers.type != "binary":
                raise InputError(f"has {each.answers.type} answers, not a true and a false one", file=file, key=key)
            labels = each.answers.true_label, each.answers.false_label
            if odd := [label for label in labels if label not in each.masses]:
                raise InputError(f"has no mass for {odd[0]!r}", file=file, key=f"{key}.masses")
            words = AnswerWords(labels[0].lower(), labels[1].lower())
            true, false = (each.masses[label] for label in labels)
            if not (math.isfinite(true + false) and min(true, false) >= 0.0):
                raise InputError(f"{true} and {false} are not masses", file=file, key=f"{key}.masses")
            found[_atom(name, file, key)] = Prediction(
                each.query, true, false, each.null_mass, each.unassigned_mass, each.probability_override
            )
        return cls(MappingProxyType(found), words)

    def write(self, path: Path | str) -> Path:
        """Write what s3e's `PredictionSet.from_dict` reads, as JSON, atomically.

        Raises:
            InputError: it cannot be written.
        """
        forms = self.words.forms()
        labels = self.words.affirmative, self.words.negative
        options = [_Option(label=label, tokens=list(told)) for label, told in zip(labels, forms, strict=True)]
        answers = _Answers(options=options, true_label=labels[0], false_label=labels[1])
        predictions = {
            str(atom): _Prediction(
                query=each.query,
                masses=dict(zip(labels, (each.true_mass, each.false_mass), strict=True)),
                null_mass=each.null_mass,
                unassigned_mass=each.unassigned_mass,
                probability_override=each.calibrated,
                answers=answers,
            )
            for atom, each in self.predictions.items()
        }
        return _write(Path(path), _Predictions(format_version=VERSION, predictions=predictions))


@dataclass(frozen=True, slots=True)
class PlattProfile:
    """Platt scaling in s3e's form, P = 1 / (1 + exp(a * log-odds + b)). As a function, it is what `S3E` takes as
    `calibrate`; atoms without a group keep their probability.

    Attributes:
        groups: slope (-a) and bias (-b), by predicate or by atom as text, or one under `__global__`, as the scope is.
        counts: the labels that these rest on: of true and of false atoms.
        meta: what s3e knows of where it comes from: it refuses a profile of another domain or other answers.
    """

    scope: str
    groups: Mapping[str, tuple[float, float]]
    counts: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, atom: Atom, probability: float) -> float:
        key = {GLOBAL: _EVERY, LIFTED: atom.predicate}.get(self.scope, str(atom))
        if key not in self.groups:
            return probability
        slope, bias = self.groups[key]
        kept = min(1.0 - _EPS, max(_EPS, probability))
        logit = max(-700.0, min(700.0, slope * math.log(kept / (1.0 - kept)) + bias))
        return 1.0 / (1.0 + math.exp(-logit))

    @classmethod
    def of(cls, calibration: Calibration, predicates: Iterable[str] = ()) -> PlattProfile:
        """Make a profile of a calibration: a group for each predicate that it knows, and for each of `predicates`."""
        names = sorted({*calibration.predicates, *predicates})
        scalings = {name: calibration.predicates.get(name, calibration.shared) for name in names}
        return cls(
            LIFTED,
            {name: (each.slope, each.bias) for name, each in scalings.items()},
            {name: (each.true, each.false) for name, each in scalings.items()},
            {"scoring": "logprobs"},
        )

    def calibration(self, model: str = "") -> Calibration:
        """Return the profile as a calibration.

        Raises:
            InputError: it has a correction for each atom, or one that reverses the order of probabilities.
        """
        if self.scope == GROUNDED:
            raise InputError("corrects each atom by itself; a calibration has one correction for each predicate")
        try:
            scalings = {
                key: Scaling(slope, bias, *self.counts.get(key, (0, 0))) for key, (slope, bias) in self.groups.items()
            }
        except ValueError as error:
            raise InputError(f"reverses what a model says: {error}") from None
        if self.scope == GLOBAL:
            return Calibration(scalings.get(_EVERY, Scaling()), {}, model=model)
        return Calibration(Scaling(), scalings, model=model)

    @classmethod
    def read(cls, path: Path | str) -> PlattProfile:
        """Read what s3e's `PlattCalibrator.save` writes.

        Raises:
            InputError: the first mistake, in one line with file and key.
        """
        file = Path(path)
        document = _read(file, _Platt)
        if document.kind != "platt":
            raise InputError(f"expected 'platt', got {document.kind!r:.40}", file=file, key="kind")
        if document.scope not in SCOPES:
            raise InputError(f"no scope {document.scope!r:.40}; valid: {', '.join(SCOPES)}", file=file, key="scope")
        return cls(
            document.scope,
            {key: (-group.a, -group.b) for key, group in document.groups.items()},
            {key: (group.positive_count, group.negative_count) for key, group in document.groups.items()},
            document.meta,
        )

    def write(self, path: Path | str) -> Path:
        """Write what s3e's `PlattCalibrator.load` reads, atomically.

        Raises:
            InputError: it cannot be written.
        """
        groups = {}
        for key, (slope, bias) in self.groups.items():
            true, false = self.counts.get(key, (0, 0))
            groups[key] = _Group(
                a=-slope, b=-bias, sample_count=true + false, positive_count=true, negative_count=false
            )
        return _write(Path(path), _Platt(format_version=VERSION, scope=self.scope, meta=dict(self.meta), groups=groups))


def _read(file: Path, model: type[M]) -> M:
    content = read_json(file, largest=_LARGEST)
    found = content.get("format_version") if isinstance(content, dict) else None
    if found != VERSION:
        raise InputError(f"expected {VERSION} as in s3e 0.5, got {found!r:.40}", file=file, key="format_version")
    try:
        return model.model_validate(content)
    except ValidationError as error:
        key, message = first_mistake(error, model)
        raise InputError(message, file=file, key=".".join(key) or None) from None


def _write(file: Path, document: BaseModel) -> Path:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document.model_dump(), indent=2, sort_keys=True, ensure_ascii=False)
        return write_atomic(file, (text + "\n").encode())
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=file) from None


def _atom(name: str, file: Path, key: str) -> Atom:
    try:
        return Atom.parse(name)
    except ValueError as error:
        raise InputError(str(error), file=file, key=key) from None


def _mean(values: Iterable[float]) -> float:
    kept = [min(1.0, max(0.0, value)) for value in values]
    return sum(kept) / len(kept) if kept else 0.0
