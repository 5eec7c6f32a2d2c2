"""Things, places and a hand, as symbols: the groups of any such task, and what can become of it."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from executive.belief.mutex_inference import Group, MutexNetwork
from executive.types import Atom, Belief, Facts, SkillResult, SkillStatus, Step
from tests.fakes import FREE, at, held, pick, put

THINGS, PLACES = ("cup", "jug", "pot"), ("desk", "rack", "tray")
HAND, FLOOR = "hand", "floor"

ATOMS = tuple(sorted((*(at(thing, place) for thing in THINGS for place in PLACES), *map(held, THINGS), FREE)))
GROUPS = (
    *(Group((*(at(thing, place) for place in PLACES), held(thing))) for thing in THINGS),
    Group((FREE, *map(held, THINGS)), exact=True),
)
NETWORK = MutexNetwork(ATOMS, GROUPS)


def truth(where: Mapping[str, str]) -> Facts:
    """`where` each thing is: a place, the hand, or the floor."""
    true = {held(thing) if place == HAND else at(thing, place) for thing, place in where.items() if place != FLOOR}
    return Facts.closed(true | ({FREE} if HAND not in where.values() else set()), ATOMS)


def answers(facts: Mapping[Atom, bool], wrong: frozenset[Atom] = frozenset(), look: int = 0) -> Belief:
    """Plain answers about each atom, some of them wrong."""
    return Belief(look, {atom: float(value != (atom in wrong)) for atom, value in facts.items()}, source="scripted")


class StepOutcome(NamedTuple):
    """An action, what its skill says, and what is so afterwards."""

    step: Step | None
    result: SkillResult | None
    facts: Facts


def story(rng: random.Random, length: int) -> Iterator[StepOutcome]:
    """A first moment and what follows: actions that mostly work, and now and then someone who moves a thing."""
    where = {thing: rng.choice(PLACES) for thing in THINGS}
    yield StepOutcome(None, None, truth(where))
    for _ in range(length):
        thing = next((thing for thing in THINGS if where[thing] == HAND), "")
        if not thing and not (lying := [thing for thing in THINGS if where[thing] != FLOOR]):
            return
        if thing:
            step = put(thing, rng.choice(PLACES))
            meant = step.args[1]
        else:
            thing, meant = rng.choice(lying), HAND
            step = pick(thing, where[thing])
        chance, status = rng.random(), SkillStatus.DONE
        if chance < 0.8:
            where[thing] = meant
        elif chance < 0.9:
            status = SkillStatus.NO_PATH
        else:
            where[thing], status = rng.choice([*PLACES, FLOOR]), rng.choice([SkillStatus.DONE, SkillStatus.DROPPED])
        if rng.random() < 0.05:
            other = rng.choice([other for other in THINGS if where[other] != HAND])
            where[other] = rng.choice(PLACES)
        yield StepOutcome(step, SkillResult(step, status), truth(where))
