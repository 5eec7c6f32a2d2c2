"""A learned skill: what the policy says is done under supervision, and each way in which it goes wrong has its name."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from executive.errors import InputError
from executive.protocols import Simulator, Skill
from executive.sim.world import MujocoWorld
from executive.skills.policy import POLICY_FORMAT, NetworkPolicy, Policy, PolicySkill
from executive.types import Facts, SkillStatus, Step
from tests.executive.sim.stage import grocery
from tests.skills.test_skills import Robot, _OnTheRobot

ITEM = "lemon"
FEATURES = 22


class Servo:
    """A policy by hand: over the item, down, close, up. It has nothing but what every policy is given."""

    period = 0.1

    def __init__(self, beside: float = 0.0, still: bool = False, away: bool = False) -> None:
        self.beside, self.still, self.away = beside, still, away

    def act(self, features: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, bool]:
        place, turn = features[:3] + [self.beside, 0, 0], features[3:9].reshape(2, 3)
        width, closed = features[20:]
        motion = np.zeros(6)
        if self.still:
            return motion, False
        if self.away:
            return np.array([0, 0, -0.06, 0, 0, 0]), False
        if closed > 0.99 and width > 0.0:
            motion[2] = -0.03
            return motion, True
        aside = float(np.hypot(*place[:2]))
        motion[:2] = 0.5 * place[:2]
        motion[2] = np.clip(0.5 * (place[2] - (0.0 if aside < 0.01 else 0.1)), -0.04, 0.04)
        axes = [*turn, np.cross(*turn)]
        flat = [number for number in range(3) if abs(axes[number][2]) < 0.5]
        narrow = axes[min(flat, key=lambda number: float(features[9 + number]))]  # between the pads
        angle = (np.arctan2(narrow[1], narrow[0]) + np.pi / 2) % np.pi - np.pi / 2
        motion[5] = np.clip(angle, -0.2, 0.2)
        there = aside < 0.004 and abs(place[2]) < 0.005
        return motion, there or closed > 0.0


def attempt(policy: Policy, robot: Robot, cancel_in: str = "") -> SkillStatus:
    if cancel_in:
        robot.cancel_in(cancel_in)
    return PolicySkill(policy)(Step("pick", (ITEM, robot.table_of(ITEM))), robot._context()).status


class TestPolicySkill(_OnTheRobot):
    def make(self) -> tuple[Skill, Simulator]:
        return PolicySkill(Servo()), grocery(seed=20, items=(ITEM,))

    def possible(self) -> Step:
        source = self.table_of(grocery(seed=20, items=(ITEM,)))
        return Step.strips("pick", (ITEM, source), Facts(), Facts.parse(f"robot-gripping({ITEM})"))

    def misplaced(self) -> Step:
        pytest.skip("a policy takes the item wherever it is seen: the table is not its business")

    def table_of(self, world: MujocoWorld) -> str:
        return Robot(world).table_of(ITEM)


def test_what_the_policy_wants_is_done_and_the_item_is_in_the_hand() -> None:
    robot = Robot(grocery(20, (ITEM,)))
    assert attempt(Servo(), robot) is SkillStatus.DONE
    assert robot.so(f"robot-gripping({ITEM})")
    assert robot.phases()[0] == "approach"
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() < 0.05


@pytest.mark.parametrize(
    ("policy", "status"),
    [
        (Servo(beside=0.12), SkillStatus.GRASP_MISSED),
        (Servo(still=True), SkillStatus.TIMED_OUT),
        (Servo(away=True), SkillStatus.UNREACHABLE),
    ],
    ids=["beside the item", "that does nothing", "that leads away"],
)
def test_a_policy_that_goes_wrong_is_named_and_the_arm_goes_home(policy: Policy, status: SkillStatus) -> None:
    robot = Robot(grocery(20, (ITEM,)))
    assert attempt(policy, robot) is status
    assert not robot.so(f"robot-gripping({ITEM})")
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() < 0.05


def test_it_ends_where_the_run_is_cancelled() -> None:
    robot = Robot(grocery(20, (ITEM,)))
    assert attempt(Servo(), robot, cancel_in="approach") is SkillStatus.CANCELLED
    robot.go_on()


def test_where_the_item_is_comes_from_what_the_robot_is_told_and_not_from_the_truth() -> None:
    """With an error that is told, the hand goes to where the item was said to be, and misses."""
    robot = Robot(grocery(20, (ITEM,)))
    robot.world.mislead(np.array([0.12, 0.0, 0.0]))
    assert attempt(Servo(), robot) is SkillStatus.GRASP_MISSED


def network(file: Path, change: Callable[[dict[str, np.ndarray], dict[str, object]], None]) -> Path:
    """A network that wants nothing, but for a change."""
    tensors: dict[str, np.ndarray] = {
        "features.mean": np.zeros(FEATURES, np.float32),
        "features.deviation": np.ones(FEATURES, np.float32),
        "motion.mean": np.arange(6, dtype=np.float32),
        "motion.deviation": np.ones(6, np.float32),
        "motion.noise": np.zeros(6, np.float32),
        "weight.0": np.zeros((4, FEATURES), np.float32),
        "bias.0": np.array([1.0, -1.0, 2.0, 0.0], np.float32),
        "weight.1": np.ones((7, 4), np.float32),
        "bias.1": np.zeros(7, np.float32),
    }
    about: dict[str, object] = {"format": POLICY_FORMAT, "action": "pick", "period": 0.1}
    change(tensors, about)
    save_file(tensors, file, {"executive": json.dumps(about)})
    return file


def test_a_network_computes_what_its_layers_say(tmp_path: Path) -> None:
    policy = NetworkPolicy(network(tmp_path / "one", lambda tensors, about: None))
    motion, closes = policy.act(np.ones(FEATURES), np.random.default_rng(0))
    assert motion == pytest.approx(np.arange(6) + 3.0)  # 1 + 2: what is below zero is cut off
    assert closes
    assert policy.period == 0.1


def test_noise_is_drawn_from_the_skills_own_generator(tmp_path: Path) -> None:
    def noisy(tensors: dict[str, np.ndarray], about: dict[str, object]) -> None:
        tensors["motion.noise"] = np.full(6, 0.5, np.float32)

    policy = NetworkPolicy(network(tmp_path / "one", noisy))
    drawn = [policy.act(np.ones(FEATURES), np.random.default_rng(seed))[0] for seed in (1, 1, 2)]
    assert (drawn[0] == drawn[1]).all()
    assert (drawn[0] != drawn[2]).all()


BROKEN: dict[str, Callable[[dict[str, np.ndarray], dict[str, object]], None]] = {
    "a layer is missing": lambda tensors, about: void(tensors.pop("bias.1")),
    "other features": lambda tensors, about: tensors.update({"features.mean": np.zeros(3, np.float32)}),
    "a layer of another size": lambda tensors, about: tensors.update({"weight.1": np.ones((7, 5), np.float32)}),
    "not a number": lambda tensors, about: tensors.update({"bias.0": np.full(4, np.nan, np.float32)}),
    "another format": lambda tensors, about: about.update(format="pickle"),
    "no period": lambda tensors, about: void(about.pop("period")),
    "a period of nothing": lambda tensors, about: about.update(period=0),
}


def void(value: object) -> None:
    pass


@pytest.mark.parametrize("change", BROKEN.values(), ids=BROKEN)
def test_a_file_that_is_no_policy_is_named(
    change: Callable[[dict[str, np.ndarray], dict[str, object]], None], tmp_path: Path
) -> None:
    file = network(tmp_path / "bad.safetensors", change)
    with pytest.raises(InputError) as caught:
        NetworkPolicy(file)
    assert caught.value.file == file


@pytest.mark.parametrize("content", [None, b"", b"no tensors at all" * 10], ids=["none", "empty", "other bytes"])
def test_what_is_no_file_of_tensors_is_named(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "bad.safetensors"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError):
        NetworkPolicy(file)
