"""A run's seed, and how much patience it has: what the policy is set up with."""

from __future__ import annotations

from dataclasses import dataclass

from executive.types import SkillStatus

_CHANCE = frozenset(
    {
        SkillStatus.DONE,
        SkillStatus.GRASP_MISSED,
        SkillStatus.DROPPED,
        SkillStatus.SLIPPED,
        SkillStatus.STOPPED_SHORT,
    }
)
"""Statuses after which the same step may well succeed; after the others it will most likely fail the same way."""


@dataclass(frozen=True, slots=True)
class Settings:
    """A run's seed, budgets and decision thresholds.

    `max_looks_again` and `precondition_wait` count looks beyond the first one after an action; `max_retries` counts
    tries beyond the first one of a step.
    """

    seed: int = 0
    max_cycles: int = 200
    max_actions: int = 100
    max_replans: int = 50
    max_looks: int = 500
    max_seconds: float = 86_400.0
    """Wall seconds, all processes of the run together."""
    max_retries: int = 2
    max_failures: int = 10
    """How often one step may fail with the same relevant facts before it is given up on; `max_retries` + 2 where
    another try rarely helps (no path, unreachable, not there). `max_retries` + 2 more are too many whatever was known.
    """
    max_looks_again: int = 3
    """Enough to look closer, and then twice with the arm further out of the way."""
    max_questions: int = 32
    """How many atoms one look may ask about: all of them, where there are no more, else those that matter now."""
    guard_looks: int = 2
    """How many looks the hold guard takes in each transfer; one more only confirms that the item is gone."""
    precondition_wait: int = 2
    sure: float = 0.999
    """A literal of the goal that is less probable than this is looked at once more before the goal is claimed, and as
    long as anything is less sure than this no goal is given up for want of a plan, while looks are left."""
    claim: float = 0.98
    """A literal of the goal that is less probable than this, after all looks that there are, is not claimed to hold."""
    max_goal_plans: int = 64
    """How often the planner may be asked to find out which part of the goal can be reached, and, before that, how often
    whether all of it can be from what may be so."""

    def __post_init__(self) -> None:
        for name in ("sure", "claim"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be a probability, got {getattr(self, name)}")
        for name in self.__dataclass_fields__:
            least = 1 if name == "max_questions" else 0
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)}")

    def max_failures_with_same_facts(self, status: SkillStatus) -> int:
        """Return how many failures of one step with the same relevant facts are too many; one, where it is known that
        another try fails: an object is larger than what it is to be put on, or other objects are in the way."""
        if status in (SkillStatus.DOES_NOT_FIT, SkillStatus.BLOCKED):
            return 1
        return self.max_failures if status in _CHANCE else min(self.max_failures, self.max_retries + 2)

    def max_failures_ever(self, status: SkillStatus) -> int:
        """Return how many failures of one step are too many, whatever was known."""
        return self.max_failures_with_same_facts(status) + self.max_retries + 2
