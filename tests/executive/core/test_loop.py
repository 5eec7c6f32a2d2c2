"""The loop as a whole: it always ends, in an order of events that can be relied upon, whatever its parts do."""

from __future__ import annotations

import math
import random
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.app.assembly import make_executive
from executive.belief import Thresholds
from executive.core.settings import Settings
from executive.errors import ExecutiveError, InputError, MissingError
from executive.faults import FaultInjector, parse_fault
from executive.protocols import Simulator, SkillContext, Tell, World
from executive.trace.report.summary import summarise
from executive.types import (
    Atom,
    Belief,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    FaultInjected,
    Frame,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Phase,
    Plan,
    Reason,
    Scenery,
    SkillResult,
    SkillStatus,
    Started,
    Step,
    Timing,
)
from tests.fakes import FLOOR, WATCHED, FakeWorld, Recorder, Stage, at, steps_of

GOAL = Facts({at("a", "q"): True, at("b", "r"): True, at("a", "p"): False})


def well_told(events: Sequence[Event], stage: Stage, ended: Ended) -> None:
    """What holds of the events of any run."""
    payloads = [event.payload for event in events]
    assert isinstance(payloads[0], Started)
    assert isinstance(payloads[1], Scenery)
    assert payloads[-1] is ended
    count = Counter(type(payload) for payload in payloads)
    assert count[Started] == count[Scenery] == count[Ended] == 1
    assert count[Dispatched] == count[SkillResult] == ended.actions
    assert count[Observation] >= ended.looks >= count[Observation] - 1, "the last look may have broken off"
    assert ended.replans == max(0, count[Plan] - 1)
    assert ended.cycles == max(event.cycle for event in events)
    for earlier, later in pairwise(events):
        assert earlier.cycle <= later.cycle
        assert earlier.time <= later.time
        assert earlier.wall <= later.wall
    within = stage.settings
    assert ended.actions <= within.max_actions
    assert ended.cycles <= within.max_cycles
    assert ended.replans <= within.max_replans
    orders = [payload for payload in payloads if isinstance(payload, Dispatched)]
    assert [order.action for order in orders] == list(range(1, ended.actions + 1))
    for order, result in zip(orders, (p for p in payloads if isinstance(p, SkillResult)), strict=True):
        assert order.step == result.step
    stops = [p for p in payloads if isinstance(p, Decision) and p.kind is DecisionKind.STOP]
    assert all((stop.outcome, stop.causes) == (ended.outcome, ended.causes) for stop in stops)
    assert ended.causes


def seen_honestly(events: Sequence[Event], stage: Stage, ended: Ended) -> None:
    """A goal that is claimed to be seen was seen: all of it, in the looks since the last action."""
    since: list[Belief] = []
    for event in events:
        if isinstance(event.payload, Dispatched):
            since = []
        elif isinstance(event.payload, Belief) and event.payload.source != "assumed":
            since.append(event.payload)
    told = {atom: value for belief in since for atom, value in belief.probability.items()}
    seen = bool(since) and all(stage.thresholds.truth(told[a]) is v for a, v in stage.goal.items() if a in told)
    seen = seen and all(atom in told for atom in stage.goal)
    if ended.goal_seen:
        assert seen
        assert ended.outcome is OutcomeKind.GOAL_REACHED
        assert ended.unreached == ()
    assert ended.goal_seen == (ended.outcome is OutcomeKind.GOAL_REACHED)
    assert stage.blind or ended.outcome is not OutcomeKind.PLAN_COMPLETED


