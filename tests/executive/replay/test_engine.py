"""A record decides as its run did; with other settings, it says where the two part and claims nothing beyond."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.belief import (
    EXACT,
    ActionModel,
    BayesMonitor,
    Group,
    Monitor,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
)
from executive.belief.sensor_model import ErrorModel
from executive.core.settings import Settings
from executive.errors import InputError
from executive.faults import FaultInjector, parse_fault
from executive.replay import Decided, Record, Replay, replay, side_by_side
from executive.types import Decision, DecisionKind, Event, Facts, OutcomeKind, Plan, Probed, SkillStatus, Started
from tests.executive.core.test_loop import Chaos
from tests.fakes import (
    FLOOR,
    FREE,
    FakePlanner,
    ScriptedEstimator,
    Stage,
    StubbornSkill,
    Ticking,
    at,
    budget,
    held,
    put,
    steps_of,
)

BOTH = Facts({at("a", "q"): True, at("b", "r"): True})


def two(**changes: object) -> Stage:
    """Two things, to be carried to q and to r."""
    return Stage(BOTH, {"a": "p", "b": "p"}, **changes)  # type: ignore[arg-type]


def record_of(events: Sequence[Event]) -> Record:
    (record,) = Record.all(events)
    return record


def decided(events: Sequence[Event]) -> list[Decided]:
    return [Decided(event.cycle, event.payload) for event in events if isinstance(event.payload, Decision)]


def fused(stage: Stage, eye: SensorModel = EXACT, memory: bool = True) -> BayesMonitor:
    """Each thing in one place, the hand holding one thing or none."""
    things = sorted(stage.world.where)
    groups = [Group(tuple(atom for atom in stage.task.atoms if thing in atom.args)) for thing in things]
    groups.append(Group((FREE, *map(held, things)), exact=True))
    return BayesMonitor(MutexNetwork(stage.task.atoms, tuple(groups)), eye, ActionModel() if memory else None)


def repeats(events: Sequence[Event], monitor: Monitor) -> Record:
    """The law: with the monitor of then, the same decisions, to the last digit of what they rest on."""
    record = record_of(events)
    again, told = replay(record, monitor), decided(events)
    assert list(record.decisions) == told
    assert not again.parted, again.end
    if record.cut:  # what the run did not come to any more may be decided beyond
        assert list(again.decisions[: len(told)]) == told
    else:
        assert (list(again.decisions), again.end) == (told, "")
    assert all(row.same for row in side_by_side(record, again))
    return record


@pytest.mark.parametrize("part", range(4))
def test_whatever_happened_in_a_run_its_record_decides_the_same(part: int, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("CRITICAL")
    outcomes: Counter[str] = Counter()
    for seed in range(part * 60, (part + 1) * 60):
        chaos = Chaos(seed)
        outcomes[chaos.executive.run().outcome] += 1
        repeats(chaos.stage.recorder.events, chaos.stage.monitor)
    assert len(outcomes) >= 4, outcomes


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    flips=st.sampled_from([0.0, 0.03, 0.2]),
    memory=st.booleans(),
    specs=st.lists(st.sampled_from(["drop:p=0.3", "miss:p=0.3", "shove:p=0.2"]), max_size=3),
)
def test_so_does_one_whose_looks_were_weighed_together(seed: int, flips: float, memory: bool, specs: list[str]) -> None:
    stage, dice = two(settings=Settings(seed, max_replans=8, max_actions=30)), random.Random(seed)
    stage.faults = FaultInjector([parse_fault(spec) for spec in specs], stage.world, seed)
    stage.estimator = ScriptedEstimator(
        stage.world, scripted=lambda look, atom, truth: float(truth is not (dice.random() < flips))
    )
    stage.monitor = fused(stage, SensorModel(other=ErrorModel(0.05, 0.05)) if flips else EXACT, memory)
    stage.play()
    repeats(stage.recorder.events, stage.monitor)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), part=st.floats(0, 1))
def test_a_record_that_breaks_off_decides_the_same_as_far_as_it_goes(seed: int, part: float) -> None:
    stage = two(settings=Settings(seed, max_replans=8))
    stage.faults = FaultInjector([parse_fault("drop:p=0.3"), parse_fault("shove:p=0.2")], stage.world, seed)
    stage.play()
    kept = stage.recorder.events[: 1 + round(part * (len(stage.recorder.events) - 1))]
    record = repeats(kept, stage.monitor)
    stopped = any(isinstance(e.payload, Decision) and e.payload.kind is DecisionKind.STOP for e in kept)
    assert record.cut == ("" if stopped else "the run was killed here, or is still going on")


def test_goals_that_were_given_up_are_given_up_again_without_a_planner() -> None:
    stage = two(script={2: f"land {FLOOR}"})
    assert stage.play().outcome is OutcomeKind.PARTIAL
    assert len(stage.recorder.of(Probed)) >= 2
    repeats(stage.recorder.events, stage.monitor)


def test_a_plan_that_the_budget_did_not_allow_is_not_taken_up_again() -> None:
    stage = two(script={2: "land r"}, settings=Settings(max_replans=0))
    ended = stage.play()
    assert (ended.outcome, ended.causes) == (OutcomeKind.GAVE_UP, (budget("replans", 0),))
    repeats(stage.recorder.events, stage.monitor)


@pytest.mark.parametrize("status", [SkillStatus.NO_PATH, SkillStatus.GRASP_MISSED])
def test_plans_that_were_to_do_without_a_step_are_told_once_more(status: SkillStatus) -> None:
    stage, stuck = two(), put("a", "q")
    stage.planner = FakePlanner([stuck, *(step for step in steps_of(stage.task) if step != stuck)])
    stage.skill = StubbornSkill([stuck], status)
    assert stage.play().outcome is OutcomeKind.PARTIAL
    assert "place(a,q)" in {step for plan in stage.recorder.of(Plan) for step in plan.without}
    repeats(stage.recorder.events, stage.monitor)


@pytest.mark.parametrize("limit", range(1, 30, 2))
def test_a_run_whose_time_was_up_ends_there_again(limit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look, each question to the planner and each action takes a second, and something never works."""
    clock, stage = Ticking(), two(settings=Settings(max_seconds=float(limit)))
    stage.skill = StubbornSkill([put("a", "q")])
    for part, name in ((stage.skill, "_end"), (stage.planner, "plan"), (stage.estimator, "estimate")):
        monkeypatch.setattr(part, name, clock.second(getattr(part, name)))
    monkeypatch.setattr("executive.core.session.time.monotonic", clock)
    ended = stage.play()
    assert clock.now <= limit + 1
    if ended.outcome is not OutcomeKind.PARTIAL:
        assert ended.causes == (budget("seconds", limit),)
    repeats(stage.recorder.events, stage.monitor)


