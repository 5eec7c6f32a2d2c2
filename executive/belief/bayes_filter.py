"""The monitor with consistency and memory: a Bayes filter over the states that a task can be in.

The posterior probability of a state is proportional to the likelihood of the answers, times the prior that the action
model computes from the belief before. After an action the belief is a mixture of three distributions, one for each
outcome (`executive.belief.action_model`). It stays a mixture until the next action, so that all looks in between
contribute to which outcome it was.

Where the task's states are listed (`executive.belief.state_space`), the filter is exact over them. Else, and as far as
an accident may have led to a state that no action leads to, states that violate a mutex group have probability 0, and
between actions the belief is kept as one marginal for each atom. Together with the groups these stand for a
distribution over states in which atoms of different groups are independent except for the atoms that the groups share
(the Bethe form, exact if the groups' overlaps form no cycle, as with items and a gripper; an assumed density filter,
Boyen and Koller 1998).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np

from executive.belief.action_model import ActionModel, Chances, affected, skill_evidence, with_effects
from executive.belief.constrained import ConstrainedNetwork
from executive.belief.interface import Judgement, Supposition, Thresholds
from executive.belief.last_known import LastKnown
from executive.belief.mutex_inference import EMPTY_GROUP, Group, MutexNetwork
from executive.belief.place_priors import informed
from executive.belief.priors import Listed, Posterior, Prior, Weighted, infer, predict
from executive.belief.priors import posterior as listed_posterior
from executive.belief.sensor_model import LEAST_EVIDENCE, PastEvidence, SensorModel
from executive.belief.state_space import StateSpace
from executive.belief.witnesses import WitnessModel, together
from executive.types import (
    Atom,
    Belief,
    Contradiction,
    Facts,
    FloatArray,
    Overruled,
    SkillResult,
    SkillStatus,
    Step,
    Visibility,
)

DEFAULT_THRESHOLDS = Thresholds(0.15, 0.85)
"""The thresholds where no error rate was requested: probabilities in between mean unknown."""

HIDDEN_NOISE = 0.1
"""The process noise of what is hidden, as a share of that of what is not: what nobody sees is seldom moved. Assumed."""

TOUCHED = 0.2
"""The probability that what is behind a front is no longer as it was, once the front was seen to have moved without the
robot: whoever moved it may have taken something out or put something in. Assumed."""

_CERTAIN = 1e3
"""Log-odds far beyond any evidence, to condition on an atom."""

_EDGE = 1e-6
"""Priors are clipped to [_EDGE, 1 - _EDGE]."""


ACCIDENT = 0.002
"""The prior probability, at each moment, that the world has left the states that actions lead to, or come back."""


class Hypothesis(NamedTuple):
    """A possible outcome of the last action: its prior probability, its distribution over states, and whether it is
    that the action's effects came about."""

    chance: float
    prior: Prior
    effects: bool = False


