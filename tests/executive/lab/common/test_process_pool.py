"""Whoever works, the same jobs come to the same; one that comes to grief costs itself alone; nobody stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest

from executive.errors import ExecutiveError, InputError, MissingError
from executive.lab.campaign.episode import FAILED, Player, Row, row_of
from executive.lab.common.process_pool import TRIES, JobResult, ProcessPool, WorkerLostError, WorkerPool, run_jobs
from executive.lab.common.ray_pool import RayPool
from executive.util.processes import TERMINATION_SIGNALS
from tests.executive.lab import jobs
from tests.executive.lab.campaign import players
from tests.executive.lab.campaign.players import campaign, lasting, play
from tests.executive.lab.fake_ray import Died, FakeRay, Reference
from tests.executive.lab.inline import Inline


def done(pool: WorkerPool[Any, Any], wanted: Iterable[Any], tries: int = 1) -> list[JobResult[Any, Any]]:
    waiting = iter(wanted)
    return [each for ended in run_jobs(pool, lambda: next(waiting, None), lambda: False, tries) for each in ended]


def values(pool: WorkerPool[Any, Any], wanted: Sequence[str], tries: int = 1) -> dict[str, object]:
    """What came of each, an exception as its kind and its text."""
    came = {each.job: each.outcome for each in done(pool, wanted, tries)}
    assert came.keys() == set(wanted)
    return {job: (type(it), str(it)) if isinstance(it, Exception) else it for job, it in came.items()}


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    """In place of the module."""
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    return fake


POOLS: dict[str, Callable[[Any, int], WorkerPool[Any, Any]]] = {
    "processes": lambda prepare, count: ProcessPool(prepare, count),
    "ray": lambda prepare, count: RayPool(prepare, count),
    "inline": lambda prepare, count: Inline(prepare, count),
}


@pytest.fixture(params=POOLS)
def make_pool(request: pytest.FixtureRequest, ray: FakeRay) -> Callable[[Any, int], WorkerPool[Any, Any]]:
    """Makes crews of each kind."""
    return POOLS[request.param]


MISSING = (MissingError, "no GL; install it with: apt-get install gl")


def test_values_and_exceptions_arrive_unchanged_from_every_pool(
    make_pool: Callable[[Any, int], WorkerPool[Any, Any]],
) -> None:
    with make_pool(jobs.worker, 2) as pool:
        came = values(pool, ["a", "input", "b", "missing", "bug", "c"])
        assert came == {
            "a": "A",
            "b": "B",
            "c": "C",
            "input": (InputError, "here.toml: a.b: is wrong"),
            "missing": MISSING,
            "bug": (ZeroDivisionError, "a bug\nin two lines"),
        }
        assert (pool.free, pool.running_progress) == (2, 0.0)
        (bug,) = done(pool, ["bug"])
        assert "in __call__" in "".join(getattr(bug.outcome, "__notes__", ()))
        with pytest.raises(ZeroDivisionError):
            bug.value()
    with make_pool(jobs.refusing, 1) as pool:
        assert values(pool, ["a", "b"]) == {"a": MISSING, "b": MISSING}


def test_what_cannot_be_sent_is_told_all_the_same() -> None:
    with ProcessPool[str, str](jobs.worker, 1) as pool:
        came = values(pool, ["odd", "unsendable", "a"])
    assert came["odd"] == (RuntimeError, "OddError: one two")
    assert came["a"] == "A"
    assert isinstance(came["unsendable"], tuple)
    assert came["unsendable"][0] is RuntimeError


def test_the_same_episodes_give_the_same_rows_whoever_plays_them(ray: FakeRay) -> None:
    episodes = list(campaign().episodes())
    same = {episode.key: lasting(play(episode)) for episode in episodes}

    def rows(pool: WorkerPool[Any, Row]) -> dict[tuple[str, ...], Row]:
        return {each.job.key: lasting(row_of(each)) for each in done(pool, episodes)}

    with ProcessPool(players.symbolic, 2, 600.0, single_threaded=True) as processes:
        assert rows(processes) == same
    with RayPool(players.symbolic, None, 600.0) as on_ray:
        assert on_ray.free == ray.cores
        assert rows(on_ray) == same
    assert len(ray.actors) == ray.cores
    assert all(actor.dead for actor in ray.actors)


def test_the_real_ray_gives_them_too() -> None:
    pytest.importorskip("ray", reason="the extra executive[ray] is not installed")
    with RayPool(jobs.worker, 2) as pool:
        came = values(pool, ["a", "input", "missing", "b"])
    assert came == {"a": "A", "b": "B", "input": (InputError, "here.toml: a.b: is wrong"), "missing": MISSING}


def test_a_process_that_dies_or_hangs_costs_one_job() -> None:
    with ProcessPool[str, str](jobs.worker, 1) as pool:
        ended = {each.job: each for each in done(pool, ["a", "dies", "b"])}
        assert [ended[job].outcome for job in "ab"] == ["A", "B"]
        why = ended["dies"].outcome
        assert isinstance(why, WorkerLostError)
        assert str(why).startswith("its process died by signal 9 (was there enough memory? --jobs takes fewer of them)")
        (member,) = pool._workers
        pool._limit = 0.2
        (late,) = done(pool, ["hangs"])
        assert isinstance(late.outcome, WorkerLostError)
        assert str(late.outcome) == "took longer than 0.2 s and was ended"
        assert (member.process.is_alive(), pool.free) == (False, 1)


def test_a_job_whose_process_was_lost_is_done_again_a_few_times(tmp_path: Path) -> None:
    mark = f"once:{tmp_path / 'mark'}"
    with ProcessPool[str, str](jobs.worker, 1) as pool:
        came = {each.job: each.outcome for each in done(pool, ["a", mark, "dies"], TRIES)}
    assert came["a"] == "A"
    assert came[mark] == mark.upper()
    assert isinstance(came["dies"], WorkerLostError)


def test_a_process_takes_one_job_after_the_other_and_keeps_what_it_made() -> None:
    with ProcessPool[str, str](jobs.worker, 1) as pool:
        first, second = (each.outcome for each in done(pool, ["pid:1", "pid:2"]))
    assert str(first).split()[1] == "1"
    assert str(second).split() == [str(first).split()[0], "2"]


def test_how_far_jobs_are_is_told_and_processes_leave_with_their_crew() -> None:
    with ProcessPool[str, str](jobs.worker, 1) as pool:
        pool.submit("hangs")
        while pool.running_progress != 0.5:
            assert pool.gather(60.0) == []
        assert pool.free == 0
        pid = pool._workers[0].process.pid
    assert pid is not None
    assert gone(pid)


def test_workers_hear_no_order_and_none_outlives_a_parent_that_is_killed() -> None:
    """Each is in the middle of a job, and has started a program of its own."""
    command = [sys.executable, "-m", "tests.executive.lab.jobs"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2
        for order in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            for worker in workers:
                os.kill(worker, order)
        time.sleep(0.3)
        assert not any(map(gone, workers, [0.0, 0.0]))
        parent.kill()
    assert all(map(gone, workers))


def gone(pid: int, patience: float = 20.0) -> bool:
    """Whether a process ends within a while."""
    until = time.monotonic() + patience
    while True:
        try:
            with open(f"/proc/{pid}/stat") as file:
                if file.read().rpartition(")")[2].split()[0] == "Z":  # dead, and nobody has asked for it yet
                    return True
        except (FileNotFoundError, ProcessLookupError):
            return True
        if time.monotonic() >= until:
            return False
        time.sleep(0.05)


def test_an_order_that_comes_while_a_process_is_spawned_is_not_lost() -> None:
    from executive.util.processes import block_signals

    # To this thread: one to the process is for any thread that does not block it, and may come after the test.
    with pytest.raises(KeyboardInterrupt), block_signals():
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


FIRST = """
import multiprocessing, pathlib, time
from executive.util.processes import block_signals

