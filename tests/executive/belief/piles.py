"""Piles of cups on trays: a task whose states keep more than mutex groups say."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from executive.belief import StateSpace
from executive.types import ALWAYS, Atom, Condition, Effect, Facts, Step

CUPS, TRAYS = ("a", "b", "c"), ("s", "t", "u")


def on(upper: str, lower: str) -> Atom:
    return Atom("on", (upper, lower))


def at(cup: str, tray: str) -> Atom:
    return Atom("at", (cup, tray))


def top(cup: str) -> Atom:
    return Atom("top", (cup,))


def put(cup: str, tray: str, cups: Sequence[str] = CUPS, trays: Sequence[str] = TRAYS) -> Step:
    """Take the top cup of a pile and put it on the pile of another tray, where its top is the one below afterwards."""
    effects = [Effect(ALWAYS, Facts({at(cup, tray): True, top(cup): True}))]
    for other in cups:
        if other != cup:
            effects.append(Effect(Condition.literal(on(cup, other)), Facts({on(cup, other): False, top(other): True})))
            below = Condition.of(Facts({at(other, tray): True, top(other): True}))
            effects.append(Effect(below, Facts({on(cup, other): True, top(other): False})))
    effects += [
        Effect(Condition.literal(at(cup, other)), Facts({at(cup, other): False})) for other in trays if other != tray
    ]
    return Step("put", (cup, tray), Condition.of(Facts({top(cup): True, at(cup, tray): False})), tuple(effects))


def task(cups: Sequence[str], trays: Sequence[str]) -> tuple[tuple[Atom, ...], tuple[Step, ...]]:
    """The atoms and the actions of a task with these cups and trays."""
    atoms = (
        *(on(upper, lower) for upper in cups for lower in cups if upper != lower),
        *(at(cup, tray) for cup in cups for tray in trays),
        *map(top, cups),
    )
    return atoms, tuple(put(cup, tray, cups, trays) for cup in cups for tray in trays)


ATOMS, STEPS = task(CUPS, TRAYS)
START = frozenset({at("a", "s"), at("b", "s"), at("c", "t"), on("b", "a"), top("b"), top("c")})


def piles() -> list[frozenset[Atom]]:
    """Every way to pile the cups up on the trays, by hand."""
    found = []
    for order in itertools.permutations(CUPS):
        for first, second in itertools.combinations_with_replacement(range(len(CUPS) + 1), 2):
            true = set()
            for tray, pile in zip(TRAYS, (order[:first], order[first:second], order[second:]), strict=True):
                true |= {at(cup, tray) for cup in pile} | {on(u, low) for low, u in itertools.pairwise(pile)}
                true |= {top(pile[-1])} if pile else set()
            found.append(frozenset(true))
    return found


def listed() -> StateSpace:
    """The states that the actions lead to."""
    found = StateSpace.reachable(ATOMS, STEPS, START)
    assert found is not None
    return found
