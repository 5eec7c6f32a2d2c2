"""The run in a terminal, in a pipe, and in terminals that are not what they seem."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from executive.trace.story.story import Story
from executive.trace.terminal.console import console_for, is_live, waiting
from executive.trace.terminal.sink import TerminalSink
from executive.trace.terminal.view import dashboard, event_line, story_lines
from executive.types import Decision, DecisionKind, Event, Phase, Plan, Started, Timing
from tests.executive.trace.strategies import events
from tests.executive.trace.synthetic import pick, synthetic_events
from tests.fakes import recorded

CURSOR = re.compile(r"\x1b\[[0-9;?]*[A-Za-ln-z]")
"""Any control sequence but a colour, which ends in m."""


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")


def show(stream: io.StringIO, some: list[Event], close: bool = True) -> str:
    sink = TerminalSink(stream)
    for event in some:
        sink.write(event)
    if close:
        sink.close()
    return stream.getvalue()


def stories(some: list[Event]) -> Iterator[Story]:
    story = Story()
    for event in some:
        story.tell(event)
        yield story


def assert_fits(story: Story, width: int, height: int) -> None:
    lines = dashboard(story, width, height)
    assert len(lines) <= height
    for line in lines:
        assert cell_len(line.plain) <= width
        assert "\n" not in line.plain


def test_the_live_view_fits_80_by_24_at_every_moment() -> None:
    for story in stories(synthetic_events()):
        assert_fits(story, 80, 23)


@given(st.lists(events, max_size=12), st.integers(10, 120), st.integers(3, 50))
def test_the_live_view_fits_whatever_happens(some: list[Event], width: int, height: int) -> None:
    for story in stories(some):
        assert_fits(story, width, height)


def test_of_a_long_plan_the_steps_around_the_current_one_are_shown() -> None:
    story = Story()
    steps = tuple(pick(f"item-{index}", "wood-table") for index in range(60))
    story.tell(Event(0, 0.0, 0.0, Plan(steps, 60.0, "", 0.0)))
    for line in story.plans[0].lines[:40]:
        line.mark = type(line.mark)("done")
    shown = "\n".join(line.plain for line in dashboard(story, 80, 23))
    assert "item-39" in shown
    assert "item-40" in shown
    assert_fits(story, 80, 23)


def test_in_a_pipe_there_are_plain_lines_as_things_happen() -> None:
    stream = io.StringIO()
    text = show(stream, synthetic_events())
    assert "\x1b" not in text
    lines = text.splitlines()
    assert lines[0].strip() == "0.0 s  grocery: breakfast, seed 3, estimator oracle"
    assert any(line.endswith("fault drop@2: the gripper opened in mid-transfer") for line in lines)
    assert any("replan: on-table(cereal-box,white-table) not seen" in line for line in lines)
    assert lines[-1].endswith("goal-reached: the goal is seen to hold")
    assert all(re.match(r" *\d+\.\d s  \S", line) for line in lines)


def test_no_color_means_no_tricks_even_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    assert not CURSOR.search(show(Terminal(), synthetic_events()))


def test_a_dumb_terminal_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    assert not CURSOR.search(show(Terminal(), synthetic_events()))


def test_a_terminal_gets_its_cursor_back_and_keeps_the_story() -> None:
    stream = Terminal()
    text = show(stream, synthetic_events())
    assert text.rfind("\x1b[?25h") > text.rfind("\x1b[?25l") >= 0, "the cursor is hidden, and shown again"
    story = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text[text.rfind("\x1b[?25h") :])
    for line in (
        "  ✗ place cereal-box white-table: dropped",
        "      fault drop@2: the gripper opened in mid-transfer",
        "  - 2 steps left undone",
        "  ✓ pick cereal-box wood-table, attempt 2",
        "the goal is seen to hold",
    ):
        assert line in story.splitlines(), line


def test_a_run_that_never_began_leaves_nothing_behind() -> None:
    assert show(Terminal(), []) == ""


@given(st.lists(events, max_size=12), st.integers(30, 100))
def test_the_story_has_no_line_breaks_or_control_characters_of_its_own(some: list[Event], width: int) -> None:
    for story in stories(some):
        for line in story_lines(story, width):
            assert line.plain.isprintable()
    for event in some:
        text = event_line(event, story)
        assert text is None or text.plain.isprintable()


def test_a_message_cannot_move_the_cursor() -> None:
    rogue = Decision(DecisionKind.REPLAN, recorded("before\x1b[2J\nafter"))
    text = show(io.StringIO(), [Event(0, 0.0, 0.0, rogue)])
    assert text.splitlines() == ["    0.0 s  replan: before [2J after"]


def test_where_marks_cannot_be_encoded_there_are_others() -> None:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    console_for(stream).print("✓ ✗ ▶ · ü")
    stream.flush()
    assert raw.getvalue() == b"+ x > . ?\n"


def test_half_a_character_does_not_end_a_run() -> None:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="utf-8")
    console_for(stream).print("a folder \udcff ü")
    stream.flush()
    assert raw.getvalue() == "a folder ? ü\n".encode()


def test_who_is_live() -> None:
    assert is_live(console_for(Terminal()))
    assert not is_live(console_for(io.StringIO()))
    assert not is_live(console_for(Terminal(), {"NO_COLOR": "1"}))


def test_what_is_waited_for_is_said_on_a_terminal_alone_and_taken_back() -> None:
    pipe, terminal = io.StringIO(), Terminal()
    for stream in (pipe, terminal):
        with pytest.raises(KeyboardInterrupt), waiting(stream, "loading"):
            raise KeyboardInterrupt
    assert pipe.getvalue() == ""
    shown = terminal.getvalue()
    assert "loading" in shown
    assert shown.rfind("\x1b[2K") > shown.rfind("loading"), "its line is erased"
    assert shown.rfind("\x1b[?25h") > shown.rfind("\x1b[?25l") >= 0, "the cursor is hidden, and shown again"


def test_each_line_is_there_as_soon_as_it_happens() -> None:
    stream = io.StringIO()
    started = synthetic_events()[0]
    assert isinstance(started.payload, Started)
    assert "grocery: breakfast" in show(stream, [started], close=False)


def test_what_is_compiled_is_told_for_as_long_as_it_takes() -> None:
    started = next(event for event in synthetic_events() if isinstance(event.payload, Started))
    begun = Event(0, 0.0, 0.1, Phase("compile", "this and that"))
    done = Event(0, 0.0, 9.0, Timing("compile", 8.9))
    assert "this and that" in show(io.StringIO(), [started, begun])
    before, during, after = (
        "\n".join(line.plain for line in dashboard(story, 80, 23)) for story in stories([started, begun, done])
    )
    assert "this and that" in during
    assert "this and that" not in before + after
