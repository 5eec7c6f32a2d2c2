"""The example's parts keep the same contracts as the shipped ones, and their run recovers by sight alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from examples import own_world
from examples.own_world import HAND, Board, ColourEstimator, put, take
from executive.protocols import Estimator, Simulator, Skill, World
from executive.types import Atom, Facts, Observation, OutcomeKind, Step
from tests.contracts import EstimatorContract, SimulatorContract, SkillContract

CUPS = ("left", "middle", "right")


def board(**where: str) -> Board:
    return Board({"red": "left", "blue": "middle", **where}, CUPS)


def held(marble: str) -> Atom:
    return Atom("held", (marble,))


def contained(marble: str, cup: str) -> Atom:
    return Atom("in", (marble, cup))


def atoms(world: Board) -> list[Atom]:
    inside = [contained(marble, cup) for marble in world.where for cup in world.cups]
    return [*inside, *map(held, world.where), Atom("free")]


def truth(world: Board) -> Facts:
    true = {held(m) if place == HAND else contained(m, place) for m, place in world.where.items()}
    return Facts.closed(true if world.held else {*true, Atom("free")}, atoms(world))


class TestBoard(SimulatorContract):
    def make(self) -> Simulator:
        return board(red=HAND)

    def pass_time(self, world: World, seconds: float) -> None:
        assert isinstance(world, Board)
        world.advance(seconds)


class TestEye(EstimatorContract):
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        world = board()
        return ColourEstimator(list(world.where), CUPS), world.observe(), atoms(world)


class _OnTheBoard(SkillContract):
    def holds(self, world: Simulator, facts: Facts) -> bool:
        assert isinstance(world, Board)
        return truth(world).entails(facts)


class TestTake(_OnTheBoard):
    def make(self) -> tuple[Skill, Simulator]:
        return take, board()

    def possible(self) -> Step:
        return self.step("left")

    def misplaced(self) -> Step:
        return self.step("right")

    def step(self, cup: str) -> Step:
        after = Facts({held("red"): True, contained("red", cup): False, Atom("free"): False})
        return Step.strips("take", ("red", cup), Facts({contained("red", cup): True, Atom("free"): True}), after)


class TestPut(_OnTheBoard):
    def make(self) -> tuple[Skill, Simulator]:
        return put, board(red=HAND)

    def possible(self) -> Step:
        return self.step("red")

    def misplaced(self) -> Step:
        return self.step("blue")

    def step(self, marble: str) -> Step:
        after = Facts({contained(marble, "right"): True, held(marble): False, Atom("free"): True})
        return Step.strips("put", (marble, "right"), Facts({held(marble): True}), after)


@pytest.mark.parametrize("red", [*CUPS, HAND])
@pytest.mark.parametrize("blue", CUPS)
def test_the_eye_reads_what_is_true_from_the_picture(red: str, blue: str) -> None:
    world = board(red=red, blue=blue)
    belief = ColourEstimator(list(world.where), CUPS).estimate(world.observe(), atoms(world))
    assert belief.facts() == truth(world)


def test_without_a_picture_the_eye_cannot_tell() -> None:
    world = board()
    belief = ColourEstimator(list(world.where), CUPS).estimate(Observation(0, 0.0, {}, np.zeros(1)), atoms(world))
    assert belief.unanswered == set(atoms(world))


@pytest.mark.parametrize(
    ("faults", "actions", "replans"),
    [((), 4, 0), (("drop@2",), 6, 1), (("miss@1",), 5, 0), (("shove@4:item=red",), 6, 1)],
)
def test_the_run_recovers(faults: Sequence[str], actions: int, replans: int) -> None:
    ended = own_world.main(faults)
    assert (ended.outcome, ended.actions, ended.replans) == (OutcomeKind.GOAL_REACHED, actions, replans)
