"""Kinematics, collision checks, motions and trajectories keep their laws on the real robot."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from toppra.algorithm import TOPPRA

from executive.skills import trajectory, transforms
from executive.skills.arm import Arm, arm_of
from executive.skills.collision import Held
from executive.types import FloatArray
from tests.executive.sim.stage import ITEMS, grocery

DOWN = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])


@pytest.fixture(scope="module")
def arm() -> Arm:
    world = grocery(seed=3)
    built = arm_of(world.handle)
    built.collision.update(world.obstacles(), world.gripper_joints())
    return built


def above(x: float, y: float, z: float) -> FloatArray:
    target = np.eye(4)
    target[:3, :3], target[:3, 3] = DOWN, (x, y, z)
    return target


def reach(arm: Arm, target: FloatArray) -> FloatArray:
    home = arm.limits.home
    found = (arm.kinematics.solve(target, seed) for seed in arm.kinematics.seeds(target, home))
    return next(q for q in found if q is not None)


@pytest.mark.parametrize("x", [0.30, 0.45, 0.60])
@pytest.mark.parametrize("y", [-0.5, -0.2, 0.1, 0.4])
def test_what_ik_finds_is_where_forward_kinematics_says(arm: Arm, x: float, y: float) -> None:
    target = above(x, y, 0.95)
    q = reach(arm, target)
    assert np.abs(arm.kinematics.forward(q) - target).max() < 4e-3
    assert (q >= arm.limits.lower).all()
    assert (q <= arm.limits.upper).all()


def test_out_of_reach_has_no_configuration(arm: Arm) -> None:
    assert arm.kinematics.solve(above(1.5, 0.0, 0.95), arm.limits.home) is None


def test_poses_and_matrices_are_inverses() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        quaternion = rng.normal(size=4)
        quaternion *= np.sign(quaternion[0]) / np.linalg.norm(quaternion)
        pose = np.concatenate([rng.normal(size=3), quaternion])
        back = transforms.pose(transforms.matrix(pose))
        assert np.allclose(back * np.sign([1, 1, 1, *([back[3]] * 4)]), pose)
        assert np.allclose(transforms.matrix(pose) @ transforms.inverse(transforms.matrix(pose)), np.eye(4))


def test_table_items_and_own_links_are_in_the_way(arm: Arm) -> None:
    world = grocery(seed=3)
    arm.collision.update(world.obstacles(), world.gripper_joints())
    assert arm.collision.free(arm.limits.home)
    assert not arm.collision.free(reach(arm, above(0.45, 0.0, 0.79)))  # fingers in the table
    can = world.obstacles()["soda-can"]
    inside = reach(arm, above(can[0] + 0.055, can[1], can[2]))  # one finger in the can
    assert not arm.collision.free(inside)
    arm.collision.update(world.obstacles(), world.gripper_joints(), ignored=["soda-can"])
    assert ("soda-can" in str(arm.collision.touching(inside))) is False
    folded = arm.limits.home.copy()
    folded[2] = 2.9
    assert not arm.collision.free(folded)


def test_held_item_is_part_of_the_robot(arm: Arm) -> None:
    world = grocery(seed=3)
    hanging = np.eye(4)
    hanging[2, 3] = 0.12  # the bottle below the hand
    q = reach(arm, above(0.46, 0.0, 0.98))
    arm.collision.update(world.obstacles(), world.gripper_joints(), ignored=ITEMS)
    assert arm.collision.free(q)
    arm.collision.update(world.obstacles(), world.gripper_joints(), Held("water-bottle", hanging), ITEMS)
    assert not arm.collision.free(q)  # its bottom is in the table
    assert arm.collision.free(arm.limits.home)


def test_motion_avoids_what_is_in_the_way_and_repeats_by_seed(arm: Arm) -> None:
    world = grocery(seed=3)
    arm.collision.update(world.obstacles(), world.gripper_joints())
    start, goal = reach(arm, above(0.5, 0.42, 0.86)), reach(arm, above(0.45, -0.42, 0.86))
    blocked = {item: pose.copy() for item, pose in world.obstacles().items()}
    for item, (x, y) in zip(
        ITEMS, [(0.5, 0.2), (0.4, 0.2), (0.6, 0.2), (0.5, -0.2), (0.4, -0.2), (0.6, -0.2)], strict=True
    ):
        blocked[item][:2] = x, y
    arm.collision.update(blocked, world.gripper_joints())
    assert not arm.planner.edge_free(start, goal)
    first, again, other = (arm.planner.plan(start, [goal], seed) for seed in (5, 5, 6))
    assert first is not None
    assert again is not None
    assert other is not None
    assert first.planner == "RRT*"
    assert np.array_equal(first.configurations, again.configurations)
    assert not np.array_equal(first.configurations, other.configurations)
    assert np.allclose(first.configurations[0], start)
    assert np.allclose(first.configurations[-1], goal)
    for one, next_one in zip(first.configurations, first.configurations[1:], strict=False):
        assert arm.planner.edge_free(one, next_one)


def test_the_trees_that_were_searched_grow_from_both_ends_and_change_nothing(arm: Arm) -> None:
    world = grocery(seed=3)
    blocked = {item: pose.copy() for item, pose in world.obstacles().items()}
    for item, (x, y) in zip(
        ITEMS, [(0.5, 0.2), (0.4, 0.2), (0.6, 0.2), (0.5, -0.2), (0.4, -0.2), (0.6, -0.2)], strict=True
    ):
        blocked[item][:2] = x, y
    arm.collision.update(blocked, world.gripper_joints())
    start, goal = reach(arm, above(0.5, 0.42, 0.86)), reach(arm, above(0.45, -0.42, 0.86))
    bare = arm.planner.plan(start, [goal], seed=5)
    told = arm.planner.plan(start, [goal], seed=5, keep_tree=True)
    assert bare is not None
    assert told is not None
    assert np.array_equal(bare.configurations, told.configurations)
    assert bare.tree is None
    assert told.tree is not None
    assert told.tree.shape[1:] == (2, len(start))
    begins, ends = ([tuple(q) for q in told.tree[:, side]] for side in (0, 1))
    assert tuple(start) in begins
    assert tuple(goal) in ends
    known = Counter([*begins, *ends])
    assert max(known[one] + known[other] for one, other in zip(begins, ends, strict=True)) > 2
    for parent, child in told.tree[:: max(1, len(told.tree) // 20)]:
        assert arm.planner.edge_free(parent, child)


def test_no_motion_into_the_table(arm: Arm) -> None:
    world = grocery(seed=3)
    arm.collision.update(world.obstacles(), world.gripper_joints())
    inside = reach(arm, above(0.45, 0.0, 0.78))
    assert arm.planner.plan(arm.limits.home, [inside], seed=1, iterations=50) is None


@pytest.mark.parametrize("speed", [1.0, 0.4])
@pytest.mark.parametrize("seed", range(4))
def test_trajectories_keep_the_limits_and_rest_at_both_ends(arm: Arm, seed: int, speed: float) -> None:
    limits = arm.limits
    path = limits.home + np.cumsum(np.random.default_rng(seed).normal(0, 0.4, (2 + seed, 6)), axis=0)
    motion = trajectory.timed(path, limits, speed)
    assert np.allclose(motion.position(0.0), path[0], atol=1e-6)
    assert np.allclose(motion.position(motion.seconds), path[-1], atol=1e-6)
    assert np.allclose(motion.velocity(0.0), 0.0, atol=1e-6)
    assert np.allclose(motion.velocity(motion.seconds), 0.0, atol=1e-2)
    times = motion.period * np.arange(len(motion.positions))
    velocity = np.stack([motion.velocity(float(time)) for time in times])
    moved = np.gradient(np.stack([motion.position(float(time)) for time in times]), times, axis=0)
    assert np.allclose(moved[1:-1], velocity[1:-1], atol=0.02 * speed)
    rates = [velocity]
    for limit in (limits.velocity, limits.acceleration, limits.jerk):
        assert (np.abs(rates[-1]) <= speed * limit * (1 + 1e-6)).all()
        rates.append(np.diff(rates[-1], axis=0) / (times[1] - times[0]))
    # Corners are rounded, and no more is cut of them than that.
    along = np.concatenate([np.linspace(one, other, 400) for one, other in pairwise(path)])
    places = motion.samples(0.02)
    assert max(np.linalg.norm(along - place, axis=1).min() for place in places) < 0.05


def test_slow_timing_keeps_the_limits_too(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = arm.limits
    path = limits.home + np.cumsum(np.random.default_rng(1).normal(0, 0.05, (30, 6)), axis=0)
    quick = trajectory.timed(path, limits)
    monkeypatch.setattr(TOPPRA, "compute_trajectory", lambda *_: None)
    motion = trajectory.timed(path, limits)
    assert motion.seconds > quick.seconds
    velocity = np.stack([motion.velocity(float(time)) for time in np.linspace(0.0, motion.seconds, 500)])
    assert (np.abs(velocity) <= limits.velocity).all()
    assert np.allclose(motion.position(motion.seconds), path[-1])


def test_a_path_that_goes_nowhere_takes_no_time(arm: Arm) -> None:
    home = arm.limits.home
    motion = trajectory.timed(np.stack([home, home]), arm.limits)
    assert motion.seconds == 0.0
    assert np.array_equal(motion.position(0.0), home)
