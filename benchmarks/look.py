"""What a look costs: the shipped eye loaded, the cameras drawn, all questions of a domain answered.

    python -m benchmarks.look

Medians of wall time on this machine, in seconds. `load` is a fresh process from nothing to a model that is ready, with
the time of importing torch and transformers in it and named apart.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

_LOAD = """
import json, sys, time
began = time.perf_counter()
import torch, transformers.models.auto.modeling_auto, transformers.models.fast_vlm.modeling_fast_vlm
import transformers.models.qwen2.modeling_qwen2, transformers.models.resnet.modeling_resnet
imported = time.perf_counter()
from executive.domain import load_subject
from executive.eye import EyeConfig, open_eye
open_eye(EyeConfig(vlm=sys.argv[2]) if sys.argv[2] else EyeConfig(), load_subject(sys.argv[1]))
print(json.dumps([imported - began, time.perf_counter() - imported]))
"""


def main() -> None:
    from executive import machine

    machine.require()
    arguments = _arguments()
    loads = [_load(arguments.domain, arguments.vlm or "") for _ in range(3)]
    row = {
        "import torch and transformers": statistics.median(imported for imported, _ in loads),
        "load": statistics.median(loaded for _, loaded in loads),
        **_looks(arguments.domain, arguments.vlm, arguments.looks),
    }
    if arguments.json:
        print(json.dumps(row, indent=2))
        return
    for name, value in row.items():
        print(f"{name:32}{value:8.3f}")


def _load(domain: str, vlm: str) -> tuple[float, float]:
    done = subprocess.run([sys.executable, "-c", _LOAD, domain, vlm], check=True, capture_output=True, text=True)
    imported, loaded = json.loads(done.stdout.splitlines()[-1])
    return imported, loaded


def _looks(name: str, vlm: str | None, count: int) -> dict[str, float]:
    from executive.domain import load_domain
    from executive.eye import EyeConfig, open_eye
    from executive.sim.world import MujocoWorld

    domain = load_domain(name)
    eye = open_eye(EyeConfig(vlm=vlm), domain.subject)
    world = MujocoWorld(domain.scene, domain.task.objects)
    try:
        seen = world.observe()
        eye.estimate(seen, domain.task.atoms)  # the first one warms up
        drawing = _median(world.observe, count)
        # Always other pictures, if only by their noise: nothing that an eye keeps of a picture is to help it.
        others = iter([world.observe() for _ in range(count)])
        asking = _median(lambda: eye.estimate(next(others), domain.task.atoms), count)
        whole = _median(lambda: eye.estimate(world.observe(), domain.task.atoms), count)
    finally:
        world.close()
    return {
        f"draw {len(seen.images)} pictures": drawing,
        f"answer {len(domain.task.atoms)} questions": asking,
        "whole look": whole,
    }


def _median(work: Callable[[], object], count: int) -> float:
    taken = []
    for _ in range(count):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("domain", nargs="?", default="grocery")
    parser.add_argument("--vlm", help="another model than the shipped one")
    parser.add_argument("--looks", type=int, default=30)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    main()