if __name__ == "__main__":
    process = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60.0,))
    with block_signals():
        process.start()
    print(pathlib.Path(f"/proc/{process.pid}/status").read_text())
    process.kill()
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads the signals of a process from /proc")
def test_not_even_the_first_process_that_is_spawned_can_be_interrupted_before_it_is_ready(tmp_path: Path) -> None:
    script = tmp_path / "first.py"
    script.write_text(FIRST)
    said = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True).stdout
    blocked = int(next(line.split()[1] for line in said.splitlines() if line.startswith("SigBlk:")), 16)
    assert [each for each in TERMINATION_SIGNALS if not blocked >> (each - 1) & 1] == []


def test_nothing_more_is_begun_once_it_is_stopped() -> None:
    pool = Inline(jobs.worker, 2)
    waiting = iter("abcdef")
    for ended in run_jobs(pool, lambda: next(waiting, None), lambda: len(pool.done) >= 2):
        assert len(ended) == 1
    assert len(pool.done) == 2


@pytest.mark.slow
def test_a_killed_worker_of_the_real_ray_is_replaced_and_nothing_is_lost(tmp_path: Path) -> None:
    """Ray is installed with the extra: `pip install 'executive[ray]'`."""
    pytest.importorskip("ray", reason="the extra executive[ray] is not installed")
    wanted = ["a", f"once:{tmp_path / 'first'}", "b", "pid:1", f"once:{tmp_path / 'second'}", "c", "pid:2", "d"]
    with RayPool(jobs.worker, 2) as pool:
        came = values(pool, wanted, TRIES)
        assert {job: it for job, it in came.items() if not job.startswith("pid")} == {
            job: job.upper() for job in wanted if not job.startswith("pid")
        }
        (lost,) = done(pool, ["dies"], TRIES)
        assert isinstance(lost.outcome, WorkerLostError)
        assert pool.free == 2
        # Whoever works now was made after one was killed: a killed worker has done more jobs than none.
        (pid,) = (str(each.outcome).split() for each in done(pool, ["pid:3"]))
        os.kill(int(pid[0]), signal.SIGKILL)  # from outside, while it waits for work
        assert set(values(pool, ["e", "f", "g"], TRIES).values()) == {"E", "F", "G"}


