"""Simulated time against robosuite's `env.step`, and a grocery action against the time that it would take."""

from __future__ import annotations

import contextlib
import io
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.speed.queries import TABLES, stage
from benchmarks.speed.table import Row
from executive.protocols import SkillContext
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills.arm import arm_of
from executive.skills.pick import pick
from executive.skills.place import place
from executive.types import Atom, News, Step

_MEANING = {"on-table": "on", "robot-gripping": "gripping", "robot-gripper-empty": "gripper-empty"}
_WHAT = ("soda-can", "bread-loaf", "cereal-box")


def measure(everything: bool) -> list[Row]:
    rounds = 10 if everything else 5
    world, other = stage(20), _robosuite()
    step = 1e3 * world.model.opt.timestep, 1e3 * other.sim.model.opt.timestep
    rng = np.random.default_rng(0)
    ours, theirs = [], []
    home, reach = world.handle.limits.home, np.array([0.3, 0.1, 0.1, 0.1, 0.1, 0.3])
    for _ in range(rounds):
        ours.append(_cost(lambda: _move(world, home + rng.uniform(-reach, reach))))
        theirs.append(_cost(lambda: _act(other, rng)))
    other.close()
    mine, robosuite = statistics.median(ours), statistics.median(theirs)
    ratio = statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    actions = [ratio for item in _WHAT for ratio in _actions(item)]
    slowest = min(actions)
    return [
        Row("simulation, one simulated second", mine, robosuite, "s", "3 times", ratio >= 3,
            "robosuite's env.step (PickPlace, UR5e, Robotiq 85)",
            f"ratio {ratio:.1f}; steps of {step[0]:g} ms, robosuite's of {step[1]:g} ms; the arm moving all the time"),
        Row("grocery action, simulated seconds in one", statistics.median(actions), None, "s", "4", slowest >= 4,
            "real time, no pictures",
            f"{len(actions)} actions of pick and place, planned and carried out; the slowest {slowest:.1f}"),
    ]  # fmt: skip


def _cost(work: Callable[[], float]) -> float:
    """Seconds of processor time for every simulated second of some work, which returns how many those are."""
    began = time.process_time()
    seconds = work()
    return (time.process_time() - began) / seconds


def _move(world: MujocoWorld, goal: np.ndarray[Any, Any]) -> float:
    """Drive the arm as skills do, for about a second."""
    start, began, count = world.joints(), world.time, 125
    for index in range(count):
        share = (index + 1) / count
        world.command(start + (goal - start) * share, (goal - start) / (count * world.handle.control_period))
        world.advance()
    return float(world.time - began)


def _act(environment: Any, rng: np.random.Generator) -> float:
    """One second of robosuite's, with the operational-space controller that is its default."""
    low, high = environment.action_spec
    action = 0.3 * rng.uniform(low, high)
    steps = round(environment.control_freq)
    for _ in range(steps):
        environment.step(action)
    return float(steps / environment.control_freq)


def _robosuite() -> Any:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        import robosuite

        environment = robosuite.make(
            "PickPlace",
            robots="UR5e",
            gripper_types="Robotiq85Gripper",
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            ignore_done=True,
        )
        environment.reset()
    return environment


def _actions(item: str) -> list[float]:
    """Simulated seconds in each second of processor time, for a pick and a place of an item."""
    world = stage(20)
    truth, rng, said = Truth(world, _MEANING), np.random.default_rng(0), list[News]()
    arm_of(world.handle).collision.free(world.joints())
    source = next(table for table in TABLES if truth.of([Atom("on-table", (item, table))]).true)
    target = TABLES[(TABLES.index(source) + 1) % len(TABLES)]
    context = SkillContext(world.handle, rng, said.append, lambda: False)
    found = []
    for skill, step in (
        (pick, Step("pick", (item, source))),
        (place, Step("place", (item, target))),
    ):
        began = time.process_time()
        result = skill(step, context)
        found.append(result.seconds / (time.process_time() - began))
    return found
