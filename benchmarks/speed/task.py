"""All six items with one drop, by sight, as `executive run` does it: the wall's clock against the simulated one."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.speed.table import Row

STAGES = ("observe", "estimate", "plan", "motion", "guard", "skill", "other")


def measure(everything: bool) -> list[Row]:
    from executive.app.run import RunConfig, run
    from executive.util import requirements

    requirements.require()
    with tempfile.TemporaryDirectory() as scratch:
        done = run(RunConfig("grocery", seed=3, faults=("drop@4",), runs=Path(scratch), name="task"))
    if done["outcome"] != "goal-reached":
        raise RuntimeError(f"the run that is timed ended as {done['outcome']}")
    spent, simulated = done["wall_seconds"], done["sim_seconds"]
    wall, rest = spent["total"], spent["other"] / spent["total"]
    parts = ", ".join(f"{name} {spent[name]:.1f}" for name in STAGES)
    return [
        Row("six items and a drop, by sight", wall, simulated, "s", "less than simulated", wall < simulated,
            "the simulated time", f"{done['actions']} actions, {done['looks']} looks; s: {parts}"),
        Row("what of it is none of its parts", rest, None, "", "0.05", rest < 0.05, "the run's wall time",
            "the loop, its events, the trace on disk"),
    ]  # fmt: skip
