"""Programs of a planner keep their limits, are quoted by the line that matters, and never outlive who started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from executive.planning.programs import Ended, last_words, memory_limit, run_program

ROOT = Path(__file__).resolve().parents[3]


def alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in (Path("/proc") / str(pid) / "status").read_text()
    except OSError:
        return False


def wait_until_gone(pid: int) -> None:
    while alive(pid):
        time.sleep(0.01)


def test_a_program_reads_its_input_in_its_folder_and_is_told_by_its_exit_code(tmp_path: Path) -> None:
    (tmp_path / "input").write_text("good morning")
    ended = run_program(["sh", "-c", "cat > output; pwd; exit 5"], tmp_path, 60.0, tmp_path / "input")
    assert ended == Ended(5, f"{tmp_path}\n", expired=False)
    assert (tmp_path / "output").read_text() == "good morning"


def test_a_program_that_cannot_be_started_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="no/such"):
        run_program(["/no/such/program"], tmp_path, 60.0)


def test_its_time_is_up_for_all_that_it_started(tmp_path: Path) -> None:
    script = "sleep 1000 & echo $! > pid; wait"
    ended = run_program(["sh", "-c", script], tmp_path, 0.5)
    assert (ended.code, ended.expired) == (-signal.SIGKILL, True)
    wait_until_gone(int((tmp_path / "pid").read_text()))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit another process")
def test_what_it_computes_is_limited_apart_from_how_long_it_takes(tmp_path: Path) -> None:
    ended = run_program(["sh", "-c", "while :; do :; done"], tmp_path, 600.0, processor=0.5)
    assert (ended.code, ended.expired) == (-signal.SIGXCPU, False)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit another process")
def test_it_cannot_take_all_memory(tmp_path: Path) -> None:
    script = f"block = bytearray({memory_limit()} + 1)"
    ended = run_program([sys.executable, "-c", script], tmp_path, 60.0)
    assert (ended.code, ended.last_words) == (1, "MemoryError")


STARTER = """
import sys, threading
from pathlib import Path
from executive.planning.programs import run_program
where = Path(sys.argv[1])
def run(number):
    run_program(["sh", "-c", f"echo $$ > {number}.part; mv {number}.part {number}; exec sleep 1000"], where, 900.0)
threading.Thread(target=run, args=(1,), daemon=True).start()
run_program(["true"], where, 60.0)
run(2)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_it_ends_with_the_process_that_started_it(tmp_path: Path, number: signal.Signals) -> None:
    starter = subprocess.Popen([sys.executable, "-c", STARTER, str(tmp_path)], cwd=ROOT)
    try:
        for name in ("1", "2"):
            while not (tmp_path / name).exists():
                assert starter.poll() is None
                time.sleep(0.01)
        pids = [int((tmp_path / name).read_text()) for name in ("1", "2")]
        assert all(map(alive, pids))
    finally:
        starter.send_signal(number)
        starter.wait()
    for pid in pids:
        wait_until_gone(pid)


def test_whoever_watches_may_be_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then the next program is watched again."""
    monkeypatch.setattr("executive.planning.programs._watching", None)
    for _ in range(2):
        assert run_program(["true"], tmp_path, 60.0).code == 0
        (watcher,) = [
            int(folder.name)
            for folder in Path("/proc").glob("[0-9]*")
            if alive(int(folder.name))
            and (folder / "stat").read_text().rpartition(")")[2].split()[1] == str(os.getpid())
            and b"while read" in (folder / "cmdline").read_bytes()
        ][-1:]
        os.kill(watcher, signal.SIGKILL)
        wait_until_gone(watcher)
        assert run_program(["true"], tmp_path, 60.0).code == 0


def test_several_threads_may_run_programs(tmp_path: Path) -> None:
    codes = dict[int, int]()

    def work(number: int) -> None:
        codes[number] = run_program(["sh", "-c", f"exit {number}"], tmp_path, 60.0).code

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert codes == {number: number for number in range(8)}


@pytest.mark.parametrize(
    ("said", "quoted"),
    [
        (["[t=0.1s, 9 KB] reading", "line 3: bad variable", "Peak memory: 9 KB", "exit code 33"], "bad variable"),
        (["Peak memory: 9 KB", ""], "Peak memory"),
        ([], "it said nothing"),
    ],
)  # fmt: skip
def test_it_is_quoted_by_the_line_that_matters(said: list[str], quoted: str) -> None:
    assert quoted in last_words(said)
