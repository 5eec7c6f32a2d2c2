"""Actions, and what skills report about them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from executive.types.facts import FloatArray
from executive.types.tasks import Step


class SkillStatus(StrEnum):
    DONE = "done"
    NO_PATH = "no path"
    UNREACHABLE = "unreachable"
    BLOCKED = "blocked"  # it could be done but for other objects, which are known
    DOES_NOT_FIT = "does not fit"  # the object is larger than the place
    NOT_THERE = "not there"  # the object is not where the step says; it is not fetched from elsewhere
    NOT_APPLICABLE = "not applicable"  # the action's precondition does not hold, so that nothing was done
    GRASP_MISSED = "grasp missed"
    DROPPED = "dropped"
    FELL = "fell"  # it was put down, and did not stay where it was put
    COLLAPSED = "collapsed"  # what it was put on fell
    CLOSED = "closed"  # the place is a drawer that is not open
    JAMMED = "jammed"  # what is to slide does not move
    STOPPED_SHORT = "stopped short"  # it moved, and not all of the way
    SLIPPED = "slipped"  # the hand slipped off what it pulled or pushed
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    CRASHED = "crashed"


class Sense(StrEnum):
    """The sense by which a dropped object was noticed."""

    FELT = "felt"  # the gripper's width, the joints
    SEEN = "seen"  # the pictures of the hold guard


@dataclass(frozen=True, slots=True)
class SkillResult:
    """A skill's report. `seconds` is the world's time that it took, `planned_seconds` the time of all that it planned
    (larger than `seconds` if it ended early). `sense` is how a skill that ended because of a drop noticed it. `holding`
    is whether the gripper senses an object at the end (None: it has no such sensor, or was not asked). `blockers` are
    the objects in the way of a step that is BLOCKED: with any one of them elsewhere it may work."""

    step: Step
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0
    planned_seconds: float = 0.0
    sense: Sense | None = None
    holding: bool | None = None
    blockers: tuple[str, ...] = ()

    @property
    def done(self) -> bool:
        return self.status is SkillStatus.DONE


@dataclass(frozen=True, slots=True)
class Dispatched:
    """A step is dispatched to its skill: the run's `action`-th one (from 1), the step's `attempt`-th try."""

    step: Step
    action: int
    attempt: int
    index: int
    """The step's position in the current plan, from 0."""


COMPILE = "compile"
"""The phase, and the timing stage, in which skills are compiled, once on a machine."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A skill enters a phase of its work (`plan`, `approach`, `grip`, `transfer`, ...), expected to last `seconds`; or,
    before the first look, `compile`."""

    name: str
    detail: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion about to be followed: (N, dof) configurations in rad and the (N, 3) path of the end effector in m,
    world frame. `planner` and `planning_seconds` (wall) say where it came from. `tree`, where a run asks for it, is
    the search tree: its (M, 2, 3) edges as paths of the end effector, in m."""

    configurations: FloatArray
    end_effector: FloatArray
    seconds: float
    planner: str
    planning_seconds: float
    cost: float = math.nan
    tree: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Moved:
    """The arm was moved, or should have been, out of the cameras' view: by which skill, with which status, and how long
    it took in the world's seconds."""

    move: str
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0
