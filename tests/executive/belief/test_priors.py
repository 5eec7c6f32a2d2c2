"""Distributions over listed states, and what actions make of them, held against adding up by hand."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.belief.action_model import Chances
from executive.belief.priors import Listed, Weighted, posterior, predict
from executive.types import Atom, Facts
from tests.executive.belief.hands import ATOMS as HAND_ATOMS
from tests.executive.belief.hands import NETWORK
from tests.executive.belief.piles import ATOMS, STEPS, at, listed, put, top

SPACE = listed()
CHANCES = Chances(0.7, 0.2, 0.1)


def drawn(seed: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.random.default_rng(seed).dirichlet(np.full(len(SPACE), 0.3))


@given(seed=st.integers(0, 1000), number=st.integers(0, len(STEPS) - 1), noise=st.floats(0.001, 0.3))
def test_what_an_action_leads_to_is_a_distribution_and_that_of_adding_up(seed: int, number: int, noise: float) -> None:
    before, step = drawn(seed), STEPS[number]
    loose = set(step.affects)
    found = predict(SPACE, before, step, CHANCES, loose, noise)
    assert math.fsum(part.chance for part in found) == pytest.approx(1.0)
    for part in found:
        assert np.exp(part.prior.log_probability).sum() == pytest.approx(1.0)
    whole = sum(part.chance * np.exp(part.prior.log_probability) for part in found)
    expected = np.zeros(len(SPACE))
    for state, mass in enumerate(before):
        facts = Facts.closed(SPACE.true(state), ATOMS)
        able = step.precondition.truth(facts)
        after = facts | {a: bool(v) for a, v in step.changes(facts).items()} if able else facts
        target = SPACE.number(after.true)
        assert target is not None
        expected[target] += CHANCES.effects * mass
        expected[state] += CHANCES.nothing * mass
        alike = [n for n in range(len(SPACE)) if SPACE.true(n) - loose == SPACE.true(state) - loose]
        others = [n for n in alike if n not in (state, target)] or alike
        expected[others] += CHANCES.other * mass / len(others)
    assert whole == pytest.approx((1 - noise) * expected + noise / len(SPACE), abs=1e-12)


def test_effects_come_about_only_where_the_action_can_be_done() -> None:
    certain = np.zeros(len(SPACE))
    state = next(n for n in range(len(SPACE)) if at("a", "s") in SPACE.true(n))
    certain[state] = 1.0
    found = predict(SPACE, certain, put("a", "s"), CHANCES, (), 0.01)
    assert [part.effects for part in found] == [False, False]
    assert found[0].chance == pytest.approx(CHANCES.effects + CHANCES.nothing)


@given(seed=st.integers(0, 1000))
def test_evidence_is_weighed_by_bayes_rule(seed: int) -> None:
    rng = random.Random(seed)
    evidence = {atom: rng.uniform(-3, 3) for atom in rng.sample(ATOMS, 6)}
    parts = [(0.25, Listed(SPACE, np.log(drawn(seed)))), (0.75, Listed(SPACE, np.log(drawn(seed + 1))))]
    mass = [
        sum(chance * math.exp(prior.log_probability[n]) for chance, prior in parts)
        * math.exp(math.fsum(evidence.get(atom, 0.0) for atom in SPACE.true(n)))
        for n in range(len(SPACE))
    ]
    assert posterior(parts, evidence) == pytest.approx(np.array(mass) / math.fsum(mass))


def test_both_kinds_say_how_likely_the_evidence_is() -> None:
    evidence = {top("a"): 2.0}
    for prior in (Listed.uniform(SPACE), Listed(SPACE, np.log(drawn(3)))):
        share = prior.solve({}).marginal[top("a")]
        assert prior.solve({}).log_total == pytest.approx(0.0)
        assert math.exp(prior.solve(evidence).log_total) == pytest.approx(share * math.exp(2.0) + 1 - share)
    weights = dict.fromkeys(HAND_ATOMS, 0.3)
    allowed, some = Weighted.of(NETWORK, weights), Atom("held", ("cup",))
    assert some in HAND_ATOMS
    share = allowed.solve({}).marginal[some]
    assert math.exp(allowed.solve({some: 2.0}).log_total) == pytest.approx(share * math.exp(2.0) + 1 - share)
