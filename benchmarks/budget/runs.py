"""What a run takes: until its first motion, on a machine where nothing was compiled, in memory, and against the clock
of the simulated world; and how many episodes of a campaign are played in a minute."""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.budget.figures import Figure
from benchmarks.budget.tree import Spent, run_watched

_FIRST = """
import sys
from executive.__main__ import main
from executive.trace.terminal.sink import TerminalSink

told = TerminalSink.write

def write(self, event):
    told(self, event)
    if type(event.payload).__name__ == "Dispatched":
        self.seen = True
    if type(event.payload).__name__ == "Frame" and getattr(self, "seen", False):
        print("MOVES", flush=True)

TerminalSink.write = write
sys.argv = ["executive", "run", "grocery", "--seed", "3", "--runs", sys.argv[1]]
main()
"""
"""A run that says when the arm moves for the first time."""

_ONE = ["-m", "executive", "run", "grocery", "--seed", "3", "--fault", "drop@4", "--quiet", "--json"]


def start() -> Iterator[Figure]:
    rounds = [_first() for _ in range(3)]
    wall, cpu = (statistics.median(values) for values in zip(*((each.wall, each.cpu) for each in rounds), strict=True))
    yield Figure("`executive run` to its first motion", "6.7 s", 3.0, wall, cpu=cpu, note="median of 3")
    with tempfile.TemporaryDirectory() as caches:
        fresh = _first({"NUMBA_CACHE_DIR": caches, "XDG_CACHE_HOME": caches})
    yield Figure(
        "the same with nothing compiled, more than that (a wheel's first run)", "minutes", 60.0, fresh.wall - wall,
        cpu=fresh.cpu - cpu, note="numba's and our own caches empty; a clone compiles while it is set up",
    )  # fmt: skip


def memory() -> Iterator[Figure]:
    with tempfile.TemporaryDirectory() as folder:
        spent = run_watched([sys.executable, *_ONE, "--runs", folder])
    parts = ", ".join(f"{name} {value:.0f}" for name, value in spent.parts.items())
    yield Figure("memory of one default run, peak over its processes", "0.89 GB", 0.6, spent.mebibytes * 1.048576e-3,
                 "GB", note=f"proportional set sizes, MiB: {parts}")  # fmt: skip


def whole() -> Iterator[Figure]:
    for poses, target in (("oracle", 10.0), ("depth", 6.0)):
        with tempfile.TemporaryDirectory() as folder:
            spent = run_watched([sys.executable, *_ONE, "--runs", folder, "--poses", poses])
        done = json.loads(spent.said)
        taken = done["wall_seconds"]
        stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in taken.items() if seconds >= 0.05)
        former = "6.4 times" if poses == "oracle" else ""
        yield Figure(f"six items and a drop, by sight, poses {poses}: faster than simulated", former, target,
                     done["sim_seconds"] / taken["total"], "times", more=True, cpu=spent.cpu,
                     note=f"{done['outcome']}, {done['actions']} actions; wall s: {stages}")  # fmt: skip


def campaign() -> Iterator[Figure]:
    one_thread = {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    single, _ = _campaign(1, 4, "oracle", one_thread)
    for poses, target in (("oracle", 15.0), ("depth", 8.0)):
        many, spent = _campaign(2, 8, poses)
        if poses == "oracle":
            yield Figure("a campaign of 2 jobs against one", "", 1.7, many / single, "times", more=True,
                         note="4 episodes by one job, 8 by two, the start of both included")  # fmt: skip
        former = "about 10" if poses == "oracle" else ""
        yield Figure(f"episodes a minute of a campaign by sight, 2 jobs, poses {poses}", former, target, many,
                     "a minute", more=True, cpu=spent.cpu, note="8 episodes, the start included")  # fmt: skip


def _campaign(jobs: int, episodes: int, poses: str, environment: dict[str, str] | None = None) -> tuple[float, Spent]:
    """Return the episodes a minute."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "campaign.toml"
        file.write_text(
            f'title = "Speed"\nseeds = {episodes}\n[run]\nposes = "{poses}"\n[[domains]]\ndomain = "grocery"\n'
            '[faults]\n"drop" = ["drop:p=0.1"]\n[estimators]\nvlm = {}\n'
        )
        began = time.perf_counter()
        spent = run_watched([sys.executable, "-m", "executive", "bench", str(file), "--jobs", str(jobs), "--out",
                             str(Path(name) / "out")], environment=environment)  # fmt: skip
        return 60.0 * episodes / (time.perf_counter() - began), spent


def _first(environment: dict[str, str] | None = None) -> Spent:
    with tempfile.TemporaryDirectory() as folder:
        return run_watched([sys.executable, "-c", _FIRST, folder], until="MOVES", environment=environment)
