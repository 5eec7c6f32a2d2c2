"""The log in the viewer: a line for each fault, each plan, and all else that did not go by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from executive.trace import phrases
from executive.trace.story.story import Story
from executive.trace.viewer.colours import AMBER, BLUE, GREEN, PURPLE, RED, SILVER, Colour
from executive.types import (
    Blinded,
    Decision,
    DecisionKind,
    Ended,
    FaultInjected,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Moved,
    NoPlan,
    OutcomeKind,
    Payload,
    Plan,
    PosesEstimated,
    Questions,
    Reason,
    Resumed,
    SkillResult,
    SkillStatus,
)

LOG_WIDTH = 66
"""Characters of a line, in a window of 1280 pixels."""


class LogLine(NamedTuple):
    text: str
    level: str
    colour: Colour


_LEVELS: Mapping[type, tuple[str, Colour]] = {
    Blinded: ("LOOK", RED),
    Guarded: ("GUARD", AMBER),
    Resumed: ("PROCESS", SILVER),
    Moved: ("MOVE", BLUE),
    NoPlan: ("PLAN", RED),
    FaultInjected: ("FAULT", PURPLE),
    SkillResult: ("SKILL", RED),
    Decision: ("DECISION", AMBER),
}


def log_lines(payload: Payload, story: Story) -> list[LogLine]:
    """Return what the log says of an event; `story` has been told of it."""
    match payload:
        case Questions(warnings=warnings):
            return [LogLine(warning, "QUESTION", AMBER) for warning in warnings]
        case Looked(kind=LookKind.CLOSER | LookKind.MOVED) as look:
            told = phrases.look(look.observation_id, "", look.kind, look.questions, look.atoms, look.cameras)
            return [LogLine(told, "LOOK", BLUE)]
        case Judged(contradictions=contradictions, overruled=overruled):
            return [LogLine(_first(some), "LOOK", AMBER) for some in (contradictions, overruled) if some]
        case PosesEstimated(left_out=left_out):
            return [LogLine(phrases.depth_left_out(*each), "POSES", AMBER) for each in left_out.items()]
        case Plan(steps=steps):
            return [LogLine(phrases.plan_title(len(story.plans), len(steps)), "PLAN", SILVER)]
        case Ended(outcome=outcome):
            return [LogLine(phrases.event(payload), "END", outcome_colour(outcome))]
        case Guarded(held=True) | SkillResult(status=SkillStatus.DONE):
            return []
        case Decision() if not _is_told(payload):
            return []
    level = _LEVELS.get(type(payload))
    return [] if level is None else [LogLine(phrases.event(payload), *level)]


def _first(some: Sequence[object]) -> str:
    """The first of some findings of a kind; an estimator that is often wrong leaves room for what is decided."""
    return phrases.event(some[0]) + (f" (and {len(some) - 1} more)" if len(some) > 1 else "")


def _is_told(decision: Decision) -> bool:
    """Return whether a decision is not what happens when all goes well, and not told by the end of the run."""
    routine = decision.kind is DecisionKind.CONTINUE and (decision.report is None or decision.report.done)
    routine = routine and decision.code is not Reason.LOOK_FIRST
    return not routine and decision.kind is not DecisionKind.STOP


def outcome_colour(outcome: OutcomeKind | None) -> Colour:
    if outcome is OutcomeKind.GOAL_REACHED:
        return GREEN
    return AMBER if outcome is OutcomeKind.PLAN_COMPLETED else RED
