"""The panels of the viewer that are text: pure functions from a story to Markdown.

The viewer's fonts have no glyph for much of Unicode, and its headless form ends at the first one that is missing, so
every text goes through `plain` on its way there.
"""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from textwrap import wrap

from executive.trace import phrases
from executive.trace.story.last_look import Change, LookLine
from executive.trace.story.story import AtomLine, Mark, Standing, StepLine, Story
from executive.types import Atom, DecisionKind

MARKS = {
    Mark.PENDING: "○",
    Mark.CURRENT: "►",
    Mark.DONE: "✓",
    Mark.FAILED: "✗",
    Mark.SKIPPED: "-",
    Mark.DROPPED: "-",
}
_STANDINGS = {Standing.SURPRISE: "✗", Standing.DOUBT: "?", Standing.EXPECTED: "✓"}
_DRAWN = {*map(chr, range(0x20, 0x7F)), *map(chr, range(0xA1, 0x100)), *"\n→←↑↓•…≥≤≠", *MARKS.values()} - {"\xad"}
_UNDRAWN = re.compile(f"[^{re.escape(''.join(sorted(_DRAWN)))}]")
_MARKDOWN = re.compile(r"[\\`*_|<>\[\]#~$]")
_ROWS, _CHANGES = 6, 6
"""What the panels have room for, in a window of 1280x800 pixels."""


def plain(text: str) -> str:
    """`text` with every character that the viewer cannot draw replaced by a question mark."""
    return _UNDRAWN.sub("?", text)


def escaped(text: str) -> str:
    """`text` as one line of Markdown that shows it letter by letter."""
    return _MARKDOWN.sub(r"\\\g<0>", " ".join(plain(text).split()))


def status(story: Story) -> str:
    """Return where the run stands; at its end, what it came to."""
    started = story.started
    if started is None:
        return ""
    if story.ended is not None:
        lines = [f"**{escaped(str(story.ended.outcome))}**: {escaped(phrases.why(story.ended))}"]
    else:
        lines = [f"**{escaped(_doing(story))}**"]
        if story.decisions and story.decisions[-1][1].kind is not DecisionKind.CONTINUE:
            lines.append(escaped(phrases.event(story.decisions[-1][1])))
    if story.probability and story.unreached():
        lines.append(escaped(f"to go: {', '.join(story.unreached())}"))
    counts = {"action": story.actions, "look": story.looks, "replan": story.replans, "fault": len(story.faults)}
    told = [f"{story.time:.1f} s", *(phrases.plural(count, noun) for noun, count in counts.items())]
    if goal := phrases.goal(story.goal_count, story.is_blind):
        told.append(f"**{goal}**")
    return "  \n".join([*lines, " · ".join(told), escaped(phrases.event(started))])


def belief(story: Story) -> str:
    """Return what was expected against what was believed in the last comparison; before the first one, what is
    believed, or assumed where nobody looks."""
    compared = story.compared
    if compared is None:
        true = [(escaped(str(atom)), f"{p:.2f}") for atom, p in sorted(story.probability.items()) if p >= 0.5]
        if story.is_blind:
            return "\n".join(_table(["assumed true"], [row[:1] for row in true]))
        return "\n".join(_table(["believed true", "P(true)"], true))
    lines = story.atoms()
    alarm = _alarm(lines)
    shown = _worth_showing(story, lines)[: _ROWS - bool(alarm)]
    notes = [_note(story, line.atom) for line in shown]
    rows = [[*_row(line), escaped(note)] for line, note in zip(shown, notes, strict=True)]
    rest = [line for line in lines if line not in shown]
    if rest:
        as_expected = all(line.standing is Standing.EXPECTED for line in rest)
        rows.append(["", f"{len(rest)} more{', as expected' * as_expected}", "", "", ""])
    about = escaped(phrases.compared(compared.what, story.compared_step))
    head = ["", f"{about}, look {compared.observation_id}", "expected", "P(true)", ""]
    cells = len(head) if any(notes) else len(head) - 1
    return "\n".join([*alarm, *_table(head[:cells], [row[:cells] for row in rows])])


