"""When faults strike: the injector is told by the loop how far it is, breaks the world, and says to whoever comes
between the executive and its parts (`executive.faults.wrappers`) what is broken now.

Chance is drawn from the seed, the fault's place in the list and the action's number, and from nothing else: whoever
carries out the n-th action meets the same faults, whatever happened before it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial

import numpy as np

from executive.faults.catalogue import BY_SOMEONE
from executive.faults.grammar import Fault
from executive.protocols import Disturbable
from executive.types import FaultInjected, Phase, Step

_STREAM = 1  # beside the skills' chance, which is drawn from the seed and the action alone
_WHETHER, _WHEN, _HOW = range(3)  # what is drawn for a fault in an action

Report = Callable[[FaultInjected], None]


class FaultInjector:
    """Injects the faults of a list; see `executive.protocols.FaultSource`."""

    def __init__(self, faults: Sequence[Fault], world: Disturbable, seed: int = 0) -> None:
        self._faults, self._world, self._seed = tuple(faults), world, seed
        self._report: Report = _unheard
        self._action, self._at_work, self._last_phase = 0, False, ""
        self._waiting: set[int] = set()  # faults that wait for something to be carried in the action at work
        self._bites: Counter[int] = Counter()  # how often each lasting fault was felt since the last dispatch

    def begin(self, report: Report, action: int = 0) -> None:
        self._report, self._action = report, action

    def before_action(self, action: int, step: Step) -> None:
        self._action, self._at_work, self._last_phase = action, True, ""
        self._bites.clear()
        self._waiting = {*self._due(("drop", "slip"), step)}
        for place in self._due(("miss", "no-effect"), step):
            self._break(place, action)
        for place in self._due(("jam",), step):
            self._break(place, action, about=" ".join(step.args))
        self._meddle("before", step)

    def on_phase(self, action: int, step: Step, phase: Phase) -> None:
        before, self._last_phase = self._last_phase, phase.name
        for place in sorted(self._waiting):
            if (window := _window(self._faults[place], before, phase.name)) is not None:
                delay = phase.seconds * float(self.chance(place, action, _WHEN).uniform(*window))
                self._world.schedule(delay, partial(self._break_in_time, place, action))
                self._waiting.discard(place)

    def after_action(self, action: int, step: Step) -> None:
        self._at_work = False
        self._meddle("after", step)

    # What those who come between the executive and its parts ask.

    def felt(self, kind: str, step: Step | None = None) -> Iterator[tuple[int, Fault]]:
        """The faults of a kind that are there now, with their places in the list; gone is what was felt as often as it
        may be. Whoever lets one be felt says so with `bite`."""
        for place in self._due((kind,), step):
            fault = self._faults[place]
            if fault.times is None or self._bites[place] < fault.times:
                yield place, fault

    def bite(self, place: int, detail: str) -> None:
        """A lasting fault was felt; the first time in an action this is reported."""
        self._bites[place] += 1
        if self._bites[place] == 1:
            fault = self._faults[place]
            self._report(FaultInjected(fault.kind, str(fault), self._action, detail))

    def chance(self, place: int, *key: int) -> np.random.Generator:
        """The random generator of the fault at an index of the list; `key` names the draw."""
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(_STREAM, place, *key)))

    def drawn(self, place: int, *key: int) -> np.random.Generator:
        """The chance of how a lasting fault is felt this time, another each time in an action."""
        return self.chance(place, self._action, _HOW, self._bites[place], *key)

    # Inside.

    def _due(self, kinds: Collection[str], step: Step | None) -> list[int]:
        """The indices of the faults of these kinds that strike in this action."""
        return [
            place
            for place, fault in enumerate(self._faults)
            if fault.kind in kinds
            and (step is None or fault.kind in BY_SOMEONE or {fault.item, fault.drawer} <= {None, *step.args})
            and (fault.covers(self._action) if fault.chance is None else self._strikes(place, fault.chance))
        ]

    def _strikes(self, place: int, chance: float) -> bool:
        return bool(self.chance(place, self._action, _WHETHER).random() < chance)

    def _meddle(self, way: str, step: Step) -> None:
        for place in self._due(BY_SOMEONE, step):
            if self._faults[place].way == way:
                self._break(place, self._action)

    def _break_in_time(self, place: int, action: int) -> None:
        if self._at_work and self._action == action:  # the action may have ended before the moment came
            self._break(place, action)

    def _break(self, place: int, action: int, **arguments: str) -> None:
        fault = self._faults[place]
        if fault.kind in BY_SOMEONE:
            named = {"item": fault.item, "with": fault.other, "table": fault.table, "drawer": fault.drawer}
            arguments |= {key: name for key, name in named.items() if name is not None}
        if fault.seconds is not None and (fault.kind in BY_SOMEONE or fault.kind == "jam"):
            arguments["seconds"] = repr(fault.seconds)
        detail = self._world.disturb(fault.kind, self.chance(place, action, _HOW), **arguments)
        self._report(FaultInjected(fault.kind, str(fault), action, detail))


def _window(fault: Fault, before: str, phase: str) -> tuple[float, float] | None:
    """The part of a phase in which a fault strikes that waits for something to be carried; None: not in this one."""
    if fault.way == "grasp":
        return (0.0, 0.3) if before == "grip" and phase in ("lift", "transfer") else None
    if fault.way == "release":
        return (0.25, 0.75) if phase == "lower" else None
    return (0.25, 0.75) if phase == "transfer" else None


def _unheard(fault: FaultInjected) -> None:
    """The default listener, which does nothing."""
