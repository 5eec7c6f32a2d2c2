"""How far long work is, and how long it still takes."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.lab.common.progress import Progress, RemainingTime, Stage, estimate, show_progress, show_stages


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
    with show_progress(stream, "episodes") as watch:
        for second in range(65):
            watch(Progress(second, 64, second, float(second)))
        watch(Progress(64, 64, 64, 65.0))
    assert stream.getvalue().splitlines() == [
        "0 of 64 episodes",
        "30 of 64 episodes  60 a minute, 0:00:34 left",
        "60 of 64 episodes  60 a minute, 0:00:04 left",
        "64 of 64 episodes  60 a minute, 0:00:00 left",
    ]


@given(
    st.lists(st.floats(0.1, 1e5), min_size=1, max_size=6),
    st.floats(0.1, 20.0),
    st.data(),
)
def test_the_outlook_is_right_where_stages_compare_as_told(
    efforts: list[float], slower: float, data: st.DataObject
) -> None:
    """Whatever the machine: what is left is what the rest of this stage and all later ones take."""
    names = [f"stage {number}" for number in range(len(efforts))]
    remaining = RemainingTime(dict(zip(names, efforts, strict=True)))
    at = data.draw(st.integers(0, len(efforts) - 1))
    wanted = data.draw(st.integers(1, 1000))
    there = data.draw(st.integers(0, wanted - 1))
    done = data.draw(st.integers(there + 1, wanted))
    step = slower * efforts[at] / wanted
    left = remaining.left(names[at], done, wanted, done - there, (done - there) * step)
    assert left == pytest.approx((wanted - done) * step + slower * sum(efforts[at + 1 :]))
    assert remaining.place(names[at]) == (at + 1, len(efforts))


def test_nothing_is_said_of_the_rest_before_something_is_done() -> None:
    assert RemainingTime({"one": 1.0, "two": 2.0}).left("one", 3, 9, 0, 0.0) is None


def test_each_stage_is_named_with_how_many_there_are_and_how_long_all_of_it_takes() -> None:
    stream = io.StringIO()
    with show_stages(stream) as watch:
        watch(Stage("pictures", 1, 2, 0, 4, None))
        watch(Stage("pictures", 1, 2, 1.5, 4, 7200.0))
        watch(Stage("pictures", 1, 2, 4, 4, 3600.4))
        watch(Stage("tower", 2, 2, 1, 9, 3599.0, "loss 0.500"))
        watch(Stage("tower", 2, 2, 9, 9, 0.0, "loss 0.250"))
    assert stream.getvalue().splitlines() == [
        "stage 1 of 2, pictures: 0 of 4",
        "stage 1 of 2, pictures: 4 of 4  about 1:00:00 left in all",
        "stage 2 of 2, tower: 1 of 9  about 0:59:59 left in all  loss 0.500",
        "stage 2 of 2, tower: 9 of 9  about 0:00:00 left in all  loss 0.250",
    ]


def test_on_a_terminal_there_is_a_bar_for_each_stage() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with show_stages(stream) as watch:
        watch(Stage("pictures", 1, 2, 2, 4, 7200.0))
        watch(Stage("tower", 2, 2, 1, 9, 3599.0, "loss 0.500"))
    last = stream.getvalue().replace("\r", "\n").splitlines()
    assert any("1 of 2 pictures" in line and "2/4" in line for line in last)
    assert any("2 of 2 tower" in line and "1/9" in line and "about 0:59:59 left in all" in line for line in last)
