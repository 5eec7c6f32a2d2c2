"""How long it takes until something happens: an import, a help text, a run's first motion; and where it goes."""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import tempfile
import time

from benchmarks.speed.table import Row

_IMPORT = "import executive"
_HELP = "import sys; sys.argv = ['executive', '--help']; from executive.__main__ import main; main()"
_FIRST = """
import cProfile, os, pstats, sys
from executive.core import time_limits
from executive.skills.arm import Attempt
folder, profiled = sys.argv[1], sys.argv[2] == "profiled"
watch = cProfile.Profile()

def moves(self, *arguments, **options):
    watch.disable()
    if profiled:
        for (file, _, name), (_, _, _, seconds, _) in pstats.Stats(watch).stats.items():
            print("TOOK", seconds, name.replace(" ", "_"))
    sys.stdout.flush()
    os._exit(0)

Attempt.move = moves
if profiled:
    time_limits.within = lambda seconds, work: work()  # in this thread, which is the one that is watched
    watch.enable()
from executive.__main__ import main
sys.argv = ["executive", "run", "grocery", "--seed", "3", "--runs", folder]
main()
"""
"""A run that ends where the arm is about to move; with what each function took until then, if it is profiled."""

_STAGES = {
    "stage the world": "_simulator",
    "wait for the model, which loads beside": "ready",
    "find mutex groups": "find_mutexes",
    "take the pictures": "observe",
    "answer the questions": "estimate",
    "plan": "plan",
    "set up the arm": "arm_of",
    "write the viewer's recording": "set_sinks",
    "import modules": "_load_unlocked",
}
"""What it goes for -> the function whose time that is."""


def measure(everything: bool) -> list[Row]:
    rounds = 9 if everything else 5
    empty = _median("pass", rounds)
    imported, helped = _median(_IMPORT, rounds), _median(_HELP, rounds)
    run, profile = _first_motion()
    against = "an empty program"
    return [
        Row("start, import executive", imported, empty, "s", "0.15 s", imported <= 0.15, against, _where(_IMPORT)),
        Row("start, executive --help", helped, empty, "s", "0.3 s", helped <= 0.3, against, _where(_HELP)),
        Row("start, executive run to its first motion", run, None, "s", "3 s", run <= 3.0, "", profile),
    ]


def _median(program: str, rounds: int) -> float:
    return statistics.median(_processor_time(program) for _ in range(rounds))


def _processor_time(program: str) -> float:
    """Seconds of processor time that a fresh interpreter takes, its start and end included."""
    import resource

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _first_motion() -> tuple[float, str]:
    """Wall seconds until a run's first motion, for its model loads in a process beside; and what they go for."""
    spent = []
    for _ in range(3):
        began = time.perf_counter()
        _run_until_motion("bare")
        spent.append(time.perf_counter() - began)
    took: dict[str, float] = {}
    for line in _run_until_motion("profiled").splitlines():
        if line.startswith("TOOK "):
            _, seconds, name = line.split()
            took[name] = max(took.get(name, 0.0), float(seconds))
    parts = [f"{what} {took[name]:.2f} s" for what, name in _STAGES.items() if name in took]
    return statistics.median(spent), "wall time, profiled, some within others: " + ", ".join(parts)


def _run_until_motion(how: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([sys.executable, "-c", _FIRST, folder, how], check=True, capture_output=True, text=True)
    return done.stdout


def _where(program: str, count: int = 4) -> str:
    """The imports that take longest, each with all that it brings."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", program], check=True, capture_output=True, text=True
    )
    found = re.findall(r"import time:\s+\d+ \|\s+(\d+) \|( +)(\S+)", done.stderr)
    most = sorted(((int(each), name) for each, indent, name in found if len(indent) <= 5), reverse=True)
    return "imports, with theirs: " + ", ".join(f"{name} {1e-3 * each:.0f} ms" for each, name in most[:count])
