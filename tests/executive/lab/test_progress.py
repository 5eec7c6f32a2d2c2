"""How far long work is, and how long it still takes."""

from __future__ import annotations

import io

import pytest

from executive.lab.progress import Progress, estimate, told


@pytest.mark.parametrize(
    ("progress", "said"),
    [
        (Progress(0, 9, 0, 0.0), ""),
        (Progress(30, 90, 30, 60.0), "30 a minute, 0:02:00 left"),
        (Progress(5, 1200, 3, 360.0), "30 an hour, 39:50:00 left"),
        (Progress(9, 9, 4, 8.0), "30 a minute, 0:00:00 left"),
    ],
)
def test_the_pace_is_that_of_what_is_new(progress: Progress, said: str) -> None:
    assert estimate(progress) == said


def test_where_there_is_no_terminal_a_line_now_and_then_is_enough() -> None:
    stream = io.StringIO()
    with told(stream, "episodes") as watch:
        for second in range(65):
            watch(Progress(second, 64, second, float(second)))
        watch(Progress(64, 64, 64, 65.0))
    assert stream.getvalue().splitlines() == [
        "0 of 64 episodes",
        "30 of 64 episodes  60 a minute, 0:00:34 left",
        "60 of 64 episodes  60 a minute, 0:00:04 left",
        "64 of 64 episodes  60 a minute, 0:00:00 left",
    ]
