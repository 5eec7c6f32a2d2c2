"""The compiled collision check says what MuJoCo's own says, in far less time."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise, product

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from executive.sim.scene import FINGER_JOINTS, JOINTS
from executive.sim.world import MujocoWorld
from executive.skills import collision, convex_hulls
from executive.skills.collision import CollisionModel, Held
from executive.types import FloatArray
from tests.executive.sim.stage import ROOT, grocery


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return grocery(seed=3)


@pytest.fixture(scope="module")
def model(world: MujocoWorld) -> CollisionModel:
    return CollisionModel(world.handle)


def hanging() -> Held:
    in_hand = np.diag([1.0, -1.0, -1.0, 1.0])
    in_hand[2, 3] = 0.03
    return Held("cereal-box", in_hand)


def anywhere(world: MujocoWorld, count: int, seed: int) -> FloatArray:
    limits = world.handle.limits
    return np.random.default_rng(seed).uniform(limits.lower, limits.upper, (count, 6))


@pytest.mark.parametrize("held", [None, hanging()], ids=["empty", "holding"])
def test_it_says_what_mujoco_says_but_for_the_last_millimetres(
    world: MujocoWorld, model: CollisionModel, held: Held | None
) -> None:
    model.update(world.obstacles(), world.gripper_joints(), held)
    configurations = anywhere(world, 1500, seed=1)
    free = np.array([model.free(q) for q in configurations])
    nearest = np.array([model.nearest(q) for q in configurations])
    assert 0.2 < free.mean() < 0.8
    # Hulls simplified inwards: never stricter than the exact ones, and laxer by two simplifications at most.
    assert free[nearest >= collision._CLEARANCE].all()
    assert (nearest[free] > collision._CLEARANCE - 2 * collision._COARSE - 1e-5).all()
    assert np.array_equal(model.all_free(configurations), free)


def test_an_edge_is_free_where_all_its_configurations_are(world: MujocoWorld, model: CollisionModel) -> None:
    model.update(world.obstacles(), world.gripper_joints(), hanging())
    configurations = [q for q in anywhere(world, 600, seed=2) if model.free(q)]
    verdicts = []
    for start, other in pairwise(configurations):
        goal = start + (other - start) * min(1.0, 1.5 / np.linalg.norm(other - start))
        steps = int(np.ceil(np.linalg.norm(goal - start) / collision._EDGE))
        along = start + (goal - start) * np.linspace(0.0, 1.0, steps + 1)[:, None]
        verdicts.append(bool(model.all_free(along).all()))
        assert model.edge_free(start, goal) == verdicts[-1]
        assert model.edge_free(goal, start) == verdicts[-1]
    assert 0.2 < np.mean(verdicts) < 0.98


def test_what_is_held_elsewhere_or_let_go_is_followed(world: MujocoWorld, model: CollisionModel) -> None:
    """One model asked about many situations answers as a fresh one does."""
    configurations = anywhere(world, 300, seed=4)
    lifted = hanging()
    lifted.in_hand[0, 3] = 0.01
    open_fingers = np.zeros(6)
    for held, ignored, fingers in (
        (hanging(), (), world.gripper_joints()),
        (lifted, ("lemon",), world.gripper_joints()),
        (None, (), open_fingers),
        (None, ("cereal-box", "lemon"), world.gripper_joints()),
    ):
        fresh = CollisionModel(world.handle)
        for each in (fresh, model):
            each.update(world.obstacles(), fingers, held, ignored)
        assert np.array_equal(fresh.all_free(configurations), model.all_free(configurations))


def test_bodies_that_are_never_checked_cannot_touch(world: MujocoWorld) -> None:
    exact = world.handle.planning_spec().compile()
    data = mujoco.MjData(exact)
    geoms = {
        exact.body(body).name: [g for g in range(exact.ngeom) if exact.geom_bodyid[g] == body]
        for body in range(exact.nbody)
    }
    turns = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    signs = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    for first, others in collision._APART.items():
        joints = JOINTS[3:5] if first == "forearm_link" else JOINTS[4:]
        for angles in product(turns, turns):
            for name, angle in zip(joints, angles, strict=True):
                data.joint(name).qpos[:] = angle
            closed = 0.8 * float(np.cos(7 * angles[0])) ** 2
            for name, sign in zip(FINGER_JOINTS, signs, strict=True):
                data.joint(name).qpos[:] = sign * closed
            mujoco.mj_kinematics(exact, data)
            for one, other in ((one, other) for body in others for other in geoms[body] for one in geoms[first]):
                away = mujoco.mj_geomDistance(exact, data, one, other, 0.02, None)
                if away <= collision._CLEARANCE:  # it has been seen to say 0 of what is 4 cm apart
                    away = farthest_apart(*(in_world(exact, data, geom) for geom in (one, other)))
                assert away > collision._CLEARANCE, (first, exact.geom(other).name, angles, closed)


def in_world(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> FloatArray:
    """The corners of a geom's hull, (N, 3)."""
    corners: FloatArray = (
        convex_hulls.hull(model, geom, 5e-4) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    )
    return corners


def test_nothing_is_left_to_compile_after_an_installation() -> None:
    program = """
from executive.skills import collision_kernels as sweep
from executive.skills.collision import CollisionModel
from tests.executive.sim.stage import grocery
sweep.ready()
kernels = (sweep.clear, sweep.all_clear, sweep.separation, sweep.arrange)
before = [kernel.signatures for kernel in kernels]
world = grocery(seed=3)
model, home = CollisionModel(world.handle), world.handle.limits.home
model.update(world.obstacles(), world.gripper_joints())
model.free(home), model.edge_free(home, world.joints()), model.all_free(home[None])
assert [kernel.signatures for kernel in kernels] == before, "compiled once more, for other types"
"""
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


points = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed))


@settings(max_examples=40, deadline=None)
@given(points, st.integers(1, 12), st.integers(1, 12), st.floats(0.0, 3.0))
def test_the_distance_of_hulls_is_that_of_their_nearest_points(
    rng: np.random.Generator, first_count: int, second_count: int, away: float
) -> None:
    first = rng.normal(size=(first_count, 3))
    second = rng.normal(size=(second_count, 3)) + away * np.array([1.0, 0.5, -0.3])
    found = convex_hulls.apart(first, second)
    assert found == pytest.approx(farthest_apart(first, second), abs=1e-4)


def farthest_apart(first: FloatArray, second: FloatArray) -> float:
    """The distance of two hulls by least squares over the weights of their corners."""
    weight = 1e4
    ones = [np.concatenate([np.ones(len(first)), np.zeros(len(second))])]
    ones.append(1.0 - ones[0])
    system = np.vstack([np.hstack([first.T, -second.T]), weight * np.array(ones)])
    shares, _ = nnls(system, np.array([0, 0, 0, weight, weight]))
    return float(np.linalg.norm(first.T @ shares[: len(first)] - second.T @ shares[len(first) :]))


@settings(max_examples=20, deadline=None)
@given(points, st.floats(0.01, 0.5))
def test_a_simplified_hull_lies_inside_and_leaves_little_out(rng: np.random.Generator, tolerance: float) -> None:
    cloud = rng.normal(size=(60, 3)) * rng.uniform(0.2, 2.0, 3)
    kept = convex_hulls.reduced(cloud, tolerance)
    assert {tuple(point) for point in kept} <= {tuple(point) for point in cloud}
    for point in cloud:
        assert farthest_apart(point[None], kept) <= tolerance + 1e-3
    centre, radius = convex_hulls.ball(cloud)
    assert (np.linalg.norm(cloud - centre, axis=1) <= radius + 1e-9).all()
