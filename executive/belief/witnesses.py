"""What else tells of atoms beside the estimator: each witness errs in its own way, and partly where others do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from executive.belief.sensor_model import SensorModel


@dataclass(frozen=True, slots=True)
class WitnessModel:
    """How a witness errs.

    Attributes:
        sensor: its error models, and how much its own looks repeat each other's mistakes.
        shared: how much its errors are correlated with the estimator's, from 0 to 1: they see the same scene through
            the same cameras.

    Raises:
        ValueError: `shared` is not in [0, 1].
    """

    sensor: SensorModel = field(default_factory=SensorModel)
    shared: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.shared <= 1.0:
            raise ValueError(f"shared: a share from 0 to 1 is expected, got {self.shared}")


def together(answers: float | None, others: Sequence[tuple[float, float]]) -> float:
    """Return the evidence of the estimator and of witnesses about an atom together.

    Those that agree count for less than their sum, as two looks whose errors are correlated do
    (`executive.belief.SensorModel.pooled`), and for no less than the strongest of them. Those that disagree count in
    full.

    Args:
        answers: the estimator's log-likelihood ratio; None where it gave no answer.
        others: of each witness its log-likelihood ratio, and the correlation of its errors with the estimator's.
    """
    total = 0.0 if answers is None else answers
    for evidence, shared in others:
        both = total + evidence
        if total * evidence > 0.0:
            strongest = max(abs(total), abs(evidence))
            both = math.copysign(max(strongest, abs(both) / (1.0 + shared)), both)
        total = both
    return total
