"""Budgets, parts that hang, disks that are full: each ends by name, with the record whole."""

from __future__ import annotations

import errno
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.app.assembly import make_executive
from executive.cli.app import ctrl_c
from executive.core.loop import Executive
from executive.core.settings import Settings
from executive.core.time_limits import limit_estimator, limit_planner, limit_preparing, limit_skills
from executive.errors import InputError
from executive.protocols import Asking, Sink, SkillContext, Tell
from executive.trace.record.log import EVENTS_FILE, EventLog, read_events
from executive.trace.record.snapshots import Snapshots
from executive.types import (
    ALWAYS,
    Atom,
    Belief,
    Cause,
    Condition,
    Ended,
    Event,
    Facts,
    NoPlan,
    NoPlanReason,
    Observation,
    OutcomeKind,
    Phase,
    Plan,
    Questions,
    SkillResult,
    SkillStatus,
    Step,
)
from executive.util.timeout import TimeLimitError, exclusive, within
from tests.fakes import FakeWorld, Stage, at, budget, pick

SOON = 0.05


over = threading.Event()
"""Lets what hangs for ever go, once a test is over."""


def forever() -> None:
    while not over.is_set():
        try:
            over.wait(0.001)
        except Exception:
            continue


@pytest.fixture(autouse=True)
def let_go() -> Iterator[None]:
    over.clear()
    yield
    over.set()


# Work that is ended.


