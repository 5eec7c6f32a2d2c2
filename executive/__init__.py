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

if TYPE_CHECKING:
    from executive.app.assembly import make_executive
    from executive.app.config import EstimatorConfig, RunConfig
    from executive.app.estimators import open_estimator
    from executive.app.run import Run, resume, run
    from executive.app.worlds import load_skills
    from executive.core.compare import compare, progress, reaches
    from executive.core.loop import Executive
    from executive.domain import load_domain, load_subject
    from executive.domain.pddl import read_task
    from executive.faults import FaultInjector, parse_fault
    from executive.planning import FastDownwardPlanner, UnifiedPlanner
    from executive.protocols import Estimator, Planner, Simulator, Sink, Skill, SkillContext, World
    from executive.relations import Scene, takes
    from executive.relations.estimator import RelationEstimator
    from executive.sim.truth import Oracle, Truth
    from executive.sim.viewer_geometry import mujoco_poses, mujoco_scenery
    from executive.sim.world import MujocoWorld
    from executive.ticked_world import TickedWorld
    from executive.trace.phrases import why
    from executive.trace.record.log import EventLog
    from executive.trace.terminal import TerminalSink
    from executive.trace.viewer.sink import RerunSink
    from executive.types import (
        Atom,
        Belief,
        Cause,
        Condition,
        Decision,
        DecisionKind,
        DerivedRules,
        Effect,
        Ended,
        Event,
        Facts,
        Frame,
        Image,
        NoPlan,
        NoPlanReason,
        Observation,
        OutcomeKind,
        Phase,
        Plan,
        Reason,
        Scenery,
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
    "Cause",
    "Condition",
    "Decision",
    "DecisionKind",
    "DerivedRules",
    "DomainError",
    "Effect",
    "Ended",
    "Estimator",
    "EstimatorConfig",
    "Event",
    "EventLog",
    "Executive",
    "ExecutiveError",
    "Facts",
    "FastDownwardPlanner",
    "FaultInjector",
    "Frame",
    "Image",
    "InputError",
    "MissingError",
    "MujocoWorld",
    "NoPlan",
    "NoPlanReason",
    "Observation",
    "Oracle",
    "OutcomeKind",
    "Phase",
    "Plan",
    "Planner",
    "Reason",
    "RelationEstimator",
    "RerunSink",
    "Run",
    "RunConfig",
    "Scene",
    "Scenery",
    "Simulator",
    "Sink",
    "Skill",
    "SkillContext",
    "SkillResult",
    "SkillStatus",
    "Step",
    "Task",
    "TerminalSink",
    "TickedWorld",
    "Truth",
    "UnifiedPlanner",
    "Verdict",
    "World",
    "__version__",
    "compare",
    "load_domain",
    "load_skills",
    "load_subject",
    "make_executive",
    "mujoco_poses",
    "mujoco_scenery",
    "open_estimator",
    "parse_fault",
    "progress",
    "reaches",
    "read_task",
    "resume",
    "run",
    "takes",
    "why",
]

_PROTOCOLS = ("Estimator", "Planner", "Simulator", "Sink", "Skill", "SkillContext", "World")
_FROM = dict.fromkeys(_PROTOCOLS, "executive.protocols") | {
    "EstimatorConfig": "executive.app.config",
    "EventLog": "executive.trace.record.log",
    "Executive": "executive.core.loop",
    "FastDownwardPlanner": "executive.planning",
    "FaultInjector": "executive.faults",
    "MujocoWorld": "executive.sim.world",
    "Oracle": "executive.sim.truth",
    "RelationEstimator": "executive.relations.estimator",
    "RerunSink": "executive.trace.viewer.sink",
    "Run": "executive.app.run",
    "RunConfig": "executive.app.config",
    "Scene": "executive.relations",
    "TickedWorld": "executive.ticked_world",
    "TerminalSink": "executive.trace.terminal",
    "Truth": "executive.sim.truth",
    "UnifiedPlanner": "executive.planning",
    "compare": "executive.core.compare",
    "make_executive": "executive.app.assembly",
    "load_domain": "executive.domain",
    "load_skills": "executive.app.worlds",
    "load_subject": "executive.domain",
    "mujoco_poses": "executive.sim.viewer_geometry",
    "mujoco_scenery": "executive.sim.viewer_geometry",
    "open_estimator": "executive.app.estimators",
    "parse_fault": "executive.faults",
    "progress": "executive.core.compare",
    "read_task": "executive.domain.pddl",
    "reaches": "executive.core.compare",
    "resume": "executive.app.run",
    "run": "executive.app.run",
    "takes": "executive.relations",
    "why": "executive.trace.phrases",
}
"""Imported when they are first asked for: what stands behind them is not light. Whatever else is public is a value."""

former_names.install()


def __getattr__(name: str) -> object:
    if name == "SimState":
        return former_names.renamed(__name__, name, "executive.Scene", __getattr__("Scene"))
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM.get(name, "executive.types")), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
