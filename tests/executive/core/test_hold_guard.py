"""What is carried is watched: a drop that is seen ends the skill, and an eye that errs ends nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.core.hold_guard import HoldGuard
from executive.core.settings import Settings
from executive.errors import MissingError
from executive.faults import FaultInjector, parse_fault
from executive.types import (
    Atom,
    Belief,
    Decision,
    Event,
    Facts,
    FaultInjected,
    Guarded,
    Looked,
    LookKind,
    Observation,
    OutcomeKind,
    Payload,
    Phase,
    Sense,
    SkillResult,
    SkillStatus,
    Timing,
)
from tests.fakes import WATCHED, FakeWorld, ScriptedEstimator, Stage, at, held

GOAL = Facts({at("a", "q"): True})


def carrying(numb: bool = True, **changes: object) -> Stage:
    """A thing to carry from p to q, with a hand that feels nothing, and somebody who looks on."""
    stage = Stage(GOAL, {"a": "p"}, attention=WATCHED, **changes)  # type: ignore[arg-type]
    stage.skill.numb = numb
    return stage


def dropped(stage: Stage, action: int = 2) -> Stage:
    stage.faults = FaultInjector([parse_fault(f"drop@{action}")], stage.world, seed=4)
    return stage


def ends(stage: Stage) -> list[tuple[SkillStatus, Sense | None]]:
    return [(result.status, result.sense) for result in stage.recorder.of(SkillResult)]


def when(stage: Stage, kind: type[Payload]) -> list[Event]:
    return [event for event in stage.recorder.events if isinstance(event.payload, kind)]


@pytest.mark.parametrize("action", [1, 2])
def test_a_drop_that_is_seen_ends_the_skill_early_and_says_so(action: int) -> None:
    stage = dropped(carrying(), action)
    ended = stage.play()
    assert (ended.outcome, stage.goal_true) == (OutcomeKind.GOAL_REACHED, True)
    assert ends(stage)[action - 1] == (SkillStatus.DROPPED, Sense.SEEN)
    (drop,) = when(stage, FaultInjected)
    noticed = next(event for event in when(stage, Guarded) if isinstance(event.payload, Guarded) and event.payload.lost)
    assert drop.time < noticed.time < drop.time + 3.0
    result = stage.recorder.of(SkillResult)[action - 1]
    assert result.reason == "held(a) is seen no longer"
    assert result.planned_seconds > result.seconds


def test_a_drop_that_is_felt_needs_no_eye() -> None:
    stage = dropped(carrying(numb=False))
    stage.play()
    assert ends(stage)[1] == (SkillStatus.DROPPED, Sense.FELT)


def test_without_a_guard_a_numb_hand_carries_on_empty() -> None:
    stage = dropped(carrying(settings=Settings(guard_looks=0)))
    assert stage.play().outcome is OutcomeKind.GOAL_REACHED
    assert ends(stage)[1] == (SkillStatus.DONE, None)
    assert stage.recorder.of(Guarded) == []


def test_it_asks_one_question_a_few_times_a_transfer_and_that_is_no_look_of_the_loop() -> None:
    stage = carrying(settings=Settings(guard_looks=3))
    ended = stage.play()
    glances = [look for look in stage.recorder.of(Looked) if look.kind is LookKind.GUARD]
    transfers = sum(phase.name == "transfer" for phase in stage.recorder.of(Phase))
    assert (len(glances), transfers) == (6, 2)
    assert {look.questions for look in glances} == {1}
    assert ended.looks == 3 == len(stage.recorder.of(Looked)) - len(glances)
    assert len(stage.recorder.of(Observation)) == 9
    assert sum(timing.stage == "guard" for timing in stage.recorder.of(Timing)) == 6
    assert [told.held for told in stage.recorder.of(Guarded)] == [True] * 6


def test_one_glance_that_errs_ends_nothing() -> None:
    glances = iter([False, True, True, False, True, True])
    stage = carrying(settings=Settings(guard_looks=2))
    stage.estimator = Glancing(stage.world, glances)
    ended = stage.play()
    assert (ended.outcome, ended.actions, ended.replans) == (OutcomeKind.GOAL_REACHED, 2, 0)
    assert [told.held for told in stage.recorder.of(Guarded)] == [False, True, True, False, True, True]
    assert not any(told.lost for told in stage.recorder.of(Guarded))


class Glancing(ScriptedEstimator):
    """An eye that looks on as it is told, and looks well."""

    def __init__(self, world: FakeWorld, glances: object) -> None:
        super().__init__(world)
        self._glances = glances

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        belief = super().estimate(observation, atoms)
        if len(atoms) > 1:
            return belief
        said = next(self._glances, True)  # type: ignore[call-overload]
        if isinstance(said, Exception):
            raise said
        known = {} if said is None else {atoms[0]: float(said)}
        return replace(belief, probability=known, unanswered=frozenset(atoms) - known.keys())


def test_those_who_look_on_and_err_twice_cost_time_and_drop_nothing() -> None:
    stage = carrying(numb=False)
    stage.estimator = Glancing(stage.world, iter([False, False]))
    ended = stage.play()
    assert (ended.outcome, stage.goal_true, ended.replans) == (OutcomeKind.GOAL_REACHED, True, 0)
    assert ends(stage)[0] == (SkillStatus.DROPPED, Sense.SEEN)
    cause = stage.recorder.of(Decision)[1].causes[0]
    assert (cause.status, cause.detail) == (SkillStatus.DROPPED, "held(a) is seen no longer")


@pytest.mark.parametrize("glance", [None, ValueError("the cable came off")])
def test_an_eye_that_cannot_tell_meanwhile_ends_nothing(glance: object, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("CRITICAL")
    stage = carrying()
    stage.estimator = Glancing(stage.world, iter([glance] * 9))
    assert stage.play().outcome is OutcomeKind.GOAL_REACHED
    assert {status for status, _ in ends(stage)} == {SkillStatus.DONE}


def test_what_is_missing_on_the_machine_is_no_matter_of_the_skill() -> None:
    stage = carrying()
    stage.estimator = Glancing(stage.world, iter([MissingError("no GL", command="apt-get install gl")]))
    with pytest.raises(MissingError):
        stage.play()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([True, False, None]), max_size=12), st.integers(0, 4))
def test_a_skill_is_told_after_two_glances_in_a_row_that_see_nothing_and_not_before(
    said: list[bool | None], looks: int
) -> None:
    world, told, answers = FakeWorld({"a": "hand"}, "pq"), list[Guarded](), iter(said)
    number = iter(range(99))

    def glance(atom: Atom) -> Belief:
        answer = next(answers, True)
        return Belief(next(number), {} if answer is None else {atom: float(answer)})

    def hear(payload: Payload) -> None:
        assert isinstance(payload, Guarded)
        told.append(payload)

    guard = HoldGuard(held("a"), looks, world, glance, hear)
    for name in ("approach", "transfer", "lower"):
        guard.on_phase(Phase(name, seconds=3.0))
        world.advance(3.0)
    held_ = [each.held for each in told]
    pairs = [index for index in range(1, len(held_)) if held_[index - 1] is held_[index] is False]
    assert [index for index, each in enumerate(told) if each.lost] == pairs[:1]
    assert bool(guard.lost()) is bool(pairs)
    assert not pairs or pairs[0] == len(told) - 1, "nobody asks once it is lost"
    doubts = sum(answer is False for answer in held_)
    assert len(told) <= looks + doubts


def test_a_skill_that_is_over_is_not_watched_any_more() -> None:
    world, told = FakeWorld({"a": "hand"}, "pq"), list[Payload]()
    guard = HoldGuard(held("a"), 3, world, lambda atom: Belief(0, {atom: 1.0}), told.append)
    guard.on_phase(Phase("transfer", seconds=3.0))
    world.advance(1.0)
    guard.close()
    world.advance(9.0)
    assert len(told) == 1