@dataclass(frozen=True, slots=True)
class BeliefState:
    """The prior for the present moment, and the evidence of the looks at it.

    Attributes:
        hypotheses: the prior, one for each outcome of the last action.
        evidence: the log-likelihood ratios of this moment's answers, atom by atom.
        witnessed: the same of what each witness told, by its name.
        marginal: each atom's posterior probability; None before the first look.
        chances: each hypothesis's posterior probability; None before the first look.
        before, now: the last known values before this moment's looks, and with them.
        earlier: the evidence of looks at earlier moments about atoms that no action has affected since.
        sensed: the evidence in the last skill's report.
        acted: the atoms that the last action may have changed.
    """

    hypotheses: tuple[Hypothesis, ...]
    evidence: Mapping[Atom, tuple[float, ...]] = field(default_factory=lambda: MappingProxyType({}))
    marginal: Mapping[Atom, float] | None = None
    before: LastKnown = field(default_factory=LastKnown)
    now: LastKnown = field(default_factory=LastKnown)
    earlier: Mapping[Atom, PastEvidence] = field(default_factory=lambda: MappingProxyType({}))
    sensed: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))
    chances: tuple[float, ...] | None = None
    witnessed: Mapping[str, Mapping[Atom, tuple[float, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    acted: frozenset[Atom] = frozenset()

    @property
    def told(self) -> Mapping[Atom, tuple[float, ...]]:
        """The log-likelihood ratios of all that this moment's looks told of an atom, whoever did."""
        if not self.witnessed:
            return self.evidence
        every = (self.evidence, *self.witnessed.values())
        atoms = {atom: None for each in every for atom in each}
        return {atom: tuple(value for each in every for value in each.get(atom, ())) for atom in atoms}


@dataclass(frozen=True, slots=True, eq=False)
class BayesMonitor:
    """Estimates the state from consistent answers, with a memory of earlier looks.

    Args:
        network: the task's atoms and its mutex groups; without groups, the atoms are independent.
        sensor_model: the error model of the answers.
        actions: the reliability of the skills; None for a monitor without memory, which forgets at each action.
        thresholds: by predicate; `DEFAULT_THRESHOLDS` for those that it does not name.
        carried: by action, the atom that is true while its skill carries something (see `Step.about`); the gripper's
            own sensing is evidence about it, besides the looks.
        space: the states that the task's actions lead to, if they are listed.
        witnesses: how those err that tell of atoms beside the estimator, by name; others are not listened to.
        visibility: when atoms can be seen. What is said of one that is not believed to be visible is not used.
        prior: how probable atoms are before the first look, of those of which something is stated
            (`executive.belief.place_priors`).
    """

    kind: ClassVar[str] = "fused"
    network: MutexNetwork
    sensor_model: SensorModel = field(default_factory=SensorModel)
    actions: ActionModel | None = field(default_factory=ActionModel)
    thresholds: Mapping[str, Thresholds] = field(default_factory=lambda: MappingProxyType({}))
    carried: Mapping[str, tuple[str, tuple[int, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    space: StateSpace | None = None
    witnesses: Mapping[str, WitnessModel] = field(default_factory=lambda: MappingProxyType({}))
    visibility: Visibility = field(default_factory=Visibility)
    prior: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))
    _start: tuple[Hypothesis, ...] = field(init=False, repr=False)
    _uniform: Mapping[Atom, float] = field(init=False, repr=False)
    _partners: Mapping[Atom, frozenset[Atom]] = field(init=False, repr=False)
    _clusters: Mapping[Atom, tuple[tuple[Group, ...], ...]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        groups_of = self.network.groups_of
        partners = {
            atom: frozenset(partner for group in groups_of[atom] for partner in group.atoms) - {atom}
            for atom in self.network.atoms
        }
        object.__setattr__(self, "_partners", partners)
        clusters = {
            atom: found for atom, groups in groups_of.items() if len(found := _clustered(atom, groups)) < len(groups)
        }
        object.__setattr__(self, "_clusters", clusters)
        object.__setattr__(self, "_uniform", self.network.solve({}).marginal)
        if self.space is not None and self.space.atoms != self.network.atoms:
            raise ValueError("the listed states are about other atoms than the mutex groups")
        object.__setattr__(self, "_start", self._before_any_look())

    def begin(self) -> BeliefState:
        """Return a prior in which all states are equally probable but for what is stated (`prior`); groups are rarely
        empty (`EMPTY_GROUP`), and states that are not listed rarely occur where some are (`ACCIDENT`)."""
        return BeliefState(self._start)

    def _before_any_look(self) -> tuple[Hypothesis, ...]:
        weights = {}
        for atom, groups in self.network.groups_of.items():
            sizes = [len(group.atoms) for group in groups if not group.exact]
            weights[atom] = math.fsum(math.log((1.0 - EMPTY_GROUP) / (EMPTY_GROUP * size)) for size in sizes)
        allowed = Weighted.of(self.network, weights)
        stated = {atom: value for atom, value in self.prior.items() if atom in weights}
        if stated:
            even = allowed.solve({}).marginal
            allowed = self._weighted(informed(self.network.groups, even, stated))
        if self.space is None:
            return (Hypothesis(1.0, allowed),)
        listed = Listed.uniform(self.space)
        if stated:
            even = self.space.solve({}).marginal
            ratios = {atom: _log_odds(value) - _log_odds(even[atom]) for atom, value in stated.items()}
            listed = Listed(self.space, np.log(np.maximum(listed_posterior([(1.0, listed)], ratios), 1e-300)))
        return Hypothesis(1.0 - ACCIDENT, listed), Hypothesis(ACCIDENT, allowed)

    def acted(self, memory: BeliefState, step: Step | None, result: SkillResult | None = None) -> BeliefState:
        if self.actions is None:
            return replace(self.begin(), before=memory.now, now=memory.now)
        marginal, process_noise = memory.marginal or self._posterior(memory).marginal, self.actions.process_noise
        # Over listed states, what no action explains is any state at all: all is doubted there already.
        touched = self._touched(memory)
        marginal = {
            a: (1.0 - TOUCHED) * p + TOUCHED * self._uniform[a] if a in touched else p for a, p in marginal.items()
        }
        after = marginal if step is None else with_effects(marginal, step, self._partners)
        hidden = self._hidden(marginal) | self._hidden(after)
        unchanged = self._with_noise(marginal, process_noise, hidden)
        undetermined: frozenset[Atom] = frozenset()
        chances = Chances(0.0, 1.0, 0.0)
        if step is None:
            outcomes = [(1.0, unchanged, False)]
        else:
            chances = self.actions.chances(step.action, SkillStatus.DONE if result is None else result.status)
            undetermined = affected(step, self._partners)
            outcomes = [
                (chances.effects, self._with_noise(after, process_noise, hidden), True),
                (chances.nothing, unchanged, False),
                (chances.other, {**unchanged, **{atom: self._uniform[atom] for atom in undetermined}}, False),
            ]
        hypotheses = [Hypothesis(chance, self._weighted(then), effects) for chance, then, effects in outcomes]
        if self.space is not None:
            share, before = self._listed(memory)
            listed = predict(self.space, before, step, chances, undetermined, process_noise)
            hypotheses = [Hypothesis(share * each.chance, each.prior, each.effects) for each in listed] + [
                each._replace(chance=(1.0 - share) * each.chance) for each in hypotheses
            ]
        return BeliefState(
            tuple(hypotheses),
            before=memory.now,
            now=memory.now,
            earlier=MappingProxyType(self._carry_evidence(memory, marginal, unchanged, undetermined)),
            sensed=MappingProxyType({}) if step is None else skill_evidence(self.carried, step, result),
            acted=undetermined,
        )

    def _touched(self, memory: BeliefState) -> frozenset[Atom]:
        """Return the atoms that are out of view behind what was seen to have moved though the last action did not move
        it, and their mutex partners: where the things that they are about may be instead. What is in view is there."""
        before, now = memory.before.facts, memory.now.facts
        moved = {atom for atom, value in now.items() if before.get(atom, value) is not value} - memory.acted
        if not moved or not self.visibility:
            return frozenset()
        visibility, in_view = self.visibility, now.true - self.visibility.hidden(now)
        behind = {
            atom
            for atom in visibility.covered(now)
            if not moved.isdisjoint(visibility.rules.support(visibility.conditions[atom].atoms))
            and in_view.isdisjoint(self._partners[atom])
        }
        return frozenset(behind.union(*(self._partners[atom] for atom in behind)))

    def looked(self, memory: BeliefState, raw: Belief, cycle: int) -> tuple[BeliefState, Judgement]:
        if not self.visibility:
            return self._looked(memory, raw, cycle)
        # What can be seen depends on what is seen: first what always can be, then what can be as far as that tells.
        told = raw.probability.keys() | {atom for each in raw.witnesses.values() for atom in each}
        used = told - self.visibility.conditions.keys()
        while True:
            after, judgement = self._looked(memory, _only(raw, used), cycle)
            known = judgement.seen | {atom: each.value for atom, each in judgement.remembered.items()}
            more = told - used - self.visibility.hidden(known)
            if not more:
                return after, judgement
            used |= more

    def _looked(self, memory: BeliefState, raw: Belief, cycle: int) -> tuple[BeliefState, Judgement]:
        answers = {atom: value for atom, value in raw.probability.items() if atom in self._partners}
        evidence = {**memory.evidence}
        for atom, value in answers.items():
            evidence[atom] = (*evidence.get(atom, ()), self.sensor_model.evidence(atom, value))
        memory = replace(memory, evidence=MappingProxyType(evidence), witnessed=self._witnessed(memory, raw))
        told = memory.told
        posterior = self._posterior(memory)
        marginal = posterior.marginal
        seen = self._seen(marginal, told)
        now = memory.before.updated(seen, cycle)
        decided = {atom: marginal[atom] for atom in self.network.atoms if atom in told or atom in seen}
        judgement = Judgement(
            belief=replace(raw, probability=decided, unanswered=frozenset(self.network.atoms) - decided.keys()),
            seen=seen,
            probability=MappingProxyType(dict(marginal)),
            state=Facts.closed(posterior.best, self.network.atoms)
            if posterior.is_listed
            else self._state(posterior.best, told, seen, now.facts),
            contradictions=self._contradictions(answers, marginal),
            overruled=tuple(self._overruled(answers, seen, marginal)),
            remembered=now.remembered(seen, cycle, marginal),
            came_about=self._came_about(memory, posterior),
        )
        return replace(memory, marginal=marginal, now=now, chances=posterior.chances), judgement

    def state_without(self, memory: BeliefState, atom: Atom) -> Facts | None:
        partners = sorted(self._partners[atom])
        posteriors = [self._posterior(memory, {atom: -_CERTAIN, partner: _CERTAIN}) for partner in partners]
        if not posteriors:
            return None
        return Facts.closed(max(posteriors, key=lambda posterior: posterior.log_best).best, self.network.atoms)

    def state_with(self, memory: BeliefState, atom: Atom) -> Facts | None:
        return Facts.closed(self._posterior(memory, {atom: _CERTAIN}).best, self.network.atoms)

    def supposing(self, memory: BeliefState, literals: Mapping[Atom, bool]) -> Supposition:
        conditions = {atom: _CERTAIN if value else -_CERTAIN for atom, value in literals.items()}
        posterior = self._posterior(memory, conditions)
        return Supposition(posterior.marginal, Facts.closed(posterior.best, self.network.atoms))

    def _witnessed(self, memory: BeliefState, raw: Belief) -> Mapping[str, Mapping[Atom, tuple[float, ...]]]:
        """Return what witnesses told at this moment, with what they tell in one more look."""
        found = {name: dict(told) for name, told in memory.witnessed.items()}
        for name, told in raw.witnesses.items():
            if name in self.witnesses:
                own, sensor = found.setdefault(name, {}), self.witnesses[name].sensor
                for atom, value in told.items():
                    if atom in self._partners:
                        own[atom] = (*own.get(atom, ()), sensor.evidence(atom, value))
        return MappingProxyType(found)

    def _told(self, memory: BeliefState) -> dict[Atom, float]:
        """Return the evidence of this moment's looks about each atom, of the estimator and of witnesses together."""
        pooled = {atom: self.sensor_model.pooled(values, atom.predicate) for atom, values in memory.evidence.items()}
        if not memory.witnessed:
            return pooled
        others: dict[Atom, list[tuple[float, float]]] = {}
        for name, told in memory.witnessed.items():
            witness = self.witnesses[name]
            for atom, values in told.items():
                evidence = witness.sensor.pooled(values, atom.predicate), witness.shared
                others.setdefault(atom, []).append(evidence)
        return {atom: together(pooled.get(atom), others.get(atom, ())) for atom in memory.told}

    def _carry_evidence(
        self,
        memory: BeliefState,
        marginal: Mapping[Atom, float],
        unchanged: Mapping[Atom, float],
        undetermined: frozenset[Atom],
    ) -> dict[Atom, PastEvidence]:
        """Return the evidence that stays for the next moment: that about atoms which the action does not affect.
        `marginal` is the posterior of this moment, `unchanged` the same with process noise."""
        kept = {}
        told = self._told(memory)
        for atom in (told.keys() | memory.earlier.keys()) - undetermined:
            before, after = memory.earlier.get(atom), _log_odds(marginal[atom])
            if before is None:
                now = PastEvidence((after,), after)
            elif atom in told:
                now = before.with_look(told[atom], after)
            else:
                now = before
            kept[atom] = now._replace(believed=_log_odds(unchanged[atom]))
        return kept

    def _increment(self, atom: Atom, evidence: float, memory: BeliefState) -> float:
        earlier = memory.earlier.get(atom)
        return evidence if earlier is None else self.sensor_model.increment(evidence, earlier, atom.predicate)

    def _came_about(self, memory: BeliefState, posterior: Posterior) -> float | None:
        """Return the probability that the last action had its effects; None if there was none."""
        effects = [each.effects for each in memory.hypotheses]
        if not any(effects):
            return None
        return math.fsum(chance for chance, own in zip(posterior.chances, effects, strict=True) if own)

    def _listed(self, memory: BeliefState) -> tuple[float, FloatArray]:
        """Return the prior probability, at the next moment, that the state is a listed one, and the posterior
        probability of each listed state if it is."""
        parts = [(each.chance, each.prior) for each in memory.hypotheses if isinstance(each.prior, Listed)]
        chances = memory.chances or self._posterior(memory).chances
        share = math.fsum(
            chance for chance, each in zip(chances, memory.hypotheses, strict=True) if isinstance(each.prior, Listed)
        )
        return (1.0 - ACCIDENT) * share + ACCIDENT * (1.0 - share), listed_posterior(parts, self._evidence(memory))

    def _weighted(self, marginal: Mapping[Atom, float]) -> Weighted:
        """Return the distribution over states with these marginals, in Bethe form: the product over groups of the
        probability of the group's true atom (or of none), divided by the surplus factors of shared atoms. Groups that
        share several atoms count as one: divided by each of these, what is improbable would become probable."""
        clipped = {atom: min(1.0 - _EDGE, max(_EDGE, value)) for atom, value in marginal.items()}
        none = {
            group: 0.0 if group.exact else math.log(max(_EDGE, 1.0 - math.fsum(clipped[atom] for atom in group.atoms)))
            for group in self.network.groups
        }
        weights = {}
        for atom, groups in self.network.groups_of.items():
            log_true, log_false = math.log(clipped[atom]), math.log1p(-clipped[atom])
            clusters = self._clusters.get(atom) or tuple((group,) for group in groups)
            weights[atom] = math.fsum(
                log_true - math.fsum(none[group] for group in cluster) / len(cluster) for cluster in clusters
            )
            weights[atom] += (1 - len(clusters)) * (log_true - log_false)
        if isinstance(self.network, ConstrainedNetwork):
            weights = self.network.fitted(weights, clipped)
        return Weighted.of(self.network, weights)

    def _evidence(self, memory: BeliefState) -> dict[Atom, float]:
        """Return what this moment's looks and the last skill's report add to the log-odds of each atom."""
        evidence = {atom: self._increment(atom, value, memory) for atom, value in self._told(memory).items()}
        for atom, value in memory.sensed.items():
            evidence[atom] = evidence.get(atom, 0.0) + value
        return evidence

    def _posterior(self, memory: BeliefState, conditions: Mapping[Atom, float] = MappingProxyType({})) -> Posterior:
        """Apply Bayes' rule over outcomes and states. `conditions` are log-odds that replace the evidence about their
        atoms."""
        return infer(
            [(each.chance, each.prior) for each in memory.hypotheses], {**self._evidence(memory), **conditions}
        )

    def _with_noise(
        self, marginal: Mapping[Atom, float], process_noise: float, hidden: Collection[Atom] = ()
    ) -> dict[Atom, float]:
        """Return the marginals mixed with the uniform prior's, which has the weight `process_noise`, and less for what
        is hidden."""
        mixed = {}
        for atom, value in marginal.items():
            noise = HIDDEN_NOISE * process_noise if atom in hidden else process_noise
            mixed[atom] = (1.0 - noise) * value + noise * self._uniform[atom]
        return mixed

    def _hidden(self, marginal: Mapping[Atom, float]) -> frozenset[Atom]:
        """Return the atoms that are not believed to be visible."""
        if not self.visibility:
            return frozenset()
        truth = {atom: self._truth(atom, value) for atom, value in marginal.items()}
        return self.visibility.hidden({atom: value for atom, value in truth.items() if value is not None})

    def _truth(self, atom: Atom, probability: float) -> bool | None:
        return self.thresholds.get(atom.predicate, DEFAULT_THRESHOLDS).truth(probability)

    def _seen(self, marginal: Mapping[Atom, float], asked: Mapping[Atom, Sequence[float]]) -> Facts:
        """Return the truth of the answered atoms at their thresholds, and what follows from it by the mutex groups,
        and in the listed states, about the others, as far as their own thresholds allow it. An answer too weak to count
        neither tells anything nor keeps what the others tell from being seen."""
        answered = {atom for atom, values in asked.items() if max(map(abs, values)) >= LEAST_EVIDENCE}
        truth = {atom: self._truth(atom, marginal[atom]) for atom in answered}
        seen = {atom: value for atom, value in truth.items() if value is not None}
        for group in self.network.groups:
            unseen = [atom for atom in group.atoms if atom not in seen]
            follows: Mapping[Atom, bool] = {}
            if any(seen.get(atom) for atom in group.atoms):
                follows = dict.fromkeys(unseen, False)
            elif group.exact and len(unseen) == 1:
                follows = {unseen[0]: True}
            self._add(seen, follows, answered, marginal)
        if self.space is not None:
            self._add(seen, self.space.common(seen), answered, marginal)
        return Facts(seen)

    def _add(
        self,
        seen: dict[Atom, bool],
        follows: Mapping[Atom, bool],
        answered: Collection[Atom],
        marginal: Mapping[Atom, float],
    ) -> None:
        """Add to `seen` what follows from it about atoms that were not answered."""
        for atom, value in follows.items():
            if atom not in answered and atom not in seen and self._truth(atom, marginal[atom]) is value:
                seen[atom] = value

    def _state(self, best: frozenset[Atom], asked: Mapping[Atom, Sequence[float]], seen: Facts, known: Facts) -> Facts:
        """Return `Judgement.state`."""
        true = {atom for atom in asked if atom in best}
        true |= seen.only(atom for atom in seen if atom not in asked).true
        concealed = self.visibility.conditions.keys() - asked.keys() - seen.keys()
        true |= {atom for atom in sorted(concealed & best) if true.isdisjoint(self._partners[atom])}
        remembered = sorted(known.without(asked).without(seen).without(concealed).true)
        return Facts.closed(
            true.union(atom for atom in remembered if true.isdisjoint(self._partners[atom])), self.network.atoms
        )

    def _contradictions(
        self, answers: Mapping[Atom, float], marginal: Mapping[Atom, float]
    ) -> tuple[Contradiction, ...]:
        found = []
        for group in self.network.groups:
            asked = [atom for atom in group.atoms if atom in answers]
            conflicting = [atom for atom in asked if answers[atom] >= 0.5]
            empty = group.exact and not conflicting and len(asked) == len(group.atoms)
            if len(conflicting) > 1 or empty:
                conflicting = asked if empty else conflicting
                answered, resolved = ({atom: of[atom] for atom in conflicting} for of in (answers, marginal))
                found.append(Contradiction(answered, resolved, empty))
        return tuple(found)

    def _overruled(self, answers: Mapping[Atom, float], seen: Facts, marginal: Mapping[Atom, float]) -> list[Overruled]:
        return [
            Overruled(atom, answered, value, seen.get(atom), marginal[atom])
            for atom, value in answers.items()
            if (answered := self._truth(atom, value)) is not None and seen.get(atom) is not answered
        ]


def _only(raw: Belief, atoms: Collection[Atom]) -> Belief:
    """Return the answers about these atoms; the others count as unanswered."""
    witnesses = {name: {a: told for a, told in each.items() if a in atoms} for name, each in raw.witnesses.items()}
    return replace(raw.without(raw.probability.keys() - atoms), witnesses=witnesses)


def _log_odds(probability: float) -> float:
    clipped = min(1.0 - _EDGE, max(_EDGE, probability))
    return math.log(clipped / (1.0 - clipped))


def _clustered(atom: Atom, groups: Sequence[Group]) -> tuple[tuple[Group, ...], ...]:
    """Return an atom's groups, those together that share another atom, too."""
    found: list[tuple[set[Atom], list[Group]]] = []
    for group in groups:
        others = set(group.atoms) - {atom}
        joined = [each for each in found if not each[0].isdisjoint(others)]
        found = [each for each in found if each[0].isdisjoint(others)]
        found.append((others.union(*(each[0] for each in joined)), [g for each in joined for g in each[1]] + [group]))
    return tuple(tuple(members) for _, members in found)
