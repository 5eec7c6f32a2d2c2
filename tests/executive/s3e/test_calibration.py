"""Laws of calibration: it keeps the order and the bounds, leaves alone what is right, and mends what is not."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image as Picture

from executive.errors import InputError
from executive.s3e.calibration import Calibration, Method, Scaling, fit
from executive.s3e.calibration_file import FILE
from executive.s3e.reliability import Bin, expected_calibration_error, pairs, plot_reliability, reliability
from executive.types import Atom, Belief, Evidence, Facts

probabilities = st.floats(0.0, 1.0)
scalings = st.builds(
    Scaling, st.floats(0.01, 50.0), st.floats(-10.0, 10.0), st.integers(0, 10_000), st.integers(0, 10_000)
)
names = st.sampled_from(["on", "held", "free", "at-home", "x_1"])
calibrations = st.builds(
    Calibration, scalings, st.dictionaries(names, scalings), st.sampled_from(Method), st.text(max_size=8)
)
Look = tuple[Belief, Facts]


def sigmoid(odds: float) -> float:
    return 1 / (1 + math.exp(-odds))


def looks(
    count: int, seed: int, slope: float = 1.0, bias: float = 0.0, predicate: str = "on", rate: float = 0.4
) -> list[Look]:
    """Labelled looks of ten atoms. Truth is drawn from what the model ought to say; what it says is distorted, so that
    its log-odds times `slope` plus `bias` are the right ones."""
    rng = np.random.default_rng(seed)
    atoms = [Atom(predicate, (f"a{index}",)) for index in range(10)]
    made = []
    for number in range(count):
        right = rng.beta(2 * rate, 2 * (1 - rate), size=len(atoms)).clip(1e-2, 1 - 1e-2)
        said = [sigmoid((math.log(p / (1 - p)) - bias) / slope) for p in right]
        truth = Facts(dict(zip(atoms, (rng.random(len(atoms)) < right).tolist(), strict=True)))
        made.append((Belief(number, dict(zip(atoms, said, strict=True)), source="s3e:tiny"), truth))
    return made


def answers(made: list[Look], calibrated: Calibration | None = None) -> list[tuple[float, bool]]:
    return [pair for belief, truth in made for pair in pairs(calibrated.apply(belief) if calibrated else belief, truth)]


# A correction


@given(scalings, probabilities, probabilities)
def test_a_correction_keeps_order_and_bounds(scaling: Scaling, one: float, other: float) -> None:
    low, high = sorted((scaling(one), scaling(other)))
    assert 0.0 <= low <= high <= 1.0
    assert (scaling(one) <= scaling(other)) if one <= other else (scaling(one) >= scaling(other))


@given(scalings, probabilities)
def test_a_correction_is_what_it_says(scaling: Scaling, probability: float) -> None:
    assume(1e-6 < probability < 1 - 1e-6)
    odds = scaling.slope * math.log(probability / (1 - probability)) + scaling.bias
    assume(abs(odds) < 700)
    assert scaling(probability) == pytest.approx(sigmoid(odds), abs=1e-9)


@given(probabilities)
def test_no_correction_changes_nothing(probability: float) -> None:
    assert Calibration()(Atom("on"), probability) == pytest.approx(probability, abs=2e-6)


@pytest.mark.parametrize("probability", [-0.1, 1.1, math.nan])
def test_only_probabilities_are_corrected(probability: float) -> None:
    with pytest.raises(ValueError, match="not a probability"):
        Scaling()(probability)


@pytest.mark.parametrize(("slope", "bias"), [(0.0, 0.0), (-1.0, 0.0), (math.nan, 0.0), (math.inf, 0.0), (1, math.inf)])
def test_a_correction_that_loses_the_order_cannot_be_made(slope: float, bias: float) -> None:
    with pytest.raises(ValueError, match="order"):
        Scaling(slope, bias)


def test_applying_it_touches_probabilities_alone() -> None:
    on, free = Atom("on", ("a",)), Atom("free")
    evidence = {on: (Evidence(("front",), 0.8, 0.1),)}
    belief = Belief(7, {on: 0.9}, frozenset({free}), "s3e:tiny", evidence)
    corrected = Calibration(predicates={"on": Scaling(1.0, -1.0)}).apply(belief)
    assert corrected.probability == {on: pytest.approx(sigmoid(math.log(9) - 1))}
    assert belief.probability == {on: 0.9}
    assert (corrected.observation_id, corrected.unanswered, corrected.source) == (7, frozenset({free}), "s3e:tiny")
    assert corrected.evidence == evidence


def test_a_predicate_that_was_not_seen_gets_the_shared_correction() -> None:
    calibrated = Calibration(Scaling(1.0, 1.0), {"on": Scaling(1.0, -1.0)})
    assert calibrated(Atom("on"), 0.5) < 0.5 < calibrated(Atom("held"), 0.5)


# Learning it


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(Method))
def test_what_is_right_already_changes_little(seed: int, method: Method) -> None:
    calibrated = fit(looks(400, seed), method)
    for probability in (0.05, 0.3, 0.5, 0.7, 0.95):
        assert calibrated(Atom("on"), probability) == pytest.approx(probability, abs=0.04)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.4, 0.7), st.floats(-1.0, 1.0))
def test_what_is_too_sure_is_mended_on_other_looks_of_the_same_kind(seed: int, slope: float, bias: float) -> None:
    calibrated = fit(looks(300, seed, slope, bias))
    unseen = looks(300, seed + 1, slope, bias)
    before = expected_calibration_error(answers(unseen))
    after = expected_calibration_error(answers(unseen, calibrated))
    assert after < min(0.05, before)
    scaling = calibrated.predicates["on"]
    assert scaling.slope == pytest.approx(slope, rel=0.25)
    assert scaling.bias == pytest.approx(bias, abs=0.3)


def test_temperature_has_no_bias_and_mends_what_needs_none() -> None:
    calibrated = fit(looks(300, 1, 0.4), "temperature")
    assert {scaling.bias for scaling in (calibrated.shared, *calibrated.predicates.values())} == {0.0}
    unseen = looks(300, 2, 0.4)
    assert expected_calibration_error(answers(unseen, calibrated)) < expected_calibration_error(answers(unseen)) / 2


def test_predicates_are_corrected_one_by_one() -> None:
    calibrated = fit([*looks(300, 1, 0.5, 1.0, "on"), *looks(300, 2, 1.0, -1.0, "held")])
    assert calibrated.predicates["on"].slope == pytest.approx(0.5, rel=0.2)
    assert calibrated.predicates["on"].bias == pytest.approx(1.0, abs=0.25)
    assert calibrated.predicates["held"].slope == pytest.approx(1.0, rel=0.2)
    assert calibrated.predicates["held"].bias == pytest.approx(-1.0, abs=0.25)


def test_the_fewer_examples_the_nearer_to_the_shared_correction() -> None:
    def distance(rare: list[Look]) -> float:
        calibrated = fit([*looks(300, 1, 1.0, -1.0, "on"), *rare])
        return abs(calibrated.predicates["held"].bias - calibrated.shared.bias)

    many, few = looks(100, 2, 1.0, 2.0, "held"), looks(1, 2, 1.0, 2.0, "held")
    assert distance(few) < distance(many)
    calibrated = fit([*looks(300, 1, 0.5, -1.0, "on"), *looks(300, 2, 1.0, 2.0, "held")])
    slopes = sorted(scaling.slope for scaling in calibrated.predicates.values())
    assert slopes[0] < calibrated.shared.slope < slopes[1]
    always = [(Belief(0, {Atom("held"): 0.9}), Facts({Atom("held"): True}))] * 50
    assert distance(always) == 0.0  # it was never false: nothing is known of its own


def test_perfect_separation_and_single_labels_stay_finite() -> None:
    on = Atom("on")
    separated = [(Belief(0, {on: p}), Facts({on: p > 0.5})) for p in (0.0, 0.2, 0.8, 1.0)] * 5
    for data in (separated, separated[:1], [(Belief(0, {on: 0.5}), Facts({on: True}))] * 3):
        for method in Method:
            calibrated = fit(data, method)
            assert 0.0 <= calibrated(on, 0.0) <= calibrated(on, 0.5) <= calibrated(on, 1.0) <= 1.0


def test_answers_that_say_the_opposite_are_not_turned_round() -> None:
    opposite = [(belief, Facts({atom: not true for atom, true in truth.items()})) for belief, truth in looks(200, 3)]
    calibrated = fit(opposite)
    assert calibrated(Atom("on"), 0.1) < calibrated(Atom("on"), 0.9)
    rate = np.mean([true for _, truth in opposite for true in truth.values()])
    assert calibrated(Atom("on"), 0.5) == pytest.approx(rate, abs=0.03)


def test_neither_the_order_of_looks_nor_that_of_atoms_matters() -> None:
    data = [*looks(30, 1, 0.5, 1.0, "on"), *looks(30, 2, 2.0, 0.0, "held")]
    one, other = fit(data), fit(data[::-1])
    for predicate, scaling in one.predicates.items():
        assert (other.predicates[predicate].slope, other.predicates[predicate].bias) == pytest.approx(
            (scaling.slope, scaling.bias), rel=1e-4, abs=1e-4
        )


def test_a_correction_is_adopted_where_held_out_looks_get_better_by_it() -> None:
    wrong, right = looks(200, 1, slope=0.4, bias=-1.0, predicate="wrong"), looks(200, 2, predicate="right")
    units = [number // 10 for number in range(200)]
    fitted = fit([*wrong, *right], units=[*units, *units])
    assert fitted.predicates["wrong"].slope == pytest.approx(0.4, abs=0.05)
    again = looks(300, 3, slope=0.4, bias=-1.0, predicate="wrong")
    before, after = (expected_calibration_error(answers(again, made)) for made in (None, fitted))
    assert after < 0.03 < before
    error = expected_calibration_error(answers(looks(300, 4, predicate="right"), fitted))
    assert error < 0.03


def test_a_correction_that_does_not_carry_over_is_not_adopted() -> None:
    """Each problem has a share of true atoms of its own, and what is learned of some is wrong about the others."""
    made, units = [], []
    for unit in range(12):
        for look in looks(3, unit, rate=0.5, predicate="on"):
            made.append((look[0], Facts(dict.fromkeys(look[1], unit % 4 < 2))))
            units.append(unit)
    said = [(Belief(0, dict.fromkeys(belief.probability, 0.5)), truth) for belief, truth in made]
    assert fit(said, units=units).predicates["on"] == Scaling(1.0, 0.0, 180, 180)
    assert fit(said[:6], units=units[:6]).predicates["on"] != Scaling(1.0, 0.0, 60, 0), "too few problems to hold out"


def test_each_look_has_a_unit() -> None:
    with pytest.raises(ValueError, match="zip"):
        fit(looks(10, 1), units=[1, 2, 3])


def test_what_has_no_label_or_no_answer_does_not_count() -> None:
    on, held, free = Atom("on"), Atom("held"), Atom("free")
    calibrated = fit([(Belief(0, {on: 0.9, held: 0.2}, frozenset({free})), Facts({on: True, free: True}))])
    assert set(calibrated.predicates) == {"on"}
    assert (calibrated.shared.true, calibrated.shared.false) == (1, 0)
    for nothing in ([], [(Belief(0, {on: 0.9}), Facts({held: True}))]):
        with pytest.raises(InputError, match="nothing to learn from"):
            fit(nothing)


def test_it_remembers_whose_answers_it_corrects() -> None:
    assert fit(looks(5, 1)).model == "s3e:tiny"
    assert fit(looks(5, 1), model="other").model == "other"


# The file


@given(calibrations)
def test_what_is_saved_is_loaded(tmp_path_factory: pytest.TempPathFactory, calibrated: Calibration) -> None:
    folder = tmp_path_factory.mktemp("model")
    file = calibrated.save(folder)
    assert file == folder / FILE
    assert Calibration.load(folder) == calibrated == Calibration.load(file)
    assert [path.name for path in folder.iterdir()] == [FILE]


def test_a_person_can_read_it(tmp_path: Path) -> None:
    document = json.loads(fit(looks(50, 1)).save(tmp_path / "sub" / "tiny.json").read_text())
    assert document["format"] == 2
    assert document["correction"]["method"] == "platt"
    assert document["correction"]["predicates"]["on"].keys() == {"slope", "bias", "true", "false"}


def test_a_write_that_fails_leaves_the_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = Calibration(Scaling(2.0, 1.0)).save(tmp_path).read_bytes()

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        Calibration().save(tmp_path)
    assert (tmp_path / FILE).read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def edited(**changes: Any) -> str:
    correction: dict[str, Any] = {
        "method": "platt",
        "shared": {"slope": 1.0, "bias": 0.0},
        "predicates": {"on": {"slope": 1.5, "bias": -0.5, "true": 3, "false": 4}},
    }
    good: dict[str, Any] = {"format": 2, "model": "tiny", "correction": correction}
    for key, value in changes.items():
        (correction if key in correction else good)[key] = value
    return json.dumps({key: value for key, value in good.items() if value is not None})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not JSON"),
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "not a calibration"),
        (edited(format=3), "format: expected 2, got 3"),
        (edited(format=None), "format: expected 2, got None"),
        (edited(method="isotonic"), "correction.method: no method 'isotonic'; valid: platt, temperature"),
        (edited(model=3), "model: should be a valid string, got 3"),
        (edited(extra=1), "extra: unknown key"),
        (edited(correction=None), "correction: is missing"),
        (edited(shared=None), "correction.shared: should be"),
        (edited(shared={"slope": 1.0}), "correction.shared.bias: is missing"),
        (edited(shared={"slope": "1", "bias": 0}), "correction.shared.slope: should be a valid number, got '1'"),
        (edited(shared={"slope": -1, "bias": 0}), "correction.shared: slope -1.0 and bias 0.0 do not keep the order"),
        (edited(shared={"slope": True, "bias": 0}), "correction.shared.slope: should be a valid number"),
        (edited(shared={"slope": math.nan, "bias": 0}), "do not keep the order"),
        (edited(shared={"slope": 10**400, "bias": 0}), "correction.shared"),
        (edited(predicates=[1]), "correction.predicates: should be a table"),
        (
            edited(predicates={"on": {"slope": 1, "bias": 0, "tru": 3}}),
            "correction.predicates.on.tru: unknown key; did you mean",
        ),
        (edited(predicates={"on": {"slope": 1, "bias": 0, "true": 1.5}}), "correction.predicates.on.true: should be"),
        (edited(predicates={"on": {"slope": 1, "bias": 0, "true": -1}}), "correction.predicates.on: -1 labels"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / FILE
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        Calibration.load(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        Calibration.load(tmp_path)
    (tmp_path / FILE).write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="is not JSON"):
        Calibration.load(tmp_path)


# How good it is


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_perfectly_calibrated_has_next_to_no_error(seed: int) -> None:
    assert expected_calibration_error(answers(looks(2000, seed))) < 0.02


@given(st.lists(st.tuples(probabilities, st.booleans()), max_size=40), st.integers(1, 20))
def test_bins_hold_every_answer_once(answered: list[tuple[float, bool]], bins: int) -> None:
    binned = reliability(answered, bins)
    assert sum(entry.count for entry in binned) == len(answered)
    assert sum(entry.count * entry.rate for entry in binned) == pytest.approx(sum(true for _, true in answered))
    assert sum(entry.count * entry.mean for entry in binned) == pytest.approx(sum(p for p, _ in answered))
    for entry in binned:
        assert entry.low - 1e-9 <= entry.mean <= entry.high + 1e-9
    assert 0.0 <= expected_calibration_error(answered, bins) <= 1.0


def test_bins_by_hand() -> None:
    answered = [(0.0, False), (0.05, True), (0.95, True), (1.0, False)]
    assert reliability(answered) == (Bin(0.0, 0.1, 2, 0.025, 0.5), Bin(0.9, 1.0, 2, 0.975, 0.5))
    assert expected_calibration_error(answered) == pytest.approx(0.475)
    assert expected_calibration_error([]) == 0.0


def test_always_wrong_and_always_right() -> None:
    assert expected_calibration_error([(1.0, False), (0.0, True)]) == 1.0
    assert expected_calibration_error([(1.0, True), (0.0, False)]) == 0.0


def test_the_plot_is_a_picture(tmp_path: Path) -> None:
    made = looks(100, 1, 0.4, 1.0)
    series = {"as the model says": answers(made), "calibrated": answers(made, fit(made))}
    file = plot_reliability(tmp_path / "sub" / "reliability.png", series)
    with Picture.open(file) as picture:
        assert picture.format == "PNG"
        assert picture.width >= 400
        colours = picture.convert("RGB").getcolors(1 << 24)
    assert colours is not None
    assert len(colours) > 10


def test_nothing_to_draw_and_nowhere_to_draw_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no answers to draw"):
        plot_reliability(tmp_path / "a.png", {"nothing": []})
    with pytest.raises(InputError, match="cannot be written"):
        plot_reliability(tmp_path, {"one": [(0.5, True)]})
