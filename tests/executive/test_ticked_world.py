"""What a world that moves in ticks has anyway: numbered looks, things that happen in time, and someone who watches."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from executive import Image, TickedWorld, World
from executive.types import FloatArray
from tests.contracts import WorldContract


class Clock(TickedWorld):
    """A world with nothing in it but a clock and two cameras."""

    def __init__(self) -> None:
        super().__init__()
        self.ticks = 0

    @property
    def time(self) -> float:
        return self.ticks / 100

    def joints(self) -> FloatArray:
        return np.zeros(2)

    def pictures(self, cameras: Collection[str] | None) -> Mapping[str, Image]:
        named = [name for name in ("a", "b") if cameras is None or name in cameras]
        return {name: np.zeros((4, 4, 3), np.uint8) for name in named}

    def tick(self) -> None:
        self.ticks += 1
        self.passed()


class TestTickedWorld(WorldContract):
    def make(self) -> World:
        return Clock()

    def pass_time(self, world: World, seconds: float) -> None:
        assert isinstance(world, Clock)
        for _ in range(round(100 * seconds)):
            world.tick()


def test_what_is_due_happens_in_order_and_may_schedule_more() -> None:
    world, happened = Clock(), list[str]()

    def first() -> None:
        happened.append("first")
        world.schedule(0.0, lambda: happened.append("at once"))
        world.schedule(0.05, lambda: happened.append("later"))

    world.schedule(0.02, lambda: happened.append("second"))
    world.schedule(0.01, first)
    for _ in range(3):
        world.tick()
    assert happened == ["first", "at once", "second"]
    for _ in range(5):
        world.tick()
    assert happened == ["first", "at once", "second", "later"]
