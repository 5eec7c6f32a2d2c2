"""The viewer's texts: drawn with the glyphs that it has, and Markdown that shows what was meant."""

from __future__ import annotations

import re
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from executive.trace.story.story import Story
from executive.trace.viewer import text_panels
from executive.types import Event, Started
from tests.executive.trace.strategies import events
from tests.executive.trace.synthetic import synthetic_events


def story_of(some: list[Event]) -> Story:
    story = Story()
    for event in some:
        story.tell(event)
    return story


@given(st.text())
def test_plain_keeps_what_the_viewer_can_draw_and_nothing_else(text: str) -> None:
    plain = text_panels.plain(text)
    assert len(plain) == len(text)
    assert all(a in (b, "?") for a, b in zip(plain, text, strict=True))
    assert all(each.isascii() or "\xa1" <= each <= "\xff" or each in "✓✗►○→←↑↓•…≥≤≠" for each in plain)
    assert all(each >= " " or each == "\n" for each in plain)
    assert text_panels.plain(plain) == plain


@given(st.text())
def test_escaped_is_one_line_that_unescapes_to_the_text(text: str) -> None:
    escaped = text_panels.escaped(text)
    assert "\n" not in escaped
    assert re.sub(r"\\(.)", r"\1", escaped) == " ".join(text_panels.plain(text).split())
    assert not re.search(r"(?<!\\)(?:\\\\)*[|*_`#<]", escaped)


@given(st.lists(events, max_size=15))
def test_any_story_can_be_told(some: list[Event]) -> None:
    story = story_of([synthetic_events()[0], *some])
    for text in (text_panels.status(story), text_panels.belief(story), text_panels.look(story)):
        assert text_panels.plain(text) == text


def test_every_row_of_a_table_has_as_many_cells_as_its_head() -> None:
    for count in range(0, len(synthetic_events()), 7):
        rows = [row for row in text_panels.belief(story_of(synthetic_events()[:count])).splitlines() if row[:1] == "|"]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) <= 1


def test_surprises_stand_out_and_come_first() -> None:
    run = synthetic_events()
    end = next(i for i, event in enumerate(run) if event.cycle == 3) - 1
    text = text_panels.belief(story_of(run[:end]))
    head, _, *rows = [row for row in text.splitlines() if row.startswith("|")]
    assert head.startswith("|  | after place cereal-box white-table, look 2 | expected | P(true) |")
    assert rows[0] == "| **✗** | **`on-table(cereal-box,white-table)`** | **true** | **0.02** |"
    assert "### ✗ 2 not as expected" in text
    assert [row.count("**") for row in rows] == [8, 8, 0, 0, 0]
    assert "6 more, as expected" in rows[-1]


def test_a_look_tells_what_it_changed_what_came_true_first() -> None:
    run = synthetic_events()
    end = next(i for i, event in enumerate(run) if event.cycle == 2)
    text = text_panels.look(story_of(run[:end]))
    assert text.startswith("**look 1** (after pick(cereal-box,wood-table)): 10 ")
    rows = [row for row in text.splitlines() if row.startswith("|")][2:]
    assert rows == [
        "| **robot-gripping(cereal-box)** | **false** | **true** | **0.98** |",
        "| on-table(cereal-box,wood-table) | true | false | 0.02 |",
        "| robot-gripper-empty() | true | false | 0.02 |",
    ]
    assert text_panels.look(story_of(run[:4])) == ""


def test_the_status_tells_the_outcome_at_the_end() -> None:
    text = text_panels.status(story_of(synthetic_events()))
    assert "**goal-reached**" in text
    assert "**goal 2 of 2**" in text
    assert "7 actions · 10 looks · 1 replan · 1 fault" in text


def test_the_goal_of_one_that_does_not_look_is_said_to_be_assumed() -> None:
    first, *rest = synthetic_events()
    assert isinstance(first.payload, Started)
    blind = story_of([replace(first, payload=replace(first.payload, estimator="none")), *rest])
    assert "**goal 2 of 2 assumed**" in text_panels.status(blind)
    assert "nobody looks" in text_panels.status(blind)
