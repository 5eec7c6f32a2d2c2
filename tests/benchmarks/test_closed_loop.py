"""What the benchmark of the closed loop counts is what it says."""

from __future__ import annotations

import pytest

from benchmarks import closed_loop
from benchmarks.closed_loop import FAULTS, GOAL, PLACES, SETTINGS, THINGS, Courier, Scorer, figures, symbolic
from executive.types import (
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Event,
    Facts,
    FaultInjected,
    NoPlan,
    Observation,
    Payload,
    Plan,
    SkillResult,
    SkillStatus,
    Verdict,
)
from tests.fakes import FREE, FakeWorld, at, held, pick, put, task

THREE = task(["a", "b"], ["p", "q"], Facts({at("a", "q"): True}))


@pytest.mark.parametrize("setting", SETTINGS)
def test_an_honest_eye_misses_nothing_and_is_alarmed_by_nothing(setting: str) -> None:
    scores = [symbolic(setting, 0.0, seed, FAULTS) for seed in range(4)]
    assert all(score.success and not score.false_success for score in scores)
    assert sum(score.failed for score in scores) > 0
    assert sum(score.missed + score.alarms + score.needless for score in scores) == 0
    assert all(0.0 <= delay < 1.0 for score in scores for delay in score.delays)


def test_the_same_seed_counts_the_same() -> None:
    assert symbolic(SETTINGS[3], 0.05, 3, FAULTS) == symbolic(SETTINGS[3], 0.05, 3, FAULTS)


def test_figures_are_shares_and_means() -> None:
    told = figures([symbolic(SETTINGS[0], 0.1, seed, FAULTS) for seed in range(4)])
    assert len(told) == len(closed_loop.HEAD)
    assert float(told[3].rstrip("%")) > 20.0, "at 10 % of flipped answers the plain threshold is alarmed all the time"


class Told:
    """A scorer that is told events by hand."""

    def __init__(self, where: dict[str, str]) -> None:
        self.world = FakeWorld(where, ["p", "q"])
        self.scorer = Scorer(lambda: self.world.truth(THREE.atoms), THREE.goal)
        self.time = 0.0

    def tell(self, *payloads: Payload) -> None:
        for payload in payloads:
            self.scorer.write(Event(0, self.time, 0.0, payload))

    def look(self) -> Observation:
        return self.world.observe()


def seen(verdict: Verdict) -> Compared:
    return Compared("effects", Facts(), verdict, 0)


GONE_ON, REPLAN = Decision(DecisionKind.CONTINUE, ""), Decision(DecisionKind.REPLAN, "")


def after_pick(where: str, verdict: Verdict, decision: Decision) -> Told:
    told = Told({"a": "p", "b": "p"})
    told.tell(told.look(), Plan((pick("a", "p"), put("a", "q")), 2.0, "", 0.0), Dispatched(pick("a", "p"), 1, 1, 0))
    told.world.where["a"] = where
    told.tell(SkillResult(pick("a", "p"), SkillStatus.DONE), told.look(), seen(verdict), decision)
    return told


FINE, WRONG = Verdict(), Verdict(violated=frozenset({held("a")}))


def test_a_failure_counts_as_missed_when_nothing_of_it_is_noticed() -> None:
    missed = after_pick("p", FINE, GONE_ON).scorer.score
    assert (missed.failed, missed.missed, missed.calm, missed.alarms) == (1, 1, 0, 0)
    noticed = after_pick("p", WRONG, REPLAN).scorer.score
    assert (noticed.failed, noticed.missed, noticed.needless) == (1, 0, 0)


def test_a_surprise_where_all_is_well_is_an_alarm_and_the_plan_it_costs_is_needless() -> None:
    calm = after_pick("hand", FINE, GONE_ON).scorer.score
    assert (calm.failed, calm.calm, calm.alarms, calm.needless) == (0, 1, 0, 0)
    alarmed = after_pick("hand", WRONG, REPLAN).scorer.score
    assert (alarmed.calm, alarmed.alarms, alarmed.needless) == (1, 1, 1)


def test_the_delay_is_from_the_drop_to_what_tells_of_it() -> None:
    told = Told({"a": "hand", "b": "p"})
    told.time = 2.0
    told.tell(FaultInjected("drop", "drop@1", 1))
    told.time = 2.5
    told.tell(SkillResult(put("a", "q"), SkillStatus.DROPPED))
    told.tell(seen(WRONG))
    assert told.scorer.score.delays == [0.5]


def test_the_courier_plans_what_can_be_carried_out() -> None:
    some, courier = task(THINGS, PLACES, GOAL), Courier(task(THINGS, PLACES, GOAL))
    everywhere = {at(thing, PLACES[(number + 1) % 3]) for number, thing in enumerate(THINGS)}
    full = {atom for atom in everywhere if atom.args[0] != "c"} | {held("c")}
    for true in (everywhere | {FREE}, full):
        plan = courier.plan(Facts.closed(true, some.atoms), GOAL)
        assert isinstance(plan, Plan)
        state = set(true)
        for step in plan.steps:
            assert all((atom in state) is value for atom, value in step.preconditions.items())
            state = (state - step.effects.false) | step.effects.true
        assert state >= GOAL.true
    assert isinstance(courier.plan(Facts.closed({FREE}, some.atoms), GOAL), NoPlan)
