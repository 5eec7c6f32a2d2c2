"""Calibration: corrects a model's probabilities to observed frequencies, predicate by predicate.

A correction is two numbers: log-odds are multiplied by a slope and shifted by a bias. The slope alone is temperature
scaling (Guo et al. 2017; the slope is 1 / temperature), both are Platt scaling (Platt 1999, whose softened targets keep
the fit finite where few or perfectly separated examples would not). The corrections of all predicates are fitted
together, with a normal prior around a shared one: the fewer examples tell of a predicate, the nearer is its correction
to that of all of them.

A correction has to earn its place: models that are right already get worse by one. Where it is known which looks belong
together (those of a problem, of an episode), a predicate keeps its correction only if probabilities of looks that it
was not fitted on come out better (cross-validation by what belongs together, as looks of one problem are alike).
"""

from __future__ import annotations

import math
import random
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from executive.errors import InputError, nearest
from executive.s3e.reliability import expected_calibration_error, pairs
from executive.types import Atom, Belief, FloatArray

if TYPE_CHECKING:  # files take pydantic, which a probability that is corrected does not
    from executive.s3e.calibration_file import CorrectionTable, Document, ScalingTable

STIFFNESS = 1.0
"""The inverse variance of the predicates' slopes and biases around the shared ones."""

LEAST_SLOPE = 0.01
"""The slope for uninformative or inverted answers: it leaves almost nothing of them, and keeps their order."""

_EDGE = 1e-6
"""Probabilities are clipped to [_EDGE, 1 - _EDGE]: log-odds of at most 13.8."""


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

    def corrected(self, data: FloatArray, names: Sequence[str]) -> FloatArray:
        """Return corrected probabilities, (N,), of (N, 3) log-odds, labels, and numbers of predicates in `names`."""
        scalings = [self.predicates.get(name, self.shared) for name in names]
        number = data[:, 2].astype(int)
        slope, bias = (np.array([getattr(each, key) for each in scalings]) for key in ("slope", "bias"))
        return _sigmoids(slope[number] * data[:, 0] + bias[number])

    def apply(self, belief: Belief) -> Belief:
        """Return the belief with corrected probabilities, and the same evidence and unanswered atoms."""
        corrected = {atom: self(atom, probability) for atom, probability in belief.probability.items()}
        return replace(belief, probability=corrected)

    def table(self) -> CorrectionTable:
        """Return the correction as it is in a file."""
        from executive.s3e.calibration_file import CorrectionTable, ScalingTable

        predicates = {name: ScalingTable(**asdict(scaling)) for name, scaling in self.predicates.items()}
        return CorrectionTable(
            method=self.method.value, shared=ScalingTable(**asdict(self.shared)), predicates=predicates
        )

    def save(self, path: Path | str) -> Path:
        """Write the correction into a file atomically; given a folder (a model's), into `calibration.json` in it. What
        else the file has stays.

        Raises:
            InputError: it cannot be written, or what is there is no such file.
        """
        from executive.s3e import calibration_file

        known = calibration_file.read(path) if calibration_file.place(path).is_file() else calibration_file.Document()
        changed = {"correction": self.table(), "model": self.model}
        return calibration_file.write(path, known.model_copy(update=changed))

    @classmethod
    def load(cls, path: Path | str) -> Calibration:
        """Read the correction in a file; given a folder, in `calibration.json` in it.

        Raises:
            InputError: the first mistake, in one line with file and key, or the file has no correction.
        """
        from executive.s3e import calibration_file

        file = calibration_file.place(path)
        found = cls.of(calibration_file.read(path), file)
        if found is None:
            raise InputError("is missing: the file corrects no probabilities", file=file, key="correction")
        return found

    @classmethod
    def of(cls, document: Document, file: Path) -> Calibration | None:
        """Return the correction in the contents of a file, if there is one.

        Raises:
            InputError: the first mistake, in one line with file and key.
        """
        table = document.correction
        if table is None:
            return None
        methods = [method.value for method in Method]
        if table.method not in methods:
            message = f"no method {table.method!r}; {nearest(table.method, methods)}"
            raise InputError(message, file=file, key="correction.method")
        return cls(
            _scaling(table.shared, file, "correction.shared"),
            {name: _scaling(each, file, f"correction.predicates.{name}") for name, each in table.predicates.items()},
            Method(table.method),
            document.model,
        )


