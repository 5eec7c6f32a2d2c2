"""The values that flow through the executive. All are frozen; none depends on a planner, a model or a simulator.

An *atom* is a grounded predicate, *facts* are signed atoms, a *condition* is a formula over atoms, a *belief* has a
probability for each atom after a look, a *verdict* is the result of comparing an expectation with a belief.
"""

from executive import former_names
from executive.types.actions import COMPILE, Dispatched, Motion, Moved, Phase, Sense, SkillResult, SkillStatus
from executive.types.conditions import ALWAYS, NEVER, Condition
from executive.types.decisions import Cause, Decision, DecisionKind, Ground, OutcomeKind, Reason
from executive.types.derived import DerivedRules
from executive.types.events import (
    Compared,
    Ended,
    Event,
    FaultInjected,
    News,
    Payload,
    Resumed,
    Revised,
    Started,
    Timing,
)
from executive.types.facts import Atom, DepthImage, Facts, FloatArray, Image
from executive.types.observations import (
    Belief,
    Blinded,
    Contradiction,
    Evidence,
    Guarded,
    Judged,
    LookCause,
    Looked,
    LookKind,
    Observation,
    Overruled,
    PictureFault,
    Questions,
    Remembered,
    Testimony,
    Verdict,
)
from executive.types.scenes import (
    Camera,
    EstimatedPose,
    Frame,
    Geometry,
    Lump,
    PointCloud,
    PosesEstimated,
    Scenery,
    Watched,
    about_vertical,
)
from executive.types.searching import PlaceToLook, SearchOrder
from executive.types.tasks import Effect, Fluent, NoPlan, NoPlanReason, Plan, Probed, Step, Task
from executive.types.visibility import Visibility

__all__ = [
    "ALWAYS",
    "COMPILE",
    "NEVER",
    "Atom",
    "Belief",
    "Blinded",
    "Camera",
    "Cause",
    "Compared",
    "Condition",
    "Contradiction",
    "Decision",
    "DecisionKind",
    "DepthImage",
    "DerivedRules",
    "Dispatched",
    "Effect",
    "Ended",
    "EstimatedPose",
    "Event",
    "Evidence",
    "Facts",
    "FaultInjected",
    "FloatArray",
    "Fluent",
    "Frame",
    "Geometry",
    "Ground",
    "Guarded",
    "Image",
    "Judged",
    "LookCause",
    "LookKind",
    "Looked",
    "Lump",
    "Motion",
    "Moved",
    "News",
    "NoPlan",
    "NoPlanReason",
    "Observation",
    "OutcomeKind",
    "Overruled",
    "Payload",
    "Phase",
    "PictureFault",
    "PlaceToLook",
    "Plan",
    "PointCloud",
    "PosesEstimated",
    "Probed",
    "Questions",
    "Reason",
    "Remembered",
    "Resumed",
    "Revised",
    "Scenery",
    "SearchOrder",
    "Sense",
    "SkillResult",
    "SkillStatus",
    "Started",
    "Step",
    "Task",
    "Testimony",
    "Timing",
    "Verdict",
    "Visibility",
    "Watched",
    "about_vertical",
]

former_names.give_reason(Decision, Ended)
