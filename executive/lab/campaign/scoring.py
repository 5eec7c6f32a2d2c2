"""Scores a run against the ground truth while it goes on: detected faults, false alarms, missed failures."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from executive.core.compare import remaining
from executive.types import (
    Blinded,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Event,
    Facts,
    FaultInjected,
    Guarded,
    NoPlan,
    Plan,
    SkillResult,
    Started,
    Step,
    Task,
)

UNSEEN = ("estimator",)
"""Kinds of faults of the estimator: the world has no sign of them."""


@dataclass(slots=True)
class Strike:
    """A fault that struck at `time` on the world's clock, and the delay in seconds until it was detected (None:
    never)."""

    kind: str
    spec: str
    action: int
    time: float
    noticed: float | None = None


@dataclass(slots=True)
class Tally:
    """What was counted in one run. Of the actions whose outcome was looked at: after how many all was in truth as
    expected (`quiet`), and after how many of these it was taken to be otherwise (`alarms`); after how many it was not
    (`failed`), and after how many of these nothing of that was noticed in the same cycle (`missed`). `needless` counts
    the decisions to plan anew when what was left of the plan led to the goal from what was true."""

    strikes: list[Strike] = field(default_factory=list)
    quiet: int = 0
    alarms: int = 0
    failed: int = 0
    missed: int = 0
    needless: int = 0


class Scorer:
    """A sink that scores a run.

    Signs of trouble are: a skill that reports it, a carried item observed to be gone, a camera that is left out, a
    planner without a plan, and an atom that is rightly observed not to be as expected. The first of these after a fault
    detects it.

    Args:
        truth: returns the ground truth of every atom. It is called right after looks, while the world stands still.
        looks: whether the run looks at all; one that does not detects nothing, whatever its skills report.
        own: faults, as they print, of the configuration itself, which are not scored.
    """

    def __init__(self, truth: Callable[[], Facts], looks: bool, own: Collection[str] = ()) -> None:
        self._truth, self._looks, self._own = truth, looks, frozenset(own)
        self._last: tuple[Compared, Facts] | None = None
        self._task: Task | None = None
        self._left = tuple[Step, ...]()
        self._plan: tuple[Step, ...] | None = None
        self.tally = Tally()

    def write(self, event: Event) -> None:
        match event.payload:
            case Started(task=task):
                self._task = task
            case Plan(steps=steps):
                self._plan = self._left = steps
            case Dispatched(index=index) if self._plan is not None:
                self._left = self._plan[index + 1 :]
            case FaultInjected() as fault if fault.spec not in self._own:
                self.tally.strikes.append(Strike(fault.kind, fault.spec, fault.action, round(event.time, 6)))
            case SkillResult() as result if not result.done:
                self._notice(event.time)
            case Guarded(lost=True) | Blinded() | NoPlan():
                self._notice(event.time)
            case Compared() as compared if self._looks:
                truth = self._truth()
                if any(truth[atom] is not compared.expected[atom] for atom in compared.verdict.violated):
                    self._notice(event.time)
                if compared.what == "effects":
                    self._last = compared, truth
            case Decision(kind=kind) if kind is not DecisionKind.LOOK_AGAIN:
                if self._last is not None:
                    self._count(*self._last)
                    self._last = None
                if kind is DecisionKind.REPLAN and self._plan is not None and self._task is not None:
                    goal, rules = self._task.goal, self._task.derived
                    self.tally.needless += remaining(self._left, self._truth(), goal, rules) is not None

    def close(self) -> None:
        pass

    def _notice(self, time: float) -> None:
        for strike in self.tally.strikes:
            if self._looks and strike.noticed is None and strike.kind not in UNSEEN:
                strike.noticed = round(time - strike.time, 6)

    def _count(self, compared: Compared, truth: Facts) -> None:
        """Counts an action's outcome by what was expected, believed and true in the end."""
        violated = compared.verdict.violated
        if truth.entails(compared.expected):
            self.tally.quiet += 1
            self.tally.alarms += bool(violated)
        else:
            self.tally.failed += 1
            self.tally.missed += all(truth[atom] is compared.expected[atom] for atom in violated)
