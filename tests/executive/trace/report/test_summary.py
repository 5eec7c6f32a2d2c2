"""What a run came to."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.trace.report.summary import (
    SUMMARY_FILE,
    Collector,
    print_summary,
    summarise,
    write_summary,
)
from executive.trace.story.costs import STAGES
from executive.types import Ended, Event, Motion, Timing
from tests.executive.trace.strategies import events
from tests.executive.trace.synthetic import synthetic_events

KEYS = (
    "run, domain, problem, seed, estimator, outcome, goal_seen, goal_true, unreached, given_up, cycles, actions, "
    "replans, looks, looking, faults, sim_seconds, wall_seconds"
)


def test_the_keys_are_those_that_were_promised_in_their_order(tmp_path: Path) -> None:
    summary = summarise(synthetic_events(), goal_true=True)
    write_summary(tmp_path, summary)
    assert ", ".join(json.loads((tmp_path / SUMMARY_FILE).read_text())) == KEYS
    assert list(summary["wall_seconds"]) == ["total", *STAGES]


def test_it_says_what_happened() -> None:
    summary = summarise(synthetic_events(), goal_true=False)
    assert (summary["outcome"], summary["goal_seen"], summary["goal_true"]) == ("goal-reached", True, False)
    assert (summary["cycles"], summary["actions"], summary["replans"], summary["looks"]) == (8, 7, 1, 10)
    (fault,) = summary["faults"]
    assert (fault["kind"], fault["spec"], fault["action"]) == ("drop", "drop@2", 2)
    assert fault["time"] == pytest.approx(4.5)
    assert summary["sim_seconds"] == pytest.approx(22.4)


def test_stages_are_told_apart() -> None:
    run = synthetic_events()
    motions = sum(event.payload.planning_seconds for event in run if isinstance(event.payload, Motion))
    told = dict.fromkeys(STAGES, 0.0)
    for event in run:
        if isinstance(event.payload, Timing):
            told[event.payload.stage] += event.payload.seconds
    wall = summarise(run)["wall_seconds"]
    assert wall["motion"] == pytest.approx(motions)
    assert wall["skill"] == pytest.approx(max(0.0, told["skill"] - motions))
    for stage in ("observe", "estimate", "plan"):
        assert wall[stage] == pytest.approx(told[stage])


@given(st.lists(events, max_size=10))
def test_whatever_happens_it_can_be_summed_up(some: list[Event]) -> None:
    """Stages are never negative and, unless they claim more than there was, add up to the total."""
    wall = summarise([synthetic_events()[0], *some])["wall_seconds"]
    stages = [wall[stage] for stage in STAGES]
    assert min(stages) >= 0
    assert sum(stages) >= wall["total"] - 0.01


def test_a_run_without_an_end_has_crashed_and_its_counts_are_those_seen() -> None:
    whole = synthetic_events()
    assert isinstance(whole[-1].payload, Ended)
    cut = summarise(whole[:-1])
    assert (cut["outcome"], cut["goal_seen"], cut["goal_true"]) == ("crashed", False, None)
    told = summarise(whole)
    for key in ("cycles", "actions", "replans", "looks", "unreached"):
        assert cut[key] == told[key], key


def test_what_was_not_seen_to_hold_is_unreached() -> None:
    run = synthetic_events()
    half = next(i for i, event in enumerate(run) if event.cycle == 6)
    assert summarise(run[:half])["unreached"] == ["on-table(milk-carton,white-table)"]


def test_events_that_are_no_run() -> None:
    with pytest.raises(ValueError, match="none of them starts it"):
        Collector().summary()


def test_the_file_is_whole_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = summarise(synthetic_events("first")), summarise(synthetic_events("second"))
    write_summary(tmp_path, first)

    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write_summary(tmp_path, second)
    assert json.loads((tmp_path / SUMMARY_FILE).read_text())["run"] == "first"
    assert [path.name for path in tmp_path.iterdir()] == [SUMMARY_FILE]


def test_people_get_the_outcome_and_the_command_that_inspects_it() -> None:
    stream = io.StringIO()
    print_summary(summarise(synthetic_events(), goal_true=False), "runs/" + "long-name" * 20, stream)
    lines = stream.getvalue().splitlines()
    assert lines[0].startswith("outcome   goal-reached; goal seen: yes, goal true: no - the robot is mistaken")
    assert lines[-1] == f"inspect   executive inspect runs/{'long-name' * 20}"
    assert "drop@2 in action 2 at 4.5 s" in stream.getvalue()


def test_who_did_not_look_is_not_said_to_have_reached_anything() -> None:
    stream, told = io.StringIO(), summarise(synthetic_events(), goal_true=False)
    print_summary({**told, "outcome": "plan-completed", "goal_seen": False}, "run", stream)
    assert "goal-reached" not in stream.getvalue()
    assert "goal seen: no, goal true: no - the robot is mistaken" in stream.getvalue()


def test_a_path_that_the_shell_would_split_is_quoted() -> None:
    stream = io.StringIO()
    print_summary(summarise(synthetic_events()), "my runs/a", stream)
    assert stream.getvalue().splitlines()[-1].endswith("executive inspect 'my runs/a'")
