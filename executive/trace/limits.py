"""How sure a monitor has to be, predicate by predicate, for those who draw it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from executive.errors import InputError
from executive.monitor import FusedMonitor, Monitor, PlainMonitor, Thresholds
from executive.monitor.fused import BAND
from executive.trace import monitors
from executive.types import Task


def thresholds(monitor: Monitor | None) -> Mapping[str, Thresholds]:
    """Above and below what an atom is taken for true and false, by predicate; `""` is for all others. Nothing where
    that is not known: of a monitor that is none of Executive's own, or where nobody looks."""
    match monitor:
        case PlainMonitor(thresholds=each):
            return {"": each}
        case FusedMonitor(thresholds=named):
            return {"": BAND, **named}
    return {}


def recorded_thresholds(run: Path, task: Task) -> Mapping[str, Thresholds]:
    """The same of a run's folder; nothing where it does not say."""
    try:
        return thresholds(monitors.load(run, task.atoms))
    except InputError:
        return {}
