"""What surrounds a run: events go out to sinks, exceptions are caught and named, steps are handed to their skills.

Nothing here decides anything; the loop does.
"""

from __future__ import annotations

import logging
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from executive.core.hold_guard import HoldGuard
from executive.errors import ExecutiveError
from executive.protocols import Asking, Estimator, FaultSource, Preparing, Sink, Skill, SkillContext, World
from executive.types import (
    COMPILE,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Motion,
    Moved,
    OutcomeKind,
    Payload,
    Phase,
    Resumed,
    SkillResult,
    SkillStatus,
    Step,
    Timing,
)
from executive.util.timeout import undisturbed

INTERRUPTED = "interrupted"

log = logging.getLogger(__name__)


class Session:
    """One run's way out to the sinks and its guard against what its parts may do.

    A sink that raises is dropped with a warning and still closed at the end. Ctrl-C that strikes inside a sink counts
    as `cancel`, so that the other sinks get the event all the same.
    """

    def __init__(
        self, sinks: Sequence[Sink], world: World, seed: int, faults: FaultSource | None, cycle: Callable[[], int]
    ) -> None:
        self._sinks, self._listening, self._world = tuple(sinks), list(sinks), world
        self._seed, self._faults, self._cycle = seed, faults, cycle
        self._start, self._time, self._delivering = time.monotonic(), 0.0, 0.0
        self._cancelled, self._stage = "", "start"
        self._action = self._moves = 0

    @property
    def seconds(self) -> float:
        """How long the run has been going on, on the wall's clock."""
        return time.monotonic() - self._start

    def cancel(self, why: str = INTERRUPTED) -> None:
        """Have the skill at work stop, and `heed` end the run. A flag: safe from any thread and signal handler."""
        self._cancelled = self._cancelled or why

    def heed(self) -> None:
        """The place to stop at when cancelled.

        Raises:
            KeyboardInterrupt: cancelled.
        """
        if self._cancelled:
            raise KeyboardInterrupt

    def open(self, first: Payload, estimator: Estimator | None) -> None:
        """Deliver the first event, tell what is going to be asked, show what the world looks like, and have its
        movements told from here on, and what is broken in it."""
        if isinstance(first, Resumed):
            self._action, self._start = first.actions, self._start - first.wall
        self.emit(first)
        if self._faults:
            self._faults.begin(self.emit, self._action)
        asking: object = estimator  # whether it asks in words is for the running program to find out
        if isinstance(asking, Asking):
            self.emit(asking.questions)
        self.emit(self._world.scenery())
        self._world.watch(self.emit)

    def prepare(self, parts: Iterable[Preparing]) -> None:
        """Have what needs it made ready. What takes time for it is told of before, and counts as a stage of its own."""
        for part in parts:
            self.heed()
            told: list[str] = []

            def tell(what: str, told: list[str] = told) -> None:
                told.append(what)
                self.emit(Phase(COMPILE, what))

            self._stage, start = COMPILE, time.monotonic()
            part.prepare(tell)
            if told:
                self.emit(Timing(COMPILE, time.monotonic() - start))

    def emit(self, payload: Payload) -> None:
        """Deliver an event to every sink, stamped with the cycle and both clocks."""
        try:
            self._time = self._world.time
        finally:  # a world that is gone takes no event with it
            self._deliver(payload)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Heed, then measure what happens inside as one stage of the loop, without what sinks take of the time."""
        self.heed()
        self._stage = name
        start, delivering = time.monotonic(), self._delivering
        try:
            yield
            self._stage = "decide"
        finally:
            self.emit(Timing(name, time.monotonic() - start - (self._delivering - delivering)))

    def guard(self, live: Callable[[], Decision]) -> tuple[Decision, BaseException | None]:
        """Call `live` and return its last decision; whatever it raises becomes one. Beside it stands what is to be
        raised again once the trace is whole: an error of the set-up, or an order to exit. The traceback of anything
        else but Ctrl-C is logged."""
        try:
            return live(), None
        except KeyboardInterrupt:
            return _stop(OutcomeKind.INTERRUPTED, self._cancelled or INTERRUPTED), None
        except ExecutiveError as error:
            return _stop(OutcomeKind.CRASHED, f"{self._stage}: {error}"), error
        except Exception as error:
            log.exception("the run crashed in stage %r", self._stage)
            at = traceback.extract_tb(error.__traceback__)[-1]
            told = f"{self._stage}: {type(error).__name__}: {error} (in {at.name}, line {at.lineno})"
            return _stop(OutcomeKind.CRASHED, told), None
        except BaseException as order:
            return _stop(OutcomeKind.INTERRUPTED, f"{self._stage}: {type(order).__name__}"), order

    def dispatch(
        self,
        order: Dispatched,
        skills: Mapping[str, Skill],
        guard: HoldGuard | None = None,
    ) -> SkillResult:
        """Hand a step to its skill, with the guard looking on. One that raises has crashed; its traceback is logged.

        The skill's chance is drawn from the run's seed and the action's number alone.
        """
        step, action, faults = order.step, order.action, self._faults
        self._action, self._moves = action, 0
        self.emit(order)
        if faults:
            faults.before_action(action, step)

        def announce(news: Phase | Motion) -> None:
            self.emit(news)
            if isinstance(news, Phase):
                if faults:
                    faults.on_phase(action, step, news)
                if guard:
                    guard.on_phase(news)

        context = self._context((action,), announce, guard.lost if guard else str)
        result = SkillResult(step, SkillStatus.CANCELLED, "interrupted")
        try:
            with self.stage("skill"):
                returned: object = skills[step.action](step, context)
            if not isinstance(returned, SkillResult):
                raise TypeError(f"it returned {returned!r}, not a SkillResult")
            result = returned
        except ExecutiveError as error:  # the set-up is to blame, not the skill
            result = SkillResult(step, SkillStatus.CRASHED, str(error))
            raise
        except Exception as error:
            log.exception("the skill for %s raised", step)
            result = SkillResult(step, SkillStatus.CRASHED, f"{type(error).__name__}: {error}")
        finally:
            if guard:
                guard.close()
            self.emit(result)
        self.heed()
        if faults:
            faults.after_action(action, step)
        return result

    def move(self, step: Step, skill: Skill) -> SkillResult:
        """Have a skill bring the arm out of the way. It is no action: no fault strikes in it, and nothing is expected
        of it. Its chance is drawn from the seed, the last action's number and how many moves there were since."""
        self._moves += 1
        with self.stage("skill"):
            result = skill(step, self._context((self._action, self._moves), self.emit, str))
        self.emit(Moved(step.action, result.status, result.reason, result.seconds))
        return result

    def _context(
        self, key: tuple[int, ...], announce: Callable[[Phase | Motion], None], lost: Callable[[], str]
    ) -> SkillContext:
        chance = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
        return SkillContext(self._world.handle, chance, announce, lambda: bool(self._cancelled), lost)

    def close(self, last: Ended, error: BaseException | None = None) -> Ended:
        """Deliver the last event, stamped with the time of the one before it, close all sinks, and raise `error`."""
        self._guarded(self._world, self._world.watch, None)
        self._deliver(last)
        for sink in self._sinks:
            self._guarded(sink, sink.close)
        if error is not None:
            raise error
        return last

    def _deliver(self, payload: Payload) -> None:
        start = time.monotonic()
        event = Event(self._cycle(), self._time, start - self._start, payload)
        with undisturbed():
            for sink in tuple(self._listening):
                if not self._guarded(sink, sink.write, event):
                    self._listening.remove(sink)
        self._delivering += time.monotonic() - start

    def _guarded(self, part: object, call: Callable[..., None], *arguments: object) -> bool:
        """Whether the call came through. Ctrl-C that strikes in it is kept for later."""
        try:
            call(*arguments)
        except KeyboardInterrupt:
            self.cancel()
        except Exception:
            log.warning("%s failed and is left alone from here on", type(part).__name__, exc_info=True)
            return False
        return True


def _stop(outcome: OutcomeKind, reason: str) -> Decision:
    return Decision(DecisionKind.STOP, reason, outcome=outcome)
