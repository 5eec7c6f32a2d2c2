"""What answers are worth, what comes of actions, and the monitor that takes every answer at its word."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief.action_model import DEFAULTS, PRIOR, ActionModel, Chances, affected, outcome, with_effects
from executive.belief.interface import Monitor, Thresholds
from executive.belief.sensor_model import EXACT, ErrorModel, PastEvidence, SensorModel
from executive.belief.threshold import ThresholdMonitor
from executive.types import Atom, Belief, Facts, SkillStatus
from tests.executive.belief.hands import ATOMS, NETWORK, answers, truth
from tests.fakes import FREE, at, held, pick

rates = st.floats(0.001, 0.49)
probabilities = st.floats(0.0, 1.0)


@given(rates, rates, st.floats(0.0, 3.0), st.floats(-2.0, 2.0), probabilities, probabilities)
def test_evidence_keeps_the_order_of_answers_and_is_worth_no_more_than_a_plain_one(
    false_alarms: float, misses: float, slope: float, bias: float, one: float, other: float
) -> None:
    reading = ErrorModel(false_alarms, misses, slope, bias)
    low, high = sorted((one, other))
    assert reading.evidence(low) <= reading.evidence(high)
    assert math.log(misses / (1 - false_alarms)) <= reading.evidence(one) <= math.log((1 - misses) / false_alarms)


@given(rates, rates)
def test_a_plain_answer_is_worth_how_much_more_often_it_is_right(false_alarms: float, misses: float) -> None:
    reading = ErrorModel(false_alarms, misses)
    assert reading.evidence(1.0) == pytest.approx(math.log((1 - misses) / false_alarms))
    assert reading.evidence(0.0) == pytest.approx(math.log(misses / (1 - false_alarms)))
    assert reading.evidence(0.5) == 0.0


@given(st.floats(0.0, 1.0), st.lists(st.floats(-5, 5), min_size=1, max_size=6))
def test_looks_together_are_worth_as_much_as_one_to_all_of_them(correlation: float, evidence: list[float]) -> None:
    pooled = SensorModel(correlation_within=correlation).pooled(evidence)
    mean = math.fsum(evidence) / len(evidence)
    assert min(abs(mean), abs(math.fsum(evidence))) - 1e-9 <= abs(pooled) <= abs(math.fsum(evidence)) + 1e-9
    assert SensorModel(correlation_within=1.0).pooled(evidence) == pytest.approx(mean)
    assert SensorModel(correlation_within=0.0).pooled(evidence) == pytest.approx(math.fsum(evidence))


@pytest.mark.parametrize(
    "values", [{"misses": 0.0}, {"false_alarms": 1.0}, {"misses": 0.6, "false_alarms": 0.5}, {"slope": -1.0}]
)
def test_a_reading_refuses_nonsense(values: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        ErrorModel(**values)


def test_an_eye_reads_each_predicate_by_its_own_rates() -> None:
    eye = SensorModel({"held": ErrorModel(0.2, 0.2)})
    assert eye.evidence(held("cup"), 1.0) == pytest.approx(math.log(4))
    assert eye.evidence(at("cup", "desk"), 1.0) == pytest.approx(math.log(19))
    assert EXACT.evidence(FREE, 1.0) > 13
    with pytest.raises(ValueError, match="from 0 to 1"):
        SensorModel(correlation_within=1.5)


def test_every_status_has_default_chances() -> None:
    assert set(DEFAULTS) == set(SkillStatus)
    for chances in DEFAULTS.values():
        assert sum(chances) == pytest.approx(1.0)
        assert min(chances) > 0


@given(st.tuples(*[st.integers(0, 5000)] * 3), st.sampled_from(SkillStatus))
def test_chances_go_from_the_defaults_to_what_was_counted(counts: tuple[int, int, int], status: SkillStatus) -> None:
    model = ActionModel({("pick", status): Chances(*counts)})
    chances, total = model.chances("pick", status), sum(counts)
    assert sum(chances) == pytest.approx(1.0)
    assert min(chances) > 0
    for chance, count, assumed in zip(chances, counts, DEFAULTS[status], strict=True):
        assert chance == pytest.approx((count + PRIOR * assumed) / (total + PRIOR))
    assert model.chances("place", status) == pytest.approx(DEFAULTS[status])


def test_outcomes_are_told_apart() -> None:
    where = {"cup": "desk", "jug": "rack", "pot": "tray"}
    step, before = pick("cup", "desk"), truth(where)
    assert outcome(step, before, truth({**where, "cup": "hand"})) == Chances(1, 0, 0)
    assert outcome(step, before, before) == Chances(0, 1, 0)
    assert outcome(step, before, truth({**where, "cup": "floor"})) == Chances(0, 0, 1)
    assert outcome(step, before, truth({**where, "jug": "tray"})) == Chances(0, 1, 0)


def test_effects_displace_what_cannot_be_beside_them_and_leave_the_rest() -> None:
    partners = {atom: frozenset(m for g in NETWORK.groups_of[atom] for m in g.atoms) - {atom} for atom in ATOMS}
    step, even = pick("cup", "desk"), dict.fromkeys(ATOMS, 0.4)
    now = with_effects(even, step, partners)
    assert (now[held("cup")], now[at("cup", "desk")], now[at("cup", "rack")], now[FREE]) == (1.0, 0.0, 0.0, 0.0)
    assert (now[held("jug")], now[at("jug", "rack")]) == (0.0, 0.4)
    open_ = {FREE, held("cup"), *(at("cup", place) for place in ("desk", "rack", "tray"))}
    assert affected(step, partners) == open_


def test_the_action_model_refuses_nonsense() -> None:
    with pytest.raises(ValueError, match="process_noise"):
        ActionModel(process_noise=0.0)
    with pytest.raises(ValueError, match="counts have to be"):
        ActionModel({("pick", SkillStatus.DONE): Chances(-1, 0, 0)})


partial = st.dictionaries(st.sampled_from(ATOMS), probabilities)


@given(st.lists(partial, min_size=1, max_size=4), st.floats(0.0, 1.0))
def test_taken_at_its_word_the_last_answer_counts_and_what_no_look_tells_is_remembered(
    looks: list[dict[Atom, float]], threshold: float
) -> None:
    monitor = ThresholdMonitor(ATOMS, Thresholds(threshold, threshold))
    typed: Monitor = monitor
    memory = typed.begin()
    told: dict[Atom, float] = {}
    for cycle, look in enumerate(looks):
        memory, judgement = monitor.looked(memory, Belief(cycle, look), cycle)
        told |= look
        assert judgement.seen == Facts({atom: value >= threshold for atom, value in told.items()})
        assert judgement.belief.probability == told
        assert judgement.belief.unanswered == set(ATOMS) - told.keys()
        assert judgement.state == Facts.closed(judgement.seen.true, ATOMS)
    memory, judgement = monitor.looked(monitor.acted(memory, None), Belief(9, {}), len(looks))
    assert not judgement.seen
    assert {atom: each.value for atom, each in judgement.remembered.items()} == {
        atom: value >= threshold for atom, value in told.items()
    }
    assert all(judgement.age(atom) is None for atom in set(ATOMS) - told.keys())


def test_atoms_of_another_task_are_passed_over() -> None:
    judgement = ThresholdMonitor(ATOMS).looked(
        ThresholdMonitor(ATOMS).begin(), Belief(0, {Atom("lit", ("lamp",)): 1.0}), 0
    )[1]
    assert not judgement.seen


def test_the_least_certain_come_first() -> None:
    where = answers(truth({"cup": "desk", "jug": "rack", "pot": "tray"})).probability
    unsure = {**where, FREE: 0.6, held("cup"): 0.5}
    _, judgement = ThresholdMonitor(ATOMS).looked(ThresholdMonitor(ATOMS).begin(), Belief(0, unsure), 0)
    assert judgement.least_certain(ATOMS)[:2] == (held("cup"), FREE)
    assert judgement.least_certain([]) == ()


@given(st.floats(0.01, 1.0), st.floats(0.7, 6.0), st.integers(1, 30))
def test_the_same_answer_about_what_nothing_has_touched_never_adds_up_to_certainty(
    correlation: float, worth: float, looks: int
) -> None:
    """n answers of worth e count for n e / (1 + (n - 1) a): e / a at most, and all of them where a is 0."""
    sensor, earlier = SensorModel(correlation_across=correlation), PastEvidence((worth,), worth)
    for _ in range(looks):
        believed = earlier.believed + sensor.increment(worth, earlier)
        assert worth - 1e-9 <= believed <= worth / correlation + 1e-9
        earlier = earlier.with_look(worth, believed)
    assert len(earlier.evidence) == looks + 1
    assert SensorModel().increment(worth, earlier) == worth


@given(st.floats(0.1, 1.0), st.lists(st.floats(0.7, 8.0), min_size=1, max_size=9), st.floats(0.7, 8.0))
def test_a_look_that_is_surer_than_all_before_it_is_one_of_them(
    correlation: float, said: list[float], now: float
) -> None:
    sensor, earlier = SensorModel(correlation_across=correlation), PastEvidence(tuple(said), said[-1])
    believed = earlier.believed + sensor.increment(now, earlier)
    pooled = SensorModel(correlation_within=correlation).pooled([*said, now])
    assert believed == pytest.approx(pooled)


def test_what_says_otherwise_counts_in_full_and_begins_anew() -> None:
    sensor, earlier = SensorModel(correlation_across=0.8), PastEvidence((2.0, 2.0), 2.0)
    assert sensor.increment(-3.0, earlier) == -3.0
    assert earlier.with_look(-3.0, -1.0) == PastEvidence((-1.0,), -1.0)
    assert sensor.increment(0.3, earlier) == 0.3, "what says next to nothing takes nothing away"
    assert earlier.with_look(0.3, 2.1) == PastEvidence((2.0, 2.0), 2.1)
