"""The monitor that weighs things up: what the looks say, what cannot be so together, and what was so before.

Consistency and memory are one computation. The probability of a state is proportional to that of its answers, times
that which the action model gives it after what was believed before; states that break a mutex group have none. What is
believed is kept as one probability for each atom. Together with the groups they stand for a distribution over states:
that in which atoms of different groups are independent but for the atoms that the groups share (the Bethe form, exact
where the groups' overlaps form no circle, as with items and a gripper; an assumed density filter, Boyen and Koller
1998). After an action it is a mixture of three such distributions, one for each outcome
(`executive.belief.action_model`); it stays one until the next action, so that all answers together tell what came of
the action."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

from executive.belief.action_model import ActionModel, applied, felt, touched
from executive.belief.interface import Judgement, Thresholds
from executive.belief.last_known import LastKnown
from executive.belief.mutex_inference import MutexNetwork
from executive.belief.sensor_model import HARDLY, PastEvidence, SensorModel
from executive.types import Atom, Belief, Contradiction, Facts, Overruled, SkillResult, SkillStatus, Step

BAND = Thresholds(0.15, 0.85)
"""Where no error rate was asked for: what is less sure than this, one way or the other, is not known."""

NOWHERE = 0.05
"""The chance, before anything was seen, that a given group's atoms are all false although one of them could be true."""

_CERTAIN = 1e3
"""Log-odds that no evidence comes near."""

_LEAST = 1e-6
"""No prior is nearer to 0 or 1."""


class Hypothesis(NamedTuple):
    """One of the things that may have come of the last action: its chance, its distribution over states as weights (see
    `MutexNetwork.solve`), and the logarithm of their sum."""

    chance: float
    weights: Mapping[Atom, float]
    log_total: float


@dataclass(frozen=True, slots=True)
class BeliefState:
    """What is believed of this moment but for its looks, their evidence atom by atom, what each atom's probability is
    with it (None before the first look), and the last known values before these looks and with them. `earlier` is what
    looks at other moments told of atoms that no action has touched since; `felt` is
    what its skill came upon, as evidence. The first
    hypothesis is that the last action's effects came about, if there are more than one."""

    hypotheses: tuple[Hypothesis, ...]
    evidence: Mapping[Atom, tuple[float, ...]] = field(default_factory=lambda: MappingProxyType({}))
    marginal: Mapping[Atom, float] | None = None
    before: LastKnown = field(default_factory=LastKnown)
    now: LastKnown = field(default_factory=LastKnown)
    earlier: Mapping[Atom, PastEvidence] = field(default_factory=lambda: MappingProxyType({}))
    felt: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))


class _Posterior(NamedTuple):
    """Each atom's probability, the most probable state's true atoms, each hypothesis's probability, and the logarithm
    of what the most probable state weighs."""

    marginal: Mapping[Atom, float]
    best: frozenset[Atom]
    chances: tuple[float, ...]
    log_best: float


