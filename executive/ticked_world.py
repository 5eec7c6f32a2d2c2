"""What every world has that moves in ticks, so that one of your own need not write it again."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from typing import Any

from executive.types import FloatArray, Frame, Image, Observation, Scenery


class TickedWorld(ABC):
    """A `World` that moves in ticks: it numbers its looks, and once in each tick, by `passed`, has what is scheduled
    happen and tells whoever watches where things are. The rest is the world's own.

    Its handle is the world itself. Nothing has to be derived from it: what has the methods of `World` is one.
    """

    noisy = False
    """Whether pictures have sensor noise (see `Observation`)."""

    def __init__(self) -> None:
        self._looks, self._scheduled = 0, list[tuple[float, Callable[[], None]]]()
        self._listener: Callable[[Frame], None] | None = None

    @property
    @abstractmethod
    def time(self) -> float:
        """Seconds on the world's own clock."""

    @abstractmethod
    def joints(self) -> FloatArray:
        """The arm's joint positions in rad."""

    @abstractmethod
    def pictures(self, cameras: Collection[str] | None) -> Mapping[str, Image]:
        """Take a picture, (H, W, 3) uint8 RGB, with every camera, or with those named that there are."""

    def frame(self) -> Frame:
        """Return where things are, for who watches; the joints alone, unless the world has more to tell."""
        return Frame({}, self.joints(), 0.0)

    def scenery(self) -> Scenery:
        return Scenery()

    @property
    def handle(self) -> Any:
        return self

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        self._looks += 1
        return Observation(
            self._looks - 1, self.time, dict(self.pictures(cameras)), self.joints(), cause, noisy=self.noisy
        )

    def stop(self) -> None:
        """Do nothing: time only passes while it is ticked. A robot that goes on by itself has to be stopped here."""
        return

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        self._scheduled.append((self.time + delay, action))

    def watch(self, listener: Callable[[Frame], None] | None) -> None:
        self._listener = listener

    def passed(self) -> None:
        """Time has passed: do what is due, the earliest first, and tell whoever watches."""
        while due := [each for each in self._scheduled if each[0] <= self.time + 1e-9]:
            first = min(due, key=lambda each: each[0])
            self._scheduled.remove(first)
            first[1]()
        if self._listener is not None:
            self._listener(self.frame())
