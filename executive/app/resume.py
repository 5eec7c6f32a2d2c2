"""Reads how far an interrupted run had come from its record.

A resumed run keeps only a part of its state and decides everything else again from what it sees. It keeps its counts,
so that budgets hold and no random number is drawn twice; the monitor's memory; and, in a blind run, what it assumed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from executive.belief import Monitor
from executive.belief.interface import Memory
from executive.core.compare import progress
from executive.errors import InputError
from executive.protocols import Simulator
from executive.trace.record import snapshots
from executive.trace.record.codec import decode, encode
from executive.trace.record.log import EVENTS_FILE, read_events
from executive.trace.story.story import Story
from executive.types import (
    Belief,
    DerivedRules,
    Ended,
    Event,
    Facts,
    Judged,
    OutcomeKind,
    Resumed,
    SkillResult,
    Started,
    Task,
)

UNFINISHED = (OutcomeKind.INTERRUPTED, OutcomeKind.CRASHED)
"""Outcomes after which a run can be resumed, as if its process had been killed."""


def remembered(events: Iterable[Event], monitor: Monitor) -> Memory:
    """Return the monitor's memory after the looks and actions in `events`, and after a time in which anything may have
    changed."""
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
        started: its first event; None for a run that was killed before recording it.
        cycle, actions, looks, plans: how many there were. The last action may have been cut off.
        observations: the id of the next observation.
        wall: the wall seconds of all its processes together.
        ended: its last event, if the run ended.
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
        """Read the run's folder.

        Raises:
            InputError: a line of the record is not an event.
        """
        if not os.path.exists(folder / EVENTS_FILE):
            return cls(folder)
        story = Story()
        for event in read_events(folder, images=False):
            story.tell(event)
        return cls(
            folder,
            story.started,
            story.cycle,
            story.actions,
            story.costs.looks,
            len(story.plans),
            story.seeing.observations,
            story.latest.wall if story.latest else 0.0,
            story.ended,
        )

    @property
    def is_over(self) -> bool:
        """Whether the run ended by itself."""
        return self.ended is not None and self.ended.outcome not in UNFINISHED

    def check(self, task: Task) -> None:
        """Check that the run had this task.

        Raises:
            InputError: it had another one.
        """
        if self.started is not None and decode(Task, encode(task)) != self.started.task:
            raise InputError("the domain has changed since: the record has another task", file=self.folder)

    def events(self, images: bool = False) -> Iterable[Event]:
        """Return all recorded events."""
        return read_events(self.folder, images) if self.started is not None else ()

    def restore(self, world: Simulator) -> int:
        """Restore a world from the last readable snapshot, and return the snapshot's cycle.

        Raises:
            InputError: there is no readable snapshot.
        """
        mistake = InputError("there is no snapshot of the world to resume from", file=self.folder / snapshots.FOLDER)
        for cycle, data in snapshots.latest(self.folder):
            try:
                world.restore(data)
            except InputError as error:  # a power cut may damage the last one
                mistake = InputError(error.message, file=self.folder / snapshots.FOLDER)
                continue
            return cycle
        raise mistake

    def resumed(self, cycle: int) -> Resumed:
        """Return the event that the run resumes with, in the world of `cycle`; its next plan replaces its last one."""
        return Resumed(cycle, self.cycle, self.actions, self.plans, self.looks, self.wall)

    def memory(self, monitor: Monitor) -> Memory:
        """Return the monitor's memory after the recorded looks and a time in which the world may have changed."""
        return remembered(self.events(), monitor)

    def assumed(self) -> Facts:
        """Return the facts that a blind run assumed."""
        known = Facts()
        rules = DerivedRules() if self.started is None else self.started.task.derived
        for event in self.events():
            match event.payload:
                case Belief() as belief:
                    known = belief.facts()
                case SkillResult(step=step):  # the belief that follows says the same, unless the run was cut off there
                    known = progress(known, step, rules)
        return known
