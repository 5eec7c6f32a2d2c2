"""Whether memory stays flat while one process plays many runs: `python -m benchmarks.memory --runs 200`.

Each is a whole run on the real stack, with dropped items and its trace on disk, made and closed as a program that uses
Executive as a library would do it. Printed is the resident memory after each, and by how much it grows from the run on
by which everything has been loaded once; `--plot` draws it.
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

MEBIBYTE = 1 << 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--warm", type=int, default=20, help="runs after which memory is expected to be flat")
    parser.add_argument("--problem", default="one-item")
    parser.add_argument("--estimator", choices=["vlm", "oracle", "none"], default="vlm")
    parser.add_argument("--no-viewer", action="store_true", help="leave the recording for the viewer out")
    parser.add_argument("--plot", type=Path, help="a picture of memory against runs")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    if not 1 <= arguments.warm < arguments.runs - 1:
        parser.error("at least two runs more than --warm are needed")
    outcomes, used, began = played(arguments)
    line = growth(used, arguments.warm)
    result = {
        "runs": arguments.runs,
        "warm": arguments.warm,
        "estimator": arguments.estimator,
        "outcomes": dict(outcomes),
        "seconds": round(time.perf_counter() - began, 1),
        "mebibytes": [round(value, 1) for value in used],
        "mebibytes_a_run": line,
    }
    if arguments.plot:
        plot(used, arguments.warm, line, arguments.plot)
    if arguments.json:
        print(json.dumps(result, indent=2))
        return
    for number in range(0, arguments.runs, max(1, arguments.runs // 20)):
        print(f"after run {number + 1:>4}: {used[number]:8.1f} MiB")
    print(f"after run {arguments.runs:>4}: {used[-1]:8.1f} MiB")
    told = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    print(f"{line:+.3f} MiB a run from run {arguments.warm} on; {told}; {result['seconds']:.0f} s")


def played(arguments: argparse.Namespace) -> tuple[Counter[str], list[float], float]:
    """How the runs ended, the memory in MiB after each, and when they began."""
    from executive.util import requirements

    requirements.require()
    from executive.app.run import RunConfig, run

    outcomes: Counter[str] = Counter()
    used: list[float] = []
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(arguments.runs):
            config = RunConfig(
                "grocery",
                problem=arguments.problem,
                seed=seed,
                faults=("drop:p=0.3",),
                estimator=arguments.estimator,
                runs=Path(scratch),
                name=f"run-{seed}",
                viewer=not arguments.no_viewer,
            )
            outcomes[run(config)["outcome"]] += 1
            gc.collect()  # what is garbage is no leak
            used.append(resident())
            print(f"\r{seed + 1} of {arguments.runs}: {used[-1]:.0f} MiB", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return outcomes, used, began


def resident() -> float:
    """The memory in MiB that this process has in use (Linux)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / MEBIBYTE


def growth(used: list[float], warm: int) -> float:
    """MiB a run, by the line that fits best from run `warm` on."""
    later = np.array(used[warm:])
    return float(np.polyfit(np.arange(later.size), later, 1)[0])


def plot(used: list[float], warm: int, line: float, file: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(range(1, len(used) + 1), used, color="#2a6f97", linewidth=1.4)
    axes.axvline(warm, color="#999999", linewidth=0.8, linestyle=":")
    axes.set(xlabel="runs in one process", ylabel="resident memory, MiB", ylim=(0.0, 1.15 * max(used)))
    axes.set_title(f"{line:+.3f} MiB a run after run {warm}", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, dpi=130)


if __name__ == "__main__":
    main()
