"""What the terminal shows, as lines of text: pure functions of a story."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from executive.trace import phrases
from executive.trace.phrases import plural
from executive.trace.story.story import Mark, PlanLine, Remark, Standing, StepLine, Story
from executive.trace.terminal.console import printable
from executive.types import (
    COMPILE,
    Blinded,
    Compared,
    Contradiction,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    Guarded,
    Judged,
    Moved,
    NoPlan,
    Observation,
    OutcomeKind,
    Payload,
    Phase,
    Plan,
    Questions,
    Resumed,
    SkillResult,
    Started,
)

_MARKS = {
    Mark.PENDING: ("·", "dim"),
    Mark.CURRENT: ("▶", "bold cyan"),
    Mark.DONE: ("✓", "green"),
    Mark.FAILED: ("✗", "bold red"),
    Mark.SKIPPED: ("-", "dim"),
    Mark.DROPPED: ("-", "dim"),
}
_STANDINGS = {Standing.SURPRISE: ("✗", "red"), Standing.DOUBT: ("?", "yellow"), Standing.EXPECTED: ("✓", "green")}
_STYLES: Sequence[tuple[type | tuple[type, ...], str]] = (
    (Dispatched, "bold"),
    (FaultInjected, "magenta"),
    (NoPlan, "red"),
    ((Questions, Contradiction, Guarded, Blinded), "yellow"),
    ((Phase, Resumed), "cyan"),
    (Moved, "dim"),
)
_ATOMS, _REMARKS = 5, 4
"""How many atoms and how many remarks the live view shows."""


def dashboard(story: Story, width: int, height: int) -> list[Text]:
    """Return the live view: no more than `height` lines of at most `width` cells.

    What changes most stands last, so that the rest keeps its place.
    """
    atoms, remarks = _atom_lines(story), _last_remarks(story, width)
    below = [*([Text(), *remarks] if remarks else []), *([Text(), *atoms] if atoms else [])]
    lines = [_title(story), _counts(story), Text()]
    lines += _plan_lines(story, max(3, height - len(lines) - len(below)))
    lines = [_one_line(line) for line in (*lines, *below)[:height]]
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return lines


def story_lines(story: Story, width: int) -> list[Text]:
    """Return the whole run so far, to stay on the screen: every plan, how its steps ended, and what came in between."""
    lines = [_title(story)]
    for remark in story.opening:
        lines += _wrapped(_remark(remark), width, "  ")
    for plan in story.plans:
        lines.append(Text(_plan_title(plan), "bold"))
        for remark in plan.remarks:
            lines += _wrapped(_remark(remark), width, "  ")
        for line in plan.lines:
            if line.mark is not Mark.DROPPED:
                lines.append(_step(line))
            for remark in line.remarks:
                lines += _wrapped(_remark(remark), width, "      ")
        dropped = sum(line.mark is Mark.DROPPED for line in plan.lines)
        if dropped:
            lines.append(Text(f"  - {plural(dropped, 'step')} left undone", "dim"))
    if story.ended is not None:
        reason = Text(phrases.why(story.ended), outcome_style(story.ended.outcome))
        lines += _wrapped(reason, width, "")
    return [_one_line(line) for line in lines]


def event_line(event: Event, story: Story) -> Text | None:
    """One line about an event, for logs and pipes; None for what is not worth one. `story` has been told of it."""
    text = _event_text(event.payload, story)
    return None if text is None else Text(f"{event.time:7.1f} s  ", "dim") + _one_line(text)


def _event_text(payload: Payload, story: Story) -> Text | None:
    match payload:
        case Started():
            return _title(story)
        case Observation(id=number, cause=cause) if not story.at_work:  # a glance is told when there is something to it
            return Text(phrases.look(number, cause))
        case Plan():
            return Text(phrases.plan(payload, story.plans[-1].number))
        case Judged(contradictions=contradictions) if contradictions:
            return Text("; ").join(map(_remark, contradictions))
        case Compared() if payload.what != "preconditions" or not payload.verdict.satisfied:
            return _comparison(story, payload)
        case Questions(warnings=()) | Guarded(held=True | None) | Decision(kind=DecisionKind.STOP):
            return None  # nothing that matters; the end says what the last decision says
        case Phase(name=name) if name != COMPILE:
            return None
    return _remark(payload) if type(payload) in phrases.EVENTS else None


def _title(story: Story) -> Text:
    return Text("" if story.started is None else phrases.event(story.started), "bold")


def _plan_title(plan: PlanLine) -> str:
    return phrases.plan_title(plan.number, len(plan.lines))


def _plan_lines(story: Story, room: int) -> list[Text]:
    """Return the plan in at most `room` lines: the steps around the current one where there are more."""
    plan = story.plan
    if plan is None:
        return [Text(phrases.opening(story.compiling, planning=bool(story.probability)), "cyan")]
    room -= 1
    lines, first = plan.lines, 0
    if len(lines) > room:
        settled = sum(line.mark in (Mark.DONE, Mark.SKIPPED) for line in lines)
        first = min(max(0, settled - room // 3), len(lines) - room)
    shown = lines[first : first + room]
    title = Text(_plan_title(plan), "bold")
    if len(shown) < len(lines):
        title.append(f" ({first + 1} to {first + len(shown)})", "not bold dim")
    return [title, *(_step(line, story.phase if line.mark is Mark.CURRENT else "") for line in shown)]


def _step(line: StepLine, phase: str = "") -> Text:
    mark, style = _MARKS[line.mark]
    text = Text("  ").append(f"{mark} {phrases.step(line.step)}", style)
    if line.attempt > 1:
        text.append(f", attempt {line.attempt}", "yellow")
    if note := phrases.note(line.note, line.cut_off):
        text.append(f": {note}", "red")
    if phase:
        text.append(f"  {phase}", "dim cyan")
    if line.mark is Mark.SKIPPED:
        text.append(", held already", "dim")
    return text


def _atom_lines(story: Story) -> list[Text]:
    """Belief against expectation: what is not as expected, and what the step was to change."""
    compared = story.compared
    if compared is None:
        return []
    lines = story.atoms()
    wrong = sum(line.standing is not Standing.EXPECTED for line in lines)
    step = story.compared_step if compared.what == "effects" else None
    shown = [
        line for line in lines if line.standing is not Standing.EXPECTED or step is None or line.atom in step.affects
    ]
    head = Text(f"seen, {phrases.compared(compared.what, story.compared_step)}: ")
    head.append("as expected", "green") if not wrong else head.append(f"{wrong} of {len(lines)} not as expected", "red")
    rows = [head]
    for line in shown[:_ATOMS]:
        mark, style = _STANDINGS[line.standing]
        probability = "unknown" if line.probability is None else f"P {line.probability:.2f}"
        expected = phrases.truth(line.expected)
        row = Text("  ").append(f"{mark} {line.atom}", style)
        rows.append(row.append(f"  expected {expected}, {probability}", "dim"))
    return rows


def _comparison(story: Story, compared: Compared) -> Text:
    wrong = [line for line in story.atoms() if line.standing is not Standing.EXPECTED]
    text = Text(f"{phrases.compared(compared.what, story.compared_step)}: ")
    if not wrong:
        return text.append("as expected", "green")
    for index, line in enumerate(wrong):
        unknown = line.standing is Standing.DOUBT
        seen = phrases.truth(None if unknown else not line.expected)
        text.append(", " if index else "").append(f"{line.atom} {seen}", "yellow" if unknown else "red")
    return text


def _last_remarks(story: Story, width: int) -> list[Text]:
    """The last remarks in `_REMARKS` lines or, if the last one takes more, in as many as it takes."""
    remarks: list[Remark] = [*story.opening]
    for plan in story.plans:
        remarks += plan.remarks
        for line in plan.lines:
            remarks += line.remarks
    lines: list[Text] = []
    for remark in reversed(remarks):
        more = _wrapped(_remark(remark), width, "")
        if lines and len(lines) + len(more) > _REMARKS:
            break
        lines = more + lines
    return lines


def _wrapped(text: Text, width: int, indent: str) -> list[Text]:
    """`text` in as many lines as it takes, the first one indented and the others two cells more."""
    narrow = max(20, width - len(indent) - 2)
    lines = _one_line(text).wrap(Console(width=narrow), narrow)
    return [Text(indent if index == 0 else f"{indent}  ") + line for index, line in enumerate(lines)]


def _remark(payload: object) -> Text:
    return Text(phrases.event(payload), _style(payload))


def _style(payload: object) -> str:
    match payload:
        case SkillResult():
            return "green" if payload.done else "red"
        case Decision():
            return _decision_style(payload)
        case Ended():
            return outcome_style(payload.outcome)
    return next((style for kinds, style in _STYLES if isinstance(payload, kinds)), "")


def _decision_style(decision: Decision) -> str:
    if decision.outcome is not None:
        return outcome_style(decision.outcome)
    return "" if decision.kind is DecisionKind.CONTINUE else "yellow"


def outcome_style(outcome: OutcomeKind) -> str:
    if outcome is OutcomeKind.GOAL_REACHED:
        return "bold green"
    return "bold yellow" if outcome.claims_goal else "bold red"


def _counts(story: Story) -> Text:
    goal = phrases.goal(story.goal_count, story.is_blind)
    counted = phrases.counts(action=story.actions, look=story.looks, replan=story.replans, fault=len(story.faults))
    return Text(f"cycle {story.cycle}, {story.time:.1f} s: {counted}{goal and f', {goal}'}", "dim")


def _one_line(text: Text) -> Text:
    """Without line breaks and other characters that move the cursor, which a message from outside may hold."""
    return Text(printable(text.plain), spans=text.spans, style=text.style)
