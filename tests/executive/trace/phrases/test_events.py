"""A phrase for each thing that is told of a run, the same wherever it is told."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from hypothesis import given

from executive.trace import phrases
from executive.trace.report.explain import explain
from executive.trace.terminal.sink import TerminalSink
from executive.trace.viewer.log_panel import log_lines
from executive.types import (
    Blinded,
    Cause,
    Decision,
    DecisionKind,
    Ended,
    Event,
    FaultInjected,
    Ground,
    Guarded,
    LookCause,
    LookKind,
    NoPlan,
    NoPlanReason,
    OutcomeKind,
    Payload,
    PictureFault,
    Plan,
    Reason,
    SkillResult,
    SkillStatus,
    Started,
)
from tests.executive.trace.strategies import causes, payloads
from tests.executive.trace.synthetic import synthetic_events
from tests.executive.trace.viewer.test_text_panels import story_of
from tests.fakes import at, pick

STARTED = next(event.payload for event in synthetic_events() if isinstance(event.payload, Started))
SURPRISED = (Cause(Reason.EFFECT_MISSING, (at("a", "q"),)), Cause(Reason.SEEN_INSTEAD, (at("a", "r"),)))


@given(payloads)
def test_whatever_an_event_holds_its_phrase_is_a_text(payload: Payload) -> None:
    if type(payload) in phrases.EVENTS:
        assert phrases.sentence(phrases.event(payload)).endswith(".")


@given(causes)
def test_a_decision_and_the_end_say_what_and_why(some: tuple[Cause, ...]) -> None:
    for kind in DecisionKind:
        outcome = OutcomeKind.PARTIAL if kind is DecisionKind.STOP else None
        phrase = phrases.event(Decision(kind, some, outcome=outcome))
        assert phrase.startswith(kind)
        assert phrase.endswith(phrases.why(some))
        assert (str(OutcomeKind.PARTIAL) in phrase) or outcome is None
    assert phrases.event(Ended(OutcomeKind.NO_PLAN, some, False, (), 1, 1, 0, 1)).endswith(phrases.why(some))


@pytest.mark.parametrize(
    "payload",
    [
        Decision(DecisionKind.REPLAN, SURPRISED),
        FaultInjected("drop", "drop@2", 1, "the gripper opened"),
        NoPlan(NoPlanReason.TIMED_OUT, "after 30 s"),
        Blinded("hand", "its picture is all of one colour", 3),
        Guarded(at("a", "p"), False, True, 3),
        SkillResult(pick("a", "p"), SkillStatus.DROPPED, "it fell", 2.0, 5.0),
    ],
)
def test_terminal_viewer_and_report_say_the_same_in_the_same_words(payload: Payload) -> None:
    phrase, terminal = phrases.event(payload), io.StringIO()
    events = [Event(0, 0.0, 0.0, STARTED), Event(0, 1.0, 1.0, payload)]
    sink = TerminalSink(terminal)
    for event in events:
        sink.write(event)
    assert phrase in terminal.getvalue()
    assert [line.text for line in log_lines(payload, story_of(events))] == [phrase]
    assert any(phrase in line or phrases.sentence(phrase) in line for line in explain(events))


@pytest.mark.parametrize("fault", PictureFault)
def test_why_a_picture_tells_nothing_is_a_code_in_new_records_and_words_in_old_ones(fault: PictureFault) -> None:
    told = phrases.event(Blinded("hand", fault, 3))
    assert told.startswith("camera hand is left out: its picture")
    assert phrases.event(Blinded("hand", told.partition(": ")[2], 3)) == told


def test_a_run_is_named_with_who_looks() -> None:
    looking, blind = (phrases.event(replace(STARTED, estimator=name)) for name in ("oracle", "none"))
    assert "oracle" in looking
    assert blind.removesuffix("nobody looks") == looking.removesuffix("estimator oracle")


@pytest.mark.parametrize("kind", LookKind)
def test_a_look_says_what_it_asks_about_and_through_which_cameras(kind: LookKind) -> None:
    told = phrases.look(7, "after pick(a,p)", kind, 3, 9, ("front", "hand"))
    assert told.startswith("look 7 (after pick(a,p)): ")
    assert ("3 of 9" in told) == (kind not in (LookKind.FULL, LookKind.GUARD))
    assert told.endswith("through front, hand")
    assert phrases.look(7, "", kind, 3, 9).rstrip(",") == phrases.look(7, "", kind, 3, 9)


def test_every_cause_of_a_look_is_put_into_words_and_words_of_former_records_stay() -> None:
    told = {phrases.look_cause(cause.about("on(a,b)")) for cause in LookCause}
    assert len(told) == len(LookCause)
    assert not any("{" in text for text in told)
    assert phrases.look_cause(LookCause.GOAL) == "is the goal reached?"
    for former in ("is the goal reached?", "first look", "there is no plan", "is held(a) so?", ""):
        assert phrases.look_cause(former) == former


def test_counts_agree_with_their_nouns() -> None:
    assert phrases.counts(action=1, look=0, replan=2) == "1 action, 0 looks, 2 replans"
    assert phrases.plan(Plan((pick("a", "p"),), 1.0, "", 0.0), 2) == "plan 2, 1 step: pick a p"


@pytest.mark.parametrize(
    ("ground", "said"),
    [
        (Ground(at("a", "p"), True, False, 0.1, 3), "at(a,p) is false (expected true), P 0.10, by look 3"),
        (Ground(at("a", "p"), None, None, None, 3), "at(a,p) cannot be told, by look 3"),
        (Ground(at("a", "p"), None, True, None), "at(a,p) is assumed to be true"),
    ],
)
def test_what_a_decision_depended_on_is_told_with_what_was_known_of_it(ground: Ground, said: str) -> None:
    assert phrases.ground(ground) == said
