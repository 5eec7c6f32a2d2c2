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

    `probability` (looks, atoms) is in 0..1, NaN where unanswered; `truth` (looks, atoms) bool. Where looks are at
    different objects, columns are not atoms, and not all of them can be seen everywhere: `which` (looks, columns) is
    the number of the atom that each is about, -1 for none, which is asked nothing.
    """

    atoms: tuple[Atom, ...]
    probability: FloatArray
    truth: BoolArray
    which: npt.NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        if self.probability.shape != self.truth.shape or self.truth.ndim != 2:
            raise ValueError(f"probabilities {self.probability.shape} and labels {self.truth.shape} do not match")
        if len(set(self.atoms)) != len(self.atoms):
            raise ValueError("an atom is named twice")
        if self.which is None:
            if self.truth.shape[1] != len(self.atoms):
                raise ValueError(f"{self.truth.shape[1]} columns are not one for each of {len(self.atoms)} atoms")
        elif self.which.shape != self.truth.shape or (self.which < -1).any() or (self.which >= len(self.atoms)).any():
            raise ValueError("which atom each column is about is not said for each")
        said = self.probability[~np.isnan(self.probability)]
        if ((said < 0.0) | (said > 1.0)).any():
            raise ValueError("a probability is from 0 to 1, or NaN where there is no answer")

    @property
    def looks(self) -> int:
        return int(self.truth.shape[0])

    @property
    def asked(self) -> BoolArray:
        """What was asked at all, (looks, columns)."""
        return np.ones(self.truth.shape, np.bool_) if self.which is None else self.which >= 0

    @property
    def numbers(self) -> npt.NDArray[np.int64]:
        """The number of the atom that each answer is about, (looks, columns), -1 for none."""
        every = np.broadcast_to(np.arange(self.truth.shape[1]), self.truth.shape)
        return every if self.which is None else self.which

    @property
    def has_columns(self) -> bool:
        """Whether each atom has a column of its own, asked or not: looks are at the same objects."""
        columns = np.arange(self.truth.shape[1])
        return self.which is None or bool(
            len(columns) == len(self.atoms) and ((self.which == columns) | (self.which < 0)).all()
        )

    @property
    def unanswered(self) -> BoolArray:
        """What was asked and has no answer, (looks, columns)."""
        return np.asarray(np.isnan(self.probability) & self.asked)

    @property
    def predicates(self) -> tuple[str, ...]:
        """In the order of the atoms."""
        return tuple(dict.fromkeys(atom.predicate for atom in self.atoms))

    def of(self, wanted: str | Atom) -> Answers:
        """The answers about one predicate's atoms, or about one atom."""
        kept = [index for index, atom in enumerate(self.atoms) if wanted in (atom, atom.predicate)]
        if self.which is not None:
            return self.only(np.isin(self.which, kept))
        return Answers(tuple(self.atoms[index] for index in kept), self.probability[:, kept], self.truth[:, kept])

    def where(self, looks: BoolArray) -> Answers:
        """The answers in some of the looks (looks,)."""
        return Answers(
            self.atoms, self.probability[looks], self.truth[looks], None if self.which is None else self.which[looks]
        )

    def only(self, columns: BoolArray) -> Answers:
        """Some of the answers, (looks, columns), as if no other had been asked for."""
        return Answers(
            self.atoms,
            np.where(columns, self.probability, np.nan),
            self.truth & columns,
            np.where(columns, self.numbers, -1),
        )

    def right(self, threshold: float) -> BoolArray:
        """Whether each atom (looks, atoms) is taken for what it is, where P(true) >= `threshold` is taken for true."""
        return np.asarray(self.asked & ~self.unanswered & ((self.probability >= threshold) == self.truth))

    def pairs(self) -> list[tuple[float, bool]]:
        """Each answer with its label, for `executive.s3e.reliability`."""
        answered = self.asked & ~self.unanswered
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
    known = _each_precision(answers)
    asked = answers.asked
    right, answered = answers.right(HALF), asked & ~answers.unanswered
    error = answers.probability[answered] - answers.truth[answered]
    return Scores(
        accuracy=MappingProxyType(
            {threshold: _mean(np.asarray(answers.right(threshold)[asked])) for threshold in THRESHOLDS}
        ),
        ap_micro=average_precision(answers),
        ap_macro=math.fsum(known) / len(known) if known else None,
        exact_state=_mean(np.asarray(np.asarray((right | ~asked).all(axis=1))[asked.any(axis=1)])),
        ece=expected_calibration_error(answers.pairs()) if answered.any() else None,
        brier=_mean(error**2),
        asked=int(asked.sum()),
        positives=int((answers.truth & asked).sum()),
        unanswered=int(answers.unanswered.sum()),
        missed=int((answers.truth & asked & ~right).sum()),
        false_alarms=int((~answers.truth & asked & ~right).sum()),
    )


def average_precision(answers: Answers) -> float | None:
    """The average precision of all answers pooled: the precision at each threshold, weighted by the recall that it adds
    (scikit-learn's `average_precision_score`). None where nothing is true."""
    from sklearn.metrics import average_precision_score

    asked = answers.asked
    if not answers.truth[asked].any():
        return None
    return float(average_precision_score(answers.truth[asked], _ranked(answers)))


def _each_precision(answers: Answers) -> list[float]:
    """The average precision of each atom that has one. Atoms may be thousands, each in a few looks."""
    if answers.which is None:
        return [value for atom in answers.atoms if (value := average_precision(answers.of(atom))) is not None]
    from sklearn.metrics import average_precision_score

    which, truth, ranked = answers.which[answers.asked], answers.truth[answers.asked], _ranked(answers)
    order = np.argsort(which, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(which[order])) + 1)
    return [float(average_precision_score(truth[own], ranked[own])) for own in groups if truth[own].any()]


def curve(answers: Answers) -> tuple[FloatArray, FloatArray]:
    """Recall and precision, (N,) each, from the surest claim to all of them; nothing where nothing is true."""
    from sklearn.metrics import precision_recall_curve

    asked = answers.asked
    if not answers.truth[asked].any():
        return np.empty(0), np.empty(0)
    precision, recall, _ = precision_recall_curve(answers.truth[asked], _ranked(answers), drop_intermediate=True)
    return np.asarray(recall[::-1], dtype=float), np.asarray(precision[::-1], dtype=float)


def never_true(answers: Answers) -> Collection[Atom]:
    """The atoms that have no average precision."""
    if answers.which is not None:
        true = set(np.unique(answers.which[answers.truth & answers.asked]).tolist())
        return [atom for number, atom in enumerate(answers.atoms) if number not in true]
    return [atom for column, atom in enumerate(answers.atoms) if not answers.truth[:, column].any()]


def _ranked(answers: Answers) -> FloatArray:
    return np.asarray(np.nan_to_num(answers.probability, nan=-1.0)[answers.asked], dtype=float)


def _mean(values: npt.NDArray[Any]) -> float | None:
    return float(values.mean()) if values.size else None
