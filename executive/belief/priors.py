"""Distributions over a task's states, as a Bayes filter has them before it looks, and how an action changes them.

Either a distribution is given by one weight for each atom, over the states that mutex groups allow, or by the
probability of each listed state. The second is exact whatever atoms have to do with each other; the first is all that
there is where states are too many to be listed, and where something may have happened that no action does.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from executive.belief.action_model import Chances
from executive.belief.mutex_inference import MutexNetwork, Solution
from executive.belief.state_space import IndexArray, StateSpace
from executive.types import Atom, FloatArray, Step

_LEAST = 1e-300
"""The least probability of a part that a logarithm is taken of."""


class Prior(Protocol):
    """A distribution over states."""

    def solve(self, evidence: Mapping[Atom, float]) -> Solution:
        """Infer the distribution given log-likelihood ratios of atoms; `log_total` is the logarithm of the evidence's
        likelihood, and `log_best` that of the most probable state's share in it."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """States that mutex groups allow, each with a probability proportional to the product of exp(weight) over its true
    atoms."""

    network: MutexNetwork
    weights: Mapping[Atom, float]
    log_total: float

    @classmethod
    def of(cls, network: MutexNetwork, weights: Mapping[Atom, float]) -> Weighted:
        return cls(network, weights, network.log_total(weights))

    def solve(self, evidence: Mapping[Atom, float]) -> Solution:
        found = self.network.solve({atom: weight + evidence.get(atom, 0.0) for atom, weight in self.weights.items()})
        return found._replace(log_total=found.log_total - self.log_total, log_best=found.log_best - self.log_total)


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """Listed states, with the logarithm of each one's probability, (N,)."""

    space: StateSpace
    log_probability: FloatArray

    @classmethod
    def uniform(cls, space: StateSpace) -> Listed:
        return cls(space, np.full(len(space), -math.log(len(space))))

    def solve(self, evidence: Mapping[Atom, float]) -> Solution:
        return self.space.solve(evidence, self.log_probability)


class Posterior(NamedTuple):
    """What a mixture of distributions amounts to given evidence.

    Attributes:
        marginal: the probability of each atom.
        chances: the probability of each part of the mixture.
        best: the true atoms of the most probable pair of a part and a state.
        is_listed: whether that part is one over listed states.
        log_best: the logarithm of that pair's weight.
    """

    marginal: Mapping[Atom, float]
    chances: tuple[float, ...]
    best: frozenset[Atom]
    is_listed: bool
    log_best: float


def infer(parts: Sequence[tuple[float, Prior]], evidence: Mapping[Atom, float]) -> Posterior:
    """Apply Bayes' rule to a mixture, given as the prior probability of each part and its distribution. What the
    evidence says of listed states is worked out once for all parts over these."""
    sums: dict[StateSpace, FloatArray] = {}
    likelihoods: dict[int, tuple[StateSpace, FloatArray]] = {}
    solved: dict[int, Solution] = {}
    totals, bests = np.zeros(len(parts)), np.zeros(len(parts))
    for number, (_, prior) in enumerate(parts):
        if isinstance(prior, Listed):
            if prior.space not in sums:
                sums[prior.space] = prior.space.sums(evidence)
            weight = sums[prior.space] + prior.log_probability
            bests[number] = weight.max()
            likelihood = np.exp(weight - bests[number])
            totals[number] = bests[number] + math.log(likelihood.sum())
            likelihoods[number] = prior.space, likelihood
        else:
            own = solved[number] = prior.solve(evidence)
            totals[number], bests[number] = own.log_total, own.log_best
    logs = np.log(np.maximum([chance for chance, _ in parts], _LEAST))
    shares = np.exp(logs + totals - (logs + totals).max())
    chances = shares / shares.sum()
    listed: dict[StateSpace, FloatArray] = {}
    for number, (space, likelihood) in likelihoods.items():
        mixed = likelihood * (chances[number] / likelihood.sum())
        listed[space] = listed[space] + mixed if space in listed else mixed
    each: list[Mapping[Atom, float]] = [space.marginals(probability) for space, probability in listed.items()]
    for number, own in solved.items():
        chance = float(chances[number])
        each.append({atom: chance * value for atom, value in own.marginal.items()})
    heaviest = int((logs + bests).argmax())
    if is_listed := heaviest in likelihoods:
        space, likelihood = likelihoods[heaviest]
        best = space.true(int(likelihood.argmax()))
    else:
        best = solved[heaviest].best
    marginal = {atom: min(1.0, math.fsum(own[atom] for own in each)) for atom in each[0]}
    return Posterior(marginal, tuple(chances.tolist()), best, is_listed, float((logs + bests)[heaviest]))


class Predicted(NamedTuple):
    """What an action may have led to: how probable that is, over which states, and whether its effects came about."""

    chance: float
    prior: Listed
    effects: bool


def posterior(parts: Sequence[tuple[float, Listed]], evidence: Mapping[Atom, float]) -> FloatArray:
    """Return the probability of each listed state, (N,), given evidence and a mixture of distributions over them."""
    logs = [math.log(chance) + prior.log_probability for chance, prior in parts if chance > 0.0]
    total = np.logaddexp.reduce(logs) + parts[0][1].space.sums(evidence)
    likelihood = np.exp(total - total.max())
    shares: FloatArray = likelihood / likelihood.sum()
    return shares


def predict(
    space: StateSpace,
    before: FloatArray,
    step: Step | None,
    chances: Chances,
    undetermined: Collection[Atom],
    process_noise: float,
) -> list[Predicted]:
    """Return what an action may have led to from listed states of some probability, (N,).

    Where its precondition does not hold, nothing changes. Where something else happened, the undetermined atoms may be
    anything else that goes together with the others: neither as they were nor as the action was to make them, which are
    the other two outcomes. With the probability `process_noise` the state is any at all.
    """
    found = [(1.0, before, False)]
    if step is not None:
        after = space.successors(step)
        able = after >= 0
        reached = np.bincount(after[able], weights=before[able], minlength=len(space))
        share = float(reached.sum())
        nothing = np.where(able, chances.nothing, chances.nothing + chances.effects) * before
        other = _otherwise(space.classes(undetermined), before, after)
        found = [(float(nothing.sum()), nothing / nothing.sum(), False), (chances.other, other, False)]
        if share > 0.0:
            found.insert(0, (chances.effects * share, reached / share, True))
    kept = []
    for chance, probability, effects in found:
        mixed = (1.0 - process_noise) * probability + process_noise / len(space)
        kept.append(Predicted(chance, Listed(space, np.log(mixed)), effects))
    return kept


def _otherwise(number: IndexArray, before: FloatArray, after: IndexArray) -> FloatArray:
    """Return the probability of each listed state, (N,), where an action that leads from each to `after` (-1: to none)
    came to something else: any state of the same class (`StateSpace.classes`) but the one before and the one after; any
    at all of a class that has no others."""
    leads = (after >= 0) & (after != np.arange(len(after)))
    leads[leads] = number[after[leads]] == number[leads]
    others = np.bincount(number)[number] - 1 - leads
    alone = others == 0
    each = before / np.where(alone, others + 1 + leads, others)
    found = np.bincount(number, weights=each)[number] - np.where(alone, 0.0, each)
    taken = leads & ~alone
    found -= np.bincount(after[taken], weights=each[taken], minlength=len(found))
    return np.maximum(found, 0.0)
