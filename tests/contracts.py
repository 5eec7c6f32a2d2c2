"""What every part keeps to, real or fake: one class of checks for each seam.

A test of a part derives from the class of its seam and says how such a part is made:

    class TestFakeWorld(WorldContract):
        def make(self) -> World: ...

Whatever passes can take its place in the loop.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from executive.belief import Monitor
from executive.core.attention import same_view
from executive.core.compare import progress
from executive.errors import InputError
from executive.protocols import Estimator, Planner, Simulator, Sink, Skill, SkillContext, World
from executive.trace.record import monitor_file
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Cause,
    Compared,
    Condition,
    Contradiction,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    EstimatedPose,
    Event,
    Evidence,
    Facts,
    FaultInjected,
    Frame,
    Ground,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Lump,
    Motion,
    Moved,
    News,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Overruled,
    Payload,
    Phase,
    PlaceToLook,
    Plan,
    PointCloud,
    PosesEstimated,
    Probed,
    Questions,
    Reason,
    Remembered,
    Resumed,
    Revised,
    Scenery,
    SearchOrder,
    Sense,
    SkillResult,
    SkillStatus,
    Started,
    Step,
    Task,
    Timing,
    Verdict,
    Watched,
)

PHASES = frozenset({"plan", "approach", "grip", "lift", "transfer", "lower", "release", "retreat", "home", "aside"})
"""What the phases of picking and placing are called; faults and viewers go by these names."""


class PlannerContract(ABC):
    """Plans are executable and reach the goal; the absence of one is a value that says why."""

    @abstractmethod
    def make(self) -> Planner: ...

    @abstractmethod
    def solvable(self) -> tuple[Facts, Condition]:
        """A complete state and a goal that takes at least one step."""

    @abstractmethod
    def unsolvable(self) -> tuple[Facts, Condition]:
        """A complete state and a goal that no plan reaches."""

    def test_a_plan_replayed_through_compare_holds(self) -> None:
        state, goal = self.solvable()
        plan = self.make().plan(state, goal)
        assert isinstance(plan, Plan)
        assert plan.steps
        assert plan.planner
        assert plan.seconds >= 0.0
        for step in plan.steps:
            assert step.precondition.truth(state), f"{step} cannot be done"
            state = progress(state, step)
        assert goal.truth(state)

    def test_a_goal_that_holds_takes_an_empty_plan(self) -> None:
        state, goal = self.solvable()
        planner = self.make()
        plan = planner.plan(state, goal)
        assert isinstance(plan, Plan)
        for step in plan.steps:
            state = progress(state, step)
        again = planner.plan(state, goal)
        assert isinstance(again, Plan)
        assert again.steps == ()

    def test_what_is_not_mentioned_is_false(self) -> None:
        state, goal = self.solvable()
        planner = self.make()
        told_all, told_true = planner.plan(state, goal), planner.plan(state.only(state.true), goal)
        assert isinstance(told_all, Plan)
        assert isinstance(told_true, Plan)
        assert told_all.steps == told_true.steps

    def test_a_plan_does_without_what_it_is_to_avoid(self) -> None:
        state, goal = self.solvable()
        planner, avoid = self.make(), frozenset[Step]()
        answer = planner.plan(state, goal)
        for _ in range(3):
            assert isinstance(answer, Plan)
            avoid |= {answer.steps[-1]}
            answer = planner.plan(state, goal, avoid)
            if isinstance(answer, NoPlan):
                assert answer.reason is NoPlanReason.UNSOLVABLE
                break
            assert avoid.isdisjoint(answer.steps)
        again = planner.plan(state, goal)
        assert isinstance(again, Plan)
        assert not avoid.isdisjoint(again.steps), "it is avoided in that one question alone"

    def test_no_plan_is_a_value_with_its_reason(self) -> None:
        answer = self.make().plan(*self.unsolvable())
        assert isinstance(answer, NoPlan)
        assert answer.reason is NoPlanReason.UNSOLVABLE

    def test_the_same_question_has_the_same_answer(self) -> None:
        planner = self.make()
        first, _, second = (planner.plan(*ask) for ask in (self.solvable(), self.unsolvable(), self.solvable()))
        assert isinstance(first, Plan)
        assert isinstance(second, Plan)
        assert first.steps == second.steps


class EstimatorContract(ABC):
    """A belief over exactly what was asked; what cannot be told is said to be unanswered."""

    @abstractmethod
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        """An estimator, a look, and at least two atoms to ask of it."""

    def test_every_question_is_answered_or_said_not_to_be_and_no_other(self) -> None:
        estimator, observation, atoms = self.make()
        belief = estimator.estimate(observation, atoms)
        assert isinstance(belief, Belief)
        assert belief.probability.keys() | belief.unanswered == set(atoms)
        assert belief.observation_id == observation.id
        assert belief.source == estimator.name != ""

    def test_the_order_of_the_questions_changes_no_answer(self) -> None:
        estimator, observation, atoms = self.make()
        forwards = estimator.estimate(observation, atoms)
        backwards = estimator.estimate(observation, list(reversed(atoms)))
        assert dict(backwards.probability) == pytest.approx(dict(forwards.probability), abs=1e-6)
        assert backwards.unanswered == forwards.unanswered

    def test_nothing_asked_is_nothing_answered(self) -> None:
        estimator, observation, _ = self.make()
        belief = estimator.estimate(observation, [])
        assert not belief.probability
        assert not belief.unanswered


class MonitorContract(ABC):
    """State estimates about all of a task's atoms, and values for a memory."""

    @abstractmethod
    def make(self) -> Monitor: ...

    @abstractmethod
    def moments(self) -> tuple[Facts, Step, Facts]:
        """What is so of every atom, a step, and what is so after it."""

    def look(self, facts: Mapping[Atom, bool], number: int = 0) -> Belief:
        """An estimator that never errs and is sure."""
        return Belief(number, {atom: float(value) for atom, value in facts.items()}, source="sure")

    def test_what_is_seen_is_believed_and_what_is_planned_from(self) -> None:
        first, step, second = self.moments()
        monitor = self.make()
        memory = monitor.begin()
        for number, facts in enumerate((first, second)):
            memory, judgement = monitor.looked(memory, self.look(facts, number), number)
            assert judgement.seen == facts
            assert judgement.state == facts
            assert judgement.belief.observation_id == number
            assert not judgement.belief.unanswered
            assert all(judgement.age(atom) == 0 for atom in facts)
            memory = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))

    def test_an_estimate_is_about_every_atom_whatever_was_asked(self) -> None:
        first, _, _ = self.moments()
        monitor, atoms = self.make(), sorted(first)
        for some in (atoms, atoms[:1], []):
            _, judgement = monitor.looked(monitor.begin(), self.look({atom: first[atom] for atom in some}), 0)
            assert judgement.probability.keys() == set(atoms)
            assert all(0.0 <= value <= 1.0 for value in judgement.probability.values())
            assert set(judgement.state) == set(atoms)
            assert judgement.belief.probability.keys() | judgement.belief.unanswered == set(atoms)
            assert set(judgement.seen) <= set(judgement.belief.probability)
            assert set(some) <= set(judgement.seen)

    def test_what_was_seen_before_an_action_is_not_seen_after_it(self) -> None:
        first, step, _ = self.moments()
        monitor = self.make()
        memory, _ = monitor.looked(monitor.begin(), self.look(first), 0)
        memory = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))
        _, judgement = monitor.looked(memory, Belief(1, {}, frozenset(first), "blind"), 1)
        assert not judgement.seen
        assert judgement.belief.unanswered == set(first)

    def test_the_same_calls_give_the_same_values_in_any_order_of_the_atoms(self) -> None:
        first, step, second = self.moments()
        atoms, said = sorted(first), []
        for all_atoms, some in ((atoms, atoms[::2]), (atoms[::-1], atoms[::2][::-1])):
            monitor = self.make()
            memory, _ = monitor.looked(monitor.begin(), self.look({atom: first[atom] for atom in all_atoms}), 0)
            acted = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))
            for _ in range(2):  # a memory is a value: what came of it once does not change it
                _, judgement = monitor.looked(acted, self.look({atom: second[atom] for atom in some}, 1), 1)
                said.append((dict(judgement.probability), judgement.seen, judgement.state))
        assert all(each[1:] == said[0][1:] for each in said)
        assert all(each[0] == pytest.approx(said[0][0]) for each in said)

    def test_it_comes_back_from_a_record(self, tmp_path: Path) -> None:
        first, step, second = self.moments()
        monitor = self.make()
        assert monitor_file.save(tmp_path, monitor) is not None
        judged = []
        for each in (monitor, monitor_file.load(tmp_path, sorted(first))):
            memory, _ = each.looked(each.begin(), self.look(first), 0)
            memory = each.acted(memory, step, SkillResult(step, SkillStatus.DONE))
            _, judgement = each.looked(memory, self.look(second, 1), 1)
            judged.append((dict(judgement.probability), judgement.seen, judgement.state, judgement.came_about))
        assert judged[0] == judged[1]