def fit(
    looks: Iterable[tuple[Belief, Mapping[Atom, bool]]],
    method: Method | str = Method.PLATT,
    model: str = "",
    units: Sequence[Hashable] = (),
) -> Calibration:
    """Learn from labelled looks: what was believed (without calibration), and the truth. Atoms without a probability or
    a label do not count.

    Args:
        units: what each look belongs to; with at least `LEAST_UNITS` of them, corrections are adopted only where looks
            of other units come out better by them, and all of them only if they do so together.

    Raises:
        InputError: no atom has both.
        ValueError: there are units, but not one for each look.
    """
    method = Method(method)
    source, rows = "", list[tuple[float, bool, str, Hashable]]()
    looks = list(looks)
    for (belief, truth), unit in zip(looks, units or [0] * len(looks), strict=True):
        source = source or belief.source
        for atom, probability in belief.probability.items():
            if atom in truth:
                rows.append((_logit(probability), truth[atom], atom.predicate, unit))
    if not rows:
        raise InputError("there is nothing to learn from: no atom has both a probability and a label")
    predicates = tuple(sorted({row[2] for row in rows}))
    number = {name: index for index, name in enumerate(predicates)}
    data = np.array([(odds, label, number[name]) for odds, label, name, _ in rows], dtype=np.float64)
    found = _calibration(data, predicates, method, model or source)
    folds = _folds([row[3] for row in rows])
    return found if folds is None else _earned(found, data, folds)


def held_out(
    looks: Sequence[tuple[Belief, Mapping[Atom, bool]]],
    units: Sequence[Hashable],
    method: Method | str = Method.PLATT,
    parts: int | None = None,
) -> tuple[list[tuple[float, bool]], list[tuple[float, bool]]]:
    """Return all probabilities with their labels before and after calibration, in the order of the looks, each look's
    by what `fit` learns of the looks of other units.

    Args:
        parts: so many parts are left out in turn, `FOLDS` by default. With as many as there are units, each is left out
            by itself: the result does not hang on who is left out with whom, which matters where units are few and the
            share of true atoms differs between them.

    Raises:
        ValueError: there are fewer units than `LEAST_UNITS`, or not one for each look.
    """
    folds = _folds(units, parts or FOLDS)
    if folds is None:
        raise ValueError(f"at least {LEAST_UNITS} units are needed to hold some out")
    after: dict[int, list[tuple[float, bool]]] = {}
    for fold in np.unique(folds):
        known = np.flatnonzero(folds != fold).tolist()
        fitted = fit([looks[place] for place in known], method, units=[units[place] for place in known])
        for place in np.flatnonzero(folds == fold).tolist():
            belief, truth = looks[place]
            after[place] = pairs(fitted.apply(belief), truth)
    before = [pair for belief, truth in looks for pair in pairs(belief, truth)]
    return before, [pair for place in range(len(looks)) for pair in after[place]]


FOLDS = 10
"""Parts that labelled looks are divided into for cross-validation, at most: few parts leave less to learn from."""

LEAST_UNITS = 5
"""With fewer units, nothing is held out."""

BINS = 15
"""Bins of the calibration error that corrections must not raise."""


def _folds(units: Sequence[Hashable], parts: int = FOLDS) -> npt.NDArray[np.int64] | None:
    """Return for each row the number of the fold that its unit is in, by a fixed seed; None for too few units."""
    different = list(dict.fromkeys(units))
    if len(different) < LEAST_UNITS:
        return None
    turn = random.Random(0).sample(range(len(different)), len(different))
    fold = {unit: place % parts for unit, place in zip(different, turn, strict=True)}
    return np.array([fold[unit] for unit in units], dtype=np.int64)


def _earned(fitted: Calibration, data: FloatArray, folds: npt.NDArray[np.int64]) -> Calibration:
    """Return the calibration without the corrections that make probabilities of held-out looks no better: a predicate's
    logarithmic score has to get better, and the calibration error of all together must not get worse. (That of one
    predicate by itself is mostly chance.)"""
    names = tuple(fitted.predicates)
    held_out = np.empty(len(data))
    for fold in np.unique(folds):
        left_out = folds == fold
        part = _calibration(data[~left_out], names, fitted.method, "")
        held_out[left_out] = part.corrected(data[left_out], names)
    label, raw, number = data[:, 1], _sigmoids(data[:, 0]), data[:, 2].astype(int)
    gain = _log_score(held_out, label) - _log_score(raw, label)
    better = np.bincount(number, weights=gain, minlength=len(names)) > 0.0
    if not _no_worse(np.where(better[number], held_out, raw), raw, label):
        better[:] = False
    adopted = {
        name: scaling if better[place] else _unchanged(scaling)
        for place, (name, scaling) in enumerate(fitted.predicates.items())
    }
    is_shared = float(gain.sum()) > 0.0 and _no_worse(held_out, raw, label)
    return replace(fitted, shared=fitted.shared if is_shared else _unchanged(fitted.shared), predicates=adopted)


