"""What a skill does, and what it says of that."""

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
    DOES_NOT_FIT = "does not fit"  # it is larger than what it is to be put on
    NOT_THERE = "not there"  # the object is not where the step says; it is not fetched from elsewhere
    GRASP_MISSED = "grasp missed"
    DROPPED = "dropped"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    CRASHED = "crashed"


class Sense(StrEnum):
    """By what the robot knows whether it still holds what it carries."""

    FELT = "felt"  # the gripper's width, the joints
    SEEN = "seen"  # the pictures that the guard took meanwhile


@dataclass(frozen=True, slots=True)
class SkillResult:
    """What a skill says of itself. `seconds` is the world's time that it took, `planned_seconds` what it would have
    taken to the end as far as it was planned (larger than `seconds` when it ended early). `sense` is by what a skill
    that ended because of a drop came to know of it. `holding`: whether the hand feels, at the end, that it holds
    something (None: it cannot feel, or was not asked)."""

    step: Step
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0
    planned_seconds: float = 0.0
    sense: Sense | None = None
    holding: bool | None = None

    @property
    def done(self) -> bool:
        return self.status is SkillStatus.DONE


@dataclass(frozen=True, slots=True)
class Dispatched:
    """A step is handed to its skill: the `action`-th one of the run (from 1), the `attempt`-th try of it."""

    step: Step
    action: int
    attempt: int
    index: int
    """Position in the current plan, from 0."""


COMPILE = "compile"
"""The phase, and the stage, in which skills are made ready, once on a machine."""


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
    world frame. `planner` and `planning_seconds` (wall) say where it came from. `tree`, where a run asks for it, is all
    that was searched: the (M, 2, 3) edges of the planner's tree as the end effector would go along them, in m."""

    configurations: FloatArray
    end_effector: FloatArray
    seconds: float
    planner: str
    planning_seconds: float
    cost: float = math.nan
    tree: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Moved:
    """The arm was brought out of the way for a better look, or was to be: by which skill, how that ended, and how long
    it took in the world's seconds."""

    move: str
    status: SkillStatus
    reason: str = ""
    seconds: float = 0.0
