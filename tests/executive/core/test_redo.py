"""What is never sure is made sure by doing it once more; what the hand feels counts; what was given up stays so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from executive.belief import ErrorModel, SensorModel
from executive.belief.action_model import ABSENCE_EVIDENCE, GRIP_EVIDENCE, skill_evidence
from executive.core.settings import Settings
from executive.types import (
    Atom,
    Belief,
    Cause,
    DecisionKind,
    Dispatched,
    Facts,
    Observation,
    OutcomeKind,
    Reason,
    SkillResult,
    SkillStatus,
    Step,
)
from tests.fakes import (
    FLOOR,
    FREE,
    Answer,
    FakePlanner,
    ScriptedEstimator,
    Stage,
    Ticking,
    at,
    budget,
    decided,
    held,
    pick,
    put,
)

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
CARRIED = {"pick": ("held", (0,)), "place": ("held", (0,))}
SHARP = SensorModel(other=ErrorModel(1e-3, 1e-3), correlation_within=0.8, correlation_across=0.8)


class Leaning(ScriptedEstimator):
    """Takes a thing on r, across from q, for one on q, with the same doubt in every look."""

    lean, there = 0.75, 0.2

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        belief = super().estimate(observation, atoms)
        if self._world.past[observation.id]["a"] != "r":
            return belief
        told = {**belief.probability}
        told |= {atom: value for atom, value in ((at("a", "q"), self.lean), (at("a", "r"), self.there)) if atom in told}
        return Belief(belief.observation_id, told, belief.unanswered, belief.source)


def across(**parts: object) -> Stage:
    """A thing is put across the edge between q, where the goal has it, and r."""
    made = Stage(GOAL, {"a": "p", "b": "p"}, script={2: "land quietly r"})
    made.estimator = Leaning(made.world)
    return made.weighing(sensor_model=SHARP, **parts)


def test_a_goal_that_is_never_sure_is_brought_about_once_more() -> None:
    made = across()
    ended = made.play()
    assert (ended.outcome, ended.goal_seen, made.goal_true) == (OutcomeKind.GOAL_REACHED, True, True)
    steps = [order.step for order in made.recorder.of(Dispatched)]
    assert steps[-2:] == [pick("a", "r"), put("a", "q")]
    (again,) = decided(made, Reason.DONE_AGAIN)
    assert (again.kind, again.evidence) == (DecisionKind.REPLAN, (at("a", "q"),))
    assert again.causes[-1] == Cause(Reason.DONE_AGAIN, (at("a", "r"), FREE))


def test_it_is_done_once_more_only_once() -> None:
    """Where doing it again leaves it as doubtful as before, the run says so and ends."""
    made = across()
    assert isinstance(made.estimator, Leaning)
    made.estimator.lean = 0.6
    made.skill.script = dict.fromkeys(range(2, 99, 2), "land quietly r")
    ended = made.play()
    assert (ended.outcome, ended.goal_seen) == (OutcomeKind.PARTIAL, False)
    (cause,) = ended.causes
    assert (cause.code, cause.atoms) == (Reason.GOAL_ONLY_BELIEVED, (at("a", "q"),))
    assert len(decided(made, Reason.DONE_AGAIN)) == 1


def test_before_a_goal_is_given_up_it_is_tried_where_the_thing_may_be() -> None:
    """It is dropped where it can hardly be told, and no plan leads on from not knowing where it is."""
    made = across()
    assert isinstance(made.estimator, Leaning)
    made.estimator.lean, made.estimator.there = 0.02, 0.2
    ended = made.play()
    assert (ended.outcome, ended.goal_seen, made.goal_true) == (OutcomeKind.GOAL_REACHED, True, True)
    optimistic = decided(made, Reason.OPTIMISTIC_PLAN)
    assert {(each.kind, each.evidence) for each in optimistic} == {(DecisionKind.REPLAN, (at("a", "r"),))}
    assert pick("a", "r") in [order.step for order in made.recorder.of(Dispatched)]


def test_a_hunch_that_is_wrong_is_not_followed_for_ever() -> None:
    made = across()
    made.skill.script = {2: "land quietly floor"}
    made.estimator = ScriptedEstimator(made.world, {look: {at("a", "r"): 0.2} for look in range(3, 99)})
    ended = made.play()
    assert (ended.outcome, ended.unreached) == (OutcomeKind.PARTIAL, ("at(a,q)",))
    assert 1 <= len(decided(made, Reason.OPTIMISTIC_PLAN)) <= 2
    reports = [each for each in made.recorder.of(SkillResult) if each.step == pick("a", "r")]
    assert {each.status for each in reports} == {SkillStatus.NOT_THERE}


def nowhere_for_sure(settings: Settings) -> Stage:
    """It may be in any of eleven places, and there is no plan from any of them."""
    places = tuple("pqrstuvwxyz")
    everywhere: dict[Atom, Answer] = {at("a", place): 0.2 for place in places}
    made = Stage(Facts({at("a", "z"): True}), {"a": FLOOR}, places, always=everywhere, settings=settings).weighing()
    made.planner = FakePlanner([])
    return made


def supposed(made: Stage) -> int:
    """How often the planner was asked from a state in which the thing is somewhere."""
    return sum(any(atom.predicate == "at" for atom in state.true) for state, _ in made.planner.asked)


@pytest.mark.parametrize("most", [0, 3, 64])
def test_so_many_hunches_are_followed_up_and_no_more(most: int) -> None:
    made = nowhere_for_sure(Settings(max_goal_plans=most))
    assert made.play().outcome is OutcomeKind.NO_PLAN
    assert supposed(made) == min(most, 10), "in one of them the goal would hold already"


def test_hunches_keep_to_the_time_that_the_run_has(monkeypatch: pytest.MonkeyPatch) -> None:
    made, clock = nowhere_for_sure(Settings(max_seconds=6.0)), Ticking()
    monkeypatch.setattr(made.planner, "plan", clock.second(made.planner.plan))
    monkeypatch.setattr("executive.core.session.time.monotonic", clock)
    ended = made.play()
    assert (ended.outcome, ended.causes) == (OutcomeKind.GAVE_UP, (budget("seconds", 6),))
    assert (clock.now, len(made.planner.asked)) == (6.0, 6)
    assert 0 < supposed(made) < 10


def test_what_is_seen_not_to_be_anywhere_is_no_reason_to_try() -> None:
    made = across()
    made.skill.script = {2: "land quietly floor"}
    made.estimator = ScriptedEstimator(made.world)
    ended = made.play()
    assert ended.outcome is OutcomeKind.PARTIAL
    assert not decided(made, Reason.OPTIMISTIC_PLAN)


def test_nothing_is_done_again_for_what_the_looks_do_not_speak_of() -> None:
    """Not to see a thing at all is no reason to move it."""
    made = Stage(GOAL, {"a": "p", "b": "p"}, always={at("a", "q"): None}).weighing(sensor_model=SHARP)
    ended = made.play()
    assert not ended.goal_seen
    assert not decided(made, Reason.DONE_AGAIN)


def test_the_hand_is_asked_before_an_eye_that_takes_the_thing_for_held() -> None:
    """The eye sees it held, the fingers feel nothing, and the place that was meant to follow finds nothing to place."""
    step = put("a", "q")
    empty = SkillResult(step, SkillStatus.NO_PATH, holding=False)
    beliefs = {}
    for carried in ({}, CARRIED):
        monitor = Stage(GOAL, {"a": "p", "b": "p"}).weighing(sensor_model=SHARP, carried=carried).monitor
        memory = monitor.begin()
        lifted = {atom: float(atom == held("a") or atom == at("b", "p")) for atom in (*monitor.network.atoms,)}  # type: ignore[attr-defined]
        memory, _ = monitor.looked(memory, Belief(0, lifted), 0)
        memory = monitor.acted(memory, step, empty)
        wrong = {**lifted, held("a"): 0.9, FREE: 0.6, at("a", "p"): 0.4}
        _, judgement = monitor.looked(memory, Belief(1, wrong), 1)
        beliefs[bool(carried)] = judgement.probability[held("a")]
    assert beliefs[True] < 0.5 < 0.9 < beliefs[False]


def test_a_full_hand_holds_the_thing_only_where_the_skill_got_it() -> None:
    step = pick("a", "p")
    assert skill_evidence(CARRIED, step, SkillResult(step, SkillStatus.DONE, holding=True)) == {
        held("a"): GRIP_EVIDENCE
    }
    assert skill_evidence(CARRIED, step, SkillResult(step, SkillStatus.GRASP_MISSED, holding=False)) == {
        held("a"): -GRIP_EVIDENCE
    }
    assert not skill_evidence(CARRIED, step, SkillResult(step, SkillStatus.GRASP_MISSED, "full", holding=True))
    assert not skill_evidence(CARRIED, step, SkillResult(step, SkillStatus.DONE))
    assert not skill_evidence({}, step, SkillResult(step, SkillStatus.DONE, holding=True))


def test_what_a_skill_does_not_find_where_it_should_be_is_not_there() -> None:
    step = pick("a", "p")
    missing = SkillResult(step, SkillStatus.NOT_THERE, holding=False)
    assert skill_evidence(CARRIED, step, missing) == {at("a", "p"): -ABSENCE_EVIDENCE, held("a"): -GRIP_EVIDENCE}
    assert skill_evidence({}, step, missing) == {at("a", "p"): -ABSENCE_EVIDENCE}
    assert skill_evidence(CARRIED, put("a", "q"), SkillResult(put("a", "q"), SkillStatus.NOT_THERE)) == {
        held("a"): -ABSENCE_EVIDENCE
    }


def test_what_a_skill_does_not_find_is_where_the_action_takes_it_from_whatever_else_it_needs() -> None:
    """That nothing is on it, or that a drawer is open, is not what the report is about."""
    clear = Atom("clear", ("a",))
    needs = {clear: True, at("a", "b"): True, FREE: True}
    step = Step.strips("unstack", ("a", "b"), needs, {at("a", "b"): False})
    missing = SkillResult(step, SkillStatus.NOT_THERE)
    assert skill_evidence({}, step, missing) == {at("a", "b"): -ABSENCE_EVIDENCE}
    assert not skill_evidence({}, step, replace(missing, status=SkillStatus.NOT_APPLICABLE)), "it may be either"
