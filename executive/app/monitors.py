"""The monitor, put together from a few words: how sure is sure enough, and whether it remembers.

Everything that is built here could be built by hand from `executive.belief`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from executive.app import sensor_fit as trust
from executive.app.estimators import EstimatorConfig
from executive.belief import (
    EXACT,
    ActionModel,
    BayesMonitor,
    Monitor,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
)
from executive.domain.loader import Domain
from executive.errors import InputError, nearest
from executive.planning.mutex_groups import find_mutexes


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """What decides what is made of the looks.

    `alpha` is the share of looks in which something may be told wrongly, predicate by predicate; the thresholds follow
    from the calibration looks in the file `trust`, by default the one beside the model's folder. `threshold` takes
    every answer at its word instead, above or below it: no unknowns, no consistency, no memory, as in the paper (0.5).
    Without `memory` each moment is judged by its own looks alone. Without any of these, what is less sure than
    `executive.belief.bayes_filter.BAND` is unknown.
    """

    alpha: float | None = None
    threshold: float | None = None
    memory: bool = True
    trust: Path | None = None

    def __post_init__(self) -> None:
        if self.alpha is not None and not 0.0 < self.alpha < 1.0:
            raise InputError(f"an error rate between 0 and 1, not {self.alpha:g}", key="--alpha")
        if self.threshold is not None and not 0.0 <= self.threshold <= 1.0:
            raise InputError(f"a probability from 0 to 1, not {self.threshold:g}", key="--threshold")
        if self.threshold is not None and self.alpha is not None:
            raise InputError("is one way to say how sure is sure enough, --threshold is another", key="--alpha")
        if self.threshold is not None and self.trust is not None:
            raise InputError("goes without --threshold, which takes the eye at its word", key="--trust")


PRESETS: Mapping[str, MonitorConfig] = MappingProxyType(
    {"plain": MonitorConfig(threshold=0.5), "consistent": MonitorConfig(memory=False), "full": MonitorConfig()}
)
"""Each answer alone, as in the paper; the answers of one moment together; and with all that was seen before."""


def preset(name: str, key: str = "--monitor") -> MonitorConfig:
    """The monitor of that name.

    Raises:
        InputError: there is none.
    """
    if name not in PRESETS:
        raise InputError(f"no monitor {name!r}; {nearest(name, PRESETS)}", key=key)
    return PRESETS[name]


def open_monitor(config: MonitorConfig, domain: Domain, eye: EstimatorConfig | None, seconds: float = 30.0) -> Monitor:
    """The monitor of a run in which `eye` looks; None is one that is always right, unless the file of trust says
    otherwise. Finds the task's mutex groups, which may take so many wall `seconds`.

    Raises:
        InputError: the file of trust is none, or has too few looks for the error rate.
        DomainError: the domain's outcomes have a mistake.
        MissingError: Fast Downward's translator is not installed.
    """
    if config.threshold is not None:
        return ThresholdMonitor(domain.task.atoms, Thresholds(config.threshold, config.threshold))
    # What costs little and can be wrong comes first.
    counts = {} if domain.outcomes is None else trust.load_outcomes(domain.outcomes, domain.parsed.actions)
    worth, thresholds = _eye(config, domain, eye)
    network = MutexNetwork(domain.task.atoms, find_mutexes(domain.parsed, timeout=seconds).groups)
    actions = ActionModel(counts) if config.memory else None
    return BayesMonitor(network, worth, actions, thresholds, domain.looking.carried)


def _eye(
    config: MonitorConfig, domain: Domain, eye: EstimatorConfig | None
) -> tuple[SensorModel, Mapping[str, Thresholds]]:
    """What the eye's answers are worth, and the thresholds that were asked for."""
    if eye is None and config.trust is None:
        if config.alpha is not None:
            message = "is for an eye that errs; it goes with --estimator vlm, or with --trust where a fault has it err"
            raise InputError(message, key="--alpha")
        return EXACT, {}
    file = config.trust or (trust.beside(eye.vlm) if eye is not None and eye.server is None else None)
    if file is None:
        if config.alpha is not None:
            message = (
                f"it is not known how often this eye errs: there is no {trust.FILE} beside the model; have executive "
                "calibrate make one, or name one with --trust"
            )
            raise InputError(message, key="--alpha")
        return SensorModel(), {}
    known = trust.load(file, domain.name)
    if config.alpha is None:
        return known.eye, {}
    unmeasured = sorted({atom.predicate for atom in domain.task.atoms} - known.conformal.scores.keys())
    if unmeasured:
        raise InputError(f"has no calibration looks about {', '.join(unmeasured)}", file=file, key="--alpha")
    try:
        return known.eye, known.conformal.thresholds(config.alpha)
    except ValueError as error:
        raise InputError(str(error), file=file, key="--alpha") from None