def test_a_blind_run_has_no_looks_to_part_over() -> None:
    stage = two(blind=True, script={1: "lie"})
    stage.play()
    record = repeats(stage.recorder.events, stage.monitor)
    other = replay(record, ThresholdMonitor(stage.task.atoms, Thresholds(0.9, 0.9)))
    assert all(row.same for row in side_by_side(record, other))


def at_thresholds(stage: Stage, threshold: float) -> tuple[Record, Replay]:
    """The record of a played stage, and its replay at another threshold."""
    record = record_of(stage.recorder.events)
    before = replay(record, stage.monitor)
    return record, replay(record, ThresholdMonitor(stage.task.atoms, Thresholds(threshold, threshold)), before)


def differences(record: Record, other: Replay) -> list[tuple[int, DecisionKind | None, DecisionKind | None]]:
    def kind(side: Decision | None) -> DecisionKind | None:
        return side.kind if side else None

    rows = side_by_side(record, other)
    return [(row.cycle, kind(row.recorded), kind(row.replayed)) for row in rows if not row.agree]


def test_24_another_threshold_decides_otherwise_and_says_where_the_record_ends_for_it() -> None:
    stage = two(looks={3: {at("a", "q"): 0.6}})
    assert stage.play().actions == 4
    record, other = at_thresholds(stage, 0.7)
    assert differences(record, other) == [(2, DecisionKind.CONTINUE, DecisionKind.LOOK_AGAIN)]
    assert other.parted
    assert other.end == "it looks again (after place(a,q)), where action 3 of the run was pick(b,p)"
    assert sum(row.same for row in side_by_side(record, other)) == 2


def test_looks_that_another_threshold_does_without_are_passed_over() -> None:
    stage = two(looks={3: {at("a", "q"): 0.4}})
    assert stage.play().looks == 6, "one of them again"
    record, other = at_thresholds(stage, 0.3)
    assert (other.parted, other.end) == (False, "")
    assert differences(record, other) == [
        (2, DecisionKind.LOOK_AGAIN, DecisionKind.CONTINUE),
        (2, DecisionKind.CONTINUE, None),
    ]


def test_a_plan_is_taken_from_another_state_only_if_it_works_from_there() -> None:
    stage = two(looks={1: {at("a", "r"): 0.4}})
    stage.play()
    record, other = at_thresholds(stage, 0.3)  # takes a to be in two places, which takes nothing from the plan
    assert other.asked[1][0] != replay(record, stage.monitor).asked[1][0]
    assert len(other.decisions) > 1

    stage = two(looks={1: {at("b", "r"): 0.6, at("b", "p"): 0.45}})
    stage.play()
    _, other = at_thresholds(stage, 0.7)
    assert other.parted
    assert other.end.startswith("it plans from another state (not at(b,r))")


def test_settings_of_another_release_are_passed_over_and_nonsense_is_named() -> None:
    stage = two()
    stage.play()
    events = list(stage.recorder.events)
    started = events[0].payload
    assert isinstance(started, Started)
    odd = replace(started, settings={**started.settings, "of-tomorrow": 3})
    assert record_of([replace(events[0], payload=odd), *events[1:]]).settings == stage.settings
    for name, value, told in (
        ("max_retries", -1, "max_retries must be at least 0, got -1"),
        ("seed", 0.1, "seed: should be a valid integer, got 0.1"),
        ("sure", "very", "sure: should be a valid number, got 'very'"),
        ("max_looks", 10**30, "max_looks: should be less than"),
    ):
        wrong = replace(started, settings={**started.settings, name: value})
        with pytest.raises(InputError, match=f"these are no settings of a run: {told}"):
            record_of([replace(events[0], payload=wrong)])
    with pytest.raises(InputError, match="these events are no run"):
        record_of(events[1:])
