"""What the terminal shows, as lines of text: pure functions of a story."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

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
    Phase,
    Plan,
    Questions,
    Resumed,
    SkillResult,
    SkillStatus,
    Started,
    Step,
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
_ATOMS, _REMARKS = 5, 4
"""How many atoms and how many remarks the live view shows."""


def spoken(step: Step) -> str:
    return " ".join((step.action, *step.args))


def dashboard(story: Story, width: int, height: int) -> list[Text]:
    """The live view: no more than `height` lines of at most `width` cells.

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
    """The whole run so far, to stay on the screen: every plan, how its steps ended, and what came in between."""
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
            lines.append(Text(f"  - {dropped} {'step' if dropped == 1 else 'steps'} left undone", "dim"))
    if story.ended is not None:
        reason = Text(story.ended.reason, outcome_style(story.ended.outcome))
        lines += _wrapped(reason, width, "")
    return [_one_line(line) for line in lines]


def event_line(event: Event, story: Story) -> Text | None:
    """One line about an event, for logs and pipes; None for what is not worth one. `story` has been told of it."""
    payload = event.payload
    text = Text()
    match payload:
        case Started():
            text = _title(story)
        case Questions() if payload.warnings:
            more = f" (and {len(payload.warnings) - 1} more)" if len(payload.warnings) > 1 else ""
            text.append(f"questions, {payload.translator}: {payload.warnings[0]}{more}", "yellow")
        case Phase(name=name, detail=detail) if name == COMPILE:
            text.append(f"compiling {detail}", "cyan")
        case Observation() if not story.at_work:  # what the guard sees is told when there is something to it
            text.append(f"look {payload.id}: {payload.cause}" if payload.cause else f"look {payload.id}")
        case Plan():
            steps = ", ".join(spoken(step) for step in payload.steps)
            text.append(f"{_plan_title(story.plans[-1])}: {steps}")
        case NoPlan() | FaultInjected() | Blinded() | Moved() | Resumed():
            text = _remark(payload)
        case Guarded(held=False):
            text = _remark(payload)
        case Judged() if payload.contradictions:
            text = Text("; ").join(map(_remark, payload.contradictions))
        case Dispatched():
            attempt = f" (attempt {payload.attempt})" if payload.attempt > 1 else ""
            text.append(f"action {payload.action}: {spoken(payload.step)}{attempt}", "bold")
        case SkillResult():
            text.append(f"skill: {payload.status}{f', {payload.reason}' if payload.reason else ''}")
            text.stylize("green" if payload.done else "red")
        case Compared() if payload.what != "preconditions" or not payload.verdict.satisfied:
            text = _comparison(story, payload)
        case Decision() if payload.kind is not DecisionKind.STOP:  # the end says the same
            text = _remark(payload)
        case Ended():
            text.append(f"{payload.outcome}: {payload.reason}", outcome_style(payload.outcome))
        case _:
            return None
    return Text(f"{event.time:7.1f} s  ", "dim") + _one_line(text)


def _title(story: Story) -> Text:
    if story.started is None:
        return Text("")
    started = story.started
    text = Text(f"{started.domain}: {started.task.problem}", "bold")
    text.append(f", seed {started.seed}, estimator {started.estimator}", "not bold")
    return text


def _plan_title(plan: PlanLine) -> str:
    count = len(plan.lines)
    return f"plan {plan.number}, {count} {'step' if count == 1 else 'steps'}"


