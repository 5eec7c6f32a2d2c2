"""Payloads of every kind, for laws that hold for all of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from executive.types import (
    ALWAYS,
    Atom,
    Belief,
    Blinded,
    Cause,
    Compared,
    Condition,
    Contradiction,
    Decision,
    DecisionKind,
    DerivedRules,
    Dispatched,
    Effect,
    Ended,
    EstimatedPose,
    Event,
    Evidence,
    Facts,
    FaultInjected,
    Frame,
    Ground,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Lump,
    Motion,
    Moved,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Overruled,
    Payload,
    Phase,
    PlaceToLook,
    Plan,
    PointCloud,
    PosesEstimated,
    Probed,
    Questions,
    Reason,
    Remembered,
    Resumed,
    Revised,
    Scenery,
    SearchOrder,
    Sense,
    SkillResult,
    SkillStatus,
    Started,
    Step,
    Task,
    Timing,
    Verdict,
)

names = st.from_regex(r"[a-z][a-z0-9_\-]{0,8}", fullmatch=True)
texts = st.text(max_size=30)
finite = st.floats(allow_nan=False, allow_infinity=False)
seconds = st.floats(0, 1e6)
counts = st.integers(0, 10**6)
atoms = st.builds(Atom, names, st.lists(names, max_size=3).map(tuple))
facts = st.dictionaries(atoms, st.booleans(), max_size=5).map(Facts)
conditions = st.recursive(
    facts.map(Condition.of),
    lambda inner: st.lists(inner, max_size=3).flatmap(
        lambda parts: st.sampled_from([Condition.all_of(parts), Condition.any_of(parts)])
    ),
    max_leaves=5,
)
arguments = st.lists(names, max_size=3).map(tuple)
conditional = st.builds(Effect, conditions.filter(lambda condition: condition != ALWAYS), facts)
steps = st.builds(Step.strips, names, arguments, facts, facts) | st.builds(
    Step, names, arguments, conditions, st.lists(conditional, max_size=2).map(tuple), finite
)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**40), 2**40) | finite | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=5,
)


def numbers(*shape: int) -> st.SearchStrategy[np.ndarray[Any, np.dtype[np.float64]]]:
    return hnp.arrays(np.float64, shape, elements=st.floats(-100, 100).map(lambda value: round(value, 4)))


@st.composite
def tasks(draw: st.DrawFn) -> Task:
    universe = draw(st.lists(atoms, unique=True, max_size=6))
    parts = [Condition.literal(atom, draw(st.booleans())) for atom in universe[:2]]
    goal = draw(st.sampled_from([Condition.all_of(parts), Condition.any_of(parts) if parts else ALWAYS]))
    rules = DerivedRules({Atom("derived", atom.args): Condition.literal(atom, False) for atom in universe[4:]})
    objects = draw(st.dictionaries(names, names, max_size=4))
    parameters = draw(st.dictionaries(names, st.lists(names, max_size=2).map(tuple), max_size=2))
    declared, numeric = frozenset(universe[2:4]), tuple(draw(st.lists(names, max_size=2)))
    return Task(draw(names), draw(names), objects, tuple(universe), goal, declared, parameters, numeric, derived=rules)


@st.composite
def observations(draw: st.DrawFn) -> Observation:
    shape = draw(st.tuples(st.integers(1, 20), st.integers(1, 20), st.just(3)))
    shade = draw(st.integers(0, 255))
    images = {camera: np.full(shape, shade, np.uint8) for camera in draw(st.lists(texts, unique=True, max_size=2))}
    reach = draw(st.integers(0, 65535))
    depth = {camera: np.full(shape[:2], reach, np.uint16) for camera in images if draw(st.booleans())}
    return Observation(draw(counts), draw(seconds), images, draw(numbers(6)), draw(texts), depth=depth)


@st.composite
def beliefs(draw: st.DrawFn) -> Belief:
    asked = draw(st.lists(atoms, unique=True, max_size=8))
    silent = frozenset(asked[:2])
    probability = {atom: draw(st.floats(0, 1)) for atom in asked[2:]}
    answers = st.lists(st.builds(Evidence, st.lists(texts, max_size=2).map(tuple), finite, finite, texts), max_size=2)
    return Belief(draw(counts), probability, silent, draw(texts), {atom: tuple(draw(answers)) for atom in asked[:3]})


@st.composite
def motions(draw: st.DrawFn) -> Motion:
    count = draw(st.integers(1, 12))
    cost = draw(st.one_of(st.floats(0, 100), st.just(math.nan), st.just(math.inf)))
    return Motion(draw(numbers(count, 6)), draw(numbers(count, 3)), draw(seconds), draw(texts), draw(seconds), cost)


@st.composite
def verdicts(draw: st.DrawFn) -> Verdict:
    parts = draw(st.lists(atoms, unique=True, max_size=6))
    return Verdict(frozenset(parts[:2]), frozenset(parts[2:4]), frozenset(parts[4:]))


plans = st.builds(Plan, st.lists(steps, max_size=3).map(tuple), seconds, texts, seconds)
no_plans = st.builds(NoPlan, st.sampled_from(NoPlanReason), texts, texts, seconds)
shares = st.floats(0, 1)
maybe = st.none() | st.booleans()
chances = st.dictionaries(atoms, shares, max_size=4)
cameras = st.lists(texts, max_size=2).map(tuple)
results = st.builds(
    SkillResult, steps, st.sampled_from(SkillStatus), texts, seconds, seconds, st.none() | st.sampled_from(Sense)
)
grounds_of_decisions = st.builds(Ground, atoms, maybe, maybe, st.none() | shares, st.integers(-1, 99), cameras)


causes = st.lists(
    st.builds(
        Cause, st.sampled_from(Reason), st.lists(atoms, max_size=3).map(tuple),
        st.lists(st.none() | counts, max_size=3).map(tuple), st.lists(texts, max_size=2).map(tuple),
        st.lists(texts, max_size=2).map(tuple), st.none() | st.sampled_from(SkillStatus), texts, counts, seconds,
        seconds, texts, st.lists(shares, max_size=2).map(tuple), st.lists(seconds, max_size=2).map(tuple),
    ),
    min_size=1, max_size=3,
).map(tuple)  # fmt: skip


@st.composite
def decisions(draw: st.DrawFn) -> Decision:
    kind = draw(st.sampled_from(DecisionKind))
    outcome = draw(st.sampled_from(OutcomeKind)) if kind is DecisionKind.STOP else None
    evidence = tuple(draw(st.lists(atoms, max_size=3)))
    grounds = tuple(draw(st.lists(grounds_of_decisions, max_size=2)))
    return Decision(kind, draw(causes), evidence, outcome, grounds, draw(st.none() | results))


estimated_poses = st.builds(EstimatedPose, numbers(7), numbers(6, 6), finite, cameras, texts, seconds)

RECORDED: Mapping[type, st.SearchStrategy[Payload]] = {
    Started: st.builds(
        Started,
        names,
        names,
        tasks(),
        texts,
        st.integers(-(2**63), 2**63 - 1),
        st.dictionaries(texts, json_values, max_size=3),
    ),
    Resumed: st.builds(Resumed, counts, counts, counts, counts, counts, seconds),
    Questions: st.builds(
        Questions, st.dictionaries(atoms, st.just("Is it there?"), max_size=3), texts, texts,
        st.just(("Yes", "No")), st.lists(texts, max_size=2).map(tuple),
    ),
    Observation: observations(),
    PosesEstimated: st.builds(
        PosesEstimated, st.dictionaries(texts, estimated_poses, max_size=2), st.lists(texts, max_size=2).map(tuple),
        st.lists(st.builds(Lump, numbers(3), numbers(3)), max_size=2).map(tuple),
        st.dictionaries(texts, texts, max_size=2),
        st.dictionaries(texts, st.dictionaries(texts, st.floats(0, 1), max_size=2), max_size=2),
    ),
    Belief: beliefs(),
    Plan: plans,
    NoPlan: no_plans,
    Probed: st.builds(Probed, conditions, plans) | st.builds(Probed, conditions, st.none(), no_plans),
    SearchOrder: st.builds(
        SearchOrder,
        st.lists(st.builds(PlaceToLook, conditions, shares, seconds, seconds), max_size=3).map(tuple), facts, counts,
    ),
    Dispatched: st.builds(Dispatched, steps, counts, counts, counts),
    Phase: st.builds(Phase, texts, texts, seconds),
    Motion: motions(),
    FaultInjected: st.builds(FaultInjected, texts, texts, counts, texts),
    SkillResult: results,
    Compared: st.builds(Compared, texts, facts, verdicts(), counts),
    Decision: decisions(),
    Revised: st.builds(Revised, facts, facts),
    Looked: st.builds(Looked, counts, st.sampled_from(LookKind), counts, counts, cameras),
    Judged: st.builds(
        Judged, counts, chances, facts, st.lists(st.builds(Contradiction, chances, chances), max_size=2).map(tuple),
        st.lists(st.builds(Overruled, atoms, st.booleans(), shares, maybe, shares), max_size=2).map(tuple),
        st.dictionaries(atoms, st.builds(Remembered, st.booleans(), counts, shares), max_size=2), st.none() | shares,
    ),
    Moved: st.builds(Moved, texts, st.sampled_from(SkillStatus), texts, seconds),
    Guarded: st.builds(Guarded, atoms, maybe, st.booleans(), counts),
    Blinded: st.builds(Blinded, texts, texts, counts),
    Timing: st.builds(Timing, texts, seconds),
    Ended: st.builds(
        Ended, st.sampled_from(OutcomeKind), causes, st.booleans(), st.lists(texts, max_size=3).map(tuple),
        counts, counts, counts, counts,
    ),
}  # fmt: skip
"""How to make any payload that a record holds."""

payloads: st.SearchStrategy[Payload] = st.one_of(*RECORDED.values())
events = st.builds(Event, counts, seconds, seconds, payloads)

assert {*RECORDED, Scenery, Frame, PointCloud} == set(get_args(Payload)), "a payload type has no strategy"


def same(a: Any, b: Any) -> bool:
    """Equal, arrays and NaN included; pictures, which are stored with loss, by shape."""
    if isinstance(a, np.ndarray):
        alike = isinstance(b, np.ndarray) and a.shape == b.shape
        return alike and (a.dtype == np.uint8 or bool(np.array_equal(a, b, equal_nan=True)))
    if dataclasses.is_dataclass(a) and not isinstance(a, type):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, Mapping) and not isinstance(a, Facts):
        return isinstance(b, Mapping) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and math.isnan(a):
        return isinstance(b, float) and math.isnan(b)
    return bool(a == b) and type(a) is type(b)
