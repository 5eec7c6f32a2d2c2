"""Scores obey their definitions, whatever the answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sklearn.metrics import average_precision_score

from executive.lab.evaluation.metrics import THRESHOLDS, Answers, average_precision, curve, never_true, scores
from executive.types import Atom

PROBABILITIES = st.one_of(st.floats(0.0, 1.0), st.sampled_from([0.3, 0.5, 0.7, math.nan]))


@st.composite
def answers(draw: st.DrawFn, looks: int = 12, atoms: int = 5) -> Answers:
    shape = (draw(st.integers(1, looks)), draw(st.integers(1, atoms)))
    probability = draw(arrays.arrays(np.float64, shape, elements=PROBABILITIES))
    truth = draw(arrays.arrays(np.bool_, shape))
    names = tuple(Atom("on" if index % 2 else "held", (f"a{index}",)) for index in range(shape[1]))
    return Answers(names, probability, truth)


def answered(probability: list[list[float]], truth: list[list[bool]]) -> Answers:
    atoms = tuple(Atom("p", (f"a{index}",)) for index in range(len(truth[0])))
    return Answers(atoms, np.array(probability), np.array(truth))


@given(answers())
def test_a_mistake_is_missed_or_a_false_alarm(given_: Answers) -> None:
    made = scores(given_)
    accuracy, exact = made.accuracy[0.5], made.exact_state
    assert accuracy is not None
    assert exact is not None
    assert made.missed + made.false_alarms == round((1.0 - accuracy) * made.asked)
    assert made.missed <= made.positives <= made.asked
    assert exact <= accuracy + 1e-9
    wrong = sum(
        math.isnan(p) or (p >= 0.5) is not bool(t)
        for p, t in zip(given_.probability.ravel().tolist(), given_.truth.ravel().tolist(), strict=True)
    )
    assert wrong == made.missed + made.false_alarms


@given(answers(), st.integers(0, 2**32))
def test_no_order_of_looks_or_atoms_matters(given_: Answers, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = rng.permutation(given_.looks), rng.permutation(len(given_.atoms))
    shuffled = Answers(
        tuple(given_.atoms[column] for column in columns),
        given_.probability[rows][:, columns],
        given_.truth[rows][:, columns],
    )
    one, other = scores(given_).document(), scores(shuffled).document()
    assert one == {
        key: pytest.approx(value, nan_ok=True) if value is not None else None for key, value in other.items()
    }


@given(answers())
def test_the_whole_is_made_of_its_parts(given_: Answers) -> None:
    whole, each = scores(given_), [scores(given_.of(atom)) for atom in given_.atoms]
    parts = [scores(given_.of(name)) for name in given_.predicates]
    for counted in ("asked", "positives", "unanswered", "missed", "false_alarms"):
        total = getattr(whole, counted)
        assert total == sum(getattr(one, counted) for one in each) == sum(getattr(one, counted) for one in parts)
    known = [one.ap_micro for one in each if one.ap_micro is not None]
    assert len(known) == len(given_.atoms) - len(list(never_true(given_)))
    assert whole.ap_macro == (pytest.approx(np.mean(known)) if known else None)
    assert [one.ap_macro for one in each] == [one.ap_micro for one in each]


@given(answers())
def test_only_the_order_of_probabilities_counts_for_average_precision(given_: Answers) -> None:
    squeezed = Answers(given_.atoms, np.round(given_.probability, 2) / 2, given_.truth)
    coarse = Answers(given_.atoms, np.round(given_.probability, 2), given_.truth)
    assert average_precision(squeezed) == pytest.approx(average_precision(coarse))


@given(answers())
def test_average_precision_is_the_area_below_the_steps_of_the_curve(given_: Answers) -> None:
    recall, precision = curve(given_)
    value = average_precision(given_)
    if value is None:
        assert not given_.truth.any()
        assert recall.size == precision.size == 0
        return
    assert recall[0] == 0.0
    assert recall[-1] == pytest.approx(1.0)
    assert (np.diff(recall) >= 0).all()
    assert value == pytest.approx(float(np.sum(np.diff(recall) * precision[1:])))


def test_macro_is_the_mean_over_atoms_however_rare() -> None:
    """One predicate with two atoms; a mean over predicates, or over answers, would be another number."""
    truth = [[True, False], [True, True], [True, False], [True, False]]
    probability = [[0.9, 0.8], [0.9, 0.2], [0.9, 0.7], [0.9, 0.6]]
    made = scores(answered(probability, truth))
    assert made.ap_macro == pytest.approx((1.0 + 0.25) / 2)
    pooled = average_precision_score(np.array(truth).ravel(), np.array(probability).ravel())
    assert made.ap_micro == pytest.approx(pooled)
    assert made.ap_micro != pytest.approx(made.ap_macro)


def test_an_atom_that_is_never_true_is_left_out_of_macro() -> None:
    given_ = answered([[0.9, 0.9], [0.1, 0.9]], [[True, False], [False, False]])
    made = scores(given_)
    assert made.ap_macro == 1.0
    assert list(never_true(given_)) == [given_.atoms[1]]


def test_what_is_unanswered_is_right_at_no_threshold_and_claimed_last() -> None:
    nan = math.nan
    made = scores(answered([[nan, nan], [0.2, 0.9]], [[True, False], [False, True]]))
    assert [made.accuracy[threshold] for threshold in THRESHOLDS] == [0.5, 0.5, 0.5]
    assert (made.unanswered, made.missed, made.false_alarms) == (2, 1, 1)
    assert made.exact_state == 0.5
    assert made.ece == pytest.approx(0.15)  # of the two that were answered
    assert made.brier == pytest.approx((0.04 + 0.01) / 2)
    assert made.ap_micro == pytest.approx(0.5 * 1.0 + 0.5 * 2 / 4)


def test_the_threshold_itself_counts_as_true() -> None:
    """The paper's Section 4: Y >= theta."""
    made = scores(answered([[0.3, 0.5, 0.7]], [[True, True, True]]))
    assert [made.accuracy[threshold] for threshold in THRESHOLDS] == pytest.approx([1.0, 2 / 3, 1 / 3])


