"""A run told in sentences: all of it that matters, and nothing that is not in its events."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.faults import FaultInjector, parse_fault
from executive.trace import phrases
from executive.trace.phrases import sentence
from executive.trace.record.log import EventLog, read_events
from executive.trace.report.explain import explain, print_lines
from executive.types import Decision, DecisionKind, Event, Facts, FaultInjected, SkillResult
from tests.executive.trace.strategies import events
from tests.executive.trace.synthetic import synthetic_events
from tests.fakes import Stage, at

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})


def played(**changes: object) -> Stage:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, **changes)  # type: ignore[arg-type]
    stage.faults = FaultInjector([parse_fault("drop@2")], stage.world, seed=4)
    stage.play()
    return stage


def test_each_cycle_is_told_once_and_in_order() -> None:
    run = played().recorder.events
    heads = [line.partition(",")[0] for line in explain(run) if line.startswith("Cycle ")]
    assert heads == [f"Cycle {number}" for number in range(run[-1].cycle + 1)]


def test_a_cycle_in_which_all_went_as_expected_is_one_line() -> None:
    lines = explain(played().recorder.events)
    (first,) = (index for index, line in enumerate(lines) if line.startswith("Cycle 1,"))
    assert lines[first] == "Cycle 1, 0.0 s to 5.5 s: pick a p was done, and seen as expected (look 1)."
    assert lines[first + 1].startswith("Cycle 2,")


def test_what_went_wrong_is_told_with_what_it_was_decided_on() -> None:
    stage = played()
    lines = explain(stage.recorder.events, cycle=2)
    text = "\n".join(lines)
    (fault,) = stage.recorder.of(FaultInjected)
    assert fault.detail in text
    failed = next(result for result in stage.recorder.of(SkillResult) if not result.done)
    assert sentence(phrases.event(failed)) in text
    assert "at(a,q) should be true and is false (P 0.00)" in text
    assert "at(a,q) is false (expected true), P 0.00, by look 2" in text


def test_what_nobody_looked_at_is_told_as_assumed() -> None:
    text = "\n".join(explain(played(blind=True).recorder.events))
    assert "plan-completed" in text
    assert "at(b,r) is assumed to be true (expected true)" in text
    assert "is true" not in text


@pytest.mark.parametrize("looks", [{}, {3: {at("b", "r"): None}}, {5: {at("a", "q"): 0.0}}])
def test_every_decision_that_is_no_routine_is_told_with_its_reason(looks: dict[int, object]) -> None:
    stage = played(looks=looks)
    text = "\n".join(explain(stage.recorder.events))
    decisions = [d for d in stage.recorder.of(Decision) if d.kind is not DecisionKind.CONTINUE]
    assert decisions
    for decision in decisions:
        assert sentence(phrases.event(decision)) in text


def test_the_record_alone_tells_the_same(tmp_path: Path) -> None:
    run = synthetic_events()
    log = EventLog(tmp_path)
    for event in run:
        log.write(event)
    log.close()
    for cycle in (None, 2):
        assert explain(read_events(tmp_path, images=False), cycle) == explain(run, cycle)


def test_a_cycle_that_is_not_there_is_bad_input() -> None:
    with pytest.raises(InputError, match=r"^cycle: there is no cycle 99; the run has cycles 0 to 8"):
        explain(synthetic_events(), 99)
    with pytest.raises(InputError, match="none of them starts it"):
        explain(synthetic_events()[1:])


@given(st.lists(events, max_size=12), st.booleans())
def test_any_order_of_events_is_told_in_printable_lines(some: list[Event], whole: bool) -> None:
    start, stream = synthetic_events()[0], io.StringIO()
    lines = explain([start, *some], start.cycle if whole else None)
    print_lines(lines, stream)
    printed = stream.getvalue().splitlines()
    assert len(printed) == len(lines)
    assert all(line.isprintable() for line in printed)