class Chaos:
    """Parts that do whatever a seeded die says, within their contracts and outside of them."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        dice = self.dice
        low = dice.choice([0.5, 0.5, 0.3, 0.0])
        self.stage = Stage(
            dice.choice([GOAL, Facts({at("a", "q"): True}), Facts()]),
            {thing: dice.choice(["p", "q", "r", "hand", FLOOR]) if thing == "a" else "p" for thing in "ab"},
            settings=Settings(
                seed=seed,
                max_cycles=dice.choice([0, 3, 40, 40, 40]),
                max_actions=dice.choice([0, 2, 30, 30, 30]),
                max_replans=dice.choice([0, 1, 12, 12, 12]),
                max_retries=dice.choice([0, 1, 2]),
                max_failures=dice.choice([0, 2, 5]),
                max_looks_again=dice.choice([0, 1, 2]),
                precondition_wait=dice.choice([0, 1, 2]),
                max_goal_plans=dice.choice([0, 1, 10]),
            ),
            blind=dice.random() < 0.1,
            thresholds=Thresholds(low, max(low, dice.choice([0.5, 0.7, 1.0]))),
        )
        self.noise = dice.choice([0.0, 0.02, 0.2, 0.5])
        self.silence = dice.choice([0.0, 0.0, 0.1, 0.5, 1.0])
        self.mishap = dice.choice([0.0, 0.1, 0.5, 0.9])
        self.bug = dice.choice([0.0, 0.0, 0.0, 0.03])
        stage, world = self.stage, self.stage.world
        stage.estimator = type(stage.estimator)(world, scripted=self.answer)
        self.search = stage.planner.plan
        stage.planner.plan = self.plan  # type: ignore[method-assign]
        stage.skill.script = {}
        specs = ["drop:p=0.3", "miss:p=0.2", "shove:p=0.2", "drop@2", "shove@1:item=a"]
        chosen = [parse_fault(spec) for spec in dice.sample(specs, dice.randint(0, 3))]
        stage.faults = FaultInjector(chosen, world, seed)
        self.executive = make_executive(
            stage.task,
            stage.planner,
            world,
            {"pick": self.skill, "place": self.skill} if dice.random() < 0.95 else {},
            None if stage.blind else stage.estimator,
            [Flaky(dice, self.bug), stage.recorder, Flaky(dice, self.bug)],
            stage.settings,
            stage.faults,
            initial=world.truth(stage.task.atoms) if stage.blind else None,
            monitor=stage.monitor,
        )

    def maybe_break(self) -> None:
        if self.dice.random() < self.bug:
            raise self.dice.choice([ValueError, KeyboardInterrupt, OSError])("by chance")
        if self.dice.random() < self.bug / 4:
            self.executive.cancel()

    def answer(self, look: int, atom: Atom, truth: bool) -> float | None:
        self.maybe_break() if atom == self.stage.task.atoms[0] else None
        if self.dice.random() < self.silence:
            return None
        wrong = self.dice.random() < self.noise
        return self.dice.random() if wrong and self.dice.random() < 0.3 else float(truth is not wrong)

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        self.maybe_break()
        if self.dice.random() < self.mishap / 4:
            return NoPlan(self.dice.choice(list(NoPlanReason)), "by chance")
        if self.dice.random() < self.mishap / 4:
            steps = self.dice.choices(steps_of(self.stage.task), k=self.dice.randint(0, 4))
            return Plan(tuple(steps), 0.0, "by chance", 0.0)
        return self.search(state, goal, avoid)

    def skill(self, step: Step, context: SkillContext) -> SkillResult:
        self.maybe_break()
        world, skill = self.stage.world, self.stage.skill
        if self.dice.random() < self.mishap:
            status = self.dice.choice([status for status in SkillStatus if status is not SkillStatus.CRASHED])
            if self.dice.random() < 0.5:
                thing = self.dice.choice("ab")
                world.where[thing] = self.dice.choice(["p", "q", "r", FLOOR])
            context.announce(Phase("transfer", seconds=self.dice.random()))
            world.advance(self.dice.random())
            return SkillResult(step, status, "by chance", 1.0, self.dice.choice([1.0, 2.0]))
        return skill(step, context)


class Flaky:
    """A sink that breaks now and then."""

    def __init__(self, dice: random.Random, chance: float) -> None:
        self.dice, self.chance = dice, chance

    def write(self, event: Event) -> None:
        if self.dice.random() < self.chance / 5:
            raise self.dice.choice([OSError, KeyboardInterrupt])("the disk is full")

    def close(self) -> None:
        self.write(None)  # type: ignore[arg-type]


def chaotic(seed: int) -> tuple[Ended, list[Event]]:
    chaos = Chaos(seed)
    ended = chaos.executive.run()
    events = chaos.stage.recorder.events
    well_told(events, chaos.stage, ended)
    seen_honestly(events, chaos.stage, ended)
    assert chaos.stage.recorder.closed == 1
    return ended, events


@pytest.mark.parametrize("part", range(8))
def test_whatever_its_parts_do_the_loop_ends_with_a_name_and_claims_nothing_unseen(
    part: int, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("CRITICAL")
    outcomes = Counter(chaotic(seed)[0].outcome for seed in range(part * 250, (part + 1) * 250))
    assert len(outcomes) >= 5, outcomes


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32))
def test_and_so_it_does_for_any_seed(seed: int) -> None:
    chaotic(seed)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32))
def test_the_same_seed_tells_the_same_story(seed: int) -> None:
    def story() -> list[object]:
        kinds = Dispatched | SkillResult | Decision | Belief | Plan | NoPlan | FaultInjected | Ended
        return [(e.cycle, e.time, e.payload) for e in chaotic(seed)[1] if isinstance(e.payload, kinds)]

    assert story() == story()


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 10**6),
    st.lists(st.sampled_from(["drop:p=0.3", "miss:p=0.3", "shove:p=0.2", "drop@2", "miss@1"]), max_size=4),
    st.booleans(),
    st.booleans(),
)
def test_with_patience_and_an_eye_that_errs_in_nothing_every_fault_is_made_good(
    seed: int, specs: list[str], weighing: bool, numb: bool
) -> None:
    endless = 10**6
    patience = Settings(seed, max_cycles=endless, max_actions=endless, max_replans=endless, max_failures=endless)
    stage = Stage(GOAL, {"a": "p", "b": "p"}, settings=patience, attention=WATCHED)
    stage = stage.weighing() if weighing else stage
    stage.skill.numb = numb
    stage.faults = FaultInjector([parse_fault(spec) for spec in specs], stage.world, seed)
    ended = stage.play()
    assert (ended.outcome, ended.goal_seen, stage.goal_true) == (OutcomeKind.GOAL_REACHED, True, True)


def test_a_blind_run_carries_its_plan_out_and_claims_what_it_believes() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, script={1: "lie", 2: "fail"}, blind=True)
    ended = stage.play()
    assert (ended.outcome, ended.goal_seen, ended.unreached, stage.goal_true) == (
        OutcomeKind.PLAN_COMPLETED,
        False,
        (),
        False,
    )
    assert (ended.actions, ended.looks, ended.replans) == (4, 0, 0)
    assert ended.codes == (Reason.GOAL_NOT_OBSERVED,)
    assert stage.recorder.of(Observation) == []
    assert {belief.source for belief in stage.recorder.of(Belief)} == {"assumed"}
    assert stage.recorder.of(Belief)[-1].facts().entails(GOAL)
    assert stage.recorder.of(Decision)[1].causes == (
        Cause(Reason.SKILL_FAILED, steps=("place(a,q)",), status=SkillStatus.NO_PATH, detail="no motion was found"),
        Cause(Reason.EFFECTS_ASSUMED),
    )


def test_a_blind_run_without_a_plan_says_so() -> None:
    ended = Stage(GOAL, {"a": FLOOR, "b": "p"}, blind=True).play()
    assert (ended.outcome, ended.unreached) == (OutcomeKind.NO_PLAN, ("at(a,q)", "at(b,r)"))


def test_a_blind_run_has_to_be_told_what_holds() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    with pytest.raises(InputError, match="must be told the initial facts"):
        make_executive(stage.task, stage.planner, stage.world, {}, None)


def test_one_that_looks_is_not_told() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    told = Facts({at("a", "q"): True, at("b", "r"): True, at("a", "p"): False, at("b", "p"): False})
    skills = {"pick": stage.skill, "place": stage.skill}
    executive = make_executive(stage.task, stage.planner, stage.world, skills, stage.estimator, initial=told)
    stage.estimator._always = {at("b", "r"): None}
    executive.run()
    assert stage.planner.asked[0][0][at("b", "r")] is False


@pytest.mark.parametrize("error", [InputError("no such camera"), MissingError("no GL", command="apt-get install gl")])
def test_an_error_of_the_set_up_is_raised_once_the_trace_is_whole(error: ExecutiveError) -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})

    def observe(cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        raise error

    stage.world.observe = observe  # type: ignore[method-assign]
    with pytest.raises(type(error)) as caught:
        stage.play()
    assert caught.value is error
    last = stage.recorder.events[-1].payload
    assert isinstance(last, Ended)
    assert (last.outcome, stage.recorder.closed) == (OutcomeKind.CRASHED, 1)
    assert last.causes == (Cause(Reason.STAGE_FAILED, what="observe", detail=str(error)),)


def test_an_order_to_exit_is_obeyed_once_the_trace_is_whole() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})

    def skill(step: Step, context: SkillContext) -> SkillResult:
        raise SystemExit(3)

    executive = make_executive(
        stage.task, stage.planner, stage.world, {"pick": skill, "place": skill}, stage.estimator, [stage.recorder]
    )
    with pytest.raises(SystemExit):
        executive.run()
    last = stage.recorder.events[-1].payload
    assert isinstance(last, Ended)
    assert (last.outcome, stage.recorder.closed) == (OutcomeKind.INTERRUPTED, 1)


def test_a_skill_that_is_missing_or_returns_nonsense_has_crashed(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("CRITICAL")
    nonsense = Stage(GOAL, {"a": "p", "b": "p"}, script={1: "nonsense"})
    (cause,) = nonsense.play().causes
    assert (cause.code, "None" in cause.detail) == (Reason.SKILL_CRASHED, True)
    missing = Stage(GOAL, {"a": "p", "b": "p"})
    ended = make_executive(missing.task, missing.planner, missing.world, {}, missing.estimator).run()
    assert ended.outcome is OutcomeKind.CRASHED
    assert ended.causes == (Cause(Reason.SKILL_CRASHED, steps=("pick(a,p)",), detail="KeyError: 'pick'"),)


class Broken(Recorder):
    """Breaks at its n-th event, and when it is closed."""

    def __init__(self, after: int, error: type[BaseException]) -> None:
        super().__init__()
        self.after, self.error = after, error

    def write(self, event: Event) -> None:
        super().write(event)
        if len(self.events) == self.after:
            raise self.error("the disk is full")

    def close(self) -> None:
        super().close()
        raise self.error("the disk is full")


@pytest.mark.parametrize("after", [1, 2, 17])
def test_a_sink_that_raises_is_dropped_and_nothing_else_changes(after: int, caplog: pytest.LogCaptureFixture) -> None:
    stage, alone = (Stage(GOAL, {"a": "p", "b": "p"}, script={2: "land r"}) for _ in range(2))
    broken = Broken(after, OSError)
    ended = make_executive(
        stage.task,
        stage.planner,
        stage.world,
        {"pick": stage.skill, "place": stage.skill},
        stage.estimator,
        [broken, stage.recorder],
    ).run()
    assert ended == alone.play()
    assert len(stage.recorder.events) == len(alone.recorder.events)
    assert (len(broken.events), broken.closed) == (after, 1)
    assert "Broken failed and is left alone from here on" in caplog.text


def test_ctrl_c_in_a_sink_interrupts_the_run_and_costs_no_sink_an_event() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    broken = Broken(20, KeyboardInterrupt)
    ended = make_executive(
        stage.task,
        stage.planner,
        stage.world,
        {"pick": stage.skill, "place": stage.skill},
        stage.estimator,
        [broken, stage.recorder],
    ).run()
    assert ended.outcome is OutcomeKind.INTERRUPTED
    assert [event.payload for event in broken.events] == [event.payload for event in stage.recorder.events]
    assert isinstance(stage.recorder.events[-1].payload, Ended)


@pytest.mark.parametrize("script", [{}, {2: "raise"}, {2: "interrupt"}])
def test_the_robot_stands_still_once_the_run_is_over_whatever_ended_it(
    script: dict[int, str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("CRITICAL")
    stage = Stage(GOAL, {"a": "p", "b": "p"}, script=script)
    stage.play()
    assert stage.world.stopped == 1


def test_a_world_that_cannot_stop_costs_the_trace_nothing(caplog: pytest.LogCaptureFixture) -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})

    def stop() -> None:
        raise OSError("the robot does not answer")

    stage.world.stop = stop  # type: ignore[method-assign]
    assert stage.play().goal_seen
    assert stage.recorder.closed == 1
    assert "FakeWorld failed" in caplog.text


class OnlyAWorld:
    """What a real robot has, and nothing of a simulator."""

    def __init__(self, world: World) -> None:
        self._world = world

    def __getattr__(self, name: str) -> Any:
        if name not in ("time", "handle", "observe", "stop", "schedule", "scenery", "watch"):
            raise AttributeError(name)
        return getattr(self._world, name)


def test_the_loop_asks_for_nothing_that_only_a_simulator_has() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"}, attention=WATCHED, script={2: "land r"})
    world: Any = OnlyAWorld(stage.world)
    assert (isinstance(world, World), isinstance(world, Simulator)) == (True, False)
    stage.world = world
    assert stage.play().goal_seen


def test_cancelled_before_it_began() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    executive = stage.executive()
    executive.cancel()
    ended = executive.run()
    assert (ended.outcome, ended.looks, ended.actions) == (OutcomeKind.INTERRUPTED, 0, 0)
    assert isinstance(stage.recorder.events[0].payload, Started)


def test_a_world_that_is_gone_takes_no_event_with_it(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("CRITICAL")
    stage = Stage(GOAL, {"a": "p", "b": "p"})

    class Gone(FakeWorld):
        gone = False

        @property
        def time(self) -> float:
            if self.gone:
                raise OSError("connection lost")
            return super().time

        def watch(self, listener: Callable[[Frame], None] | None) -> None:
            if self.gone:
                raise OSError("connection lost")

    stage.world = Gone({"a": "p", "b": "p"}, ["p", "q", "r"])

    def lose(world: FakeWorld) -> None:
        Gone.gone = True

    stage.skill.script = {2: lose}
    stage.estimator = type(stage.estimator)(stage.world)
    ended = stage.play()
    assert ended.outcome is OutcomeKind.CRASHED
    assert "connection lost" in ended.causes[0].detail
    assert stage.recorder.events[-1].payload is ended
    assert stage.recorder.events[-1].time == pytest.approx(5.5)
    assert [result.status for result in stage.recorder.of(SkillResult)] == [SkillStatus.DONE, SkillStatus.CRASHED]
    assert stage.recorder.closed == 1


def test_each_action_has_chance_of_its_own_that_depends_on_nothing_before_it() -> None:
    plain = Stage(GOAL, {"a": "p", "b": "p"}, settings=Settings(seed=7))
    rough = Stage(GOAL, {"a": "p", "b": "p"}, script={1: "fail", 3: "land r"}, settings=Settings(seed=7))
    other = Stage(GOAL, {"a": "p", "b": "p"}, settings=Settings(seed=8))
    for stage in (plain, rough, other):
        stage.play()
    assert plain.skill.chance == rough.skill.chance[: len(plain.skill.chance)]
    assert len(set(rough.skill.chance + other.skill.chance)) == len(rough.skill.chance + other.skill.chance)
    first = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(1,))).random()
    assert plain.skill.chance[0] == first


def test_frames_phases_and_times_of_every_stage_are_told() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    ended = stage.play()
    stages = Counter(timing.stage for timing in stage.recorder.of(Timing))
    assert stages == {"observe": ended.looks, "estimate": ended.looks, "plan": 1, "skill": ended.actions}
    assert all(timing.seconds >= 0.0 for timing in stage.recorder.of(Timing))
    assert {phase.name for phase in stage.recorder.of(Phase)} >= {"approach", "grip", "transfer", "lower", "release"}
    frames = [event for event in stage.recorder.events if isinstance(event.payload, Frame)]
    assert len(frames) > 10 * ended.actions
    assert stage.world._listener is None, "nobody watches a world whose run is over"


class Clock:
    """A wall clock that moves when somebody takes his time."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


