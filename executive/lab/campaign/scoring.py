"""Scores a run against the ground truth while it goes on: detected faults, false alarms, missed failures."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from executive.core.compare import remaining
from executive.trace.story.story import Story
from executive.types import (
    Blinded,
    Compared,
    Decision,
    DecisionKind,
    Event,
    Facts,
    FaultInjected,
    Guarded,
    NoPlan,
    SkillResult,
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
        self._story = Story()
        self.tally = Tally()

    def write(self, event: Event) -> None:
        self._story.tell(event)
        match event.payload:
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
                started = self._story.started
                if kind is DecisionKind.REPLAN and started is not None and self._story.plan is not None:
                    rest = remaining(self._story.left, self._truth(), started.task.goal, started.task.derived)
                    self.tally.needless += rest is not None

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