def test_nothing_at_all_has_no_score() -> None:
    none = scores(Answers((Atom("p"),), np.empty((0, 1)), np.empty((0, 1), dtype=bool)))
    assert (none.ap_micro, none.ap_macro, none.exact_state, none.ece, none.brier) == (None,) * 5
    assert (none.asked, none.missed) == (0, 0)


@pytest.mark.parametrize(
    ("probability", "truth", "atoms"),
    [
        ([[0.5, 0.5]], [[True]], 1),
        ([[0.5, 0.5]], [[True, True]], 1),
        ([[1.5]], [[True]], 1),
        ([[-0.1]], [[True]], 1),
    ],
)
def test_answers_that_are_none_are_refused(probability: list[list[float]], truth: list[list[bool]], atoms: int) -> None:
    with pytest.raises(ValueError, match=r"match|columns|probability"):
        Answers(tuple(Atom("p", (f"a{n}",)) for n in range(atoms)), np.array(probability), np.array(truth))


@given(answers(), st.integers(0, 2**32))
def test_columns_that_are_other_atoms_in_each_look_come_to_the_same(given_: Answers, seed: int) -> None:
    rng = np.random.default_rng(seed)
    order = np.argsort(rng.random(given_.truth.shape), axis=1)
    pad = np.full((given_.looks, 2), -1)
    mixed = Answers(
        given_.atoms,
        np.concatenate([np.take_along_axis(given_.probability, order, 1), np.full(pad.shape, np.nan)], axis=1),
        np.concatenate([np.take_along_axis(given_.truth, order, 1), np.zeros(pad.shape, np.bool_)], axis=1),
        np.concatenate([order, pad], axis=1),
    )
    assert list(never_true(mixed)) == list(never_true(given_))
    for one, other in (
        (scores(mixed), scores(given_)),
        *((scores(mixed.of(name)), scores(given_.of(name))) for name in given_.predicates),
    ):
        for name, value in one.document().items():
            wanted = other.document()[name]
            assert value == (None if wanted is None else pytest.approx(wanted)), name


@given(answers(), st.integers(0, 2**32))
def test_answers_apart_make_the_whole(given_: Answers, seed: int) -> None:
    some = np.random.default_rng(seed).random(given_.truth.shape) < 0.5
    one, other, whole = scores(given_.only(some)), scores(given_.only(~some)), scores(given_)
    for counted in ("asked", "positives", "unanswered", "missed", "false_alarms"):
        assert getattr(one, counted) + getattr(other, counted) == getattr(whole, counted)
