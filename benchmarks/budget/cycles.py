"""Turns of the whole loop in the symbolic world, with wrong answers and actions that fail: belief, plan, decision and
events, at a thousand and at ten thousand fluent atoms."""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.budget.figures import Figure
from benchmarks.speed.replan import PARCELS
from executive.domain.pddl import Schema
from executive.planning.fast_downward import FastDownwardPlanner
from executive.types import Facts

CITIES, VANS = 8, 2
"""So many, whatever the number of parcels: atoms grow with the objects."""

PARTS = ("look", "belief", "plan", "decision", "event")
_CYCLES = 4


def cycles() -> Iterator[Figure]:
    for atoms, former, target in ((1_000, "3.3 s", 0.3), (10_000, "41 s at 4,757", 3.0)):
        row = measured(round((atoms - VANS * CITIES) / (CITIES + VANS)))
        parts = ", ".join(f"{part} {row[part]:.3f}" for part in PARTS)
        note = f"{row['atoms']:,} atoms, {row['actions']:,} grounded actions; median cycle; CPU s: {parts}"
        played = row["cycles"] > 1
        if not played:
            note = f"{row['atoms']:,} atoms: the run ended as {row['outcome']} after {row['cycles']} cycles"
        yield Figure(f"a cycle at {atoms:,} fluent atoms", former, target, row["cycle"] if played else None,
                     cpu=row["cpu"] if played else None, note=note)  # fmt: skip
    yield Figure("memory of that", "", 500.0, row["mebibytes"], "MiB", note="peak of the process, without the planner")


def measured(parcels: int) -> dict[str, Any]:
    """Measure a run with so many parcels, in a process of its own, for its memory: seconds and bytes by part."""
    command = [sys.executable, "-m", "benchmarks.budget.cycles", str(parcels)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


class _Clock:
    """Divides the seconds of processor time, those of ended children included, among parts that may lie in each
    other."""

    def __init__(self) -> None:
        self.spent: defaultdict[str, float] = defaultdict(float)
        self._within = ["decision"]
        self._since = sum(_processor_times())

    def switch(self) -> None:
        now = sum(_processor_times())
        self.spent[self._within[-1]] += now - self._since
        self._since = now

    def wrap(self, owner: Any, name: str, part: str) -> None:
        """Have a method's time counted as that of a part."""
        method: Callable[..., Any] = getattr(owner, name)

        def timed(*arguments: Any, **options: Any) -> Any:
            self.switch()
            self._within.append(part)
            try:
                return method(*arguments, **options)
            finally:
                self.switch()
                self._within.pop()

        setattr(owner, name, timed)


def _measure(parcels: int) -> dict[str, Any]:
    from executive.app.config import RunConfig
    from executive.app.run import Run
    from executive.belief import BayesMonitor
    from executive.core import time_limits
    from executive.core.session import Session
    from executive.planning.sas_task import size
    from executive.symbolic.world import SymbolicEstimator

    time_limits.within = lambda seconds, work: work()  # type: ignore[attr-defined]  # in this thread, which is watched
    clock = _Clock()
    clock.wrap(BayesMonitor, "acted", "belief")
    clock.wrap(BayesMonitor, "looked", "belief")
    clock.wrap(FastDownwardPlanner, "plan", "plan")
    clock.wrap(SymbolicEstimator, "estimate", "look")
    clock.wrap(Session, "_deliver", "event")
    turns = _Turns(clock)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, parcels)
        began = time.perf_counter()
        config = RunConfig(
            str(folder / "domain.pddl"), str(folder / "problem.pddl"), world="symbolic", flip=0.01, no_effect=0.1,
            max_cycles=_CYCLES, max_seconds=3600.0, patience=600.0, runs=folder / "runs", name="run", viewer=False,
        )  # fmt: skip
        with Run(config, [turns]) as run:
            opened = time.perf_counter() - began
            done = run.execute()
            atoms, actions = len(run.domain.task.atoms), size(run.domain.parsed)
            first, again = _planned(run.domain.parsed)
        written = sum(file.stat().st_size for file in (folder / "runs" / "run").rglob("*") if file.is_file())
    whole = [sum(turn.values()) for turn in turns.spent[1:]]
    parts = {part: statistics.median(turn[part] for turn in turns.spent[1:]) for part in PARTS}
    return {
        "parcels": parcels, "atoms": atoms, "actions": actions, "opened": opened, **parts,
        "first look": turns.spent[0]["look"], "grounding": first["plan"] - again["plan"],
        "replan": again["plan"], "search": again["search"],
        "cycle": statistics.median(turns.walls[1:]), "cpu": statistics.median(whole),
        "cycles": done["cycles"],
        "outcome": done["outcome"],
        "bytes": written / max(1, len(turns.spent)),
        "mebibytes": _peak(),
    }  # fmt: skip


def _peak() -> float:
    """The most memory in MiB that this program had at once. `ru_maxrss` would have that of the one that started it."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def _planned(schema: Schema) -> list[dict[str, float]]:
    """Seconds of processor time of the first plan of a task and of another one, in our process and in the search's."""
    planner, state = FastDownwardPlanner(schema, timeout=600.0), Facts.closed(schema.task.declared, schema.task.atoms)
    taken = []
    for _ in range(2):
        before = _processor_times()
        planner.plan(state, schema.task.goal)
        own, children = (now - then for now, then in zip(_processor_times(), before, strict=True))
        taken.append({"plan": own, "search": children})
    return taken


class _Turns:
    """A sink that takes the time of each cycle; the first is that of the first look and plan."""

    def __init__(self, clock: _Clock) -> None:
        self._clock, self._cycle, self._began = clock, 0, time.perf_counter()
        self.spent: list[dict[str, float]] = []
        self.walls: list[float] = []

    def write(self, event: Any) -> None:
        if event.cycle != self._cycle:
            self._cycle = event.cycle
            self._turned()

    def close(self) -> None:
        self._turned()

    def _turned(self) -> None:
        self._clock.switch()
        self.spent.append({part: self._clock.spent[part] for part in PARTS})
        self._clock.spent.clear()
        now = time.perf_counter()
        self.walls.append(now - self._began)
        self._began = now


def _write(folder: Path, parcels: int) -> None:
    """Parcels that are all at the first city and belong in others; one in ten has to be moved."""
    names, cities = [f"p{n}" for n in range(parcels)], [f"c{n}" for n in range(CITIES)]
    vans = [f"v{n}" for n in range(VANS)]
    at = [f"(at {parcel} {cities[n % CITIES]})" for n, parcel in enumerate(names)]
    at += [f"(van-at {van} {cities[0]})" for van in vans]
    goal = [f"(at {parcel} {cities[(n + (n % 10 == 0)) % CITIES]})" for n, parcel in enumerate(names)]
    (folder / "domain.pddl").write_text(PARCELS)
    (folder / "problem.pddl").write_text(
        f"(define (problem many) (:domain parcels) (:objects {' '.join(names)} - parcel {' '.join(vans)} - van"
        f" {' '.join(cities)} - city) (:init {' '.join(at)}) (:goal (and {' '.join(goal)})))"
    )


def _processor_times() -> tuple[float, float]:
    """Seconds of processor time of this process, and of its children that have ended."""
    own, children = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


if __name__ == "__main__":
    print(json.dumps(_measure(int(sys.argv[1]))))
