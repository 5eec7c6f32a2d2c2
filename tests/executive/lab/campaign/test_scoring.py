"""What is counted of a run, held against the symbolic world's truth."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.core.settings import Settings
from executive.faults import FaultInjector, parse_fault
from executive.lab.campaign.scoring import Scorer, Strike, Tally
from executive.types import (
    Atom,
    Cause,
    Compared,
    Decision,
    DecisionKind,
    Event,
    Facts,
    FaultInjected,
    Reason,
    SkillResult,
    SkillStatus,
)
from tests.executive.lab.campaign.players import GOAL, scored
from tests.fakes import FLOOR, ScriptedEstimator, Stage, at, pick

STEP = pick("a", "p")

SPECS = ["drop:p=0.3", "miss:p=0.3", "shove:p=0.2", "drop@2", "shove@1:item=a"]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.sampled_from(SPECS), max_size=3))
def test_an_eye_that_is_always_right_raises_no_false_alarm_and_misses_nothing(seed: int, specs: list[str]) -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, settings=Settings(seed))
    stage.faults = FaultInjector([parse_fault(spec) for spec in specs], stage.world, seed)
    _, tally = scored(stage)
    assert (tally.alarms, tally.missed) == (0, 0)
    recorder = stage.recorder
    assert len(tally.strikes) == len(recorder.of(FaultInjected))
    looked_at = {e.cycle for e in recorder.events if isinstance(e.payload, Compared) and e.payload.what == "effects"}
    assert tally.quiet + tally.failed == len(looked_at)
    for strike in tally.strikes:
        assert strike.noticed is None or strike.noticed >= 0.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.02, 0.2]))
def test_every_action_is_quiet_or_failed_whatever_the_eye_says(seed: int, flips: float) -> None:

    dice = random.Random(seed)
    stage = Stage(GOAL, {"a": "p", "b": "p"}, settings=Settings(seed, max_replans=6))
    stage.estimator = ScriptedEstimator(
        stage.world, scripted=lambda look, atom, truth: float(truth is not (dice.random() < flips))
    )
    _, tally = scored(stage)
    assert 0 <= tally.alarms <= tally.quiet
    assert 0 <= tally.missed <= tally.failed
    assert tally.quiet + tally.failed <= len(stage.recorder.of(SkillResult))


def test_one_that_does_not_look_notices_nothing() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, blind=True)
    stage.faults = FaultInjector([parse_fault("drop@2")], stage.world, 1)
    _, tally = scored(stage)
    assert [(strike.kind, strike.action, strike.noticed) for strike in tally.strikes] == [("drop", 2, None)]
    assert (tally.quiet, tally.failed) == (0, 0)


def test_a_drop_is_noticed_when_the_hand_feels_it() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    stage.faults = FaultInjector([parse_fault("drop@2")], stage.world, 4)
    _, tally = scored(stage)
    (strike,) = tally.strikes
    (end,) = [e for e in stage.recorder.events if isinstance(e.payload, SkillResult) and not e.payload.done]
    assert strike.noticed == pytest.approx(end.time - strike.time, abs=1e-6)
    assert strike.noticed is not None
    assert 0.0 < strike.noticed < 1.0


def test_a_surprise_that_is_none_is_a_false_alarm_and_one_that_looking_again_takes_back_is_not() -> None:
    wrong: dict[Atom, float | None] = {at("b", "r"): 1.0, at("b", "p"): 0.0}
    for looks, alarms in (({2: wrong}, 0), ({2: wrong, 3: wrong}, 1)):
        stage = Stage(GOAL, {"a": "p", "b": "p"}, looks=looks)
        _, tally = scored(stage)
        assert (tally.alarms, tally.missed) == (alarms, 0)


def test_a_failure_that_the_eye_does_not_see_is_missed_as_long_as_it_does_not() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, script={2: f"land quietly {FLOOR}"})
    stage.estimator = ScriptedEstimator(
        stage.world, scripted=lambda look, atom, truth: 1.0 if look > 2 and atom == at("a", "q") else float(truth)
    )
    _, tally = scored(stage)
    assert (tally.quiet, tally.alarms, tally.failed, tally.missed) == (1, 0, 3, 3)


def test_an_eye_that_was_made_to_err_is_nothing_to_be_noticed() -> None:
    scorer = Scorer(Facts, looks=True)
    for payload in (
        FaultInjected("estimator", "estimator:wrong@2", 2),
        FaultInjected("drop", "drop@2", 2),
        SkillResult(STEP, SkillStatus.DROPPED),
        Decision(DecisionKind.CONTINUE, (Cause(Reason.AS_EXPECTED),)),
    ):
        scorer.write(Event(2, 3.0, 0.0, payload))
    assert [strike.noticed for strike in scorer.tally.strikes] == [None, 0.0]
    assert scorer.tally == Tally(
        [Strike("estimator", "estimator:wrong@2", 2, 3.0), Strike("drop", "drop@2", 2, 3.0, 0.0)]
    )


def test_a_plan_that_is_made_while_the_old_one_leads_to_the_goal_is_needless() -> None:
    wrong: dict[Atom, float | None] = {at("b", "q"): 0.8, at("b", "p"): 0.2}
    for looks, script, needless in (
        ({2: wrong, 3: wrong}, {}, True),
        ({}, {2: "land quietly r"}, False),
        ({2: wrong}, {}, False),
    ):
        stage = Stage(GOAL, {"a": "p", "b": "p"}, looks=looks, script=script)
        _, tally = scored(stage)
        assert (tally.needless > 0) is needless


def test_what_is_broken_of_the_one_who_is_scored_is_no_strike() -> None:
    scorer = Scorer(Facts, looks=True, own=["camera:dark@0-"])
    for spec in ("camera:dark@0-", "camera:dark@2"):
        scorer.write(Event(2, 3.0, 0.0, FaultInjected("camera", spec, 2)))
    assert [strike.spec for strike in scorer.tally.strikes] == ["camera:dark@2"]
