"""Labels of identical things: they follow what is seen to move, and are doubted where nobody saw what happened."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.perception.assignment import marginals
from executive.perception.tracks import Tracks
from executive.types import FloatArray

NAMES = ("can-a", "can-b", "can-c")
PERIOD = 0.2
HOME = np.array([[0.4, -0.4, 0.9], [0.4, 0.0, 0.9], [0.4, 0.4, 0.9]])


def by_name(label: str, position: FloatArray) -> float:
    """Each is known to start at its place."""
    return 1.0 if np.linalg.norm(position - HOME[NAMES.index(label)]) < 0.15 else 1e-4


def followed(path: list[FloatArray], tracks: Tracks | None = None, period: float = PERIOD) -> Tracks:
    """The tracks after frames of positions (3, 3), the true thing of each in the order of the names, found with 1 mm of
    error and in an order that tells nothing."""
    tracks = Tracks(NAMES, by_name) if tracks is None else tracks
    rng = np.random.default_rng(len(path))
    begin = max(0.0, tracks.time + period)
    for number, positions in enumerate(path):
        order = rng.permutation(len(positions))
        tracks.update(begin + number * period, positions[order] + rng.normal(0.0, 0.001, positions.shape))
    return tracks


def exchanged(one: int, other: int, frames: int, aside: float = 0.1, start: FloatArray = HOME) -> list[FloatArray]:
    """Two things change places in so many frames, in half circles around one another."""
    path = []
    for share in np.linspace(0.0, 1.0, frames):
        smooth = 3 * share**2 - 2 * share**3
        now = start.copy()
        way = start[other] - start[one]
        across = aside * np.sin(np.pi * smooth) * np.array([1.0, 0.0, 0.5])
        now[one], now[other] = start[one] + smooth * way + across, start[other] - smooth * way - across
        path.append(now)
    return path


def assert_right(tracks: Tracks, where: FloatArray, least: float = 0.95) -> None:
    for name, position in zip(NAMES, where, strict=True):
        assert np.linalg.norm(tracks.track(name).position - position) < 0.01, name
        assert tracks.identity()[name][name] > least


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_marginals_are_those_of_all_assignments(data: st.DataObject) -> None:
    rows = data.draw(st.integers(1, 4))
    columns = data.draw(st.integers(0, rows))
    weight = st.floats(0.01, 5.0)
    weights = np.array([[data.draw(weight) for _ in range(columns)] for _ in range(rows)]).reshape(rows, columns)
    absent = np.array([data.draw(weight) for _ in range(rows)])
    expected = np.zeros((rows, columns + 1))
    for chosen in itertools.permutations(range(rows), columns):
        probability = np.prod([weights[row, column] for column, row in enumerate(chosen)])
        probability *= np.prod([absent[row] for row in range(rows) if row not in chosen])
        for row in range(rows):
            expected[row, chosen.index(row) if row in chosen else columns] += probability
    expected /= expected.sum(axis=1, keepdims=True)
    assert marginals(weights, absent) == pytest.approx(expected, abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.2, 1.0, 4.0]), st.integers(1, 3))
def test_the_order_of_detections_changes_nothing_and_beliefs_stay_probabilities(
    seed: int, period: float, seen: int
) -> None:
    rng = np.random.default_rng(seed)
    one, other = Tracks(NAMES, by_name), Tracks(NAMES, by_name)
    for number in range(6):
        there = HOME if number == 0 else rng.uniform(-0.5, 0.5, (seen, 3))
        first = one.update(number * period, there)
        order = rng.permutation(len(there))
        second = other.update(number * period, there[order])
        assert tuple(np.array(first.labels)[order]) == second.labels
        told = np.array([[row[name] for name in NAMES] for row in one.identity().values()])
        again = np.array([[row[name] for name in NAMES] for row in other.identity().values()])
        assert told == pytest.approx(again, abs=1e-9)
        assert told.sum(axis=0) == pytest.approx(1.0)
        assert told.sum(axis=1) == pytest.approx(1.0)
        assert told.min() >= 0.0


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(list(itertools.combinations(range(3), 2))), st.integers(10, 40), st.floats(0.06, 0.2))
def test_an_exchange_that_was_filmed_is_followed(pair: tuple[int, int], frames: int, aside: float) -> None:
    tracks = followed([HOME] * 5 + exchanged(*pair, frames, aside))
    where = HOME.copy()
    where[[*pair]] = where[[*reversed(pair)]]
    assert_right(tracks, where)


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(list(itertools.combinations(range(3), 2))), st.floats(3.0, 60.0))
def test_an_exchange_that_nobody_saw_leaves_no_label_above_0_6(pair: tuple[int, int], gap: float) -> None:
    tracks = followed([HOME] * 5)
    where = HOME.copy()
    where[[*pair]] = where[[*reversed(pair)]]
    tracks.update(4 * PERIOD + gap, where)
    assert all(max(row.values()) <= 0.6 for row in tracks.identity().values())
    tracks = followed([where] * 20, tracks)  # nor does looking longer help
    assert all(max(row.values()) <= 0.6 for row in tracks.identity().values())


def test_what_was_put_elsewhere_while_nobody_looked_may_be_either() -> None:
    tracks = followed([HOME] * 5)
    there = HOME + np.array([[0.1, 0.2, 0.0], [-0.05, 0.25, 0.0], [0.0, 0.0, 0.0]])
    tracks.update(4 * PERIOD + 1.0, there)
    row = tracks.identity()["can-c"]
    assert row["can-c"] > 0.65
    assert max(tracks.identity()["can-a"].values()) < 0.75


def test_hours_of_standing_still_in_view_change_nothing() -> None:
    assert_right(followed([HOME] * 300), HOME, 0.9999)


def test_what_is_hidden_alone_keeps_its_label_and_is_found_again() -> None:
    tracks = followed([HOME] * 5 + [HOME[:2]] * 30)
    assert tracks.identity()["can-c"]["can-c"] > 0.95
    assert_right(followed([HOME] * 3, tracks), HOME)


def test_two_that_are_hidden_together_may_have_been_exchanged() -> None:
    tracks = followed([HOME] * 5 + [HOME[:1]] * 30 + [HOME] * 3)
    identity = tracks.identity()
    assert identity["can-a"]["can-a"] > 0.95
    assert max(identity["can-b"].values()) <= 0.6
    assert max(identity["can-c"].values()) <= 0.6


def test_what_the_hand_holds_is_known_by_touch() -> None:
    tracks = followed([HOME] * 5)
    at, time = HOME[0].copy(), 4 * PERIOD
    for _ in range(10):
        time, at = time + PERIOD, at + [0.0, 0.05, 0.02]
        named = tracks.update(time, HOME[[2, 1]], {"can-a": at})
        assert named.labels == ("can-c", "can-b")
    tracks.update(time + PERIOD, np.stack([HOME[1], at, HOME[2]]))
    assert_right(tracks, np.stack([at, HOME[1], HOME[2]]))


def test_without_anything_known_beforehand_no_label_is_better_than_another() -> None:
    tracks = Tracks(NAMES)
    tracks.update(0.0, HOME)
    assert all(value == pytest.approx(1 / 3) for row in tracks.identity().values() for value in row.values())


def test_what_is_known_beforehand_names_what_is_seen_first_and_what_turns_up_later() -> None:
    tracks = Tracks(NAMES, by_name)
    assert tracks.update(0.0, HOME[[2, 0]]).labels == ("can-c", "can-a")
    assert tracks.update(0.2, HOME[[1, 2, 0]]).labels == ("can-b", "can-c", "can-a")
    assert_right(tracks, HOME)
