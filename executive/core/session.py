"""The session of a run: it delivers events to sinks, turns exceptions into an end, and dispatches steps to skills.
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
from executive.protocols import FaultSource, Preparing, Sink, Skill, SkillContext, World
from executive.types import (
    COMPILE,
    Cause,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Moved,
    News,
    OutcomeKind,
    Payload,
    Phase,
    Questions,
    Reason,
    Resumed,
    SkillResult,
    SkillStatus,
    Step,
    Timing,
)
from executive.util import profile

log = logging.getLogger(__name__)


def stopwatch() -> Callable[[], float]:
    """A clock that tells how many wall seconds ago it was made."""
    start = time.monotonic()
    return lambda: time.monotonic() - start


class Session:
    """Delivers one run's events, dispatches its steps, and keeps an exception in a part from ending the program.

    A sink that raises is dropped with a warning and still closed at the end. Ctrl-C that strikes inside a sink counts
    as `cancel`, so that the other sinks get the event all the same.

    Args:
        seed: fixes the random numbers of every skill.
        faults: breaks things on purpose, where anything is to be broken.
        clock: returns how many wall seconds ago the process began with the run; without one, a stopwatch starts now.

    Attributes:
        cycle: the loop's current one, with which events are stamped; the loop sets it.
    """

    def __init__(
        self,
        sinks: Sequence[Sink],
        world: World,
        seed: int = 0,
        faults: FaultSource | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._sinks, self._listening, self._world = tuple(sinks), list(sinks), world
        self._seed, self._faults, self._clock = seed, faults, clock or stopwatch()
        self.cycle = 0
        self._before, self._time, self._delivering = 0.0, 0.0, 0.0
        self._cancelled: str | None = None
        self._stage = "start"
        self._action = self._moves = 0

    @property
    def seconds(self) -> float:
        """How many wall seconds the run has taken so far, in all its processes together."""
        return self._before + self._clock()

    def cancel(self, why: str = "") -> None:
        """Have the current skill stop, and `check_cancelled` end the run. This sets a flag, so it is safe in any thread
        and signal handler."""
        self._cancelled = why if self._cancelled is None else self._cancelled

    def check_cancelled(self) -> None:
        """End the run here if it was cancelled.

        Raises:
            KeyboardInterrupt: cancelled.
        """
        if self._cancelled is not None:
            raise KeyboardInterrupt

    def open(self, first: Payload, questions: Questions | None = None) -> None:
        """Deliver the first event, the estimator's questions and the world's shapes; from here on, the world's
        movements and what is broken in it are delivered, too."""
        if isinstance(first, Resumed):
            self._action, self._before = first.actions, first.wall
        self.emit(first)
        if self._faults:
            self._faults.begin(self.emit, self._action)
        if questions is not None:
            self.emit(questions)
        self.emit(self._world.scenery())
        self._world.watch(self.emit)

    def prepare(self, parts: Iterable[Preparing]) -> None:
        """Have each part made ready. One that takes time is announced before, and is timed as a stage of its own."""
        for part in parts:
            self.check_cancelled()
            told: list[str] = []

            def tell(what: str, told: list[str] = told) -> None:
                told.append(what)
                self.emit(Phase(COMPILE, what))

            self._stage, start = COMPILE, self._clock()
            with profile.stage(COMPILE):
                part.prepare(tell)
            if told:
                self.emit(Timing(COMPILE, self._clock() - start))

    def emit(self, payload: Payload) -> None:
        """Deliver an event to every sink, stamped with the cycle and both clocks."""
        try:
            self._time = self._world.time
        finally:  # a world that is gone takes no event with it
            self._deliver(payload)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what happens inside as one stage of the loop, without the time that sinks take.

        Raises:
            KeyboardInterrupt: cancelled before it began.
        """
        self.check_cancelled()
        self._stage = name
        start, delivering = self._clock(), self._delivering
        try:
            with profile.stage(name):
                yield
            self._stage = "decide"
        finally:
            self.emit(Timing(name, self._clock() - start - (self._delivering - delivering)))

    def guard(self, live: Callable[[], Decision]) -> tuple[Decision, BaseException | None]:
        """Call `live` and return its last decision; whatever it raises becomes one.

        The second value is what has to be raised again once the trace is complete: an error of the set-up, or an order
        to exit. The traceback of anything else but Ctrl-C is logged.
        """
        try:
            return live(), None
        except KeyboardInterrupt:
            return _stop(OutcomeKind.INTERRUPTED, Cause(Reason.INTERRUPTED, detail=self._cancelled or "")), None
        except ExecutiveError as error:
            return _stop(OutcomeKind.CRASHED, self._failed(str(error))), error
        except Exception as error:
            log.exception("the run crashed in stage %r", self._stage)
            at = traceback.extract_tb(error.__traceback__)[-1]
            told = f"{type(error).__name__}: {error} (in {at.name}, line {at.lineno})"
            return _stop(OutcomeKind.CRASHED, self._failed(told)), None
        except BaseException as order:
            cause = Cause(Reason.INTERRUPTED, what=self._stage, detail=type(order).__name__)
            return _stop(OutcomeKind.INTERRUPTED, cause), order

    def _failed(self, detail: str) -> Cause:
        return Cause(Reason.STAGE_FAILED, what=self._stage, detail=detail)

    def dispatch(
        self,
        order: Dispatched,
        skills: Mapping[str, Skill],
        guard: HoldGuard | None = None,
    ) -> SkillResult:
        """Hand a step to its skill, watched by the guard. A skill that raises has crashed; its traceback is logged.

        The skill's random numbers are drawn from the run's seed and the action's number alone.
        """
        step, action, faults = order.step, order.action, self._faults
        self._action, self._moves = action, 0
        self.emit(order)
        if faults:
            faults.before_action(action, step)

        def announce(news: News) -> None:
            self.emit(news)
            if isinstance(news, Phase):
                if faults:
                    faults.on_phase(action, step, news)
                if guard:
                    guard.on_phase(news)

        context = self._context((action,), announce, guard.lost if guard else str)
        result = SkillResult(step, SkillStatus.CANCELLED)
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
        self.check_cancelled()
        if result.status is SkillStatus.TIMED_OUT:  # it may be left behind in the middle of a motion
            self._guarded(self._world, self._world.stop)
        if faults:
            faults.after_action(action, step)
        return result

    def move(self, step: Step, skill: Skill) -> SkillResult:
        """Have a skill bring the arm out of the way. It is no action: no fault strikes in it, and it has no expected
        effects. Its random numbers are drawn from the seed, the last action's number and the number of moves since."""
        self._moves += 1
        with self.stage("skill"):
            result = skill(step, self._context((self._action, self._moves), self.emit, str))
        self.emit(Moved(step.action, result.status, result.reason, result.seconds))
        return result

    def _context(self, key: tuple[int, ...], announce: Callable[[News], None], lost: Callable[[], str]) -> SkillContext:
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
        return SkillContext(self._world.handle, rng, announce, lambda: self._cancelled is not None, lost)

    def close(self, last: Ended, error: BaseException | None = None) -> Ended:
        """Stop the robot, deliver the last event, stamped with the time of the one before it, close all sinks, and
        raise `error`."""
        self._guarded(self._world, self._world.stop)
        self._guarded(self._world, self._world.watch, None)
        self._deliver(last)
        for sink in self._sinks:
            with profile.stage(f"record ({type(sink).__name__})"):
                self._guarded(sink, sink.close)
        if error is not None:
            raise error
        return last

    def _deliver(self, payload: Payload) -> None:
        start = self._clock()
        event = Event(self.cycle, self._time, self._before + start, payload)
        for sink in tuple(self._listening):
            with profile.stage(f"record ({type(sink).__name__})"):
                if not self._guarded(sink, sink.write, event):
                    self._listening.remove(sink)
        self._delivering += self._clock() - start

    def _guarded(self, part: object, call: Callable[..., None], *arguments: object) -> bool:
        """Return whether the call returned without an error. Ctrl-C that strikes in it is kept for later."""
        try:
            call(*arguments)
        except KeyboardInterrupt:
            self.cancel()
        except Exception:
            log.warning("%s failed and is left alone from here on", type(part).__name__, exc_info=True)
            return False
        return True


def _stop(outcome: OutcomeKind, cause: Cause) -> Decision:
    return Decision(DecisionKind.STOP, (cause,), outcome=outcome)
