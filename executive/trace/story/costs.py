"""What a run has cost so far: wall seconds by stage, and what was spent on looking."""

from __future__ import annotations

from dataclasses import dataclass, field

from executive.types import COMPILE, Decision, DecisionKind, Event, Looked, LookKind, Motion, Moved, Timing

STAGES = ("observe", "estimate", "plan", "motion", "guard", "skill", COMPILE, "other")
"""Where wall time goes: looking, estimating atoms, planning the task, planning motions, looking after what is carried,
the rest of the skills (in a simulator, its physics), compiling what they need (once on a machine), and all else
(start-up, decisions, sinks)."""


@dataclass
class Costs:
    """Feed every event to `tell`, in order.

    `looks` are those that decisions are based on, `again` those of them that were a second look or more at the same
    moment, `questions` what was asked in them; `moves` and `moving_seconds` (world) are how often and how long the arm
    was brought out of the way, `glances` the hold guard's looks at what was carried.
    """

    looks: int = 0
    again: int = 0
    questions: int = 0
    moves: int = 0
    moving_seconds: float = 0.0
    glances: int = 0
    stages: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    def tell(self, event: Event) -> None:
        """Take in the next event."""
        match event.payload:
            case Timing(stage=stage, seconds=seconds):
                self.stages[stage if stage in self.stages else "other"] += seconds
                if stage == "guard":
                    self.stages["skill"] -= seconds  # it looks while the skill is at work
            case Motion(planning_seconds=seconds):
                self.stages["motion"] += seconds
                self.stages["skill"] -= seconds  # which is where the motion was planned, and its timing will say so
            case Looked(kind=LookKind.GUARD):
                self.glances += 1
            case Looked(questions=questions):
                self.looks += 1
                self.questions += questions
            case Moved(seconds=seconds) if seconds > 0.0:
                self.moves += 1
                self.moving_seconds += seconds
            case Decision(kind=DecisionKind.LOOK_AGAIN):
                self.again += 1

    def wall_seconds(self, total: float) -> dict[str, float]:
        """Return where the `total` wall seconds of a run went: `total`, and each stage."""
        stages = {stage: max(0.0, seconds) for stage, seconds in self.stages.items()}
        stages["other"] = max(0.0, total - sum(stages.values()) + stages["other"])
        return {"total": round(total, 3), **{stage: round(seconds, 3) for stage, seconds in stages.items()}}
