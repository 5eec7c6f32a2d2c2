"""Scenario 23: a run that is killed, at any moment, loses nothing that was reported, and goes on where it was.

Each run here is a process of its own, forked from this one, that kills itself with SIGKILL at some dealing with the
disk: before it, after it, or in the middle of writing. What it told a pipe before is what it had reported.
"""

from __future__ import annotations

import os
import random
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from executive.app.assembly import make_executive
from executive.app.resume import PastRun
from executive.belief import ThresholdMonitor
from executive.core.run_state import RunState
from executive.errors import InputError
from executive.faults import FaultInjector, parse_fault
from executive.trace.record.codec import RECORDED
from executive.trace.record.log import EVENTS_FILE, EventLog, read_events
from executive.trace.record.snapshots import Snapshots, latest
from executive.trace.report.summary import summarise
from executive.types import (
    Belief,
    Dispatched,
    Ended,
    Event,
    Facts,
    FaultInjected,
    Image,
    Judged,
    Looked,
    Observation,
    OutcomeKind,
    Plan,
    Resumed,
    SkillResult,
    SkillStatus,
    Started,
    Step,
)
from tests.fakes import FakePlanner, FakeSkill, FakeWorld, ScriptedEstimator, at, steps_of, task

WHERE = {"a": "p", "b": "p", "c": "q"}
PLACES = ("p", "q", "r")
GOAL = Facts({at("a", "r"): True, at("b", "q"): True, at("c", "r"): True})
TASK = task(sorted(WHERE), PLACES, GOAL)
KINDS = ("before", "half", "after")


