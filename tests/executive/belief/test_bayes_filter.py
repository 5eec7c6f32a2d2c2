"""Laws of the monitor that weighs things up, held against counting every state, and what it must never do."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Mapping
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief.action_model import ActionModel, Chances
from executive.belief.bayes_filter import BayesMonitor, BeliefState
from executive.belief.interface import Judgement, Thresholds
from executive.belief.mutex_inference import Group, MutexNetwork
from executive.belief.priors import Weighted
from executive.belief.sensor_model import EXACT, ErrorModel, SensorModel
from executive.types import Atom, Belief, Facts, SkillResult, SkillStatus, Step
from tests.executive.belief.hands import ATOMS, FLOOR, GROUPS, HAND, NETWORK, PLACES, THINGS, answers, story, truth
from tests.fakes import FREE, at, held, pick, put

NOISY = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(0.05, 0.05)))
FORGETFUL = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(0.05, 0.05)), actions=None)
SURE = BayesMonitor(NETWORK, EXACT)

places = st.sampled_from((*PLACES, FLOOR))
rooms = st.tuples(st.tuples(places, places, places), st.sampled_from((*THINGS, None))).map(
    lambda drawn: {thing: HAND if thing == drawn[1] else place for thing, place in zip(THINGS, drawn[0], strict=True)}
)
probabilities = st.fixed_dictionaries({}, optional={atom: st.floats(0.0, 1.0) for atom in ATOMS})


def states() -> list[frozenset[Atom]]:
    """Every state that the groups allow."""
    found = []
    for where in itertools.product((*PLACES, FLOOR, HAND), repeat=len(THINGS)):
        if where.count(HAND) <= 1:
            found.append(truth(dict(zip(THINGS, where, strict=True))).true)
    return found


STATES = states()


def after(
    monitor: BayesMonitor, *looks: Belief, memory: BeliefState | None = None, cycle: int = 0
) -> tuple[BeliefState, Judgement]:
    memory = memory or monitor.begin()
    for look in looks:
        memory, judgement = monitor.looked(memory, look, cycle)
    return memory, judgement


def settled(monitor: BayesMonitor, where: Mapping[str, str]) -> BeliefState:
    """A memory of having seen a state thrice, in three moments."""
    memory = monitor.begin()
    for cycle in range(3):
        memory, _ = monitor.looked(monitor.acted(memory, None), answers(truth(where)), cycle)
    return memory


@given(probabilities, probabilities)
def test_looks_are_weighed_by_bayes_rule_over_consistent_states(one: dict[Atom, float], two: dict[Atom, float]) -> None:
    memory, judgement = after(FORGETFUL, Belief(0, one), Belief(1, two))
    (hypothesis,) = memory.hypotheses
    assert isinstance(hypothesis.prior, Weighted)
    sensor = FORGETFUL.sensor_model
    evidence = {
        atom: sensor.pooled([sensor.evidence(atom, look[atom]) for look in (one, two) if atom in look])
        for atom in one.keys() | two.keys()
    }
    weight = {atom: hypothesis.prior.weights[atom] + evidence.get(atom, 0.0) for atom in ATOMS}
    logs = {true: math.fsum(weight[atom] for atom in true) for true in STATES}
    total = math.fsum(map(math.exp, logs.values()))
    for atom in ATOMS:
        share = math.fsum(math.exp(log) for true, log in logs.items() if atom in true) / total
        assert judgement.probability[atom] == pytest.approx(share, abs=1e-9)


@given(st.lists(probabilities, min_size=1, max_size=4), st.randoms(use_true_random=False))
def test_the_order_of_looks_at_one_moment_changes_nothing(looks: list[dict[Atom, float]], rng: random.Random) -> None:
    mixed = list(looks)
    rng.shuffle(mixed)
    _, one = after(NOISY, *(Belief(0, look) for look in looks))
    _, other = after(NOISY, *(Belief(0, look) for look in mixed))
    assert other.probability == pytest.approx(one.probability, abs=1e-9)


@given(st.integers(0, 10**6))
def test_whatever_happens_beliefs_and_states_keep_to_the_groups(seed: int) -> None:
    rng = random.Random(seed)
    memory = NOISY.begin()
    for cycle, (step, result, facts) in enumerate(story(rng, 6)):
        memory = NOISY.acted(memory, step, result) if step else memory
        asked = facts.only(atom for atom in ATOMS if rng.random() < 0.8)
        wrong = frozenset(atom for atom in asked if rng.random() < 0.2)
        memory, judgement = NOISY.looked(memory, answers(asked, wrong), cycle)
        for group in GROUPS:
            total = math.fsum(judgement.probability[atom] for atom in group.atoms)
            assert total == pytest.approx(1.0) if group.exact else total <= 1.0 + 1e-9
            assert sum(judgement.seen.get(atom, False) for atom in group.atoms) <= 1
        assert set(judgement.state) == set(ATOMS)
        assert all(sum(judgement.state[atom] for atom in group.atoms) <= 1 for group in GROUPS)
        assert judgement.belief.probability.keys() | judgement.belief.unanswered == set(ATOMS)


@given(st.integers(0, 10**6))
def test_an_eye_that_is_always_right_is_believed_at_once(seed: int) -> None:
    memory = SURE.begin()
    for cycle, (step, result, facts) in enumerate(story(random.Random(seed), 8)):
        memory = SURE.acted(memory, step, result) if step else memory
        memory, judgement = SURE.looked(memory, answers(facts), cycle)
        assert judgement.seen == judgement.state == facts
        assert not judgement.contradictions
        assert not judgement.overruled


@given(rooms, rooms)
def test_a_clear_look_wins_against_memory_within_two_looks(before: dict[str, str], now: dict[str, str]) -> None:
    memory = NOISY.acted(settled(NOISY, before), None)
    _, judgement = after(NOISY, answers(truth(now)), answers(truth(now)), memory=memory)
    assert judgement.state == truth(now)


@given(rooms, st.sampled_from(ATOMS))
def test_one_wrong_answer_does_not_move_a_memory(where: dict[str, str], wrong: Atom) -> None:
    memory = NOISY.acted(settled(NOISY, where), None)
    memory, judgement = after(NOISY, answers(truth(where), frozenset([wrong])), memory=memory)
    assert judgement.state == truth(where)
    assert truth(where).entails(judgement.seen)
    _, judgement = after(NOISY, answers(truth(where)), memory=memory)
    assert judgement.seen == truth(where)


@pytest.mark.parametrize("place", PLACES)
def test_what_came_of_an_action_is_told_by_all_answers_together(place: str) -> None:
    thing, where = "cup", {"cup": HAND, "jug": "desk", "pot": "tray"}
    step = put(thing, place)
    memory = NOISY.acted(settled(NOISY, where), step, SkillResult(step, SkillStatus.DONE))
    moved = truth({**where, thing: place})
    for wrong in (frozenset[Atom](), *(frozenset([atom]) for atom in step.unconditional)):
        _, judgement = after(NOISY, answers(moved, wrong), memory=memory)
        assert judgement.came_about is not None
        assert judgement.came_about > 0.8
        assert judgement.state == moved
    _, judgement = after(NOISY, answers(truth(where)), memory=memory)
    assert judgement.came_about is not None
    assert judgement.came_about < 0.2
    assert judgement.state == truth(where)


def test_what_cannot_be_seen_keeps_its_value_and_age_and_never_takes_an_effect_for_granted() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    memory, _ = after(SURE, answers(truth(where)), cycle=3)
    step = pick("cup", "desk")
    memory = SURE.acted(memory, step, SkillResult(step, SkillStatus.DONE))
    visible = truth(where).without([*step.unconditional, at("jug", "rack")])
    memory, judgement = after(SURE, answers(visible), memory=memory, cycle=5)
    for atom in step.unconditional:
        assert judgement.truth(atom) is None
        assert judgement.remembered[atom].value is truth(where)[atom]
        assert judgement.age(atom) == 2
        assert judgement.state[atom] is truth(where)[atom]
    assert judgement.probability[held("cup")] > 0.8  # what the action model makes of it, which nobody takes for seen
    assert judgement.truth(at("jug", "rack")) is None
    assert judgement.remembered[at("jug", "rack")].value
    assert judgement.age(at("jug", "desk")) == 0


def test_a_memory_fades_and_is_never_taken_for_a_look() -> None:
    memory, judgement = after(SURE, answers(truth({"cup": "desk", "jug": "rack", "pot": "tray"})))
    probability = judgement.probability[at("jug", "rack")]
    for cycle in range(1, 30):
        memory, judgement = after(SURE, Belief(cycle, {}), memory=SURE.acted(memory, None), cycle=cycle)
        assert judgement.probability[at("jug", "rack")] < probability
        probability = judgement.probability[at("jug", "rack")]
        assert not judgement.seen
        assert judgement.age(at("jug", "rack")) == cycle
        assert judgement.state == truth({"cup": "desk", "jug": "rack", "pot": "tray"})


def test_an_answer_that_is_hardly_one_tells_nothing_even_where_memory_is_sure() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    unsure = dict.fromkeys(ATOMS, 0.55)
    _, judgement = after(NOISY, Belief(0, unsure), memory=NOISY.acted(settled(NOISY, where), None))
    assert judgement.probability[at("cup", "desk")] > 0.85
    assert not judgement.seen


def test_what_follows_from_the_answers_by_the_groups_is_told_too() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    _, judgement = after(SURE, answers(truth(where).only([at("cup", "desk"), *map(held, THINGS)])))
    assert judgement.truth(at("cup", "rack")) is False
    assert judgement.truth(FREE) is True
    assert judgement.truth(at("jug", "rack")) is None
    assert FREE in judgement.belief.probability
    _, judgement = after(SURE, answers(Facts({held("cup"): False, held("jug"): False})))
    assert judgement.truth(FREE) is None


def test_an_answer_too_weak_to_count_neither_settles_a_group_nor_keeps_it_from_being_settled() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    told = answers(truth(where).only([at("cup", "desk"), *map(held, THINGS)])).probability
    weak = {at("cup", "rack"): 0.55, FREE: 0.45, at("jug", "rack"): 0.6, at("jug", "desk"): 0.4}
    _, judgement = after(SURE, Belief(0, {**weak, **told}))
    assert judgement.truth(at("cup", "rack")) is False, "as if nothing had been said of it"
    assert judgement.truth(FREE) is True
    assert judgement.truth(at("jug", "rack")) is None
    assert judgement.truth(at("jug", "desk")) is None


def test_what_follows_from_many_slight_doubts_is_not_seen() -> None:
    """Each of the others is false at its threshold, and yet one of them may well be true."""
    group = Group(tuple(at("cup", str(place)) for place in range(6)), exact=True)
    monitor = BayesMonitor(MutexNetwork(group.atoms, (group,)), SensorModel(other=ErrorModel(0.3, 0.3)))
    said = Belief(0, dict.fromkeys(group.atoms[1:], 0.0))
    _, judgement = after(monitor, said)
    assert judgement.seen.false == set(group.atoms[1:])
    assert judgement.probability[group.atoms[0]] == pytest.approx(1.0 / (1.0 + 5 * 0.3 / 0.7))
    assert judgement.truth(group.atoms[0]) is None
    sure = BayesMonitor(monitor.network, EXACT)
    assert after(sure, said)[1].truth(group.atoms[0]) is True


def test_contradictions_are_named_with_both_answers_and_what_is_made_of_them() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    raw = Belief(7, {**answers(truth(where)).probability, at("cup", "rack"): 0.6, FREE: 0.2})
    _, judgement = after(NOISY, raw)
    two, none = judgement.contradictions
    assert two.answers == {at("cup", "desk"): 1.0, at("cup", "rack"): 0.6}
    assert two.resolved[at("cup", "desk")] > 0.8 > 0.2 > two.resolved[at("cup", "rack")]
    assert not two.exact
    assert none.exact
    assert none.answers == {FREE: 0.2, **{held(thing): 0.0 for thing in THINGS}}
    assert none.resolved[FREE] > 0.9
    assert judgement.belief.observation_id == 7
    assert judgement.state == truth(where)


def test_an_answer_that_memory_overrules_is_reported_as_such() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    wrong = held("pot")
    memory = NOISY.acted(settled(NOISY, where), None)
    _, judgement = after(NOISY, answers(truth(where), frozenset([wrong])), memory=memory)
    (said,) = [each for each in judgement.overruled if each.atom == wrong]
    assert (said.answered, said.answer, said.believed) == (True, 1.0, False)
    assert said.probability == judgement.probability[wrong] < 0.15


def test_without_memory_each_moment_starts_anew() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    look = answers(truth(where).only([at("cup", "desk")]))
    memory, first = after(FORGETFUL, look, look, look)
    memory, again = after(FORGETFUL, look, memory=FORGETFUL.acted(memory, None))
    assert again.probability == after(FORGETFUL, look)[1].probability
    assert again.probability[at("cup", "desk")] < first.probability[at("cup", "desk")]
    assert again.came_about is None


def test_looks_that_err_together_are_worth_less_than_others() -> None:
    wrong = answers(truth({"cup": "desk", "jug": "rack", "pot": "tray"}))
    alike = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(0.05, 0.05), correlation_within=1.0))
    assert after(alike, *[wrong] * 5)[1].probability == pytest.approx(after(alike, wrong)[1].probability)
    apart = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(0.05, 0.05), correlation_within=0.0))
    assert after(apart, *[wrong] * 5)[1].probability[FREE] > after(alike, wrong)[1].probability[FREE]


def test_thresholds_are_per_predicate() -> None:
    never = Thresholds(0.0, 1.1)
    monitor = BayesMonitor(NETWORK, EXACT, thresholds={"held": never})
    _, judgement = after(monitor, answers(truth({"cup": "desk", "jug": "rack", "pot": "tray"})))
    assert all(judgement.truth(held(thing)) is None for thing in THINGS)
    assert judgement.truth(at("cup", "desk")) is True


@pytest.mark.parametrize("status", SkillStatus)
def test_whatever_a_skill_says_two_looks_tell_what_is_so(status: SkillStatus) -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    step = pick("cup", "desk")
    counts = {("pick", status): Chances(1000, 0, 0)}
    monitor = replace(NOISY, actions=ActionModel(counts))
    memory = monitor.acted(settled(monitor, where), step, SkillResult(step, status))
    for now in ("desk", "rack", FLOOR, HAND):
        facts = truth({**where, "cup": now})
        assert after(monitor, answers(facts), answers(facts), memory=memory)[1].state == facts


def test_without_groups_each_atom_is_on_its_own() -> None:
    lamps = tuple(Atom("lit", (name,)) for name in "abc")
    monitor = BayesMonitor(MutexNetwork(lamps), SensorModel(other=ErrorModel(0.1, 0.1)))
    step = Step.strips("press", ("a",), Facts(), Facts({lamps[0]: True}))
    memory, judgement = after(monitor, Belief(0, dict.fromkeys(lamps, 0.0)))
    assert judgement.probability == pytest.approx(dict.fromkeys(lamps, 0.1))
    memory = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))
    _, judgement = after(monitor, Belief(1, {lamps[0]: 1.0, lamps[1]: 0.0}), memory=memory)
    assert judgement.seen == Facts({lamps[0]: True, lamps[1]: False})


def test_a_model_that_leans_the_same_way_cycle_after_cycle_is_not_believed_more_for_it() -> None:
    """The can lies across two tables all day, and is taken to lie on one of them with the same doubt in every look."""
    leaning = Belief(0, {**answers(truth({"cup": "desk", "jug": "rack", "pot": "rack"})).probability})
    leaning = replace(leaning, probability={**leaning.probability, at("cup", "desk"): 0.75, at("cup", "tray"): 0.25})
    chance = {}
    for correlation in (0.0, 0.8):
        monitor = BayesMonitor(NETWORK, SensorModel(other=ErrorModel(1e-3, 1e-3), correlation_across=correlation))
        memory, judgement = monitor.looked(monitor.begin(), leaning, 0)
        for cycle in range(1, 12):  # other things are moved meanwhile
            step = pick("jug", "rack") if cycle % 2 else put("jug", "rack")
            memory = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))
            facts = truth({"cup": "desk", "jug": HAND if cycle % 2 else "rack", "pot": "rack"})
            look = replace(
                leaning, probability={**answers(facts).probability, **{atom: leaning.probability[atom] for atom in CUP}}
            )
            memory, judgement = monitor.looked(memory, look, cycle)
        chance[correlation] = judgement.probability[at("cup", "desk")]
    assert chance[0.0] > 0.99 > 0.95 > chance[0.8] > 0.75


CUP = [atom for atom in ATOMS if atom.args and atom.args[0] == "cup"]


def test_groups_that_share_several_atoms_keep_what_is_believed() -> None:
    """Divided by each atom that they share, as by one, what is improbable would become probable."""
    a, b, *others = (Atom(name) for name in "abcdefg")
    groups = tuple(Group((a, b, other), exact=True) for other in others)
    network = MutexNetwork((a, b, *others), groups)
    filter_ = BayesMonitor(network, SensorModel(correlation_within=0.0))
    memory, judged = filter_.looked(filter_.begin(), Belief(0, {a: 0.95, b: 0.05, **dict.fromkeys(others, 0.05)}), 0)
    assert judged.state.true == {a}
    for cycle in range(1, 6):
        memory, judged = filter_.looked(filter_.acted(memory, None), Belief(cycle, {}), cycle)
        assert judged.state.get(a) or judged.probability[a] > 0.5
        assert judged.probability[b] < 0.5
    assert BayesMonitor(MutexNetwork((a, b, *others), (groups[0], Group((a, *others[1:])))))._clusters == {}