def test_what_is_done_in_time_is_returned_and_what_it_raises_is_raised() -> None:
    assert within(60.0, lambda: "done") == "done"
    assert within(math.inf, lambda: "done") == "done"
    with pytest.raises(ZeroDivisionError):
        within(60.0, lambda: 1 // 0)


def test_a_time_limit_of_its_own_is_raised_as_what_it_is() -> None:
    def work() -> None:
        raise TimeoutError("a server's")

    with pytest.raises(TimeoutError, match="a server's"):
        within(60.0, work)


@pytest.mark.parametrize("work", [forever, lambda: over.wait(1000)])
def test_what_is_not_is_given_up_wherever_it_is(work: Callable[[], object]) -> None:
    with pytest.raises(TimeLimitError, match=r"more than 0\.05 s"):
        within(SOON, work)


def test_the_same_thread_does_one_piece_of_work_after_the_other() -> None:
    threads = {within(60.0, threading.get_ident) for _ in range(5)}
    assert len(threads) == 1
    assert threading.get_ident() not in threads


def test_what_was_given_up_returns_to_nobody() -> None:
    returned: list[str] = []

    def late() -> str:
        over.wait(1000)
        returned.append("late")
        return "late"

    with pytest.raises(TimeLimitError):
        within(SOON, late)
    assert within(60.0, lambda: "next") == "next"
    over.set()
    until = time.monotonic() + 30.0
    while not returned and time.monotonic() < until:
        time.sleep(0.001)
    assert within(60.0, lambda: "after that") == "after that"


def test_the_processes_that_it_has_started_end_with_it() -> None:
    started: list[subprocess.Popen[bytes]] = []
    below: list[int] = []

    def work() -> None:
        started.append(subprocess.Popen(["sh", "-c", "sleep 1000 & sleep 1000"]))
        while len(below) < 2:
            children = Path(f"/proc/{started[0].pid}/task/{started[0].pid}/children")
            below[:] = map(int, children.read_text().split())
        started[0].wait()

    bystander = subprocess.Popen(["sleep", "1000"])
    try:
        with pytest.raises(TimeLimitError):
            within(3.0, work)
        assert started[0].wait() != 0
        assert len(below) == 2
        until = time.monotonic() + 30.0
        while any(map(_is_asleep, below)) and time.monotonic() < until:
            time.sleep(0.001)
        assert not any(map(_is_asleep, below))
        assert bystander.poll() is None
    finally:
        bystander.kill()
        bystander.wait()


def _is_asleep(process: int) -> bool:
    """Whether a process is there and lives: where somebody else is to be told of its end, it may stay as a zombie."""
    try:
        status = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return status.rpartition(")")[2].split()[0] not in ("Z", "X")


def test_of_two_within_each_other_the_one_whose_time_is_up_ends() -> None:
    def inner_is_late() -> str:
        with pytest.raises(TimeLimitError):
            within(SOON, forever)
        return "outer goes on"

    assert within(60.0, inner_is_late) == "outer goes on"
    with pytest.raises(TimeLimitError, match=r"0\.05 s"):
        within(SOON, lambda: within(60.0, forever))


def test_what_has_to_be_whole_is_done_or_not_begun() -> None:
    told: list[str] = []
    ended = threading.Event()

    def work() -> None:
        try:
            with exclusive():
                told.append("half")
                time.sleep(3 * SOON)
                told.append("whole")
            over.wait(1000)
            with exclusive():
                told.append("more")
        finally:
            ended.set()

    with pytest.raises(TimeLimitError):
        within(SOON, work)
    assert told == ["half", "whole"], "it was waited for"
    over.set()
    assert ended.wait(30.0)
    assert told == ["half", "whole"]


def test_who_has_no_time_limit_is_not_disturbed() -> None:
    with exclusive(), exclusive():
        pass


def test_any_thread_can_set_a_time_limit() -> None:
    found: list[type[BaseException]] = []

    def work() -> None:
        try:
            within(SOON, forever)
        except TimeLimitError as error:
            found.append(type(error))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [TimeLimitError]


def test_ctrl_c_is_still_ctrl_c() -> None:
    def order() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        over.wait(1000)

    with pytest.raises(KeyboardInterrupt):
        within(60.0, order)


# Parts.


class Hanging:
    """An estimator and a planner that never answer."""

    name = "hanging"
    questions = Questions({at("a", "p"): "Is a on p?"}, "", "templates")

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        forever()
        raise AssertionError

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        forever()
        raise AssertionError


def test_an_estimator_that_hangs_has_no_answer_and_says_why() -> None:
    ended: list[str] = []
    eye = limit_estimator(Hanging(), SOON, end=lambda: ended.append("ended"))
    assert isinstance(eye, Asking)
    assert eye.questions is Hanging.questions
    observation = Observation(4, 0.0, {"front": np.zeros((2, 2, 3), np.uint8)}, np.zeros(1))
    belief = eye.estimate(observation, [at("a", "p"), at("a", "q")])
    assert belief.unanswered == {at("a", "p"), at("a", "q")}
    assert (belief.observation_id, belief.source, dict(belief.probability)) == (4, "hanging", {})
    assert {answer.error for answers in belief.evidence.values() for answer in answers} == {
        "no answer: it took more than 0.05 s"
    }
    assert ended == ["ended"], "whatever it was at"


def test_a_planner_that_hangs_has_timed_out() -> None:
    answer = limit_planner(Hanging(), SOON).plan(Facts(), ALWAYS)
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.TIMED_OUT


def test_a_skill_that_hangs_is_asked_first_and_then_given_up() -> None:
    step = pick("a", "p")

    def polite(step: Step, context: SkillContext) -> SkillResult:
        while not context.cancelled():
            time.sleep(0.001)
        return SkillResult(step, SkillStatus.CANCELLED, "cancelled", 1.5)

    def deaf(step: Step, context: SkillContext) -> SkillResult:
        forever()
        raise AssertionError

    def quick(step: Step, context: SkillContext) -> SkillResult:
        return SkillResult(step, SkillStatus.DONE)

    def late(step: Step, context: SkillContext) -> SkillResult:
        over.wait(1000)
        context.announce(Phase("late"))
        raise AssertionError

    cancelled = False
    told: list[object] = []
    context = SkillContext(None, np.random.default_rng(0), told.append, lambda: cancelled)
    skills = limit_skills({"polite": polite, "deaf": deaf, "quick": quick, "late": late}, SOON, grace=SOON)
    asked, ended, done = (skills[name](step, context) for name in ("polite", "deaf", "quick"))
    assert (asked.status, asked.reason) == (SkillStatus.TIMED_OUT, "it was asked to stop after 0.05 s")
    assert asked.seconds == 1.5
    assert ended.status is SkillStatus.TIMED_OUT
    assert "did not stop when asked to" in ended.reason
    assert done.status is SkillStatus.DONE
    assert skills["late"](step, context).status is SkillStatus.TIMED_OUT
    over.set()
    time.sleep(SOON)
    assert told == [], "what is left behind tells nothing"
    cancelled = True
    assert skills["polite"](step, context).status is SkillStatus.CANCELLED, "the run is, not the skill"


def test_a_run_whose_skill_hangs_ends_by_name() -> None:
    stage = Stage(Facts({at("a", "q"): True}), {"a": "p"}, settings=Settings(max_failures=2))
    count = 0

    def hanging(step: Step, context: SkillContext) -> SkillResult:
        nonlocal count
        count += 1
        context.announce(Phase("approach"))
        forever()
        raise AssertionError

    skills = limit_skills({"pick": hanging, "place": stage.skill}, SOON, grace=0.0)
    executive = make_executive(
        stage.task, stage.planner, stage.world, skills, stage.estimator, [stage.recorder], stage.settings
    )
    ended = executive.run()
    assert ended.outcome is OutcomeKind.GAVE_UP
    results = stage.recorder.of(SkillResult)
    assert [result.status for result in results] == [SkillStatus.TIMED_OUT] * count
    assert any("did not stop when asked to" in cause.detail for cause in ended.causes)
    assert isinstance(stage.recorder.events[-1].payload, Ended)


# Budgets.


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        (Settings(max_looks=3), budget("looks", 3)),
        (Settings(max_cycles=2), budget("cycles", 2)),
        (Settings(max_actions=1), budget("actions", 1)),
        (Settings(max_seconds=0.0), budget("seconds", 0)),
    ],
)
def test_a_budget_that_is_used_up_ends_the_run(settings: Settings, cause: Cause) -> None:
    stage = Stage(Facts({at("a", "q"): True, at("b", "q"): True}), {"a": "p", "b": "p"}, settings=settings)
    ended = stage.play()
    assert (ended.outcome, ended.causes) == (OutcomeKind.GAVE_UP, (cause,))


