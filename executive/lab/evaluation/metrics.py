"""How good answers are: the paper's metrics of multi-label classification (Section 6.2), and how well they are meant.

The labels are the ground atoms (Section 1: "the set of grounded predicates"). So the macro average of the average
precision is over ATOMS, not over predicates: robot-gripping(lemon) counts as much as on-table(lemon,wood-table),
however rarely either is true. (Section 6.2 says that it emphasizes the gripping predicates, Appendix C that it treats
rare and frequent labels equally; both hold for a mean over atoms.) The micro average pools all answers. An atom that is
never true in the data has no average precision, and is left out of the macro average.

An unanswered atom is right at no threshold. Where answers are ranked it comes last.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from executive.s3e.reliability import expected_calibration_error
from executive.types import Atom, FloatArray

THRESHOLDS = (0.3, 0.5, 0.7)
"""Those of the paper's tables; at the middle one mistakes are counted."""

HALF = 0.5

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What was said of every atom in every look, and what is true.

    `probability` (looks, atoms) is in 0..1, NaN where unanswered; `truth` (looks, atoms) bool.
    """

    atoms: tuple[Atom, ...]
    probability: FloatArray
    truth: BoolArray

    def __post_init__(self) -> None:
        if self.probability.shape != self.truth.shape or self.truth.ndim != 2:
            raise ValueError(f"probabilities {self.probability.shape} and labels {self.truth.shape} do not match")
        if self.truth.shape[1] != len(self.atoms) or len(set(self.atoms)) != len(self.atoms):
            raise ValueError(f"{self.truth.shape[1]} columns are not one for each of {len(self.atoms)} atoms")
        said = self.probability[~np.isnan(self.probability)]
        if ((said < 0.0) | (said > 1.0)).any():
            raise ValueError("a probability is from 0 to 1, or NaN where there is no answer")

    @property
    def looks(self) -> int:
        return int(self.truth.shape[0])

    @property
    def unanswered(self) -> BoolArray:
        """(looks, atoms)."""
        return np.asarray(np.isnan(self.probability))

    @property
    def predicates(self) -> tuple[str, ...]:
        """In the order of the atoms."""
        return tuple(dict.fromkeys(atom.predicate for atom in self.atoms))

    def of(self, wanted: str | Atom) -> Answers:
        """The answers about one predicate's atoms, or about one atom."""
        kept = [index for index, atom in enumerate(self.atoms) if wanted in (atom, atom.predicate)]
        return Answers(tuple(self.atoms[index] for index in kept), self.probability[:, kept], self.truth[:, kept])

    def where(self, looks: BoolArray) -> Answers:
        """The answers in some of the looks (looks,)."""
        return Answers(self.atoms, self.probability[looks], self.truth[looks])

    def right(self, threshold: float) -> BoolArray:
        """Whether each atom (looks, atoms) is taken for what it is, where P(true) >= `threshold` is taken for true."""
        return np.asarray(~self.unanswered & ((self.probability >= threshold) == self.truth))

    def pairs(self) -> list[tuple[float, bool]]:
        """Each answer with its label, for `executive.s3e.reliability`."""
        answered = ~self.unanswered
        return list(zip(self.probability[answered].tolist(), self.truth[answered].tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class Scores:
    """What answers come to. Shares are of all that was asked; a number that nothing was there to tell is None.

    `accuracy` is by threshold; `exact_state` the share of looks in which every atom is right at 0.5; `ece` and `brier`
    are over what was answered; `missed` counts what is true and was not taken for it at 0.5, `false_alarms` what is
    false and was not taken for that, and both count what was unanswered; `positives` counts what is true.
    """

    accuracy: Mapping[float, float | None]
    ap_micro: float | None
    ap_macro: float | None
    exact_state: float | None
    ece: float | None
    brier: float | None
    asked: int
    positives: int
    unanswered: int
    missed: int
    false_alarms: int

    def document(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "ap_micro": self.ap_micro,
            "ap_macro": self.ap_macro,
            **{f"accuracy_{threshold}": value for threshold, value in self.accuracy.items()},
            "exact_state": self.exact_state,
            "ece": self.ece,
            "brier": self.brier,
            "asked": self.asked,
            "true": self.positives,
            "unanswered": self.unanswered,
            "missed": self.missed,
            "false_alarms": self.false_alarms,
        }


def scores(answers: Answers) -> Scores:
    """Everything that is measured, over all answers that are given."""
    each = [average_precision(answers.of(atom)) for atom in answers.atoms]
    known = [value for value in each if value is not None]
    right, answered = answers.right(HALF), ~answers.unanswered
    error = answers.probability[answered] - answers.truth[answered]
    return Scores(
        accuracy=MappingProxyType({threshold: _mean(answers.right(threshold)) for threshold in THRESHOLDS}),
        ap_micro=average_precision(answers),
        ap_macro=math.fsum(known) / len(known) if known else None,
        exact_state=_mean(np.asarray(right.all(axis=1))),
        ece=expected_calibration_error(answers.pairs()) if answered.any() else None,
        brier=_mean(error**2),
        asked=right.size,
        positives=int(answers.truth.sum()),
        unanswered=int((~answered).sum()),
        missed=int((answers.truth & ~right).sum()),
        false_alarms=int((~answers.truth & ~right).sum()),
    )


def average_precision(answers: Answers) -> float | None:
    """The average precision of all answers pooled: the precision at each threshold, weighted by the recall that it adds
    (scikit-learn's `average_precision_score`). None where nothing is true."""
    from sklearn.metrics import average_precision_score

    if not answers.truth.any():
        return None
    return float(average_precision_score(answers.truth.ravel(), _ranked(answers)))


def curve(answers: Answers) -> tuple[FloatArray, FloatArray]:
    """Recall and precision, (N,) each, from the surest claim to all of them; nothing where nothing is true."""
    from sklearn.metrics import precision_recall_curve

    if not answers.truth.any():
        return np.empty(0), np.empty(0)
    precision, recall, _ = precision_recall_curve(answers.truth.ravel(), _ranked(answers), drop_intermediate=True)
    return np.asarray(recall[::-1], dtype=float), np.asarray(precision[::-1], dtype=float)


def never_true(answers: Answers) -> Collection[Atom]:
    """The atoms that have no average precision."""
    return [atom for column, atom in enumerate(answers.atoms) if not answers.truth[:, column].any()]


def _ranked(answers: Answers) -> FloatArray:
    return np.asarray(np.nan_to_num(answers.probability, nan=-1.0).ravel(), dtype=float)


def _mean(values: npt.NDArray[Any]) -> float | None:
    return float(values.mean()) if values.size else None
