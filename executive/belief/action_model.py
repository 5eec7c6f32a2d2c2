"""The action model: how an action changes the belief, which is the prior of the next look.

An action has one of three outcomes: its effects come about; nothing changes; or something else happens to the objects
that it is about (an item is dropped, say), and then any state of them is possible. The probability of each outcome
depends on the skill and on the status that it reports. Besides, process noise: between two actions anything may change
with a small probability (someone moves an item), so that no belief is so certain that a clear look cannot correct it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from executive.types import Atom, Condition, Facts, SkillResult, SkillStatus, Step

MOST_NOISE = 0.04
"""The process noise of a task with few atoms: the probability that any given one changes by itself."""

PRIOR = 20.0
"""The weight of the defaults, in measured actions."""


class Chances(NamedTuple):
    """The probability of each outcome of an action that ended with some status, or how often each was counted.

    The outcomes: all effects came about, nothing changed, something else happened.
    """

    effects: float
    nothing: float
    other: float


DEFAULTS: Mapping[SkillStatus, Chances] = MappingProxyType(
    {
        SkillStatus.DONE: Chances(0.93, 0.03, 0.04),
        SkillStatus.GRASP_MISSED: Chances(0.02, 0.88, 0.10),
        SkillStatus.DROPPED: Chances(0.03, 0.17, 0.80),
        SkillStatus.FELL: Chances(0.03, 0.02, 0.95),
        SkillStatus.COLLAPSED: Chances(0.03, 0.02, 0.95),
        SkillStatus.CLOSED: Chances(0.01, 0.59, 0.40),  # what was believed to be open is not
        SkillStatus.JAMMED: Chances(0.01, 0.96, 0.03),
        SkillStatus.STOPPED_SHORT: Chances(0.45, 0.45, 0.10),
        SkillStatus.SLIPPED: Chances(0.10, 0.80, 0.10),
        SkillStatus.NO_PATH: Chances(0.01, 0.97, 0.02),
        SkillStatus.UNREACHABLE: Chances(0.01, 0.97, 0.02),
        SkillStatus.BLOCKED: Chances(0.01, 0.97, 0.02),
        SkillStatus.DOES_NOT_FIT: Chances(0.01, 0.97, 0.02),
        SkillStatus.NOT_THERE: Chances(0.01, 0.19, 0.80),  # it is somewhere else than was believed
        SkillStatus.NOT_APPLICABLE: Chances(0.01, 0.97, 0.02),
        SkillStatus.TIMED_OUT: Chances(0.30, 0.40, 0.30),
        SkillStatus.CANCELLED: Chances(0.20, 0.50, 0.30),
        SkillStatus.CRASHED: Chances(0.20, 0.50, 0.30),
    }
)
"""The assumed outcome probabilities of a skill that was not measured. A skill reports what it sensed, not the outcome;
these numbers only have to be good enough for one or two looks to overrule them."""


@dataclass(frozen=True, slots=True)
class ActionModel:
    """How reliable the skills are, and how much the world changes by itself.

    Args:
        counts: how many actions had each outcome, by action and by the status that the skill reported. They correct
            the defaults.
        process_noise: the probability that any given atom changes by itself from one action to the next; that of a
            task is in `process_noise`.

    Raises:
        ValueError: the process noise is not in (0, 1), or a count is negative.
    """

    counts: Mapping[tuple[str, SkillStatus], Chances] = field(default_factory=lambda: MappingProxyType({}))
    process_noise: float = MOST_NOISE

    def __post_init__(self) -> None:
        if not 0.0 < self.process_noise < 1.0:
            raise ValueError(f"process_noise: a probability between 0 and 1 is expected, got {self.process_noise}")
        for (action, status), counts in self.counts.items():
            if min(counts) < 0:
                raise ValueError(f"{action}, {status}: counts have to be 0 or more")

    def chances(self, action: str, status: SkillStatus) -> Chances:
        """Return the probability of each outcome: the counts, with the defaults as `PRIOR` more actions."""
        counts = self.counts.get((action, status), Chances(0, 0, 0))
        total = sum(counts) + PRIOR
        pairs = zip(counts, DEFAULTS[status], strict=True)
        return Chances(*((count + PRIOR * share) / total for count, share in pairs))


def process_noise(atoms: int) -> float:
    """Return the process noise of a task with so many atoms, of which about one changes by itself from one action to
    the next: what others do to the world does not become more because more is said of it."""
    return min(MOST_NOISE, 1.0 / max(1, atoms))


GRIP_EVIDENCE = math.log(499.0)
"""The log-likelihood ratio of the gripper's own sensing (something between the fingers, or nothing): assumed wrong once
in five hundred times. In the 2,000 collected actions that `domains/grocery/outcomes.toml` counts it never was."""

ABSENCE_EVIDENCE = math.log(19.0)
"""The log-likelihood ratio of a skill's report that an object is not there, or that what it needs does not hold.
Two looks that see it there outweigh it."""


def skill_evidence(
    carried: Mapping[str, tuple[str, tuple[int, ...]]], step: Step, result: SkillResult | None
) -> Mapping[Atom, float]:
    """Return the evidence (log-likelihood ratios) in a skill's report: what the gripper senses, and what was not there.

    That the gripper holds something tells which object it is only where the skill reports success.
    """
    if result is None:
        return MappingProxyType({})
    found: dict[Atom, float] = {}
    if result.status in (SkillStatus.NOT_THERE, SkillStatus.NOT_APPLICABLE):
        needed = {atom for atom in step.precondition.facts.true if set(atom.args) & set(step.args)}
        if result.status is SkillStatus.NOT_THERE:  # an object is taken from where it is: what says so becomes false
            needed = needed.intersection(step.affects) or needed
        found = dict.fromkeys(needed, -ABSENCE_EVIDENCE) if len(needed) == 1 else {}
    atom = step.about(carried)
    if atom is not None and result.holding is not None and (result.done or not result.holding):
        found[atom] = GRIP_EVIDENCE if result.holding else -GRIP_EVIDENCE
    return MappingProxyType(found)


def outcome(step: Step, before: Facts, after: Facts) -> Chances:
    """Return which outcome an action had, as counts of which one is 1, given the facts before and after it.

    Both have to include all atoms that the step's effects name. An effect that held before the action counts as come
    about if it still holds.
    """
    changes = step.changes(before)
    if all(after[atom] is value for atom, value in changes.items() if value is not None):
        return Chances(1, 0, 0)
    if all(after[atom] is before[atom] for atom in changes):
        return Chances(0, 1, 0)
    return Chances(0, 0, 1)


def with_effects(
    marginal: Mapping[Atom, float], step: Step, partners: Mapping[Atom, frozenset[Atom]]
) -> dict[Atom, float]:
    """Return the marginals after the step's effects have come about. `partners` are each atom's mutex partners: the
    atoms that cannot be true together with it."""
    after = dict(marginal)
    for effect in step.effects:
        chance = _probability(effect.condition, marginal)
        for atom, value in effect.facts.items():
            for partner in partners[atom] if value else ():
                after[partner] *= 1.0 - chance
    for value in (False, True):  # what is both deleted and added is true
        for effect in step.effects:
            chance = _probability(effect.condition, marginal)
            for atom in effect.facts.true if value else effect.facts.false:
                after[atom] = chance * value + (1.0 - chance) * after[atom]
    return after


def _probability(condition: Condition, marginal: Mapping[Atom, float]) -> float:
    """Return how probable a condition is, its parts taken as independent. What has no marginal may be either."""
    product = 1.0
    for atom, value in condition.facts.items():
        chance = marginal.get(atom, 0.5)
        product *= chance if value else 1.0 - chance
    for choice in condition.choices:
        product *= 1.0 - math.prod(1.0 - _probability(part, marginal) for part in choice)
    return product


def affected(step: Step, partners: Mapping[Atom, frozenset[Atom]]) -> frozenset[Atom]:
    """Return the atoms that are undetermined when a step has another outcome than its effects: the effects' atoms, and
    those of their mutex partners that share an object with the step."""
    objects = frozenset(step.args)
    related = {
        partner
        for atom in step.affects
        for partner in partners[atom]
        if not partner.args or not objects.isdisjoint(partner.args)
    }
    return frozenset(related.union(step.affects))