def test_an_actor_that_dies_or_hangs_costs_one_job(ray: FakeRay) -> None:
    def prepare() -> Player:
        return play_or_not

    def play_or_not(episode: Any, tell: Any) -> Row:
        if episode.seed == players.DIES:
            raise Died
        if episode.seed == players.RAISES:
            raise ValueError("a bug")
        return play(episode)

    hanging: list[Reference] = []
    ray.hangs = lambda reference: reference in hanging
    episodes = list(campaign(5, faults={"none": ()}).episodes())[1::2]
    with RayPool(prepare, 1) as pool:
        rows = [row_of(each) for each in done(pool, [each for each in episodes if each.seed != players.HANGS])]
        assert {row.seed: row.error for row in rows if row.outcome == FAILED} == {
            players.RAISES: "ValueError: a bug",
            players.DIES: "its process died: the actor died unexpectedly",
        }
        pool.submit(episodes[players.HANGS])
        hanging += pool._busy
        pool._limit = 0.0
        (ended,) = pool.gather(1.0)
        assert isinstance(ended.outcome, WorkerLostError)
        assert (ended.job.seed, str(ended.outcome)) == (players.HANGS, "took longer than 0 s and was ended")
        assert pool.free == 1
    assert all(actor.dead for actor in ray.actors)
    assert ray.down == 1


def test_a_cluster_is_joined_or_made(ray: FakeRay) -> None:
    RayPool(jobs.worker, 3)
    RayPool(jobs.worker, None, address="auto")
    assert [(each.get("num_cpus"), each.get("address")) for each in ray.started] == [(3, None), (None, "auto")]
    with pytest.raises(ExecutiveError, match="Ray cannot be used: could not find any running Ray instance at nowhere"):
        RayPool(jobs.worker, None, address="nowhere")


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingError, match=r"extra executive\[ray\]; install it with: pip install 'executive\[ray\]'"):
        RayPool(jobs.worker, None)


def test_nobody_is_hired_before_there_is_work() -> None:
    with ProcessPool[str, str](jobs.worker, 3) as pool:
        assert (pool.free, pool.gather(0.0), pool._workers) == (3, [], [])