@dataclass(frozen=True, slots=True, eq=False)
class BayesMonitor:
    """Makes looks consistent, and remembers.

    Args:
        network: the task's atoms and its mutex groups; without groups, each atom is on its own.
        eye: what the answers are worth.
        actions: how reliable the skills are; None to forget at each action all that was seen before.
        thresholds: by predicate; `BAND` for those that it does not name.
        carried: by action, what is true while its skill carries something (see `Step.about`):
            what the hand feels is a witness to it, besides the looks.
    """

    network: MutexNetwork
    eye: SensorModel = field(default_factory=SensorModel)
    actions: ActionModel | None = field(default_factory=ActionModel)
    thresholds: Mapping[str, Thresholds] = field(default_factory=lambda: MappingProxyType({}))
    carried: Mapping[str, tuple[str, tuple[int, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    _any: Mapping[Atom, float] = field(init=False, repr=False)
    _partners: Mapping[Atom, frozenset[Atom]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        around = self.network.around
        partners = {
            atom: {mate for group in around[atom] for mate in group.atoms} - {atom} for atom in self.network.atoms
        }
        object.__setattr__(self, "_partners", {atom: frozenset(others) for atom, others in partners.items()})
        object.__setattr__(self, "_any", self.network.solve({}).marginal)

    def begin(self) -> BeliefState:
        """Any state is as probable as any other, but that groups are rarely empty (`NOWHERE`)."""
        weights = {}
        for atom, groups in self.network.around.items():
            sizes = [len(group.atoms) for group in groups if not group.exact]
            weights[atom] = math.fsum(math.log((1.0 - NOWHERE) / (NOWHERE * size)) for size in sizes)
        return BeliefState((Hypothesis(1.0, weights, self.network.solve(weights).log_total),))

    def acted(self, memory: BeliefState, step: Step | None, result: SkillResult | None = None) -> BeliefState:
        if self.actions is None:
            return replace(self.begin(), before=memory.now, now=memory.now)
        marginal, process_noise = memory.marginal or self._posterior(memory).marginal, self.actions.process_noise
        still = self._mixed(marginal, process_noise)
        open_: frozenset[Atom] = frozenset()
        if step is None:
            outcomes = [(1.0, still)]
        else:
            chances = self.actions.chances(step.action, SkillStatus.DONE if result is None else result.status)
            open_ = touched(step, self._partners)
            outcomes = [
                (chances.effects, self._mixed(applied(marginal, step, self._partners), process_noise)),
                (chances.nothing, still),
                (chances.other, {atom: self._any[atom] if atom in open_ else still[atom] for atom in still}),
            ]
        return BeliefState(
            tuple(self._hypothesis(*outcome) for outcome in outcomes),
            before=memory.now,
            now=memory.now,
            earlier=MappingProxyType(self._earlier(memory, marginal, still, open_)),
            felt=MappingProxyType({}) if step is None else felt(self.carried, step, result),
        )

    def looked(self, memory: BeliefState, raw: Belief, cycle: int) -> tuple[BeliefState, Judgement]:
        answers = {atom: value for atom, value in raw.probability.items() if atom in self._partners}
        evidence = {**memory.evidence}
        for atom, value in answers.items():
            evidence[atom] = (*evidence.get(atom, ()), self.eye.evidence(atom, value))
        memory = replace(memory, evidence=MappingProxyType(evidence))
        posterior = self._posterior(memory)
        marginal = posterior.marginal
        seen = self._seen(marginal, evidence)
        now = memory.before.updated(seen, cycle)
        told = {atom: marginal[atom] for atom in self.network.atoms if atom in evidence or atom in seen}
        judgement = Judgement(
            belief=replace(raw, probability=told, unanswered=frozenset(self.network.atoms) - told.keys()),
            seen=seen,
            probability=MappingProxyType(dict(marginal)),
            state=self._state(posterior.best, evidence, seen, now.facts),
            contradictions=self._contradictions(answers, marginal),
            overruled=tuple(self._overruled(answers, seen, marginal)),
            remembered=now.remembered(seen, cycle, marginal),
            came_about=posterior.chances[0] if len(posterior.chances) > 1 else None,
        )
        return replace(memory, marginal=marginal, now=now), judgement

    def otherwise(self, memory: BeliefState, atom: Atom) -> Facts | None:
        others = sorted(self._partners[atom])
        supposed = [self._posterior(memory, {atom: -_CERTAIN, mate: _CERTAIN}) for mate in others]
        if not supposed:
            return None
        return Facts.closed(max(supposed, key=lambda posterior: posterior.log_best).best, self.network.atoms)

    def supposing(self, memory: BeliefState, atom: Atom) -> Facts | None:
        return Facts.closed(self._posterior(memory, {atom: _CERTAIN}).best, self.network.atoms)

    def _earlier(
        self,
        memory: BeliefState,
        marginal: Mapping[Atom, float],
        still: Mapping[Atom, float],
        touched_: frozenset[Atom],
    ) -> dict[Atom, PastEvidence]:
        """What is known to have been said of the atoms that the action which comes next does not touch. `marginal` is
        what was believed at the end of this moment, `still` what is left of that for the next one."""
        kept = {}
        for atom in (memory.evidence.keys() | memory.earlier.keys()) - touched_:
            before, after = memory.earlier.get(atom), _log_odds(marginal[atom])
            if before is None:
                now = PastEvidence((after,), after)
            elif atom in memory.evidence:
                now = before.with_look(self.eye.together(memory.evidence[atom]), after)
            else:
                now = before
            kept[atom] = now._replace(believed=_log_odds(still[atom]))
        return kept

    def _anew(self, atom: Atom, evidence: float, memory: BeliefState) -> float:
        earlier = memory.earlier.get(atom)
        return evidence if earlier is None else self.eye.anew(evidence, earlier)

    def _hypothesis(self, chance: float, marginal: Mapping[Atom, float]) -> Hypothesis:
        """The distribution over states that probabilities of atoms stand for. A group contributes that of its atom, or
        of none of them; what an atom that several groups share is counted for too often is taken out again."""
        kept = {atom: min(1.0 - _LEAST, max(_LEAST, value)) for atom, value in marginal.items()}
        none = {
            group: 0.0 if group.exact else math.log(max(_LEAST, 1.0 - math.fsum(kept[atom] for atom in group.atoms)))
            for group in self.network.groups
        }
        weights = {}
        for atom, groups in self.network.around.items():
            log_true, log_false = math.log(kept[atom]), math.log1p(-kept[atom])
            weights[atom] = math.fsum(log_true - none[group] for group in groups)
            weights[atom] += (1 - len(groups)) * (log_true - log_false)
        return Hypothesis(chance, weights, self.network.solve(weights).log_total)

    def _posterior(self, memory: BeliefState, supposed: Mapping[Atom, float] = MappingProxyType({})) -> _Posterior:
        """Bayes' rule over outcomes and states. The most probable state is that of the most probable pair of both.
        `supposed` takes the place of evidence."""
        evidence = {
            atom: self._anew(atom, self.eye.together(values), memory) for atom, values in memory.evidence.items()
        }
        for atom, value in memory.felt.items():
            evidence[atom] = evidence.get(atom, 0.0) + value
        evidence = {**evidence, **supposed}
        answers, logs = [], []
        for chance, weights, log_total in memory.hypotheses:
            answer = self.network.solve({atom: weight + evidence.get(atom, 0.0) for atom, weight in weights.items()})
            answers.append(answer)
            logs.append(math.log(chance) - log_total)
        totals = [log + answer.log_total for log, answer in zip(logs, answers, strict=True)]
        shares = [math.exp(total - max(totals)) for total in totals]
        chances = tuple(share / math.fsum(shares) for share in shares)
        marginal = {
            atom: min(
                1.0, math.fsum(chance * answer.marginal[atom] for chance, answer in zip(chances, answers, strict=True))
            )
            for atom in self.network.atoms
        }
        heaviest = max(range(len(logs)), key=lambda number: logs[number] + answers[number].log_best)
        return _Posterior(marginal, answers[heaviest].best, chances, logs[heaviest] + answers[heaviest].log_best)

    def _mixed(self, marginal: Mapping[Atom, float], process_noise: float) -> dict[Atom, float]:
        """With the chance `process_noise` that anything has become of each atom."""
        return {
            atom: (1.0 - process_noise) * value + process_noise * self._any[atom] for atom, value in marginal.items()
        }

    def _truth(self, atom: Atom, probability: float) -> bool | None:
        return self.thresholds.get(atom.predicate, BAND).truth(probability)

    def _seen(self, marginal: Mapping[Atom, float], asked: Mapping[Atom, Sequence[float]]) -> Facts:
        """What the answers tell: the answered atoms at their thresholds, and what follows from these by the groups."""
        answered = (atom for atom, values in asked.items() if max(map(abs, values)) >= HARDLY)
        truth = {atom: self._truth(atom, marginal[atom]) for atom in answered}
        seen = {atom: value for atom, value in truth.items() if value is not None}
        for group in self.network.groups:
            open_ = [atom for atom in group.atoms if atom not in asked and atom not in seen]
            if any(seen.get(atom) for atom in group.atoms):
                seen.update(dict.fromkeys(open_, False))
            elif group.exact and len(open_) == 1 and all(atom in seen for atom in group.atoms if atom != open_[0]):
                seen[open_[0]] = True
        return Facts(seen)

    def _state(self, best: frozenset[Atom], asked: Mapping[Atom, Sequence[float]], seen: Facts, known: Facts) -> Facts:
        """See `Judgement.state`."""
        true = {atom for atom in asked if atom in best}
        true |= seen.only(atom for atom in seen if atom not in asked).true
        old = sorted(known.without(asked).without(seen).true)
        return Facts.closed(
            true.union(atom for atom in old if true.isdisjoint(self._partners[atom])), self.network.atoms
        )

    def _contradictions(
        self, answers: Mapping[Atom, float], marginal: Mapping[Atom, float]
    ) -> tuple[Contradiction, ...]:
        found = []
        for group in self.network.groups:
            asked = [atom for atom in group.atoms if atom in answers]
            clash = [atom for atom in asked if answers[atom] >= 0.5]
            empty = group.exact and not clash and len(asked) == len(group.atoms)
            if len(clash) > 1 or empty:
                clash = asked if empty else clash
                said, made = ({atom: of[atom] for atom in clash} for of in (answers, marginal))
                found.append(Contradiction(said, made, empty))
        return tuple(found)

    def _overruled(self, answers: Mapping[Atom, float], seen: Facts, marginal: Mapping[Atom, float]) -> list[Overruled]:
        return [
            Overruled(atom, answered, value, seen.get(atom), marginal[atom])
            for atom, value in answers.items()
            if (answered := self._truth(atom, value)) is not None and seen.get(atom) is not answered
        ]


def _log_odds(probability: float) -> float:
    kept = min(1.0 - _LEAST, max(_LEAST, probability))
    return math.log(kept / (1.0 - kept))
