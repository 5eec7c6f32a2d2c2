"""How answers are printed: drawn on a terminal, plain lines in a pipe, ASCII where there is nothing else."""

from __future__ import annotations

import io

import pytest

from executive.trace.terminal.answers import Line, print_answers

LINES = [
    Line("on", "on(a,b)", "Is a on b?", 0.93),
    Line("on", "on(b,a)", "Is b on a?", 0.0),
    Line("free", "free()", "Is the hand [red]free[/red]?", None, "no reply"),
    Line("questions", "Is it raining?", "", 1.0),
]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_pipe_gets_one_plain_line_for_each_answer() -> None:
    pipe = io.StringIO()
    print_answers(LINES, pipe)
    assert [line.rstrip() for line in pipe.getvalue().splitlines()] == [
        "0.93  █████████·  on(a,b)         Is a on b?",
        "0.00  ··········  on(b,a)         Is b on a?",
        "",
        "   ?              free()          Is the hand [red]free[/red]?  (unanswered: no reply)",
        "",
        "1.00  ██████████  Is it raining?",
    ]


def test_a_pipe_wraps_nothing() -> None:
    pipe = io.StringIO()
    print_answers([Line("on", "on(a,b)", "Is it? " * 100, 0.5)], pipe)
    assert pipe.getvalue().count("\n") == 1


def test_a_terminal_gets_a_table_in_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("NO_COLOR", raising=False)
    terminal = Terminal()
    print_answers(LINES, terminal)
    shown = terminal.getvalue()
    assert "\x1b[" in shown
    for said in ("P(true)", "on(a,b)", "█████████·", "Is the hand [red]free[/red]?", "unanswered: no reply"):
        assert said in shown


def test_without_colour_it_is_the_same_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    terminal = Terminal()
    print_answers(LINES, terminal)
    assert "\x1b[3" not in terminal.getvalue()
    assert "on(a,b)" in terminal.getvalue()


def test_ascii_is_enough() -> None:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    print_answers(LINES, stream)
    stream.flush()
    assert "0.93  #########.  on(a,b)" in raw.getvalue().decode("ascii")


def test_nothing_is_nothing() -> None:
    pipe = io.StringIO()
    print_answers([], pipe)
    assert pipe.getvalue() == ""
