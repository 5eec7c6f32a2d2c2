"""A belief over a film: what each frame is taken for, weighed with what was seen before it.

It is the Bayes filter of a run (`executive.belief`) with another transition model: between two frames nothing is known
of what the robot does, so that the state is the same, but for the chance that it changed meanwhile, which grows with
the time that went by. What every reachable state keeps holds here, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from executive.belief import ActionModel, BayesMonitor
from executive.types import Atom, Belief

STATE_SECONDS = 5.0
"""The mean time in s for which a state lasts: about what a skill takes. Assumed, and the same for every domain."""

_LEAST_NOISE = 1e-6


class FilmMemory:
    """The belief at the frames of one film, in the order of their times."""

    def __init__(self, monitor: BayesMonitor, state_seconds: float = STATE_SECONDS) -> None:
        self._monitor, self._state_seconds = monitor, state_seconds
        self._monitors: dict[float, BayesMonitor] = {}
        self._state: Any = monitor.begin()
        self._time: float | None = None
        self._frame = 0

    def look(self, time: float, belief: Belief) -> Mapping[Atom, float]:
        """Return each atom's probability at a frame, given its answers and those about all frames before."""
        monitor = self._monitor if self._time is None else self._after(time - self._time)
        if self._time is not None:
            self._state = monitor.acted(self._state, None)
        self._time, self._frame = time, self._frame + 1
        self._state, judgement = monitor.looked(self._state, belief, self._frame)
        return judgement.probability

    def _after(self, seconds: float) -> BayesMonitor:
        """Return the filter with the chance that the state changes in so many seconds."""
        key = round(max(0.0, seconds), 3)
        if key not in self._monitors:
            noise = max(_LEAST_NOISE, 1.0 - math.exp(-key / self._state_seconds))
            self._monitors[key] = replace(self._monitor, actions=ActionModel(process_noise=min(noise, 0.99)))
        return self._monitors[key]
