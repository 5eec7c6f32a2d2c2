"""Builds a run's monitor from its configuration.

Everything that is built here can be built by hand from `executive.belief`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from executive.app import sensor_fit
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
    """The options of a monitor.

    Attributes:
        alpha: the requested error rate: the share of looks in which, by predicate, some atom may get the wrong value.
            The thresholds follow from the calibration looks in the file `trust`. Without an error rate they are
            `executive.belief.bayes_filter.DEFAULT_THRESHOLDS`.
        threshold: thresholds every answer at this probability instead: no unknowns, no consistency, no memory, as in
            the paper (0.5).
        memory: whether earlier looks count; without it, each moment is estimated from its own looks alone.
        trust: the file with the sensor model and the calibration looks; by default, the one in the model's folder.

    Raises:
        InputError: a value is out of its range, or two options exclude each other.
    """

    alpha: float | None = None
    threshold: float | None = None
    memory: bool = True
    trust: Path | None = None

    def __post_init__(self) -> None:
        if self.alpha is not None and not 0.0 < self.alpha < 1.0:
            raise InputError(f"expected an error rate between 0 and 1, got {self.alpha:g}", key="--alpha")
        if self.threshold is not None and not 0.0 <= self.threshold <= 1.0:
            raise InputError(f"expected a probability from 0 to 1, got {self.threshold:g}", key="--threshold")
        if self.threshold is not None and self.alpha is not None:
            raise InputError("sets the thresholds by an error rate, and excludes --threshold", key="--alpha")
        if self.threshold is not None and self.trust is not None:
            raise InputError("excludes --threshold, which uses no sensor model", key="--trust")


PRESETS: Mapping[str, MonitorConfig] = MappingProxyType(
    {"plain": MonitorConfig(threshold=0.5), "consistent": MonitorConfig(memory=False), "full": MonitorConfig()}
)
"""plain: each answer thresholded on its own, as in the paper; consistent: the answers of one moment made consistent;
full: the same with memory."""


def preset(name: str, key: str = "--monitor") -> MonitorConfig:
    """Return the preset of that name.

    Raises:
        InputError: there is none.
    """
    if name not in PRESETS:
        raise InputError(f"no monitor {name!r}; {nearest(name, PRESETS)}", key=key)
    return PRESETS[name]


def open_monitor(
    config: MonitorConfig,
    domain: Domain,
    estimator: EstimatorConfig | None,
    seconds: float = 30.0,
    oracle: SensorModel | None = None,
) -> Monitor:
    """Build a run's monitor, and find the task's mutex groups for it.

    Args:
        estimator: the options of the estimator that it monitors; None for the oracle.
        seconds: the wall time that finding the mutex groups may take.
        oracle: the oracle's sensor model, unless `config.trust` has another one; without it, it is exact.

    Raises:
        InputError: the file `trust` is damaged, or has too few looks for the error rate.
        DomainError: the domain's outcomes have a mistake.
        MissingError: Fast Downward's translator is not installed.
    """
    if config.threshold is not None:
        return ThresholdMonitor(domain.task.atoms, Thresholds(config.threshold, config.threshold))
    # What is cheap to check comes first.
    counts = {} if domain.outcomes is None else sensor_fit.load_outcomes(domain.outcomes, domain.parsed.actions)
    sensor, thresholds = _sensor_model(config, domain, estimator, oracle or EXACT)
    network = MutexNetwork(
        domain.task.atoms, find_mutexes(domain.parsed, timeout=seconds, leaves_open=domain.leaves_open).groups
    )
    actions = ActionModel(counts) if config.memory else None
    return BayesMonitor(network, sensor, actions, thresholds, domain.looking.carried)


def _sensor_model(
    config: MonitorConfig, domain: Domain, estimator: EstimatorConfig | None, oracle: SensorModel
) -> tuple[SensorModel, Mapping[str, Thresholds]]:
    """Return the estimator's sensor model, and the thresholds for the requested error rate."""
    if estimator is None and config.trust is None:
        if config.alpha is not None:
            message = (
                "needs --estimator vlm, or --trust where a fault makes the oracle err: the oracle has no error rate"
            )
            raise InputError(message, key="--alpha")
        return oracle, {}
    file = config.trust or (
        sensor_fit.default_file(estimator.vlm) if estimator is not None and estimator.server is None else None
    )
    if file is None:
        if config.alpha is not None:
            message = (
                f"the model's error rates are not known: there is no {sensor_fit.FILE} in its folder; make one with "
                "executive calibrate, or name one with --trust"
            )
            raise InputError(message, key="--alpha")
        return SensorModel(), {}
    known = sensor_fit.load(file, domain.name)
    if config.alpha is None:
        return known.sensor_model, {}
    unmeasured = sorted({atom.predicate for atom in domain.task.atoms} - known.conformal.scores.keys())
    if unmeasured:
        raise InputError(f"has no calibration looks about {', '.join(unmeasured)}", file=file, key="--alpha")
    try:
        return known.sensor_model, known.conformal.thresholds(config.alpha)
    except ValueError as error:
        raise InputError(str(error), file=file, key="--alpha") from None
