"""A run explained in sentences, from its events alone: what was done, seen and decided, and why.

A cycle in which all went as expected is one line. Of any other, and of one that is asked for, everything is told that a
decision rested on: the atoms, what was expected of them, how probable they were, which pictures showed it, and what the
skill said.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import TextIO

from executive.errors import InputError, OptionError
from executive.trace import phrases
from executive.trace.phrases import MOST, listed, plural, sentence, truth
from executive.trace.record.log import picture_name
from executive.trace.story.story import Story
from executive.trace.terminal.console import console_for, printable
from executive.types import (
    Atom,
    Compared,
    Decision,
    DecisionKind,
    Ended,
    Event,
    FaultInjected,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Phase,
    Plan,
    Started,
)

_TOLD = (*phrases.EVENTS.keys() - {Started, Phase}, Plan)
_TIMED = (FaultInjected, Guarded)
"""What happens while a skill is at work, and is told with its time."""


def explain(events: Iterable[Event], cycle: int | None = None) -> list[str]:
    """The run, or one cycle of it, line by line; what belongs to a line above is indented.

    Raises:
        InputError: the events are no run, or it has no such cycle.
    """
    chapters: dict[int, list[Event]] = {}
    for event in events:
        chapters.setdefault(event.cycle, []).append(event)
    story = Story()
    lines: list[str] = []
    for number, some in sorted(chapters.items()):
        chapter = _chapter(some, story, whole=cycle is not None)
        if cycle is None or number == cycle:
            lines += chapter
    if story.started is None:
        raise InputError("these events are no run: none of them starts it")
    if cycle is not None and cycle not in chapters:
        raise OptionError(f"there is no cycle {cycle}; the run has cycles 0 to {max(chapters)}", option="cycle")
    return [*_opening(story.started), *lines]


def print_lines(lines: Iterable[str], stream: TextIO) -> None:
    """Print what `explain` returns; in a terminal, as wide as that is."""
    console = console_for(stream)
    for line in lines:
        text = printable(line)
        if console.is_terminal:
            indent = " " * (len(text) - len(text.lstrip()) + 2)
            width = max(40, console.width)
            text = textwrap.fill(text, width, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)
        print(text, file=stream)


def _opening(started: Started) -> list[str]:
    goal = ", ".join(started.task.goal.texts()) or "nothing"
    return [sentence(phrases.event(started)), f"The goal: {goal}."]


def _chapter(events: Sequence[Event], story: Story, whole: bool) -> list[str]:
    """The events of one cycle, which `story` is told, and when it began and ended on the world's clock."""
    body: list[str] = []
    for event in events:
        story.tell(event)
        body += _lines(event, story, whole)
    start, end = events[0].time, events[-1].time
    span = f"{start:.1f} s" if end - start < 0.05 else f"{start:.1f} s to {end:.1f} s"
    head = f"Cycle {events[0].cycle}, {span}"
    if story.is_routine and story.current is not None and not whole:
        looked = any(isinstance(each.payload, Looked) and each.payload.kind is not LookKind.GUARD for each in events)
        seen = f", and seen as expected (look {story.seeing.last.id})" if looked and story.seeing.last else ""
        return [f"{head}: {phrases.step(story.current.step)} was done{seen}."]
    return [f"{head}:", *(f"  {line}" for line in body)]


def _lines(event: Event, story: Story, whole: bool) -> list[str]:
    """Return what is told of an event, which `story` has been told of; a look is told once its answers are there."""
    match event.payload:
        case Looked() as look:
            return _look(look, story, whole)
        case Judged() as judged:
            return _judged(judged, whole)
        case Compared() as compared:
            return _compared(compared, story, whole)
        case Decision() as decision:
            return _decided(decision)
        case Plan() as plan:
            found = f" ({plan.planner})" if plan.planner else ""
            return [sentence(f"{phrases.plan(plan, len(story.plans))}{found}")]
        case Ended() as end:
            return [sentence(phrases.account(end))]
        case payload if isinstance(payload, _TOLD):
            phrase = phrases.event(payload)
            return [sentence(f"at {event.time:.1f} s, {phrase}" if isinstance(payload, _TIMED) else phrase)]
    return []


def _look(looked: Looked, story: Story, whole: bool) -> list[str]:
    if looked.kind is LookKind.GUARD and not whole:
        return []
    look = story.seeing.latest
    told = phrases.look(looked.observation_id, look.cause, looked.kind, looked.questions, looked.atoms, looked.cameras)
    lines = [sentence(told)]
    if look.unanswered:
        why = f": {look.errors[0]}" if look.errors else ""
        lines.append(f"  {len(look.unanswered)} of them got no answer{why}: {listed(sorted(look.unanswered))}.")
    if whole and looked.cameras:
        lines.append(f"  {_pictures(looked.observation_id, looked.cameras)}")
    return lines


def _judged(judged: Judged, whole: bool) -> list[str]:
    lines = [f"  {sentence(phrases.event(each))}" for each in (*judged.contradictions, *judged.overruled)]
    if whole:
        for atom, value in judged.remembered.items():
            was = f"{plural(value.age, 'cycle')} ago it was {truth(value.value)}"
            lines.append(f"  {atom} was not told; {was}, and is true by now with P {value.probability:.2f}.")
        if judged.came_about is not None:
            lines.append(f"  That the action did all it was to do has P {judged.came_about:.2f}.")
    return lines


def _compared(compared: Compared, story: Story, whole: bool) -> list[str]:
    verdict, expected = compared.verdict, compared.expected
    what = {"preconditions": "what the next step needs", "goal": "the goal", "effects": "what was expected"}
    about = what.get(compared.what, compared.what)
    if verdict.satisfied:
        return [f"Of {about}, all is seen to hold."] if compared.what != "preconditions" or whole else []
    lines = [f"Of {about}, not all is seen to hold:"]
    for atom in sorted(verdict.violated):
        wanted = expected.get(atom)  # a record of somebody else's may say less
        told = "is not as expected" if wanted is None else f"should be {truth(wanted)} and is {truth(not wanted)}"
        lines.append(f"  {atom} {told}{_probability(atom, story)}")
    if verdict.unknown:
        lines.append(f"  {listed(sorted(verdict.unknown))} cannot be told")
    return lines


def _probability(atom: Atom, story: Story) -> str:
    value, raw = story.seeing.probability.get(atom), story.seeing.latest.answers.get(atom)
    if value is None:
        return ""
    said = f", of which the look alone says {raw:.2f}" if raw is not None and abs(raw - value) > 0.005 else ""
    return f" (P {value:.2f}{said})"


def _decided(decision: Decision) -> list[str]:
    lines = [sentence(phrases.event(decision))]
    if decision.kind is DecisionKind.CONTINUE and (decision.report is None or decision.report.done):
        return lines
    lines += [f"  {phrases.ground(ground)}" for ground in decision.grounds[:MOST]]
    if len(decision.grounds) > MOST:
        lines.append(f"  and {plural(len(decision.grounds) - MOST, 'atom')} more")
    looks = dict.fromkeys((ground.observation_id, ground.cameras) for ground in decision.grounds[:MOST])
    lines += [f"  {_pictures(look, cameras)}" for look, cameras in looks if cameras]
    return lines


def _pictures(observation: int, cameras: Sequence[str]) -> str:
    """Return where the pictures of a look lie."""
    return f"Pictures of look {observation}: {', '.join(picture_name(observation, camera) for camera in cameras)}."
