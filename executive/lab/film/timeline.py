"""When each frame of a film shows what of a run: a camera films on while the robot stands still, looks and plans.

The world's clock goes on with every motion and stands while the robot thinks. In a film it is the camera's clock that
goes on, so that the film lingers at each mid-pose, the moments at which the robot looks between two actions. They are
taken from the run's events, whatever was answered.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from executive.types import Dispatched, Event, Moved, Observation, Phase, SkillResult


class Shown(NamedTuple):
    """What a frame shows: the world's clock in s, whether it is a mid-pose, and the action and its phase."""

    world_time: float
    mid_pose: bool
    action: str
    phase: str


_MOVING = "move aside"
"""The phase of what brings the arm out of the camera's view, between actions."""


def mid_poses(events: Sequence[Event]) -> tuple[float, ...]:
    """Return when, by the world's clock in s, the robot was between actions and did not move: at its looks outside of
    skills, and where a skill ended."""
    found: set[float] = set()
    acting = False
    for event in events:
        match event.payload:
            case Dispatched():
                acting = True
            case SkillResult():
                acting = False
                found.add(event.time)
            case Observation() if not acting:
                found.add(event.time)
    return tuple(sorted(found))


def shown(events: Sequence[Event], fps: float, pause: float) -> list[Shown]:
    """Return what each frame of a film shows of a run, `fps` of them a second.

    Args:
        pause: for how many seconds the film lingers at each mid-pose.
    """
    stops, last = mid_poses(events), max((event.time for event in events), default=0.0)
    changes = _changes(events)
    times = [time for time, _, _ in changes]
    total = last + pause * len(stops)
    found = []
    for number in range(max(1, math.floor(total * fps + 1e-6))):
        world, standing = _world_time(number / fps, stops, pause, last)
        if standing:
            found.append(Shown(world, True, "", ""))
            continue
        at = bisect_right(times, world + 1e-9) - 1
        action, phase = changes[at][1:] if at >= 0 else ("", "")
        found.append(Shown(world, False, action, phase))
    return found


def _world_time(time: float, stops: Sequence[float], pause: float, last: float) -> tuple[float, bool]:
    """Return the world's clock at a moment of the film, and whether the film lingers there."""
    for number, stop in enumerate(stops):
        begin = stop + pause * number
        if time < begin - 1e-9:
            return time - pause * number, False
        if time < begin + pause - 1e-9:
            return stop, True
    return min(last, time - pause * len(stops)), False


def _changes(events: Sequence[Event]) -> list[tuple[float, str, str]]:
    """Return from when on which action and phase are carried out."""
    found: list[tuple[float, str, str]] = [(0.0, "", "")]
    action = ""
    for event in events:
        match event.payload:
            case Dispatched(step=step):
                action = str(step)
                found.append((event.time, action, ""))
            case Phase(name=name):
                found.append((event.time, action, name if action else _MOVING))
            case SkillResult() | Moved():
                action = ""
                found.append((event.time, "", ""))
    return found
