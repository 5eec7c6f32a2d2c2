"""Calibration: corrects a model's probabilities to observed frequencies, predicate by predicate.

A correction is two numbers: log-odds are multiplied by a slope and shifted by a bias. The slope alone is temperature
scaling (Guo et al. 2017; the slope is 1 / temperature), both are Platt scaling (Platt 1999, whose softened targets keep
the fit finite where few or perfectly separated examples would not). Predicates with few examples of the rarer truth
value are shrunk towards the correction that all predicates share.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from executive.errors import InputError, nearest
from executive.types import Atom, Belief, FloatArray
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json

FILE = "calibration.json"
"""The name of the file beside a model."""

PRIOR = 10.0
"""A predicate with this many examples of its rarer truth value counts as much as all predicates together."""

LEAST_SLOPE = 0.01
"""The slope for uninformative or inverted answers: it leaves almost nothing of them, and keeps their order."""

_EDGE = 1e-6
"""Probabilities are clipped to [_EDGE, 1 - _EDGE]: log-odds of at most 13.8."""
_FORMAT = 1
_LARGEST = 1_000_000
_ABOUT = (
    "How to correct a vision-language model's probabilities (executive.s3e): log-odds times slope plus bias, for the "
    "predicates named here; for all others, shared. true and false: how many labels that rests on."
)


class Method(StrEnum):
    TEMPERATURE = "temperature"
    PLATT = "platt"


@dataclass(frozen=True, slots=True)
class Scaling:
    """The correction P -> sigmoid(slope * logit(P) + bias), fitted on the labels of so many true and false atoms."""

    slope: float = 1.0
    bias: float = 0.0
    true: int = 0
    false: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.slope) and self.slope > 0 and math.isfinite(self.bias)):
            raise ValueError(f"slope {self.slope!r} and bias {self.bias!r} do not keep the order of probabilities")
        if self.true < 0 or self.false < 0:
            raise ValueError(f"{min(self.true, self.false)} labels are fewer than none")

    def __call__(self, probability: float) -> float:
        """Return the corrected probability, which increases strictly within [1e-6, 1 - 1e-6]."""
        if not 0.0 <= probability <= 1.0:
            raise ValueError(f"{probability!r} is not a probability")
        return _sigmoid(self.slope * _logit(probability) + self.bias)


@dataclass(frozen=True, slots=True)
class Calibration:
    """A correction for each predicate. As a function, it is what `S3E` takes as `calibrate`."""

    shared: Scaling = field(default_factory=Scaling)
    predicates: Mapping[str, Scaling] = field(default_factory=dict)
    method: Method = Method.PLATT
    model: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "predicates", MappingProxyType(dict(sorted(self.predicates.items()))))

    def __call__(self, atom: Atom, probability: float) -> float:
        return self.predicates.get(atom.predicate, self.shared)(probability)

    def apply(self, belief: Belief) -> Belief:
        """Return the belief with corrected probabilities, and the same evidence and unanswered atoms."""
        corrected = {atom: self(atom, probability) for atom, probability in belief.probability.items()}
        return replace(belief, probability=corrected)

    def save(self, path: Path | str) -> Path:
        """Write the file atomically; given a folder (a model's), `calibration.json` in it.

        Raises:
            InputError: it cannot be written.
        """
        file = _file(path)
        document = {
            "about": _ABOUT,
            "format": _FORMAT,
            "model": self.model,
            "method": self.method.value,
            "shared": _as_table(self.shared),
            "predicates": {predicate: _as_table(scaling) for predicate, scaling in self.predicates.items()},
        }
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            return write_atomic(file, (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=file) from None

    @classmethod
    def load(cls, path: Path | str) -> Calibration:
        """Read what `save` wrote; given a folder, `calibration.json` in it.

        Raises:
            InputError: the first mistake, in one line with file and key.
        """
        file = _file(path)
        document = _read(file)
        if "domains" in document:
            message = "has a sensor model, not a calibration of probabilities: it is for executive run --trust"
            raise InputError(message, file=file)
        valid = ("about", "format", "model", "method", "shared", "predicates")
        for key in document:
            if key not in valid:
                raise InputError(f"unknown key; {nearest(key, valid)}", file=file, key=key)
        if document.get("format") != _FORMAT:
            raise InputError(f"expected {_FORMAT}, got {document.get('format')!r}", file=file, key="format")
        methods = [method.value for method in Method]
        if document.get("method") not in methods:
            raise InputError(
                f"no method {document.get('method')!r}; valid: {', '.join(methods)}", file=file, key="method"
            )
        model, predicates = document.get("model", ""), document.get("predicates", {})
        if not isinstance(model, str):
            raise InputError(f"expected a name, got {model!r:.40}", file=file, key="model")
        if not isinstance(predicates, dict):
            raise InputError(f"expected a table of predicates, got {predicates!r:.40}", file=file, key="predicates")
        return cls(
            _scaling(document.get("shared"), file, "shared"),
            {name: _scaling(table, file, f"predicates.{name}") for name, table in predicates.items()},
            Method(document["method"]),
            model,
        )


def fit(
    looks: Iterable[tuple[Belief, Mapping[Atom, bool]]], method: Method | str = Method.PLATT, model: str = ""
) -> Calibration:
    """Learn from labelled looks: what was believed (without calibration), and the truth. Atoms without a probability or
    a label do not count.

    Raises:
        InputError: no atom has both.
    """
    method = Method(method)
    seen: dict[str, list[tuple[float, bool]]] = {}
    source = ""
    for belief, truth in looks:
        source = source or belief.source
        for atom, probability in belief.probability.items():
            if atom in truth:
                seen.setdefault(atom.predicate, []).append((_logit(probability), truth[atom]))
    if not seen:
        raise InputError("there is nothing to learn from: no atom has both a probability and a label")
    data = {predicate: np.array(pairs, dtype=np.float64) for predicate, pairs in sorted(seen.items())}
    shared = _fit(np.concatenate(list(data.values())), method)
    predicates = {predicate: _leaning(_fit(pairs, method), shared) for predicate, pairs in data.items()}
    return Calibration(shared, predicates, method, model or source)


def _leaning(own: Scaling, shared: Scaling) -> Scaling:
    """Between its own correction and the shared one, by how many examples its own rests on. Between two slopes in terms
    of their logarithms, so that the order of probabilities is kept."""
    rarer = min(own.true, own.false)
    weight = rarer / (rarer + PRIOR)
    slope = math.exp(weight * math.log(own.slope) + (1 - weight) * math.log(shared.slope))
    return Scaling(slope, weight * own.bias + (1 - weight) * shared.bias, own.true, own.false)


def _fit(pairs: FloatArray, method: Method) -> Scaling:
    """The likeliest correction of (N, 2) log-odds and labels."""
    from sklearn.linear_model import LogisticRegression

    odds, label = pairs[:, 0], pairs[:, 1]
    true = int(label.sum())
    false = len(label) - true
    target = np.where(label == 1.0, (true + 1) / (true + 2), 1 / (false + 2))
    # A target of 0.9 is nine parts of an example of true and one part of an example of false.
    regression = LogisticRegression(C=np.inf, fit_intercept=method is Method.PLATT, tol=1e-8, max_iter=1000)
    regression.fit(
        np.concatenate([odds, odds])[:, None],
        np.concatenate([np.ones_like(label), np.zeros_like(label)]),
        sample_weight=np.concatenate([target, 1 - target]),
    )
    slope = float(regression.coef_[0, 0])
    bias = float(regression.intercept_[0]) if method is Method.PLATT else 0.0
    if slope < LEAST_SLOPE:
        slope, bias = LEAST_SLOPE, _logit(float(target.mean())) if method is Method.PLATT else 0.0
    return Scaling(slope, bias, true, false)


def _logit(probability: float) -> float:
    kept = min(1.0 - _EDGE, max(_EDGE, probability))
    return math.log(kept / (1.0 - kept))


def _sigmoid(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds)) if odds >= 0 else 1.0 - 1.0 / (1.0 + math.exp(min(700.0, odds)))


def _file(path: Path | str) -> Path:
    return Path(path) / FILE if os.path.isdir(path) else Path(path)


def _as_table(scaling: Scaling) -> dict[str, float]:
    return {"slope": scaling.slope, "bias": scaling.bias, "true": scaling.true, "false": scaling.false}


def _read(file: Path) -> dict[str, Any]:
    document = read_json(file, largest=_LARGEST)
    if not isinstance(document, dict):
        raise InputError("is not a calibration that Executive wrote", file=file)
    return document


def _scaling(table: object, file: Path, key: str) -> Scaling:
    valid = {"slope": (int, float), "bias": (int, float), "true": (int,), "false": (int,)}
    if not isinstance(table, dict):
        raise InputError(f"expected a table with {', '.join(valid)}, got {table!r:.40}", file=file, key=key)
    for name, value in table.items():
        if name not in valid:
            raise InputError(f"unknown key; {nearest(name, valid)}", file=file, key=f"{key}.{name}")
        if isinstance(value, bool) or not isinstance(value, valid[name]):
            raise InputError(f"expected a number, got {value!r:.40}", file=file, key=f"{key}.{name}")
    for name in ("slope", "bias"):
        if name not in table:
            raise InputError("is missing", file=file, key=f"{key}.{name}")
    try:
        return Scaling(**table)
    except (ValueError, OverflowError) as error:
        raise InputError(str(error), file=file, key=key) from None