def _plan_lines(story: Story, room: int) -> list[Text]:
    """The plan in at most `room` lines: the steps around the current one where there are more."""
    plan = story.plan
    if plan is None:
        doing = f"compiling {story.compiling}" if story.compiling else "looking at the world"
        return [Text("planning" if story.probability else doing, "cyan")]
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
    text = Text("  ").append(f"{mark} {spoken(line.step)}", style)
    if line.attempt > 1:
        text.append(f", attempt {line.attempt}", "yellow")
    if line.note:
        text.append(f": {line.note}", "red")
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
    about = f" {spoken(story.compared_step)}" if story.compared_step else ""
    title = {"preconditions": "before", "effects": "after"}.get(compared.what, compared.what)
    lines = story.atoms()
    wrong = sum(line.standing is not Standing.EXPECTED for line in lines)
    step = story.compared_step if compared.what == "effects" else None
    shown = [
        line for line in lines if line.standing is not Standing.EXPECTED or step is None or line.atom in step.affects
    ]
    head = Text(f"seen {title}{about}: ")
    head.append("as expected", "green") if not wrong else head.append(f"{wrong} of {len(lines)} not as expected", "red")
    rows = [head]
    for line in shown[:_ATOMS]:
        mark, style = _STANDINGS[line.standing]
        probability = "unknown" if line.probability is None else f"P {line.probability:.2f}"
        expected = "true" if line.expected else "false"
        row = Text("  ").append(f"{mark} {line.atom}", style)
        rows.append(row.append(f"  expected {expected}, {probability}", "dim"))
    return rows


def _comparison(story: Story, compared: Compared) -> Text:
    title = {"preconditions": "before", "effects": "after"}.get(compared.what, compared.what)
    about = f" {spoken(story.compared_step)}" if story.compared_step else ""
    wrong = [line for line in story.atoms() if line.standing is not Standing.EXPECTED]
    text = Text(f"{title}{about}: ")
    if not wrong:
        return text.append("as expected", "green")
    for index, line in enumerate(wrong):
        unknown = line.standing is Standing.DOUBT
        seen = "unknown" if unknown else "false" if line.expected else "true"
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


def _remark(remark: Remark) -> Text:
    text = Text()
    match remark:
        case FaultInjected():
            text.append(f"fault {remark.spec}: {remark.detail or remark.kind}", "magenta")
        case NoPlan():
            text.append(f"no plan: {remark.reason}{f', {remark.detail}' if remark.detail else ''}", "red")
        case Decision():
            text.append(f"{remark.kind}: {remark.reason}", _decision_style(remark))
        case Contradiction():
            text.append(f"contradiction: {contradiction(remark)}", "yellow")
        case Guarded():
            lost = ", again: the skill is told" if remark.lost else ""
            text.append(f"guard: {remark.atom} is not seen in look {remark.observation_id}{lost}", "yellow")
        case Blinded():
            text.append(f"camera {remark.camera} is left out: {remark.reason}", "yellow")
        case Moved():
            failed = "" if remark.status is SkillStatus.DONE else f" ({remark.status})"
            text.append(f"out of the way, {remark.move}: {remark.seconds:.1f} s{failed}", "dim")
        case Resumed(actions=actions):
            text.append(f"resumed after {actions} action{'s' * (actions != 1)}, looking first", "cyan")
    return text


def contradiction(clash: Contradiction) -> str:
    """Answers that cannot all be so, and what was made of them."""
    said = " and ".join(f"{atom} ({value:.2f})" for atom, value in clash.answers.items())
    held = [f"{atom} is, {value:.2f}" for atom, value in clash.resolved.items() if value >= 0.5]
    wrong = "all be false" if clash.exact else "all be true"
    return f"{said} cannot {wrong}: {', '.join(held) or 'none of them is'}"


def _decision_style(decision: Decision) -> str:
    if decision.outcome is not None:
        return outcome_style(decision.outcome)
    return "" if decision.kind is DecisionKind.CONTINUE else "yellow"


def outcome_style(outcome: OutcomeKind) -> str:
    if outcome is OutcomeKind.GOAL_REACHED:
        return "bold green"
    return "bold yellow" if outcome.claims_goal else "bold red"


def _counts(story: Story) -> Text:
    counts: Sequence[tuple[int, str]] = (
        (story.actions, "action"),
        (story.looks, "look"),
        (story.replans, "replan"),
        (len(story.faults), "fault"),
    )
    told = ", ".join(f"{count} {noun}{'' if count == 1 else 's'}" for count, noun in counts)
    goal = f", {story.goal_told}" if story.goal_told else ""
    return Text(f"cycle {story.cycle}, {story.time:.1f} s: {told}{goal}", "dim")


def _one_line(text: Text) -> Text:
    """Without line breaks and other characters that move the cursor, which a message from outside may hold."""
    return Text(printable(text.plain), spans=text.spans, style=text.style)