# The record.


class Disk:
    """A disk with room for so many bytes. What is in a run's folder counts, and so does the room that is kept."""

    def __init__(self, patch: pytest.MonkeyPatch, folder: Path, room: int, error: int = errno.ENOSPC) -> None:
        self._folder, self.room, self._error = folder, room, error
        write, write_bytes = os.write, Path.write_bytes

        def limited_write(file: int, data: bytes) -> int:
            fits = max(0, min(len(data), self._left()))
            if fits < len(data):
                write(file, data[:fits])  # as a disk does
                if not fits:
                    self._refuse()
                return fits
            return write(file, data)

        def limited_write_bytes(path: Path, data: bytes) -> int:
            if len(data) > self._left():
                write_bytes(path, data[: max(0, self._left())])
                self._refuse()
            return write_bytes(path, data)

        patch.setattr(os, "write", limited_write)
        patch.setattr(Path, "write_bytes", limited_write_bytes)
        patch.setattr(
            "executive.trace.record.snapshots.write_atomic", lambda path, data, durable: limited_write_bytes(path, data)
        )

    def _left(self) -> int:
        files = (path for path in self._folder.rglob("*") if path.is_file())
        return self.room - sum(path.stat().st_size for path in files)

    def _refuse(self) -> None:
        raise OSError(self._error, os.strerror(self._error))


def picture(world: FakeWorld) -> Any:
    return np.random.default_rng(list(str(world.where).encode())).integers(0, 256, (16, 16, 3), dtype=np.uint8)


def recorded_run(folder: Path) -> tuple[Ended, list[Event]]:
    stage = Stage(Facts({at("a", "q"): True, at("b", "r"): True}), {"a": "p", "b": "p"})
    stage.world.cameras = {"front": picture}
    made: list[Executive] = []

    def failed(why: str) -> None:
        made[0].cancel(why)

    sinks: list[Sink] = [Snapshots(folder, stage.world, failed), EventLog(folder, failed), stage.recorder]
    skills = {"pick": stage.skill, "place": stage.skill}
    made.append(make_executive(stage.task, stage.planner, stage.world, skills, stage.estimator, sinks))
    return made[0].run(), list(read_events(folder))


ROOM = 1 << 18


@pytest.mark.parametrize("room", [1_500, 3_000, 5_000, 7_000, 9_000, 12_000, 16_000, 20_000])
def test_a_full_disk_ends_the_run_and_the_record_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    Disk(monkeypatch, tmp_path, ROOM + room)
    ended, events = recorded_run(tmp_path)
    assert ended.outcome is OutcomeKind.INTERRUPTED
    assert "No space left on device" in ended.causes[0].detail
    assert events[-1].payload == ended
    assert not (tmp_path / ".room").exists()


def test_with_room_for_all_of_it_nothing_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, tmp_path, ROOM + 10_000_000)
    ended, events = recorded_run(tmp_path)
    assert (ended.outcome, events[-1].payload) == (OutcomeKind.GOAL_REACHED, ended)
    assert not (tmp_path / ".room").exists()


