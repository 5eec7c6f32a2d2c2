"""The fakes keep to the contracts that the real parts keep to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from executive.protocols import Estimator, Planner, Simulator, Sink, Skill, World
from executive.types import Atom, Condition, Facts, Observation, Payload, Step
from tests.contracts import (
    EVERY_PAYLOAD,
    EstimatorContract,
    PlannerContract,
    SimulatorContract,
    SinkContract,
    SkillContract,
)
from tests.fakes import (
    FLOOR,
    FREE,
    FakePlanner,
    FakeSkill,
    FakeWorld,
    Recorder,
    ScriptedEstimator,
    at,
    pick,
    put,
    steps_of,
    task,
)

THINGS = task(["a", "b"], ["p", "q"], Facts({at("a", "q"): True}))


class TestFakePlanner(PlannerContract):
    def make(self) -> Planner:
        return FakePlanner(steps_of(THINGS))

    def solvable(self) -> tuple[Facts, Condition]:
        return Facts.closed({at("a", "p"), at("b", "q"), FREE}, THINGS.atoms), THINGS.goal

    def unsolvable(self) -> tuple[Facts, Condition]:
        return Facts.closed({at("b", "q"), FREE}, THINGS.atoms), THINGS.goal


class TestScriptedEstimator(EstimatorContract):
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        world = FakeWorld({"a": "p", "b": FLOOR}, ["p", "q"])
        return ScriptedEstimator(world, always={at("b", "q"): None, FREE: 0.25}), world.observe(), THINGS.atoms


class TestFakeWorld(SimulatorContract):
    def make(self) -> Simulator:
        return FakeWorld({"a": "p", "b": "hand"}, ["p", "q"])

    def pass_time(self, world: World, seconds: float) -> None:
        world.handle.advance(seconds)


class TestFakePick(SkillContract):
    def make(self) -> tuple[Skill, Simulator]:
        return FakeSkill(), FakeWorld({"a": "p", "b": "p"}, ["p", "q"])

    def possible(self) -> Step:
        return pick("a", "p")

    def misplaced(self) -> Step:
        return pick("b", "q")

    def holds(self, world: Simulator, facts: Facts) -> bool:
        truth: Facts = world.handle.truth(facts)
        return truth == facts


class TestFakePlace(TestFakePick):
    def make(self) -> tuple[Skill, Simulator]:
        return FakeSkill(), FakeWorld({"a": "hand", "b": "p"}, ["p", "q"])

    def possible(self) -> Step:
        return put("a", "q")

    def misplaced(self) -> Step:
        return put("b", "q")


class TestRecorder(SinkContract):
    def make(self) -> Sink:
        return Recorder()


def test_sinks_are_shown_every_kind_of_payload_there_is() -> None:
    assert {type(payload) for payload in EVERY_PAYLOAD} == set(get_args(Payload))
