"""What becomes of the world when an action is carried out, and in between: the prior of the next look.

Three things can come of an action. Its effects come about; or nothing changes; or something else happens to what the
action is about, such as an item that is dropped, and then anything is possible of it. How often each of them is the
case hangs on the skill and on what it reports. And at any time, with a small chance, something happens to anything
(someone moves an item), so that no memory is ever so sure that a clear look could not correct it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from executive.types import Atom, Facts, SkillResult, SkillStatus, Step

PRIOR = 20.0
"""The defaults count as much as this many measured actions."""


class Chances(NamedTuple):
    """Of an action that ended with some report: how probable each outcome is, or how often it was the case."""

    effects: float
    nothing: float
    other: float


DEFAULTS: Mapping[SkillStatus, Chances] = MappingProxyType(
    {
        SkillStatus.DONE: Chances(0.93, 0.03, 0.04),
        SkillStatus.GRASP_MISSED: Chances(0.02, 0.88, 0.10),
        SkillStatus.DROPPED: Chances(0.03, 0.17, 0.80),
        SkillStatus.NO_PATH: Chances(0.01, 0.97, 0.02),
        SkillStatus.UNREACHABLE: Chances(0.01, 0.97, 0.02),
        SkillStatus.DOES_NOT_FIT: Chances(0.01, 0.97, 0.02),
        SkillStatus.NOT_THERE: Chances(0.01, 0.19, 0.80),  # it is somewhere else than was believed
        SkillStatus.TIMED_OUT: Chances(0.30, 0.40, 0.30),
        SkillStatus.CANCELLED: Chances(0.20, 0.50, 0.30),
        SkillStatus.CRASHED: Chances(0.20, 0.50, 0.30),
    }
)
"""What is assumed of a skill that was not measured. A skill says what it felt, not what came of it, and any of these
numbers only has to be good enough for one or two looks to overrule it."""


@dataclass(frozen=True, slots=True)
class ActionModel:
    """How reliable the skills are, and how calm the world is.

    Args:
        counts: of the actions with some name whose skill reported some status, how many had each outcome. The defaults
            are corrected by them.
        unrest: the chance that something happens to any given thing from one action to the next.
    """

    counts: Mapping[tuple[str, SkillStatus], Chances] = field(default_factory=lambda: MappingProxyType({}))
    process_noise: float = 0.04

    def __post_init__(self) -> None:
        if not 0.0 < self.process_noise < 1.0:
            raise ValueError(f"unrest: a chance between 0 and 1 is expected, got {self.process_noise}")
        for (action, status), counts in self.counts.items():
            if min(counts) < 0:
                raise ValueError(f"{action}, {status}: fewer than no actions")

    def chances(self, action: str, status: SkillStatus) -> Chances:
        """How probable each outcome is: the defaults as `PRIOR` actions more, beside those that were counted."""
        counts = self.counts.get((action, status), Chances(0, 0, 0))
        total = sum(counts) + PRIOR
        pairs = zip(counts, DEFAULTS[status], strict=True)
        return Chances(*((count + PRIOR * share) / total for count, share in pairs))


FELT = math.log(499.0)
"""What it is worth that fingers feel something between them, or nothing: taken to be wrong once in five hundred times.
In the 2,000 collected actions that `domains/grocery/outcomes.toml` counts it never was."""

MISSING = math.log(19.0)
"""What it is worth that a skill does not find what it went for. Two looks that see it there are worth more."""


def felt(
    carried: Mapping[str, tuple[str, tuple[int, ...]]], step: Step, result: SkillResult | None
) -> Mapping[Atom, float]:
    """What a skill came upon, as evidence (log-odds): what the hand feels, and what was not there. That the hand is
    around something says which thing only where the skill got what it went for."""
    if result is None:
        return MappingProxyType({})
    found: dict[Atom, float] = {}
    if result.status is SkillStatus.NOT_THERE:
        needed = [atom for atom, value in step.preconditions.items() if value and set(atom.args) & set(step.args)]
        found = dict.fromkeys(needed, -MISSING) if len(needed) == 1 else {}
    atom = step.about(carried)
    if atom is not None and result.holding is not None and (result.done or not result.holding):
        found[atom] = FELT if result.holding else -FELT
    return MappingProxyType(found)


def outcome(step: Step, before: Facts, after: Facts) -> Chances:
    """Which outcome an action had whose world was `before` and `after` it: one of the three counts 1. Both have to tell
    all atoms that the step's effects name. An effect that held before comes about where it still holds."""
    if all(after[atom] is value for atom, value in step.effects.items()):
        return Chances(1, 0, 0)
    if all(after[atom] is before[atom] for atom in step.effects):
        return Chances(0, 1, 0)
    return Chances(0, 0, 1)


def applied(marginal: Mapping[Atom, float], step: Step, partners: Mapping[Atom, frozenset[Atom]]) -> dict[Atom, float]:
    """Probabilities once the step's effects have come about. `partners` are the atoms that cannot be true beside
    each."""
    after = dict(marginal)
    for atom, value in step.effects.items():
        if value:
            after.update(dict.fromkeys(partners[atom], 0.0))
    after.update({atom: float(value) for atom, value in step.effects.items()})
    return after


def touched(step: Step, partners: Mapping[Atom, frozenset[Atom]]) -> frozenset[Atom]:
    """The atoms that are open when something else than its effects comes of a step: those, and what shares a group and
    a thing with them."""
    things = frozenset(step.args)
    near = {
        mate for atom in step.effects for mate in partners[atom] if not mate.args or not things.isdisjoint(mate.args)
    }
    return frozenset(near.union(step.effects))