def test_a_disk_that_is_lost_for_good_leaves_whole_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch, tmp_path, ROOM + 9_000, errno.EROFS)
    unlink = Path.unlink

    def lost(path: Path, missing_ok: bool = False) -> None:
        disk.room -= ROOM  # what is given back is gone, too
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", lost)
    ended, events = recorded_run(tmp_path)
    assert ended.outcome is OutcomeKind.INTERRUPTED
    assert "Read-only file system" in ended.causes[0].detail
    assert events
    assert (tmp_path / EVENTS_FILE).read_bytes().endswith(b"\n")


def test_a_folder_that_cannot_be_written_is_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refuse)
        with pytest.raises(InputError, match=r"cannot be written \(Permission denied\)"):
            EventLog(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(os, "posix_fallocate", refuse)
        with pytest.raises(InputError, match=r"cannot be written \(Permission denied\)"):
            EventLog(tmp_path)
    EventLog(tmp_path).close()


# Orders from outside.


@pytest.fixture
def handlers() -> Iterator[None]:
    """Each order does what it does in a terminal, whoever started the tests (nohup has SIGHUP ignored)."""
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for each in before:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)
    yield
    for each, handler in before.items():
        signal.signal(each, handler)


@pytest.mark.parametrize("order", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_asked_to_end_the_run_is_cancelled_and_then_left(order: signal.Signals, handlers: None) -> None:
    cancelled: list[int] = []
    before = signal.getsignal(order)
    with ctrl_c(lambda: cancelled.append(1)) as interrupted:
        os.kill(os.getpid(), order)
        assert cancelled == [1]
        assert interrupted.code == 128 + order
        with pytest.raises(KeyboardInterrupt if order is signal.SIGINT else SystemExit) as again:
            os.kill(os.getpid(), order)
        assert again.value.args == (() if order is signal.SIGINT else (128 + order,))
    assert signal.getsignal(order) is before


def test_nohup_is_nohup(handlers: None) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    cancelled: list[int] = []
    with ctrl_c(lambda: cancelled.append(1)):
        os.kill(os.getpid(), signal.SIGHUP)
    assert cancelled == []


BUSY = """
import hashlib, signal, sys, time
from executive.cli.app import ctrl_c
signal.signal(signal.SIGINT, signal.default_int_handler)  # else ignored, where a shell started the tests behind it
def cancel(): print("cancelled", flush=True)
with ctrl_c(cancel, float(sys.argv[1])) as interrupted:
    print("busy", flush=True)
    if sys.argv[2] == "stuck":  # in C, where no handler of Python's is called
        hashlib.pbkdf2_hmac("sha256", b"", b"", 2_000_000_000)
    time.sleep(600) if sys.argv[2] == "deaf" else time.sleep(0.2)
sys.exit(interrupted.code)
"""


@pytest.mark.parametrize("order", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("way", ["stuck", "deaf"])
def test_long_work_that_is_told_to_end_says_so_and_is_left_wherever_it_is(way: str, order: signal.Signals) -> None:
    command = [sys.executable, "-c", BUSY, "0.5", way]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "busy\n"
        process.send_signal(order)
        assert process.stderr.readline().startswith("stopping; what is finished is kept")
        assert process.stderr.readline().startswith("left in the middle of something")
        assert process.wait(60) == 128 + order


def test_long_work_that_comes_to_rest_is_not_left_in_the_middle() -> None:
    command = [sys.executable, "-c", BUSY, "600", "polite"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "busy\n"
        process.send_signal(signal.SIGTERM)
        printed, told = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert printed == "cancelled\n"
    assert told == "stopping; what is finished is kept (once more to leave at once)\n"


def test_other_signals_are_no_orders(handlers: None) -> None:
    before = signal.signal(signal.SIGUSR1, lambda number, frame: None)
    try:
        with ctrl_c(lambda: pytest.fail("nobody asked for that"), 0.0):
            os.kill(os.getpid(), signal.SIGUSR1)
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_what_is_made_ready_outlasts_no_run() -> None:
    class Endless:
        def prepare(self, tell: Tell) -> None:
            tell("the check")
            forever()

    told: list[str] = []
    (part,) = limit_preparing([Endless()], lambda: SOON)
    part.prepare(told.append)
    assert told == ["the check"]