class WorldContract(ABC):
    """A clock that only runs when time passes, looks that change nothing, a robot that can be stopped."""

    @abstractmethod
    def make(self) -> World: ...

    @abstractmethod
    def pass_time(self, world: World, seconds: float) -> None:
        """Let at least so many seconds pass in the world."""

    def test_looking_takes_no_time_and_numbers_its_observations(self) -> None:
        world = self.make()
        before = world.time
        first, second = world.observe("once"), world.observe("twice")
        assert (first.time, second.time, world.time) == (before, before, before)
        assert first.id < second.id
        assert (first.cause, second.cause) == ("once", "twice")
        assert first.images.keys() == second.images.keys()
        assert same_view(first.images, second.images)
        same = [np.array_equal(image, second.images[camera]) for camera, image in first.images.items()]
        assert not (first.noisy and any(same)), "a sensor gives no picture twice"

    def test_a_look_through_some_cameras_shows_their_pictures_alone(self) -> None:
        world = self.make()
        all_of_them = world.observe().images
        for camera, image in all_of_them.items():
            alone = world.observe("closer", [camera, "no such camera"]).images
            assert list(alone) == [camera]
            assert same_view(alone, {camera: image})
        assert not world.observe("with eyes shut", ()).images

    def test_what_is_scheduled_happens_once_and_in_time(self) -> None:
        world = self.make()
        start, happened = world.time, list[float]()
        world.schedule(0.2, lambda: happened.append(world.time - start))
        self.pass_time(world, 0.1)
        assert happened == []
        self.pass_time(world, 0.3)
        self.pass_time(world, 0.3)
        assert happened == [pytest.approx(0.2, abs=0.05)]

    def test_a_listener_sees_frames_until_nobody_watches(self) -> None:
        world, frames = self.make(), list[Watched]()
        world.watch(frames.append)
        self.pass_time(world, 1.0)
        seen = len(frames)
        assert seen > 0
        world.watch(None)
        self.pass_time(world, 1.0)
        assert len(frames) == seen

    def test_it_can_be_drawn(self) -> None:
        assert isinstance(self.make().scenery(), Scenery)

    def test_it_can_be_stopped_at_any_time_and_goes_on(self) -> None:
        world = self.make()
        for _ in range(2):
            world.stop()
        standing, moment = world.observe().joints, world.time
        self.pass_time(world, 0.3)
        assert world.time > moment
        assert world.observe().joints == pytest.approx(standing, abs=1e-3)