class Doom:
    """Kills this process at its `moment`-th dealing with the disk. A write is cut in half where `kind` says so."""

    def __init__(self, moment: int, kind: str) -> None:
        self._moment, self._kind, self._count = moment, kind, 0
        self._patch(os, "write", lambda fd, data: os.write(fd, data[: len(data) // 2]))
        self._patch(os, "ftruncate", lambda fd, size: None)
        self._patch(os, "fdatasync", lambda fd: None)
        self._patch(Path, "write_bytes", lambda path, data: write_bytes(path, data[: len(data) // 2]))
        self._patch(Path, "replace", lambda draft, file: os.truncate(draft, draft.stat().st_size // 2))
        self._patch(Path, "mkdir", lambda *_, **__: None)

    def _patch(self, owner: Any, name: str, halfway: Callable[..., Any]) -> None:
        real = getattr(owner, name)

        def deadly(*args: Any, **kwargs: Any) -> Any:
            self._count += 1
            if self._count < self._moment:
                return real(*args, **kwargs)
            setattr(owner, name, real)
            if self._kind == "half":
                halfway(*args, **kwargs)
            if self._kind == "after":
                real(*args, **kwargs)
            die()

        setattr(owner, name, deadly)


write_bytes = Path.write_bytes


def die() -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("nobody survives that")


class Telling:
    """Says into a pipe how many events were reported."""

    def __init__(self, pipe: int) -> None:
        self._pipe, self._say = pipe, os.write

    def write(self, event: Event) -> None:
        if type(event.payload).__name__ in RECORDED:
            self._say(self._pipe, b".")

    def close(self) -> None:
        """The pipe is closed with the process."""


def picture(world: FakeWorld) -> Image:
    """What is where, as a pattern."""
    return np.random.default_rng(list(str(world.where).encode())).integers(0, 256, (8, 8, 3), dtype=np.uint8)


def live(folder: Path, pipe: int, faults: tuple[str, ...], seed: int, blind: bool = False) -> Ended:
    """Begin the run in a folder, or go on with the one that is there."""
    past, world = PastRun.of(folder), FakeWorld(WHERE, PLACES)
    world.cameras = {"front": picture}
    world.past = {number: {} for number in range(past.observations)}
    log = EventLog(folder)
    monitor, run_state = ThresholdMonitor(TASK.atoms), None
    if past.started is not None:
        since = past.resumed(past.restore(world))
        known = past.assumed() if blind else Facts()
        memory = None if blind else past.memory(monitor)
        run_state = RunState(TASK, TASK.goal, known, memory).resumed(since)
    skill = FakeSkill()
    executive = make_executive(
        TASK,
        FakePlanner(steps_of(TASK)),
        world,
        {"pick": skill, "place": skill},
        None if blind else ScriptedEstimator(world),
        [Snapshots(folder, world), log, Telling(pipe)],
        faults=FaultInjector([parse_fault(spec) for spec in faults], world, seed),
        initial=world.truth(TASK.atoms) if blind else None,
        monitor=monitor,
        run_state=run_state,
    )
    ended = executive.run()
    (folder / "truth").write_text(str(world.truth(TASK.atoms).entails(GOAL)))
    return ended


@dataclass(frozen=True)
class Life:
    """How a process went: whether it was killed, and how many events it reported."""

    killed: bool
    reported: int


def lived(folder: Path, doom: tuple[int, str] | None, faults: tuple[str, ...] = (), seed: int = 0, **more: Any) -> Life:
    """Have the run begin, or go on, in a process of its own."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reading)
            if doom is not None:
                Doom(*doom)
            live(folder, writing, faults, seed, **more)
            code = 0
        finally:
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        reported = len(pipe.read())
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, -signal.SIGKILL), "it neither ended nor was killed"
    return Life(status != 0, reported)


def recorded(folder: Path) -> list[Event]:
    return list(read_events(folder)) if (folder / EVENTS_FILE).exists() else []


def repeated(events: list[Event]) -> list[Step]:
    """The steps that were dispatched after their skill had said that they are done."""
    done: set[Step] = set()
    again = []
    for event in events:
        match event.payload:
            case SkillResult(status=SkillStatus.DONE, step=step):
                done.add(step)
            case Dispatched(step=step) if step in done:
                again.append(step)
    return again


def killed_and_resumed(folder: Path, moment: int, kind: str, dice: random.Random) -> bool:
    """Whether the run came as far as that moment. It is killed there, then maybe once more in the process that goes on
    with it, and then left to come to its end."""
    folder.mkdir()
    first = lived(folder, (moment, kind))
    if not first.killed:
        return False
    events = recorded(folder)
    assert len(events) >= first.reported, "something was reported and is lost"
    if lived(folder, (dice.randint(1, 100), dice.choice(KINDS))).killed:
        assert len(recorded(folder)) >= len(events)
        assert not lived(folder, None).killed
    whole = recorded(folder)
    assert isinstance(whole[-1].payload, Ended)
    assert (whole[-1].payload.outcome, whole[-1].payload.goal_seen) == (OutcomeKind.GOAL_REACHED, True)
    assert (folder / "truth").read_text() == "True"
    assert repeated(whole) == [], "something that was done was done again"
    numbers = [event.payload.id for event in whole if isinstance(event.payload, Observation)]
    assert numbers == sorted(set(numbers)), "each look has a number of its own"
    for earlier, later in pairwise(whole):
        assert (earlier.cycle, earlier.wall) <= (later.cycle, later.wall)
    return True


@pytest.mark.parametrize("kind", KINDS)
def test_23_a_run_that_is_killed_at_some_dealing_with_the_disk_goes_on(tmp_path: Path, kind: str) -> None:
    dice = random.Random(kind)
    for number in range(5):
        killed_and_resumed(tmp_path / str(number), dice.randint(1, 150), kind, dice)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_23_at_each_of_them(tmp_path: Path, kind: str) -> None:
    dice, moment = random.Random(kind), 1
    while killed_and_resumed(tmp_path / str(moment), moment, kind, dice):
        moment += 1
    assert moment > 150, "there are that many dealings with the disk at least"


def killed_after(folder: Path, kind: type, count: int, faults: tuple[str, ...] = (), **more: Any) -> list[Event]:
    """Have the run be killed once so many events of a kind are recorded, and return them all."""
    folder.mkdir(exist_ok=True)
    before = sum(isinstance(event.payload, kind) for event in recorded(folder))

    class Fate(Telling):
        seen = before

        def write(self, event: Event) -> None:
            super().write(event)
            self.seen += isinstance(event.payload, kind)
            if self.seen == count:
                die()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "Telling", Fate)
        assert lived(folder, None, faults, **more).killed
    return recorded(folder)


def test_budgets_chances_and_counts_go_on_where_they_were(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    faults = ("shove:item=c,p=0.4",)
    events = killed_after(folder, Dispatched, 2, faults, seed=5)
    assert not lived(folder, None, faults, seed=5).killed
    whole = recorded(folder)
    (resumed,) = (event for event in whole if isinstance(event.payload, Resumed))
    assert isinstance(resumed.payload, Resumed)
    looks = sum(isinstance(event.payload, Looked) for event in events)
    plans = sum(isinstance(event.payload, Plan) for event in events)
    assert (resumed.payload.cycle, resumed.payload.actions, resumed.payload.plans) == (2, 2, plans)
    assert (resumed.payload.looks, resumed.payload.restored, resumed.cycle) == (looks, 2, 3)
    orders = [event.payload.action for event in whole if isinstance(event.payload, Dispatched)]
    assert orders == list(range(1, len(orders) + 1))
    struck = [event.payload.action for event in whole if isinstance(event.payload, FaultInjected)]
    assert struck
    assert len(struck) == len(set(struck)), "no action has its chance twice"
    summary, ended = summarise(whole), whole[-1].payload
    assert isinstance(ended, Ended)
    assert (summary["actions"], summary["replans"], summary["looks"]) == (ended.actions, ended.replans, ended.looks)
    assert len(orders) == ended.actions
    assert len(summary["faults"]) == len(struck)


def test_what_struck_before_the_kill_is_there_after_it(tmp_path: Path) -> None:
    """Killed right after someone moved a thing: the move is in the record and in the restored world."""
    folder = tmp_path / "run"
    killed_after(folder, FaultInjected, 1, ("shove:item=c@1",))
    world = FakeWorld(WHERE, PLACES)
    PastRun.of(folder).restore(world)
    assert world.where["c"] != "q"
    assert not lived(folder, None, ("shove:item=c@1",)).killed
    whole = recorded(folder)
    assert sum(isinstance(event.payload, FaultInjected) for event in whole) == 1
    assert (folder / "truth").read_text() == "True"


def test_who_does_not_look_goes_on_with_what_it_assumed(tmp_path: Path) -> None:
    for count in range(1, 6):
        folder = tmp_path / str(count)
        killed_after(folder, SkillResult, count, blind=True)
        assert PastRun.of(folder).assumed().true >= {at("a", "r")} or count < 2
        assert not lived(folder, None, blind=True).killed
        whole = recorded(folder)
        assert sum(isinstance(event.payload, Dispatched) for event in whole) == 6
        assert (folder / "truth").read_text() == "True"
        assert not any(isinstance(event.payload, Observation) for event in whole)


def test_the_monitor_remembers_what_the_looks_before_the_kill_showed(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    events = killed_after(folder, Judged, 3)
    beliefs = [event.payload for event in events if isinstance(event.payload, Belief)]
    monitor = ThresholdMonitor(TASK.atoms)
    memory = monitor.begin()
    for number, belief in enumerate(beliefs[:3]):
        memory, _ = monitor.looked(memory, belief, number)
    remembered = PastRun.of(folder).memory(monitor)
    unseen = Belief(99, {}, frozenset(TASK.atoms), "scripted")
    _, judgement = monitor.looked(remembered, unseen, 9)
    assert judgement.state == monitor.looked(monitor.acted(memory, None), unseen, 9)[1].state


def test_a_damaged_last_snapshot_costs_a_cycle_and_none_at_all_is_said(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    killed_after(folder, SkillResult, 3)
    cycles = [cycle for cycle, _ in latest(folder)]
    assert cycles == [3, 2, 1, 0]

    class Sensitive(FakeWorld):
        def restore(self, snapshot: bytes) -> None:
            try:
                super().restore(snapshot)
            except ValueError:
                raise InputError("not a snapshot") from None

    (folder / "snapshots" / "0003.world").write_bytes(b"[{")
    assert PastRun.of(folder).restore(Sensitive(WHERE, PLACES)) == 2
    for file in (folder / "snapshots").iterdir():
        file.write_bytes(b"")
    with pytest.raises(InputError, match="snapshots: not a snapshot"):
        PastRun.of(folder).restore(Sensitive(WHERE, PLACES))
    for file in (folder / "snapshots").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="no snapshot of the world"):
        PastRun.of(folder).restore(FakeWorld(WHERE, PLACES))


def test_a_record_has_one_writer(tmp_path: Path) -> None:
    log = EventLog(tmp_path)
    with pytest.raises(InputError, match="another process is at work on this run"):
        EventLog(tmp_path)
    log.close()
    EventLog(tmp_path).close()


def test_the_end_of_another_task_is_not_gone_on_with(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    killed_after(folder, Started, 1)
    PastRun.of(folder).check(TASK)
    with pytest.raises(InputError, match="domain has changed since"):
        PastRun.of(folder).check(task(sorted(WHERE), (*PLACES, "s"), GOAL))