def test_time_that_sinks_take_is_nobody_elses(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr("executive.core.session.time", clock)

    class Slow(Recorder):
        def write(self, event: Event) -> None:
            super().write(event)
            clock.now += 1.0

    def hurry(world: FakeWorld) -> None:
        clock.now += 0.25

    stage, slow = Stage(Facts({at("a", "q"): True}), {"a": "p"}, script={1: hurry, 2: hurry}), Slow()
    stage.recorder = slow
    stage.play()
    assert [timing.seconds for timing in slow.of(Timing) if timing.stage == "skill"] == [0.25, 0.25]
    assert all(timing.seconds == 0.0 for timing in slow.of(Timing) if timing.stage != "skill")
    assert slow.events[-1].wall == len(slow.events) - 1 + 0.5


def test_an_error_of_the_set_up_inside_a_skill_is_not_blamed_on_it() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})

    def skill(step: Step, context: SkillContext) -> SkillResult:
        raise MissingError("no OMPL", command="pip install ompl")

    executive = make_executive(
        stage.task, stage.planner, stage.world, {"pick": skill}, stage.estimator, [stage.recorder]
    )
    with pytest.raises(MissingError):
        executive.run()
    assert [result.status for result in stage.recorder.of(SkillResult)] == [SkillStatus.CRASHED]
    (ended,) = stage.recorder.of(Ended)
    assert ended.causes == (
        Cause(Reason.STAGE_FAILED, what="skill", detail="no OMPL; install it with: pip install ompl"),
    )