class SimulatorContract(WorldContract):
    """A world whose state can be saved and restored, and that can be disturbed."""

    @abstractmethod
    def make(self) -> Simulator: ...

    def test_a_restored_state_goes_on_as_if_nothing_had_happened(self) -> None:
        world = self.make()
        self.pass_time(world, 0.1)
        snapshot, moment = world.snapshot(), world.time
        self.pass_time(world, 0.3)
        once, until = world.observe(), world.time
        assert until > moment
        world.restore(snapshot)
        assert world.time == moment
        self.pass_time(world, 0.3)
        again = world.observe()
        assert world.time == until
        assert np.array_equal(once.joints, again.joints)
        assert same_view(once.images, again.images)

    def test_a_disturbance_says_what_it_did_and_an_unknown_one_is_bad_input(self) -> None:
        world = self.make()
        for kind in ("drop", "miss", "shove"):
            assert world.disturb(kind, np.random.default_rng(1))
        with pytest.raises(InputError, match="'eclipse'"):
            world.disturb("eclipse", np.random.default_rng(1))
        with pytest.raises(InputError, match="'no-such-item'"):
            world.disturb("shove", np.random.default_rng(1), item="no-such-item")


class SkillContract(ABC):
    """A skill reports what it did, in its phases' proper names, and stops when it is told to."""

    @abstractmethod
    def make(self) -> tuple[Skill, Simulator]:
        """A skill, in a world where `possible` can be carried out."""

    @abstractmethod
    def possible(self) -> Step:
        """A step that succeeds in that world."""

    @abstractmethod
    def misplaced(self) -> Step:
        """A step whose thing is not where the step says it is."""

    @abstractmethod
    def holds(self, world: Simulator, facts: Facts) -> bool:
        """Whether the facts are true in the world; the scorer's view."""

    def carry_out(
        self, skill: Skill, world: Simulator, step: Step, patience: float = float("inf")
    ) -> tuple[SkillResult, list[News]]:
        """What the skill says and announces; it is cancelled after `patience` seconds of the world's time."""
        announced: list[News] = []
        until = world.time + patience
        rng = np.random.default_rng(1)
        result = skill(step, SkillContext(world.handle, rng, announced.append, lambda: world.time >= until))
        return result, announced

    def test_a_step_that_can_be_done_is_done_and_told_phase_by_phase(self) -> None:
        skill, world = self.make()
        start = world.time
        result, announced = self.carry_out(skill, world, self.possible())
        assert (result.status, result.step) == (SkillStatus.DONE, self.possible())
        assert self.holds(world, self.possible().unconditional)
        assert result.seconds == pytest.approx(world.time - start, abs=1e-6)
        phases = [news for news in announced if isinstance(news, Phase)]
        assert {phase.name for phase in phases} <= PHASES
        assert "transfer" in {phase.name for phase in phases}
        assert all(phase.seconds >= 0.0 for phase in phases)

    def test_a_thing_that_is_elsewhere_is_reported_and_not_fetched(self) -> None:
        skill, world = self.make()
        result, _ = self.carry_out(skill, world, self.misplaced())
        assert result.status is SkillStatus.NOT_THERE
        assert result.reason
        assert not self.holds(world, self.misplaced().unconditional)

    def test_cancelled_it_stops_says_so_and_can_be_called_again(self) -> None:
        skill, world = self.make()
        snapshot = world.snapshot()
        result, _ = self.carry_out(skill, world, self.possible(), patience=0.0)
        assert result.status is SkillStatus.CANCELLED
        result, _ = self.carry_out(skill, world, self.possible(), patience=1.0)
        assert result.status is SkillStatus.CANCELLED
        assert not self.holds(world, self.possible().unconditional)
        world.restore(snapshot)
        assert self.carry_out(skill, world, self.possible())[0].done