def _log_score(probability: FloatArray, label: FloatArray) -> FloatArray:
    score: FloatArray = np.log(np.where(label == 1.0, probability, 1.0 - probability))
    return score


def _no_worse(corrected: FloatArray, raw: FloatArray, label: FloatArray) -> bool:
    """Return whether corrected probabilities have no higher calibration error."""
    errors = [
        expected_calibration_error(list(zip(each.tolist(), (label == 1.0).tolist(), strict=True)), BINS)
        for each in (corrected, raw)
    ]
    return errors[0] <= errors[1]


def _unchanged(scaling: Scaling) -> Scaling:
    return Scaling(1.0, 0.0, scaling.true, scaling.false)


def _calibration(data: FloatArray, predicates: Sequence[str], method: Method, model: str) -> Calibration:
    """Return the likeliest corrections of (N, 3) log-odds, labels and numbers of predicates: all predicates' slopes and
    biases at once, with independent normal priors around the shared ones, and slopes that keep the order. Predicates
    that were always true, or never, have the shared correction: there is nothing to tell their answers apart by."""
    from scipy.optimize import minimize
    from scipy.special import expit

    odds, label, number = data[:, 0], data[:, 1], data[:, 2].astype(int)
    true = np.bincount(number, weights=label, minlength=len(predicates)).astype(int)
    false = np.bincount(number, minlength=len(predicates)) - true
    counts = [(int(true.sum()), int(false.sum())), *zip(true.tolist(), false.tolist(), strict=True)]
    target = np.where(label == 1.0, (counts[0][0] + 1) / (counts[0][0] + 2), 1 / (counts[0][1] + 2))
    varies = (true > 0) & (false > 0)
    group, groups = np.where(varies[number], number + 1, 0), len(counts)  # the shared correction comes first

    def loss(values: FloatArray) -> tuple[float, FloatArray]:
        slope, bias = values.reshape(2, groups)
        logit = slope[group] * odds + bias[group]
        wrong = expit(logit) - target
        by_slope = np.bincount(group, weights=wrong * odds, minlength=groups)
        by_bias = np.bincount(group, weights=wrong, minlength=groups)
        prior = 0.0
        for gradient, value in ((by_slope, slope), (by_bias, bias)):
            apart = STIFFNESS * (value - value[0])
            gradient += apart
            gradient[0] -= apart.sum()
            prior += float(apart @ (value - value[0])) / 2
        if method is Method.TEMPERATURE:
            by_bias[:] = 0.0
        return float(np.sum(np.logaddexp(0.0, logit) - target * logit)) + prior, np.concatenate([by_slope, by_bias])

    found = minimize(
        loss,
        np.repeat([1.0, 0.0], groups),
        jac=True,
        method="L-BFGS-B",
        bounds=[(LEAST_SLOPE, None)] * groups + [(None, None)] * groups,
        options={"maxiter": 1000, "ftol": 1e-12, "gtol": 1e-6},
    )
    slopes, biases = found.x.reshape(2, groups).tolist()
    own = [place + 1 if varies[place] else 0 for place in range(len(predicates))]
    scalings = [Scaling(slopes[at], biases[at], *labels) for at, labels in zip((0, *own), counts, strict=True)]
    return Calibration(scalings[0], dict(zip(predicates, scalings[1:], strict=True)), method, model)


def _logit(probability: float) -> float:
    kept = min(1.0 - _EDGE, max(_EDGE, probability))
    return math.log(kept / (1.0 - kept))


def _sigmoid(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds)) if odds >= 0 else 1.0 - 1.0 / (1.0 + math.exp(min(700.0, odds)))


def _sigmoids(odds: FloatArray) -> FloatArray:
    """Return probabilities, clipped as log-odds are."""
    from scipy.special import expit

    clipped: FloatArray = np.clip(expit(odds), _EDGE, 1.0 - _EDGE)
    return clipped


def _scaling(table: ScalingTable, file: Path, key: str) -> Scaling:
    try:
        return Scaling(**table.model_dump())
    except ValueError as error:
        raise InputError(str(error), file=file, key=key) from None
