"""Executive: a closed-loop plan-execute-monitor framework for robots.

What users import stands here, and `executive.s3e` has state estimation for use on its own. Importing this package loads
no planner, model, simulator or viewer; each of those is imported where it is used.
"""

from __future__ import annotations

from executive.util import threads  # noqa: F401  (before anything that computes is loaded)

# isort: split
from importlib import import_module
from typing import TYPE_CHECKING

from executive import former_names
from executive.errors import DomainError, ExecutiveError, InputError, MissingError
from executive.protocols import Estimator, Planner, Sink, Skill, SkillContext, World
from executive.types import (
    Atom,
    Belief,
    Decision,
    DecisionKind,
    Ended,
    Event,
    Facts,
    Image,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Phase,
    Plan,
    SkillResult,
    SkillStatus,
    Step,
    Task,
    Verdict,
)

if TYPE_CHECKING:
    from executive.app.config import RunConfig
    from executive.app.run import Run, resume, run
    from executive.core.loop import Executive
    from executive.domain import load_domain
    from executive.faults import FaultInjector, parse_fault
    from executive.planning import FastDownwardPlanner
    from executive.trace.terminal import TerminalSink

__version__ = "0.1.0"

__all__ = [
    "Atom",
    "Belief",
    "Decision",
    "DecisionKind",
    "DomainError",
    "Ended",
    "Estimator",
    "Event",
    "Executive",
    "ExecutiveError",
    "Facts",
    "FastDownwardPlanner",
    "FaultInjector",
    "Image",
    "InputError",
    "MissingError",
    "NoPlan",
    "NoPlanReason",
    "Observation",
    "OutcomeKind",
    "Phase",
    "Plan",
    "Planner",
    "Run",
    "RunConfig",
    "Sink",
    "Skill",
    "SkillContext",
    "SkillResult",
    "SkillStatus",
    "Step",
    "Task",
    "TerminalSink",
    "Verdict",
    "World",
    "__version__",
    "load_domain",
    "parse_fault",
    "resume",
    "run",
]

_FROM = {
    "Executive": "executive.core.loop",
    "FastDownwardPlanner": "executive.planning",
    "FaultInjector": "executive.faults",
    "Run": "executive.app.run",
    "RunConfig": "executive.app.config",
    "TerminalSink": "executive.trace.terminal",
    "load_domain": "executive.domain",
    "parse_fault": "executive.faults",
    "resume": "executive.app.run",
    "run": "executive.app.run",
}
"""Imported when they are first asked for: what stands behind them is not light."""

former_names.install()


def __getattr__(name: str) -> object:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
