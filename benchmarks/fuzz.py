"""Every parser against inputs that are wrong: `python -m benchmarks.fuzz --inputs 100000` (long), or some of them:
`python -m benchmarks.fuzz fault events.jsonl --inputs 2000`.

Two ways to come by inputs: by `chance`, real files are changed in the ways that files are wrong in (the seed and an
input's number give the input again); `atheris` is guided by the lines that inputs reach (`pip install
'executive[fuzz]'`). By default each that is installed gets its share of them. A parser has to take an input or say in
one line what is wrong with it, in time, and without touching anything else. Where temporary files are in memory
(`TMPDIR=/dev/shm`), it takes half the time.
"""

from __future__ import annotations

import argparse
import importlib.util
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks.fuzzing.inputs import Rolled, changed, smallest
from benchmarks.fuzzing.targets import TARGETS
from benchmarks.fuzzing.watch import Hang, judged

ENGINES = ("chance", "atheris")


class Tally(NamedTuple):
    """What came of one target under one engine. `finding` is empty where nothing went wrong."""

    inputs: int
    taken: int
    finding: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of: {', '.join(TARGETS)}")
    parser.add_argument("--inputs", type=int, default=100_000, help="for each target")
    parser.add_argument("--engine", choices=ENGINES, action="append")
    parser.add_argument("--seed", type=int, default=0, help="fixes what is changed by chance")
    parser.add_argument("--found", type=Path, default=Path("fuzz-findings"), help="where inputs go that do harm")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.targets if name not in TARGETS]
    if unknown:
        parser.error(f"no target {unknown[0]!r}; valid: {', '.join(TARGETS)}")
    guided = importlib.util.find_spec("atheris") is not None
    engines = arguments.engine or [engine for engine in ENGINES if guided or engine != "atheris"]
    share = -(-arguments.inputs // len(engines))
    findings = 0
    print(f"{'target':<18}{'engine':<12}{'inputs':>9}{'taken':>9}{'refused':>9}{'s':>8}   {'found':<}")
    for name in arguments.targets or TARGETS:
        for engine in engines:
            began = time.perf_counter()
            if engine == "chance":
                tally = by_chance(name, share, arguments.found, arguments.seed)
            else:
                tally = by_atheris(name, share, arguments.found)
            findings += bool(tally.finding)
            print(
                f"{name:<18}{engine:<12}{tally.inputs:>9,}{tally.taken:>9,}{tally.inputs - tally.taken:>9,}"
                f"{time.perf_counter() - began:>8.0f}   {tally.finding or 'nothing'}",
                flush=True,
            )
    print(f"{findings} findings" if findings else "nothing was found")
    sys.exit(findings > 0)


def by_chance(name: str, count: int, found: Path, seed: int = 0) -> Tally:
    """Real files, changed at random. Of the first input that does harm, as little is kept as still does."""
    target, taken = TARGETS[name], 0
    seeds = target.seeds()
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)

        def harm(data: bytes) -> str:
            nonlocal taken
            try:
                taken += judged(target.read, data, scratch)
            except (Exception, Hang) as error:  # whatever a parser raises is what is looked for
                return f"{type(error).__name__}: {error}"
            return ""

        every = (changed(Rolled(random.Random(f"{seed} {number}")), seeds, target.words) for number in range(count))
        harmful = next(((number, data) for number, data in enumerate(every) if harm(data)), None)
        if harmful is None:
            return Tally(count, taken, "")
        (number, data), done = harmful, taken
        why = harm(data)
        data = smallest(data, lambda less: harm(less).partition(":")[0] == why.partition(":")[0])
        return Tally(number + 1, done, _kept(found, name, data, f"{why} (number {number})"))


def by_atheris(name: str, count: int, found: Path) -> Tally:
    """Inputs that reach new lines, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.fuzzing.guided", name, folder, str(count)]
        run = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
        done = [line.split()[1:] for line in run.stdout.splitlines() if line.startswith("done ")]
        harmful = sorted((Path(folder) / "found").glob("*")) if (Path(folder) / "found").exists() else []
        if done and not harmful and run.returncode == 0:
            return Tally(int(done[0][0]), int(done[0][1]), "")
        told = [line for line in (run.stdout + run.stderr).splitlines() if "Error" in line or "Hang" in line]
        why = told[-1].strip() if told else f"the process ended with {run.returncode}: {run.stderr[-300:]!r}"
        return Tally(0, 0, _kept(found, name, harmful[0].read_bytes() if harmful else b"", why))


def _kept(found: Path, name: str, data: bytes, why: str) -> str:
    found.mkdir(parents=True, exist_ok=True)
    file = found / f"{name.replace(' ', '-')}-{len(list(found.iterdir()))}"
    file.write_bytes(data)
    return f"{' '.join(why.split())[:200]} (input in {file})"


if __name__ == "__main__":
    main()
