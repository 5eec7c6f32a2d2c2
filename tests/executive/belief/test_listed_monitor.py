"""The monitor where states are listed: it knows what mutex groups do not say, and leaves the list when it has to."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief import EXACT, ActionModel, BayesMonitor, ErrorModel, Group, MutexNetwork, SensorModel
from executive.belief.interface import Judgement
from executive.types import Atom, Belief, Facts, SkillResult, SkillStatus, Step
from tests.executive.belief.piles import ATOMS, CUPS, START, STEPS, TRAYS, at, listed, on, piles, put, top

SPACE = listed()
GROUPS = tuple(Group(tuple(at(cup, tray) for tray in TRAYS)) for cup in CUPS)
NETWORK = MutexNetwork(ATOMS, GROUPS)
NOISY = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(0.1, 0.1)), ActionModel(), space=SPACE)
SURE = BayesMonitor(NETWORK, EXACT, ActionModel(), space=SPACE)


def answered(true: frozenset[Atom], atoms: tuple[Atom, ...] = ATOMS, wrong: frozenset[Atom] = frozenset()) -> Belief:
    return Belief(0, {atom: float((atom in true) != (atom in wrong)) for atom in atoms})


def looked(monitor: BayesMonitor, *looks: Belief) -> Judgement:
    memory = monitor.begin()
    for look in looks:
        memory, judgement = monitor.looked(memory, look, 0)
    return judgement


@given(st.sampled_from(piles()), st.sets(st.sampled_from(ATOMS), max_size=2).map(frozenset))
def test_the_state_is_one_that_actions_lead_to_whatever_is_answered(
    true: frozenset[Atom], wrong: frozenset[Atom]
) -> None:
    judgement = looked(NOISY, answered(true, wrong=wrong))
    assert SPACE.number(judgement.state.true) is not None
    assert all(0.0 <= value <= 1.0 for value in judgement.probability.values())
    if not wrong:
        assert judgement.state.true == true


def test_what_follows_in_all_listed_states_is_seen() -> None:
    told = (on("b", "a"), on("c", "b"), at("a", "t"))
    judgement = looked(SURE, Belief(0, dict.fromkeys(told, 1.0)))
    assert judgement.seen.true == {*told, at("b", "t"), at("c", "t"), top("c")}
    assert judgement.seen.false == set(ATOMS) - judgement.seen.true
    assert judgement.probability[top("c")] > 0.98


@given(st.integers(0, 10_000))
def test_actions_are_followed_without_a_look(seed: int) -> None:
    rng = random.Random(seed)
    state = Facts.closed(rng.choice(piles()), ATOMS)
    memory, _ = SURE.looked(SURE.begin(), answered(state.true), 0)
    step = rng.choice([step for step in STEPS if step.precondition.truth(state)])
    memory = SURE.acted(memory, step, SkillResult(step, SkillStatus.DONE))
    after = state | {atom: bool(value) for atom, value in step.changes(state).items()}
    other = Belief(1, {})
    assert SURE.looked(memory, other, 1)[1].state == after
    _, judgement = SURE.looked(memory, answered(after.true), 1)
    assert judgement.came_about is not None
    assert judgement.came_about > 0.98
    _, judgement = SURE.looked(memory, answered(state.true), 1)
    assert judgement.came_about is not None
    assert judgement.came_about < 0.1
    assert judgement.state == state


def test_an_accident_leads_out_of_the_listed_states_and_back() -> None:
    """A cup that lies on the floor is in no pile: no action does that."""
    state = frozenset({at("a", "s"), at("b", "s"), at("c", "t"), on("b", "a"), top("b"), top("c")})
    memory, _ = SURE.looked(SURE.begin(), answered(state), 0)
    step = put("b", "u")
    memory = SURE.acted(memory, step, SkillResult(step, SkillStatus.DONE))
    fallen = frozenset({at("a", "s"), at("c", "t"), top("a"), top("c")})
    memory, judgement = SURE.looked(memory, answered(fallen), 1)
    assert SPACE.number(fallen) is None
    assert judgement.state.true == fallen
    memory = SURE.acted(memory, None)
    _, judgement = SURE.looked(memory, answered(state), 2)
    assert judgement.state.true == state


def test_a_monitor_with_listed_states_weighs_up_like_counting_by_hand() -> None:
    told = {top("a"): 0.9, on("a", "b"): 0.8, at("b", "s"): 0.7, on("b", "c"): 0.3}
    judgement = looked(BayesMonitor(NETWORK, NOISY.sensor_model, None, space=SPACE), Belief(0, told))
    mass = {
        state: math.exp(math.fsum(NOISY.sensor_model.evidence(atom, told[atom]) for atom in state if atom in told))
        for state in piles()
    }
    total = math.fsum(mass.values())
    for atom in ATOMS:
        inside = math.fsum(value for state, value in mass.items() if atom in state) / total
        assert judgement.probability[atom] == pytest.approx(inside, abs=0.01), "but for accidents"


def test_lists_of_other_atoms_are_refused() -> None:
    with pytest.raises(ValueError, match="other atoms"):
        BayesMonitor(MutexNetwork(ATOMS[:-1]), space=SPACE)


def test_a_step_that_no_state_allows_changes_nothing() -> None:
    memory, _ = SURE.looked(SURE.begin(), answered(piles()[0]), 0)
    never = Step.strips("never", (), Facts({on("a", "b"): True, on("b", "a"): True}), Facts({top("a"): True}))
    memory = SURE.acted(memory, never, SkillResult(never, SkillStatus.DONE))
    assert SURE.looked(memory, answered(piles()[0]), 1)[1].state.true == piles()[0]


def test_an_answer_too_weak_to_count_does_not_keep_what_follows_from_being_seen() -> None:
    """This model says of nearly every cup that it is on top. What is on what it knows well, and so what is on top."""
    weak = SensorModel({"top": ErrorModel(0.8, 0.05)}, ErrorModel(0.01, 0.01))
    told = {atom: float(atom in START or atom.predicate == "top") for atom in ATOMS}
    judgement = looked(BayesMonitor(NETWORK, weak, ActionModel(), space=SPACE), Belief(0, told), Belief(0, told))
    assert judgement.seen.get(top("b")) is True
    assert judgement.seen.get(top("a")) is False
