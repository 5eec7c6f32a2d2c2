"""Every parser against inputs that are wrong: `python -m benchmarks.fuzz --inputs 100000` (hours), or some of them:
`python -m benchmarks.fuzz fault events.jsonl --inputs 2000`.

Two ways to come by inputs: `atheris` is guided by the lines that they reach (`pip install 'executive[fuzz]'`),
`hypothesis` changes real files in the ways that files are wrong in. By default each gets half of them. A parser has to
take an input or say in one line what is wrong with it, in time, and without touching anything else.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from hypothesis import HealthCheck, Phase, given, settings

from benchmarks.fuzzing.inputs import inputs
from benchmarks.fuzzing.targets import TARGETS
from benchmarks.fuzzing.watch import Hang, judged

ENGINES = ("hypothesis", "atheris")


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
    parser.add_argument("--found", type=Path, default=Path("fuzz-findings"), help="where inputs go that do harm")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.targets if name not in TARGETS]
    if unknown:
        parser.error(f"no target {unknown[0]!r}; valid: {', '.join(TARGETS)}")
    installed = [engine for engine in ENGINES if importlib.util.find_spec(engine) is not None]
    engines = arguments.engine or installed
    share = -(-arguments.inputs // len(engines))
    findings = 0
    print(f"{'target':<18}{'engine':<12}{'inputs':>9}{'taken':>9}{'refused':>9}{'s':>8}   {'found':<}")
    for name in arguments.targets or TARGETS:
        for engine in engines:
            began = time.perf_counter()
            tally = (by_hypothesis if engine == "hypothesis" else by_atheris)(name, share, arguments.found)
            findings += bool(tally.finding)
            print(
                f"{name:<18}{engine:<12}{tally.inputs:>9,}{tally.taken:>9,}{tally.inputs - tally.taken:>9,}"
                f"{time.perf_counter() - began:>8.0f}   {tally.finding or 'nothing'}",
                flush=True,
            )
    print(f"{findings} findings" if findings else "nothing was found")
    sys.exit(findings > 0)


def by_hypothesis(name: str, count: int, found: Path) -> Tally:
    """Real files, changed at random. The smallest input that does harm is kept."""
    target, done, taken = TARGETS[name], 0, 0
    last = b""

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(inputs(target.seeds(), target.words))
    def harmless(data: bytes) -> None:
        nonlocal done, taken, last
        last = data
        done += 1
        try:
            taken += judged(target.read, data, scratch)
        except Hang as hang:
            raise TimeoutError(str(hang)) from None

    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        try:
            harmless()
        except Exception as error:  # whatever a parser raises is what is looked for
            return Tally(done, taken, _kept(found, name, last, f"{type(error).__name__}: {error}"))
    return Tally(done, taken, "")


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
