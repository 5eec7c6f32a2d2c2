"""A turn of the belief, an action and a look at everything: grocery, ten blocks, 1,000 and 10,000 atoms, and six blocks
in four columns, whose 60,480 states are listed."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Iterable

from benchmarks.speed.table import Row
from executive.belief import BayesMonitor, Group, MutexNetwork, SensorModel, StateSpace
from executive.types import Atom, Belief, Condition, Effect, Facts, SkillResult, SkillStatus, Step

BLOCKS = "abcdefghij"


def measure(everything: bool) -> list[Row]:
    rounds = 9 if everything else 3
    cases = [
        ("belief, grocery", _places(6, 3), 0.02),
        ("belief, ten blocks", _towers(), 0.5),
        ("belief, 1,000 atoms", _places(250, 3), 0.15),
        ("belief, 10,000 atoms", _places(1000, 9), 1.5),
        ("belief, 60,480 listed states", _columns(6, 4), 0.5),
    ]
    rows = []
    for stage, (monitor, step), target in cases:
        seconds = statistics.median(_turn(monitor, step) for _ in range(rounds))
        note = f"{len(monitor.network.atoms)} atoms, {len(monitor.network.groups)} mutex groups, processor time"
        rows.append(Row(stage, seconds, None, "s", f"{target:g} s", seconds <= target, "an action and a look", note))
    return rows


def _turn(monitor: BayesMonitor, step: Step) -> float:
    """Seconds of processor time for an action and a look at every atom."""
    seen = {atom for group in monitor.network.groups if group.exact for atom in group.atoms[:1]}
    look = Belief(0, {atom: float(atom in seen) for atom in monitor.network.atoms})
    memory, _ = monitor.looked(monitor.begin(), look, 0)
    began = time.process_time()
    memory = monitor.acted(memory, step, SkillResult(step, SkillStatus.DONE))
    monitor.looked(memory, look, 1)
    return time.process_time() - began


def _places(items: int, places: int) -> tuple[BayesMonitor, Step]:
    """Items on places or in one gripper, as in the grocery domain."""
    free = Atom("free")
    held = [Atom("held", (f"i{item}",)) for item in range(items)]
    at = [[Atom("at", (f"i{item}", f"p{place}")) for place in range(places)] for item in range(items)]
    groups = [Group((*own, hand)) for own, hand in zip(at, held, strict=True)] + [Group((free, *held), exact=True)]
    step = Step.strips(
        "pick", ("i0", "p0"), Facts({at[0][0]: True, free: True}), Facts({at[0][0]: False, held[0]: True, free: False})
    )
    return _monitor(groups), step


def _towers() -> tuple[BayesMonitor, Step]:
    """Blocks on each other, on the table or in the hand."""

    def on(upper: str, lower: str) -> Atom:
        return Atom("on", (upper, lower))

    one = {name: {block: Atom(name, (block,)) for block in BLOCKS} for name in ("holding", "table", "clear")}
    groups = [Group((Atom("empty"), *one["holding"].values()), exact=True)]
    for block in BLOCKS:
        others = [other for other in BLOCKS if other != block]
        held, table, clear = (one[name][block] for name in ("holding", "table", "clear"))
        groups.append(Group((held, table, *(on(block, other) for other in others)), exact=True))
        groups.append(Group((held, clear, *(on(other, block) for other in others)), exact=True))
    step = Step.strips(
        "pick-up",
        ("a",),
        Facts({one["table"]["a"]: True}),
        Facts({one["table"]["a"]: False, one["holding"]["a"]: True, Atom("empty"): False}),
    )
    return _monitor(groups), step


def _columns(blocks: int, columns: int) -> tuple[BayesMonitor, Step]:
    """Blocks piled up in columns, of which the top ones can be moved."""
    names, where = BLOCKS[:blocks], [f"c{number}" for number in range(columns)]
    on = {pair: Atom("on", pair) for pair in itertools.permutations(names, 2)}
    at = {(block, column): Atom("at", (block, column)) for block in names for column in where}
    top = {block: Atom("top", (block,)) for block in names}
    steps = []
    for block, column in at:
        effects = [Effect(Condition(), Facts({at[block, column]: True, top[block]: True}))]
        for other in names:
            if other != block:
                below = Condition.of(Facts({at[other, column]: True, top[other]: True}))
                left = Condition.literal(on[block, other])
                effects.append(Effect(left, Facts({on[block, other]: False, top[other]: True})))
                effects.append(Effect(below, Facts({on[block, other]: True, top[other]: False})))
        effects += [
            Effect(Condition.literal(at[block, other]), Facts({at[block, other]: False}))
            for other in where
            if other != column
        ]
        able = Condition.of(Facts({top[block]: True, at[block, column]: False}))
        steps.append(Step("move", (block, column), able, tuple(effects)))
    start = {at[block, where[0]] for block in names} | {top[names[-1]]}
    start |= {on[upper, lower] for lower, upper in itertools.pairwise(names)}
    space = StateSpace.reachable([*on.values(), *at.values(), *top.values()], steps, start)
    assert space is not None
    return BayesMonitor(MutexNetwork(space.atoms, space.mutex_groups()), SensorModel(), space=space), steps[1]


def _monitor(groups: Iterable[Group]) -> BayesMonitor:
    kept = tuple(groups)
    return BayesMonitor(MutexNetwork(tuple({atom for group in kept for atom in group.atoms}), kept), SensorModel())
