"""Time limits: wrappers that give up an estimator, a planner or a skill that takes too long, and end its processes.

Each wrapper has the interface of what it wraps, and returns what stands for a failure when the time is up: no answer,
a planner that timed out, a skill that timed out. A skill is asked to stop first, and a planner is given its limit. What
does not stop is left behind in its thread, where it can neither tell anything nor move the simulated arm any more
(`executive.util.timeout`). The limit is the patience with the part or what is `left` of the run's time, whichever is
less.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeAlias

from executive.protocols import Asking, Estimator, Planner, Preparing, Skill, SkillContext, Tell
from executive.types import (
    Atom,
    Belief,
    Condition,
    Evidence,
    Facts,
    News,
    NoPlan,
    NoPlanReason,
    Observation,
    Plan,
    Questions,
    SkillResult,
    SkillStatus,
    Step,
)
from executive.util.timeout import TimeLimitError, exclusive, within

GRACE = 5.0
"""Wall seconds that a skill has to stop the arm once it is asked to."""

_LAST_WORD = 0.25
"""Wall seconds that a planner which keeps to its time has to say so."""

Left: TypeAlias = "Callable[[], float]"
"""Returns the wall seconds that are left of a run's time."""


def _endless() -> float:
    return math.inf


def limit_estimator(
    estimator: Estimator, seconds: float, left: Left = _endless, end: Callable[[], object] = lambda: None
) -> Estimator:
    """Return the estimator with a limit in wall seconds for each look; after it, no atom is answered, and `end` is
    called to end what the estimator was at."""
    asking: object = estimator  # whether it asks in words is for the running program to find out
    return (_AskingEstimator if isinstance(asking, Asking) else _Estimator)(estimator, seconds, left, end)


def limit_planner(planner: Planner, seconds: float) -> Planner:
    """Return the planner with a limit in wall seconds for each plan; after it, it has timed out."""
    return _Planner(planner, seconds)


def limit_skills(
    skills: Mapping[str, Skill], seconds: float, grace: float = GRACE, left: Left = _endless
) -> dict[str, Skill]:
    """Return the skills with a limit in wall seconds for each step; after it, a skill is asked to stop, `grace` seconds
    later it is given up, and it has timed out."""
    return {action: _Skill(skill, seconds, grace, left) for action, skill in skills.items()}


def limit_preparing(parts: Sequence[Preparing], left: Left) -> list[Preparing]:
    """Return the parts; their preparation ends when the run has no time left."""
    return [_Preparing(part, left) for part in parts]


class _Preparing:
    def __init__(self, part: Preparing, left: Left) -> None:
        self._part, self._left = part, left

    def prepare(self, tell: Tell) -> None:
        with suppress(TimeLimitError):  # the run is over, and the loop says so
            within(self._left(), lambda: self._part.prepare(tell))


class _Estimator:
    def __init__(self, estimator: Estimator, seconds: float, left: Left, end: Callable[[], object]) -> None:
        self._estimator, self._seconds, self._left, self._end = estimator, seconds, left, end

    @property
    def name(self) -> str:
        return self._estimator.name

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        try:
            limit = min(self._seconds, self._left())
            return within(limit, lambda: self._estimator.estimate(observation, atoms))
        except TimeLimitError as late:
            self._end()
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

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        limit = min(self._seconds, seconds)
        try:
            return within(limit + _LAST_WORD, lambda: self._planner.plan(state, goal, avoid, limit))
        except TimeLimitError as late:
            return NoPlan(NoPlanReason.TIMED_OUT, f"it took {late}, and was given up", "", limit)


class _Skill:
    def __init__(self, skill: Skill, seconds: float, grace: float, left: Left) -> None:
        self._skill, self._seconds, self._grace, self._left = skill, seconds, grace, left

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        limit = min(self._seconds, self._left())
        until = time.monotonic() + limit

        def announce(news: News) -> None:
            with exclusive():
                context.announce(news)

        def cancelled() -> bool:
            return context.cancelled() or time.monotonic() >= until

        asked = replace(context, announce=announce, cancelled=cancelled)
        try:
            result = within(limit + self._grace, lambda: self._skill(step, asked))
        except TimeLimitError as late:
            return SkillResult(
                step, SkillStatus.TIMED_OUT, f"it took {late}, did not stop when asked to, and was given up"
            )
        if isinstance(result, SkillResult) and result.status is SkillStatus.CANCELLED and not context.cancelled():
            reason = f"it was asked to stop after {round(limit, 2):g} s"
            return replace(result, status=SkillStatus.TIMED_OUT, reason=reason)
        return result
