"""A run whose process ended: how far it had come, by its record alone.

What such a run goes on with is less than it had: what it decided, it decides anew from what it sees. Kept are its
counts, so that budgets hold and no chance is drawn twice; what the monitor remembers of its looks; and, of an executive
that does not look, what it assumed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from executive.belief import Monitor
from executive.belief.interface import Memory
from executive.errors import InputError
from executive.protocols import World
from executive.trace.record import snapshots
from executive.trace.record.codec import decode, encode
from executive.trace.record.log import EVENTS_FILE, read_events
from executive.trace.story.story import Story
from executive.types import (
    Belief,
    Ended,
    Event,
    Facts,
    Judged,
    Looked,
    LookKind,
    Observation,
    OutcomeKind,
    Resumed,
    SkillResult,
    Started,
    Task,
)

UNFINISHED = (OutcomeKind.INTERRUPTED, OutcomeKind.CRASHED)
"""Ends after which a run can go on, as if its process had been killed."""


def remembered(events: Iterable[Event], monitor: Monitor) -> Memory:
    """What a monitor makes of the looks that some events tell of, and of what was done between them; and that since
    then anything may have happened."""
    memory, raw = monitor.begin(), None
    for event in events:
        match event.payload:
            case Belief() as belief:
                raw = belief
            case Judged() if raw is not None:
                memory, _ = monitor.looked(memory, raw, event.cycle)
            case SkillResult() as result:
                memory = monitor.acted(memory, result.step, result)
    return monitor.acted(memory, None)


@dataclass(frozen=True, slots=True)
class PastRun:
    """How far a run had come.

    Attributes:
        started: what it began as; None for one that was killed before it could record even that.
        cycle, actions, looks, plans: how many there were. The last action may have been cut off.
        observations: the number of the next observation.
        wall: the seconds that it took so far, all its processes together.
        ended: its end, if it came to one that is the last thing in the record.
    """

    folder: Path
    started: Started | None = None
    cycle: int = 0
    actions: int = 0
    looks: int = 0
    plans: int = 0
    observations: int = 0
    wall: float = 0.0
    ended: Ended | None = None

    @classmethod
    def of(cls, folder: Path) -> PastRun:
        """Read it from the run's folder.

        Raises:
            InputError: a line of the record is no event.
        """
        if not os.path.exists(folder / EVENTS_FILE):
            return cls(folder)
        story, wall, looks, observations = Story(), 0.0, 0, 0
        for event in read_events(folder, images=False):
            story.tell(event)
            wall = event.wall
            match event.payload:
                case Observation(id=number):
                    observations = max(observations, number + 1)
                case Looked(kind=kind):
                    looks += kind is not LookKind.GUARD
        return cls(
            folder, story.started, story.cycle, story.actions, looks, len(story.plans), observations, wall, story.ended
        )

    @property
    def is_over(self) -> bool:
        """Whether it came to an end of its own."""
        return self.ended is not None and self.ended.outcome not in UNFINISHED

    def check(self, task: Task) -> None:
        """That the run was about this task.

        Raises:
            InputError: it was about another one.
        """
        if self.started is not None and decode(Task, encode(task)) != self.started.task:
            raise InputError("its domain has changed since; what the record tells is of another task", file=self.folder)

    def events(self, images: bool = False) -> Iterable[Event]:
        """All that was recorded."""
        return read_events(self.folder, images) if self.started is not None else ()

    def restore(self, world: World) -> int:
        """Have a world be as the last readable snapshot has it, and return the cycle that it was taken in.

        Raises:
            InputError: there is none.
        """
        mistake = InputError("there is no snapshot of the world to go on from", file=self.folder / snapshots.FOLDER)
        for cycle, data in snapshots.latest(self.folder):
            try:
                world.restore(data)
            except InputError as error:  # a power cut may cost the last one
                mistake = InputError(error.message, file=self.folder / snapshots.FOLDER)
                continue
            return cycle
        raise mistake

    def resumed(self, cycle: int) -> Resumed:
        """The event that the run goes on with, in a world as it was in `cycle`. The plan that it is going to need takes
        the place of the one that it had."""
        return Resumed(cycle, self.cycle, self.actions, self.plans, self.looks, self.wall)

    def memory(self, monitor: Monitor) -> Memory:
        """What the monitor makes of the recorded looks. What has become of the world since, nobody knows."""
        return remembered(self.events(), monitor)

    def assumed(self) -> Facts:
        """What an executive that does not look took to be true."""
        known = Facts()
        for event in self.events():
            match event.payload:
                case Belief() as belief:
                    known = belief.facts()
                case SkillResult(step=step):  # the belief that follows says the same, unless the run was cut off there
                    known = known | step.effects
        return known
