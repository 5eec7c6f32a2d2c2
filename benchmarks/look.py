"""What a look costs: the shipped model loaded, the cameras drawn, all questions of a domain answered.

    python -m benchmarks.look
    python -m benchmarks.look --busy 3      # beside three processes that compute all the time
    python -m benchmarks.look --process     # by a model in a process of its own, as a run has it, too

Medians of wall time on this machine, in seconds, and of the CPU time of all threads where that is said. `load` is a
fresh process from nothing to a model that is ready, with the time of importing torch and transformers in it and named
apart. With `--busy`, quiet looks and looks beside such processes take turns, and nothing else is measured; what counts
is their ratio; so it is with `--process`, and there that of the quickest looks, from which nobody took the core. The
load when it began, which stands beside it, says how busy the machine is with other things.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from executive.s3e import Backend
    from executive.sim.world import MujocoWorld
    from executive.types import Belief, Observation

_ROUNDS = 5

_BUSY = """
import os, sys
parent = int(sys.argv[1])
print("busy", flush=True)
while os.getppid() == parent:
    for _ in range(1_000_000):
        pass
"""

_LOAD = """
import json, sys, time
began = time.perf_counter()
import torch, transformers.models.auto.modeling_auto, transformers.models.fast_vlm.modeling_fast_vlm
import transformers.models.qwen2.modeling_qwen2, transformers.models.resnet.modeling_resnet
imported = time.perf_counter()
from executive.domain.loader import load_subject
from executive.app.config import EstimatorConfig
from executive.app.estimators import open_estimator
open_estimator(EstimatorConfig(vlm=sys.argv[2] or None), load_subject(sys.argv[1]))
print(json.dumps([imported - began, time.perf_counter() - imported]))
"""


class _Taken(NamedTuple):
    """Seconds: on the wall's clock, and of all threads together."""

    wall: float
    cpu: float


def next_look(world: MujocoWorld) -> Observation:
    """A look a moment after the last one: of the same moment, pictures are not drawn again."""
    world.advance()
    return world.observe()


def main() -> None:
    from executive.util import requirements

    requirements.require()
    arguments = _arguments()
    measure = _quiet_and_busy if arguments.busy else _here_and_there if arguments.process else _alone
    row = measure(arguments)
    if arguments.json:
        print(json.dumps(row, indent=2))
        return
    for name, value in row.items():
        print(f"{name:32}{value:8.3f}")


def _alone(arguments: argparse.Namespace) -> dict[str, float]:
    loads = [_load(arguments.domain, arguments.vlm or "") for _ in range(3)]
    return {
        "import torch and transformers": statistics.median(imported for imported, _ in loads),
        "load": statistics.median(loaded for _, loaded in loads),
        **_looks(arguments.domain, arguments.vlm, arguments.looks),
    }


def _quiet_and_busy(arguments: argparse.Namespace) -> dict[str, float]:
    """Quiet looks and busy ones, by turns."""
    load, quiet, busy = os.getloadavg()[0], list[_Taken](), list[_Taken]()
    with _opened(arguments.domain, arguments.vlm) as (ask, world):
        for _ in range(_ROUNDS):
            quiet += _timed(lambda: ask(next_look(world)), max(1, arguments.looks // _ROUNDS))
            with _beside_busy(arguments.busy):
                busy += _timed(lambda: ask(next_look(world)), max(1, arguments.looks // _ROUNDS))
    return {
        "load of the machine before": load,
        "quiet look": _median(quiet),
        f"look beside {arguments.busy} busy": _median(busy),
        "ratio": _median(busy) / _median(quiet),
        "quiet look, CPU time": statistics.median(each.cpu for each in quiet),
        "busy look, CPU time": statistics.median(each.cpu for each in busy),
    }


def _here_and_there(arguments: argparse.Namespace) -> dict[str, float]:
    """Looks by a model in this process and by one in its own, by turns; and whether they answer the same."""
    from executive.s3e.backends.own_process import OwnProcess

    load, here, there = os.getloadavg()[0], list[_Taken](), list[_Taken]()
    with (
        _opened(arguments.domain, arguments.vlm) as (ask, world),
        _opened(arguments.domain, arguments.vlm, OwnProcess) as (ask_there, _),
    ):
        seen = world.observe()
        mine, other = ask(seen).probability, ask_there(seen).probability
        for _ in range(max(1, arguments.looks)):
            here += _timed(lambda: ask(next_look(world)), 1)
            there += _timed(lambda: ask_there(next_look(world)), 1)
    return {
        "load of the machine before": load,
        "look, model in this process": _median(here),
        "look, model in its own process": _median(there),
        "ratio": _median(there) / _median(here),
        "ratio of the quickest": min(each.wall for each in there) / min(each.wall for each in here),
        "largest difference of answers": max(abs(mine[atom] - other[atom]) for atom in mine),
    }


@contextmanager
def _beside_busy(count: int) -> Iterator[None]:
    """Processes that do nothing but compute, for as long as the block takes; they end with this one in any case."""
    with ExitStack() as stack:
        for _ in range(count):
            command = [sys.executable, "-c", _BUSY, str(os.getpid())]
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            stack.callback(process.kill)
            assert process.stdout is not None
            process.stdout.readline()
        yield


def _load(domain: str, vlm: str) -> tuple[float, float]:
    done = subprocess.run([sys.executable, "-c", _LOAD, domain, vlm], check=True, capture_output=True, text=True)
    imported, loaded = json.loads(done.stdout.splitlines()[-1])
    return imported, loaded


def _looks(name: str, vlm: str | None, count: int) -> dict[str, float]:
    with _opened(name, vlm) as (ask, world):
        # Always other pictures: nothing that an estimator keeps of a picture is to help it.
        others = iter([next_look(world) for _ in range(count)])
        first = next_look(world)
        return {
            f"draw {len(first.images)} pictures": _median(_timed(lambda: next_look(world), count)),
            f"answer {len(ask(first).probability)} questions": _median(_timed(lambda: ask(next(others)), count)),
            "whole look": _median(_timed(lambda: ask(next_look(world)), count)),
        }


@contextmanager
def _opened(
    name: str, vlm: str | None, load: Callable[[str], Backend] | None = None
) -> Iterator[tuple[Callable[[Observation], Belief], MujocoWorld]]:
    """What answers all questions of a domain about pictures, and the world to take them of; both warmed up."""
    from executive.app.config import EstimatorConfig
    from executive.app.estimators import open_estimator
    from executive.domain.loader import load_domain
    from executive.sim.world import MujocoWorld

    domain = load_domain(name)
    estimator = open_estimator(EstimatorConfig(vlm=vlm), domain.subject, load)
    world = MujocoWorld(domain.scene, domain.task.objects)
    try:
        estimator.estimate(world.observe(), domain.task.atoms)
        yield lambda seen: estimator.estimate(seen, domain.task.atoms), world
    finally:
        world.close()


def _timed(work: Callable[[], object], count: int) -> list[_Taken]:
    taken = []
    for _ in range(count):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        taken.append(_Taken(time.perf_counter() - wall, time.process_time() - cpu))
    return taken


def _median(taken: Sequence[_Taken]) -> float:
    return statistics.median(each.wall for each in taken)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("domain", nargs="?", default="grocery")
    parser.add_argument("--vlm", help="another model than the shipped one")
    parser.add_argument("--looks", type=int, default=30)
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="look beside so many busy processes, too")
    parser.add_argument("--process", action="store_true", help="look by a model in a process of its own, too")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    main()
