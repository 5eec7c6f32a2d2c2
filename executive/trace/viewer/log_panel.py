"""The log in the viewer: a line for each fault, each plan, and all else that did not go by itself."""

from __future__ import annotations

from typing import NamedTuple

from executive.trace.story.story import Story
from executive.trace.terminal.view import contradiction
from executive.trace.viewer import text_panels
from executive.trace.viewer.colours import AMBER, BLUE, GREEN, PURPLE, RED, WHITE, Colour
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
    Overruled,
    Payload,
    Plan,
    Questions,
    Resumed,
    SkillResult,
)

LOG_WIDTH = 66
"""Characters of a line, in a window of 1280 pixels."""


class LogLine(NamedTuple):
    text: str
    level: str
    colour: Colour


def log_lines(payload: Payload, story: Story) -> list[LogLine]:
    """What the log says of an event; `story` has been told of it."""
    match payload:
        case Questions(warnings=warnings):
            return [LogLine(warning, "QUESTION", AMBER) for warning in warnings]
        case Looked(kind=LookKind.CLOSER | LookKind.MOVED) as look:
            through = f" through {', '.join(look.cameras)}" if look.cameras else ""
            return [LogLine(f"look {look.observation_id}, {look.kind}: {look.questions} atoms{through}", "LOOK", BLUE)]
        case Judged(contradictions=clashes, overruled=overruled):
            findings = [f"answers {contradiction(clash)}" for clash in clashes], list(map(_overruled, overruled))
            return [LogLine(_first(some), "LOOK", AMBER) for some in findings if some]
        case Blinded(camera=camera, reason=reason):
            return [LogLine(f"camera {camera} is left out: {reason}", "LOOK", RED)]
        case Guarded(held=held) as guarded if held is not True:
            said = "cannot be told" if held is None else "is seen no longer"
            lost = ", again: the skill is told" if guarded.lost else ""
            return [LogLine(f"guard: {guarded.atom} {said} (look {guarded.observation_id}){lost}", "GUARD", AMBER)]
        case Resumed() as resumed:
            told = f"another process goes on with the world as it was in cycle {resumed.restored}"
            return [LogLine(told, "PROCESS", WHITE)]
        case Moved() as moved:
            reason = f", {moved.reason}" if moved.reason else ""
            return [LogLine(f"out of the way, {moved.move}: {moved.status}{reason}", "MOVE", BLUE)]
        case Plan(steps=steps):
            return [LogLine(f"plan {len(story.plans)}: {len(steps)} steps", "PLAN", WHITE)]
        case NoPlan(reason=reason, detail=detail):
            return [LogLine(f"no plan: {reason} {detail}", "PLAN", RED)]
        case FaultInjected(spec=spec, detail=detail):
            return [LogLine(f"fault {spec}: {detail}", "FAULT", PURPLE)]
        case SkillResult() as result if not result.done:
            return [LogLine(f"skill: {result.step} {result.status}, {result.reason}", "SKILL", RED)]
        case Decision() as decision if _tells(decision):
            return [LogLine(text_panels.log_line(decision), "DECISION", AMBER)]
        case Ended() as ended:
            return [LogLine(f"{ended.outcome}: {ended.reason}", "END", outcome_colour(ended.outcome))]
    return []


def _first(some: list[str]) -> str:
    """The first of some findings of a kind; an eye that is often wrong leaves room for what is decided."""
    return some[0] + (f" (and {len(some) - 1} more)" if len(some) > 1 else "")


def _overruled(wrong: Overruled) -> str:
    believed = "cannot be told" if wrong.believed is None else f"taken for {'true' if wrong.believed else 'false'}"
    return f"{wrong.atom}: seen {'true' if wrong.answered else 'false'} ({wrong.answer:.2f}), {believed}"


def _tells(decision: Decision) -> bool:
    """Whether a decision is not what happens when all goes well, and not told by the end of the run."""
    routine = text_panels.is_routine(decision) and (decision.report is None or decision.report.done)
    return not routine and decision.kind is not DecisionKind.STOP


def outcome_colour(outcome: OutcomeKind | None) -> Colour:
    if outcome is OutcomeKind.GOAL_REACHED:
        return GREEN
    return AMBER if outcome is OutcomeKind.PLAN_COMPLETED else RED
