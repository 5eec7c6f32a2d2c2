"""Another robot in another simulator: robosuite's task Stack, with a Franka Panda and robosuite's own controller.

python -m examples.robosuite_panda.panda [FAULT ...] [--server URL]
"""

import os
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is loaded: pictures are drawn without a screen
import robosuite

import executive as ex

FOLDER, TICK, TABLE = Path(__file__).parent, 0.05, 0.8
CAMERAS = dict.fromkeys(("frontview", "agentview", "sideview"), (256, 256))
CUBES, HALF = {"red": "cubeA", "green": "cubeB"}, {"red": 0.02, "green": 0.025}


class Panda(ex.TickedWorld):
    """The hand, the cubes and the fingers as robosuite observes them, at 20 Hz."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        np.random.seed(seed)  # robosuite places the cubes by it
        drawn = {"has_renderer": False, "has_offscreen_renderer": True, "use_camera_obs": False}
        self.env = robosuite.make(
            "Stack", robots="Panda", control_freq=1 / TICK, hard_reset=False, ignore_done=True, **drawn
        )
        self.seen: dict[str, Any] = self.env.reset()
        self.model, self.data, self.closed = self.env.sim.model._model, self.env.sim.data._data, False
        for _ in range(10):  # the cubes are dropped from a height of 1 cm
            self.tick()

    time = property(lambda self: round(float(self.data.time), 6))
    width = property(lambda self: float(np.ptp(self.seen["robot0_gripper_qpos"])))

    def tick(self, target: Any = None) -> None:
        """One command of robosuite's controller: towards a position of the hand (3,) in m, or none."""
        way = np.zeros(3) if target is None else np.clip(10 * (target - self.seen["robot0_eef_pos"]), -1, 1)
        self.seen, *_ = self.env.step([*way, 0, 0, 0, 1 if self.closed else -1])
        self.passed()

    def joints(self) -> Any:
        return self.seen["robot0_joint_pos"].copy()

    def pictures(self, cameras: Collection[str] | None) -> dict[str, Any]:
        named = [name for name in CAMERAS if cameras is None or name in cameras]
        return {name: self.env.sim.render(*CAMERAS[name], camera_name=name)[::-1].copy() for name in named}

    def scenery(self) -> ex.Scenery:
        return ex.mujoco_scenery(self.model, CAMERAS, self.env.robots[0].robot_model.joints)

    def frame(self) -> ex.Frame:
        return ex.Frame(ex.mujoco_poses(self.model, self.data), self.joints(), self.width)

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        if kind != "drop":
            raise ex.InputError(f"nothing here does {kind!r}; there is drop")
        block = next(filter(self.held, CUBES), None)
        if block is not None:
            place = [*rng.uniform(-0.15, 0.15, 2), TABLE + 0.05]
            self.env.sim.data.set_joint_qpos(f"{CUBES[block]}_joint0", [*place, 1, 0, 0, 0])
        return f"{block} slips out of the fingers and falls elsewhere" if block else "nothing is held"

    def at(self, block: str) -> Any:
        return self.seen[f"{CUBES[block]}_pos"]

    def held(self, block: str) -> bool:
        away = float(np.linalg.norm(self.at(block) - self.seen["robot0_eef_pos"]))
        return self.closed and self.width > 0.02 and away < 0.03

    def on(self, block: str, below: str) -> bool:
        x, y, z = map(float, self.at(block) - self.at(below))
        return x * x + y * y < 0.03**2 and abs(z - HALF[block] - HALF[below]) < 0.01 and not self.held(block)


RELATIONS: dict[str, Callable[..., bool]] = {
    "on": Panda.on,
    "held": Panda.held,
    "free": lambda panda: not any(map(panda.held, CUBES)),
    "on-table": lambda panda, block: panda.at(block)[2] < TABLE + HALF[block] + 0.01 and not panda.held(block),
    "clear": lambda panda, block: not any(panda.on(other, block) for other in CUBES if other != block),
}


def skill(step: ex.Step, context: ex.SkillContext) -> ex.SkillResult:
    """take(block) or stack(block, below): over it, down, close or open the fingers, up."""
    panda, start, takes, (block, *below) = context.handle, context.handle.time, step.action == "take", step.args
    goal = panda.at(block) if takes else panda.at(below[0]) + [0, 0, HALF[below[0]] + HALF[block] + 0.005]
    status, phases = ex.SkillStatus.DONE, [("approach" if takes else "transfer", 0.12), ("lower", 0.0)]
    for phase, height in [*phases, ("grip" if takes else "release", 0.0), ("lift", 0.15)]:
        if status is ex.SkillStatus.DROPPED and phase != "lift":
            continue
        context.announce(ex.Phase(phase, seconds=0.5))
        panda.closed = takes if phase in ("grip", "release") else panda.closed
        for tick in range(60):
            panda.tick(target := goal + [0, 0, height])
            if context.cancelled():
                return ex.SkillResult(step, ex.SkillStatus.CANCELLED, seconds=panda.time - start)
            if phase in ("transfer", "lower") and not takes and not panda.held(block):
                status, panda.closed = ex.SkillStatus.DROPPED, False
                break
            if tick > 10 and np.linalg.norm(target - panda.seen["robot0_eef_pos"]) < 0.004:
                break
    if takes and not panda.held(block):
        status, panda.closed = ex.SkillStatus.GRASP_MISSED, False
    return ex.SkillResult(step, status, seconds=panda.time - start)


def play(panda: Panda, faults: Sequence[str] = (), server: str = "", sinks: Sequence[ex.Sink] = ()) -> ex.Ended:
    schema = ex.read_task(FOLDER / "domain.pddl", FOLDER / "problem.pddl")
    eye: ex.Estimator = ex.RelationEstimator(lambda: panda, RELATIONS)
    if server:
        eye = ex.open_estimator(ex.EstimatorConfig(server=server), ex.load_subject(FOLDER))
    broken = ex.FaultInjector([ex.parse_fault(fault, list(CUBES)) for fault in faults], panda)
    parts = (schema.task, ex.FastDownwardPlanner(schema), panda, {"take": skill, "stack": skill}, eye)
    return ex.make_executive(*parts, [ex.TerminalSink(sys.stdout), *sinks], faults=broken, domain="panda").run()


if __name__ == "__main__":
    at = sys.argv.index("--server") if "--server" in sys.argv else len(sys.argv)
    sys.exit(not play(Panda(), sys.argv[1:at], "".join(sys.argv[at + 1 :])).goal_seen)
