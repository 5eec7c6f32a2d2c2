"""How sure a monitor has to be, predicate by predicate, for those who draw it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from executive.belief import BayesMonitor, Monitor, ThresholdMonitor, Thresholds
from executive.belief.bayes_filter import DEFAULT_THRESHOLDS
from executive.errors import InputError
from executive.trace.record import monitor_file
from executive.types import Task


def thresholds(monitor: Monitor | None) -> Mapping[str, Thresholds]:
    """Above and below what an atom is taken for true and false, by predicate; `""` is for all others. Nothing where
    that is not known: of a monitor that is none of Executive's own, or where nobody looks."""
    match monitor:
        case ThresholdMonitor(thresholds=each):
            return {"": each}
        case BayesMonitor(thresholds=named):
            return {"": DEFAULT_THRESHOLDS, **named}
    return {}


def recorded_thresholds(run: Path, task: Task) -> Mapping[str, Thresholds]:
    """Return the same of a run's folder; nothing where it does not say."""
    try:
        return thresholds(monitor_file.load(run, task.atoms))
    except InputError:
        return {}