def test_cancelled_during_the_last_look_the_run_is_interrupted_all_the_same() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    executive = stage.executive()

    def answer(look: int, atom: Atom, truth: bool) -> float:
        if look == 5:
            executive.cancel()
        return float(truth)

    stage.estimator._scripted = answer
    ended = executive.run()
    assert (ended.outcome, ended.actions, stage.goal_true) == (OutcomeKind.INTERRUPTED, 4, True)


def test_nothing_is_broken_any_more_once_the_run_is_cancelled() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    stage.faults = FaultInjector([parse_fault("shove@1")], stage.world)
    executive = stage.executive()
    stage.skill.script = {1: lambda world: executive.cancel()}
    assert executive.run().outcome is OutcomeKind.INTERRUPTED
    assert stage.recorder.of(FaultInjected) == []
    assert stage.recorder.of(SkillResult)[0].status is SkillStatus.CANCELLED


def test_an_estimator_that_answers_more_than_it_was_asked_changes_nothing() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    honest = stage.estimator.estimate

    def talkative(observation: Observation, atoms: Sequence[Atom]) -> Belief:
        belief = honest(observation, atoms)
        return Belief(observation.id, {**belief.probability, at("ghost", "p"): 1.0}, source="scripted")

    stage.estimator.estimate = talkative  # type: ignore[method-assign]
    assert stage.play().outcome is OutcomeKind.GOAL_REACHED
    assert all(set(state) == set(stage.task.atoms) for state, _ in stage.planner.asked)