_ATOM = Atom("at", ("a", "p"))
_FACTS = Facts({_ATOM: True})
_ENOUGH = (Cause(Reason.BUDGET_SPENT, what="actions", total=1),)
_STEP = Step.strips("pick", ("a", "p"), _FACTS, Facts({_ATOM: False}))
_TASK = Task("things", "fake", {"a": "thing"}, (_ATOM,), Condition.of(_FACTS))

EVERY_PAYLOAD: tuple[Payload, ...] = (
    Started("run", "things", _TASK, "none", 3, {"low": 0.5}),
    Resumed(0, 0, 0, 0, 0),
    Questions({_ATOM: "Is a on p?"}, "Answer yes or no.", "templates"),
    Scenery(),
    Observation(0, 0.0, {"front": np.zeros((24, 32, 3), np.uint8)}, np.zeros(6), "first look"),
    PosesEstimated(
        {"a": EstimatedPose(np.array([0.4, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0]), 1e-6 * np.eye(6), 0.001, ("front",))},
        ("b",),
        (Lump(np.zeros(3), np.full(3, 0.05)),),
        {"side": "no depth"},
    ),
    Belief(0, {_ATOM: 0.75}, frozenset({Atom("free")}), "scripted", {_ATOM: (Evidence(("front",), 0.6, 0.2),)}),
    Blinded("front", "its picture is black", 0),
    Looked(0, LookKind.FULL, 2, 2, ("front",)),
    Judged(
        0,
        {_ATOM: 0.9, Atom("free"): 0.1},
        _FACTS,
        (Contradiction({_ATOM: 0.75, Atom("free"): 0.6}, {_ATOM: 0.9, Atom("free"): 0.1}),),
        (Overruled(Atom("free"), True, 0.6, False, 0.1),),
        {Atom("held", ("a",)): Remembered(False, 2, 0.05)},
        0.5,
    ),
    SearchOrder(
        (PlaceToLook(Condition.of(_FACTS), 0.6, 2.0, 0.8), PlaceToLook(Condition(), 0.4, 1.0, 1.2)), _FACTS, 12
    ),
    NoPlan(NoPlanReason.TIMED_OUT, "after 30 s", "fake", 30.0),
    Plan((_STEP,), 1.0, "fake", 0.1),
    Probed(Condition.of(_FACTS), Plan((_STEP,), 1.0, "fake", 0.1)),
    Compared("preconditions", _FACTS, Verdict(holds=frozenset({_ATOM})), 0),
    Dispatched(_STEP, 1, 1, 0),
    Phase("transfer", "to p", 2.5),
    Motion(np.zeros((4, 6)), np.zeros((4, 3)), 2.5, "RRT*", 0.2, 1.5),
    Frame({"a": np.array([0.0, 0, 0, 1, 0, 0, 0])}, np.zeros(6), 0.05),
    PointCloud(np.zeros((2, 3), np.float32), np.zeros((2, 3), np.uint8)),
    FaultInjected("drop", "drop@1", 1, "the gripper opened"),
    Guarded(_ATOM, False, True, 1),
    SkillResult(_STEP, SkillStatus.DROPPED, "nothing is held", 2.0, 5.0, Sense.SEEN),
    Timing("skill", 0.3),
    Moved("home", SkillStatus.DONE, "", 1.5),
    Decision(
        DecisionKind.REPLAN,
        (Cause(Reason.EFFECT_MISSING, (_ATOM,)),),
        (_ATOM,),
        grounds=(Ground(_ATOM, True, False, 0.1, 0, ("front",)),),
    ),
    Revised(_FACTS, _FACTS),
    Decision(DecisionKind.STOP, _ENOUGH, (), OutcomeKind.GAVE_UP),
    Ended(OutcomeKind.GAVE_UP, _ENOUGH, False, ("at(a,p)",), 1, 1, 0, 1),
)
"""One of each thing that a sink may get to see, in an order that can happen."""


class SinkContract(ABC):
    """A sink takes whatever happens, and being closed twice."""

    @abstractmethod
    def make(self) -> Sink: ...

    def test_it_takes_every_kind_of_event(self) -> None:
        sink = self.make()
        for number, payload in enumerate(EVERY_PAYLOAD):
            sink.write(Event(min(number // 6, 1), 0.1 * number, 0.2 * number, payload))
        sink.close()
        sink.close()

    def test_it_takes_a_run_that_breaks_off(self) -> None:
        sink = self.make()
        sink.write(Event(0, 0.0, 0.0, EVERY_PAYLOAD[0]))
        sink.close()
