"""Executive: a closed-loop plan-execute-monitor framework for robots.

Importing this package loads no planner, model, simulator or viewer; each of those is imported where it is used.
"""

from executive import threads  # noqa: F401  (before anything that computes is loaded)
from executive.errors import DomainError, ExecutiveError, InputError, MissingError
from executive.types import (
    Atom,
    Belief,
    Decision,
    DecisionKind,
    Event,
    Facts,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Plan,
    SkillResult,
    SkillStatus,
    Step,
    Task,
    Verdict,
)

__version__ = "0.1.0"

__all__ = [
    "Atom",
    "Belief",
    "Decision",
    "DecisionKind",
    "DomainError",
    "Event",
    "ExecutiveError",
    "Facts",
    "InputError",
    "MissingError",
    "NoPlan",
    "NoPlanReason",
    "Observation",
    "OutcomeKind",
    "Plan",
    "SkillResult",
    "SkillStatus",
    "Step",
    "Task",
    "Verdict",
    "__version__",
]