def test_goals_that_hold_are_kept_without_asking_the_planner() -> None:
    goal = Facts({at("a", "q"): True, at("b", "r"): True})
    stage = Stage(goal, {"a": FLOOR, "b": "r"})
    ended = stage.play()
    assert (ended.outcome, ended.unreached, ended.actions) == (OutcomeKind.PARTIAL, ("at(a,q)",), 0)
    assert [asked.facts for _, asked in stage.planner.asked] == [goal, goal, goal.only([at("a", "q")]), goal]


class Compiled:
    """A part that says what it takes time for, if there is something."""

    def __init__(self, *what: str) -> None:
        self.what = what

    def prepare(self, tell: Tell) -> None:
        for each in self.what:
            tell(each)
            time.sleep(0.02)


def test_what_is_made_ready_is_told_before_the_first_look_and_is_a_stage_of_its_own() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    stage.prepare = [Compiled("the check"), Compiled()]
    stage.play()
    payloads = [event.payload for event in stage.recorder.events]
    first = next(index for index, payload in enumerate(payloads) if isinstance(payload, Observation))
    said = [payload for payload in payloads[:first] if isinstance(payload, Phase | Timing)]
    assert said[0] == Phase("compile", "the check")
    assert [type(payload) for payload in said[:2]] == [Phase, Timing]
    assert sum(timing.stage == "compile" for timing in stage.recorder.of(Timing)) == 1
    wall = summarise(stage.recorder.events)["wall_seconds"]
    assert wall["compile"] >= 0.02
    assert wall["skill"] < wall["total"] - wall["compile"]


def test_a_run_that_is_cancelled_while_something_is_made_ready_ends_there() -> None:
    stage = Stage(GOAL, {"a": "p", "b": "p"})
    executive = stage.executive()

    class Cancels:
        def prepare(self, tell: Tell) -> None:
            tell("the check")
            executive.cancel()

    stage.prepare += [Cancels(), Compiled("never begun")]
    assert executive.run().outcome is OutcomeKind.INTERRUPTED
    assert [phase.detail for phase in stage.recorder.of(Phase)] == ["the check"]
    assert stage.recorder.of(Observation) == []
