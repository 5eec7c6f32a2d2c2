"""Errors on purpose: at the rate that was asked for, the same for the same look, and of the kind that was asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from executive.errors import InputError
from executive.lab.noisy import WORSE, Noisy, Worse
from executive.protocols import Asking, Estimator
from executive.types import Atom, Belief, Image, Observation, Questions
from tests.contracts import EstimatorContract
from tests.fakes import FakeWorld, ScriptedEstimator, at

ATOMS = [at(thing, place) for thing in "abcdefgh" for place in "pqrst"]


class TestNoisy(EstimatorContract):
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        world = FakeWorld({"a": "p", "b": "q"}, "pqr")
        return Noisy(ScriptedEstimator(world, always={ATOMS[1]: None}), 0.3, 7), world.observe(), ATOMS


def turned(flips: float, looks: int, seed: int = 0) -> list[frozenset[Atom]]:
    """The atoms whose answer was turned around, look by look."""
    world = FakeWorld({"a": "p"}, "pqrst")
    eye, noisy = ScriptedEstimator(world), Noisy(ScriptedEstimator(world), flips, seed)
    found = []
    for _ in range(looks):
        observation = world.observe()
        right, said = (each.estimate(observation, ATOMS).probability for each in (eye, noisy))
        assert all(said[atom] in (right[atom], 1.0 - right[atom]) for atom in ATOMS)
        found.append(frozenset(atom for atom in ATOMS if said[atom] != right[atom]))
    return found


@pytest.mark.parametrize("flips", [0.0, 0.05, 0.5, 1.0])
def test_answers_are_turned_around_as_often_as_asked_for(flips: float) -> None:
    count = sum(map(len, turned(flips, 100)))
    total = 100 * len(ATOMS)
    assert abs(count - flips * total) <= 4 * np.sqrt(flips * (1 - flips) * total)


def test_each_look_errs_on_its_own_and_each_seed_too() -> None:
    once, again, other = turned(0.3, 20), turned(0.3, 20), turned(0.3, 20, seed=1)
    assert once == again
    assert len(set(once)) == 20
    assert not set(once) & set(other)


def test_what_else_is_asked_changes_no_answer() -> None:
    world = FakeWorld({"a": "p"}, "pqrst")
    noisy, observation = Noisy(ScriptedEstimator(world), 0.5, 3), world.observe()
    whole = noisy.estimate(observation, ATOMS).probability
    assert {atom: noisy.estimate(observation, [atom]).probability[atom] for atom in ATOMS} == whole


class Shown:
    """An eye that keeps what it is shown."""

    name = "shown"

    def __init__(self) -> None:
        self.images: list[Image] = []

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        self.images += observation.images.values()
        return Belief(observation.id, {}, frozenset(atoms), self.name)


PICTURE = np.random.default_rng(5).integers(0, 256, (48, 64, 3), dtype=np.uint8)
AMOUNTS = {"blur": (1.0, 4.0), "noise": (5.0, 40.0), "dark": (0.2, 0.8)}


@pytest.mark.parametrize("kind", WORSE)
def test_pictures_get_worse_by_the_amount_and_the_world_keeps_its_own(kind: str) -> None:
    eye, kept = Shown(), PICTURE.copy()
    for amount in (0.0, *AMOUNTS[kind], AMOUNTS[kind][1]):
        Worse(eye, kind, amount, 1).estimate(Observation(3, 0.0, {"front": PICTURE}, np.empty(0)), ATOMS)
    assert np.array_equal(PICTURE, kept)
    same, little, much, again = eye.images
    assert np.array_equal(same, PICTURE)
    assert np.array_equal(much, again)
    away = [float(np.abs(image.astype(float) - PICTURE).mean()) for image in (little, much)]
    assert 0.0 < away[0] < away[1]
    assert all(image.shape == PICTURE.shape and image.dtype == np.uint8 for image in eye.images)


def test_an_eye_that_asks_in_words_still_does() -> None:
    class Words(Shown):
        questions = Questions({ATOMS[0]: "Is a on p?"}, "", "me")

    eye: object = Worse(Words(), "blur", 1.0, 0)
    assert isinstance(eye, Asking)
    assert eye.questions is Words.questions
    assert not isinstance(Worse(Shown(), "blur", 1.0, 0), Asking)


@pytest.mark.parametrize(("kind", "amount"), [("blurr", 1.0), ("dark", 1.5), ("noise", -1.0)])
def test_what_cannot_be_done_to_a_picture_is_bad_input(kind: str, amount: float) -> None:
    with pytest.raises(InputError, match=kind):
        Worse(Shown(), kind, amount, 0)
