"""Parts that do not come to an end are ended, with the processes that they have started.

Each of these stands between the executive and an estimator, a planner or a skill, keeps its shape, and says of one that
took too long what is said of one that failed: no answer, no plan in time, a skill that timed out. A skill is asked to
stop first. In any other thread than the main one nothing can be interrupted; there a part is only asked.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from executive.alarm import LateError, within
from executive.protocols import Asking, Estimator, Planner, Skill, SkillContext
from executive.types import (
    Atom,
    Belief,
    Evidence,
    Facts,
    NoPlan,
    NoPlanReason,
    Observation,
    Plan,
    Questions,
    SkillResult,
    SkillStatus,
    Step,
)

GRACE = 5.0
"""Wall seconds that a skill has to stop the arm once it is asked to."""


def punctual_estimator(estimator: Estimator, seconds: float) -> Estimator:
    """The estimator, which has no answer once a look has taken it so many wall seconds."""
    asking: object = estimator  # whether it asks in words is for the running program to find out
    return (_AskingEstimator if isinstance(asking, Asking) else _Estimator)(estimator, seconds)


def punctual_planner(planner: Planner, seconds: float) -> Planner:
    """The planner, which has timed out once it was asked for so many wall seconds."""
    return _Planner(planner, seconds)


def punctual_skills(skills: Mapping[str, Skill], seconds: float, grace: float = GRACE) -> dict[str, Skill]:
    """The skills, which are asked to stop after so many wall seconds, and ended if they do not, and have timed out."""
    return {action: _Skill(skill, seconds, grace) for action, skill in skills.items()}


class _Estimator:
    def __init__(self, estimator: Estimator, seconds: float) -> None:
        self._estimator, self._seconds = estimator, seconds

    @property
    def name(self) -> str:
        return self._estimator.name

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        try:
            return within(self._seconds, lambda: self._estimator.estimate(observation, atoms))
        except LateError as late:
            why = (Evidence(tuple(observation.images), 0.0, 0.0, f"no answer: it took {late}"),)
            return Belief(observation.id, {}, frozenset(atoms), self.name, dict.fromkeys(atoms, why))


class _AskingEstimator(_Estimator):
    @property
    def questions(self) -> Questions:
        asking: Any = self._estimator
        questions: Questions = asking.questions
        return questions


class _Planner:
    def __init__(self, planner: Planner, seconds: float) -> None:
        self._planner, self._seconds = planner, seconds

    def plan(self, state: Facts, goal: Facts) -> Plan | NoPlan:
        try:
            return within(self._seconds, lambda: self._planner.plan(state, goal))
        except LateError as late:
            return NoPlan(NoPlanReason.TIMED_OUT, f"it took {late}, and was ended", "", self._seconds)


class _Skill:
    def __init__(self, skill: Skill, seconds: float, grace: float) -> None:
        self._skill, self._seconds, self._grace = skill, seconds, grace

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        until = time.monotonic() + self._seconds
        asked = replace(context, cancelled=lambda: context.cancelled() or time.monotonic() >= until)
        try:
            result = within(self._seconds + self._grace, lambda: self._skill(step, asked))
        except LateError as late:
            return SkillResult(
                step, SkillStatus.TIMED_OUT, f"it took {late}, did not stop when asked to, and was ended"
            )
        if isinstance(result, SkillResult) and result.status is SkillStatus.CANCELLED and not context.cancelled():
            return replace(
                result, status=SkillStatus.TIMED_OUT, reason=f"it was asked to stop after {self._seconds:g} s"
            )
        return result