def look(story: Story) -> str:
    """Return what the last look changed in what is known, and through which cameras; while something is carried, what
    the last glance at it showed."""
    last, glance = story.seeing.last, story.seeing.glance
    if last is None:
        return ""
    lines = []
    if glance is not None and glance.id > last.id:
        answers = ", ".join(f"{atom} {value:.2f}" for atom, value in glance.answers.items())
        lines += [f"**glance {glance.id}**, while it is carried: **{escaped(answers) or 'no answer'}**", ""]
    lines += [_taken(last, frozenset(story.seeing.seen_in)), ""]
    if last.changes:
        rows = [_change(change) for change in last.changes[:_CHANGES]]
        lines += _table(["atom", "was", "is now", "P(true)"], rows)
        lines += ["", f"{len(last.changes) - _CHANGES} more"] if len(last.changes) > _CHANGES else []
    else:
        lines.append("what it shows was known before" if story.looks > 1 else "the first look")
    notes = [phrases.event(each) for each in (*last.contradictions, *last.overruled)]
    notes += [phrases.blinded(camera, why) for camera, why in story.seeing.blinded.items()]
    return "\n".join([*lines, "", *(f"- {escaped(note)}" for note in notes)])


_ARGUMENT_LINES, _ARGUMENT_WIDTH = 2, 14
"""Lines and characters that a node of the plan's graph has for a step's arguments."""


def step_label(line: StepLine) -> str:
    """Return a step as a node of the plan's graph. There is room for two lines of arguments: where there are more than
    two, several stand in a line, and what does not fit is left out."""
    note = phrases.note(line.note, line.cut_off)
    tail = f"\n({note})" if note else ""
    args: Sequence[str] = line.step.args
    if len(args) > _ARGUMENT_LINES:
        args = wrap(
            " ".join(args), _ARGUMENT_WIDTH, max_lines=_ARGUMENT_LINES, placeholder=" ...", break_on_hyphens=False
        )
    return plain("\n".join((f"{MARKS[line.mark]} {line.step.action}", *args)) + tail)


def _worth_showing(story: Story, lines: Sequence[AtomLine]) -> list[AtomLine]:
    """Return all that is not as expected; of the rest what the step was to change, or, if it is no step, everything."""
    compared = story.compared
    step = story.compared_step if compared is not None and compared.what == "effects" else None
    wanted = [
        line for line in lines if line.standing is not Standing.EXPECTED or step is None or line.atom in step.affects
    ]
    return wanted


def _alarm(lines: Sequence[AtomLine]) -> list[str]:
    """Return what stands out at once: how many surprises and doubts there are, in large letters. (The viewer's Markdown
    has no colours, and its boxes for warnings begin with glyphs that its fonts lack.)"""
    counts = {Standing.SURPRISE: "not as expected", Standing.DOUBT: "cannot be told"}
    told = [
        f"{_STANDINGS[standing]} {count} {what}"
        for standing, what in counts.items()
        if (count := sum(line.standing is standing for line in lines))
    ]
    return [f"### {', '.join(told)}", ""] if told else []


def _note(story: Story, atom: Atom) -> str:
    """Return what an atom's probability rests on, where that is not the answer to a question about it alone."""
    last, kept = story.seeing.last, story.seeing.remembered.get(atom)
    if kept is not None:
        return f"seen {phrases.plural(kept.age, 'cycle')} ago"
    for wrong in last.overruled if last is not None else ():
        if wrong.atom == atom:
            return f"the look said {wrong.answer:.2f}"
    return ""


def _taken(last: LookLine, cameras: Set[str]) -> str:
    """Return which look it was, and what it took: through which of the `cameras`, unless it was all of them."""
    if last.id < 0:
        return "**told, not seen**"
    through = last.cameras if set(last.cameras) < cameras else ()
    told = escaped(phrases.look(last.id, last.cause, last.kind, last.questions, last.atoms, through))
    return re.sub(r"^look \d+", r"**\g<0>**", told)


def _change(change: Change) -> list[str]:
    probability = "?" if change.probability is None else f"{change.probability:.2f}"
    cells = [escaped(str(change.atom)), phrases.truth(change.before, "?"), phrases.truth(change.now, "?"), probability]
    return [f"**{cell}**" for cell in cells] if change.now else cells


def _row(line: AtomLine) -> list[str]:
    probability = "?" if line.probability is None else f"{line.probability:.2f}"
    cells = [_STANDINGS[line.standing], escaped(str(line.atom)), phrases.truth(line.expected), probability]
    if line.standing is Standing.EXPECTED:
        return cells
    # Atoms have no character that would end the code span.
    cells[1] = f"`{line.atom}`"
    return [f"**{cell}**" for cell in cells]


def _doing(story: Story) -> str:
    line = story.current
    if line is None:
        return (
            phrases.opening(story.compiling, planning=bool(story.probability))
            if story.plan is None
            else "about to begin"
        )
    note = phrases.note(line.note, line.cut_off)
    return phrases.action(line.action, line.step, line.attempt) + (f" - {note}" if note else "")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)]
