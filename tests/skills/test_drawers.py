"""open and close on the real stack, by contact alone: what they do, and what they say of what goes wrong; taking from a
drawer and putting into one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executive.protocols import Skill, SkillContext
from executive.sim.world import MujocoWorld
from executive.skills.drawers import close, open_
from executive.skills.pick import pick
from executive.skills.place import place
from executive.types import News, Phase, SkillResult, SkillStatus, Step
from tests.executive.sim.test_drawers import LEFT, MIDDLE, RIGHT, kitchen, true

RNG = np.random.default_rng


def do(world: MujocoWorld, skill: Skill, *args: str, on: Callable[[Phase], None] | None = None) -> SkillResult:
    """Run a skill; `on` hears of its phases."""

    def hear(news: News) -> None:
        if on is not None and isinstance(news, Phase):
            on(news)

    return skill(Step("does", args), SkillContext(world.handle, RNG(0), hear, lambda: False))


@pytest.mark.parametrize("drawer", [LEFT, MIDDLE, RIGHT])
def test_a_drawer_is_opened_and_shut_with_what_is_in_it(drawer: str) -> None:
    world = kitchen(items=("can",), placed={"can": drawer})
    stroke = world.drawers.specs[drawer].stroke
    result = do(world, open_, drawer)
    assert (result.status, result.holding) == (SkillStatus.DONE, False), result.reason
    assert world.openings()[drawer] == pytest.approx(stroke, abs=0.012)
    assert true(world, f"in(can,{drawer})", f"open({drawer})") == [True, True]
    result = do(world, close, drawer)
    assert (result.status, result.holding) == (SkillStatus.DONE, False), result.reason
    assert world.openings()[drawer] == pytest.approx(0.0, abs=0.006)
    assert true(world, f"in(can,{drawer})", f"open({drawer})") == [True, False]


def test_an_item_is_taken_from_a_drawer_and_put_into_another_and_onto_a_tray() -> None:
    world = kitchen(
        items=("lemon", "butter"), placed={"lemon": LEFT, "butter": LEFT}, opened={LEFT: True, MIDDLE: True}
    )
    for item, target, atom in (("lemon", MIDDLE, f"in(lemon,{MIDDLE})"), ("butter", "tray", "on(butter,tray)")):
        taken = do(world, pick, item, LEFT)
        assert (taken.status, taken.holding) == (SkillStatus.DONE, True), taken.reason
        assert true(world, f"holding({item})", f"in({item},{LEFT})") == [True, False]
        put = do(world, place, item, target)
        assert put.status is SkillStatus.DONE, put.reason
        assert true(world, atom, f"holding({item})") == [True, False]


def test_what_is_in_a_drawer_or_on_a_tray_is_not_taken_from_the_worktop_under_it() -> None:
    world = kitchen(items=("lemon", "can"), placed={"lemon": LEFT, "can": "tray"}, opened={LEFT: True})
    assert do(world, pick, "lemon", "worktop").status is SkillStatus.NOT_THERE
    assert do(world, pick, "can", "worktop").status is SkillStatus.NOT_THERE
    assert do(world, pick, "can", LEFT).status is SkillStatus.NOT_THERE


@pytest.mark.parametrize(
    ("item", "turn", "share"),
    [
        ("lemon", (0, 0, 90), (-1.0, 0.2)),  # rolled against the front: rolled away from it, the drawer stays open
        pytest.param("can", (0, 90, 0), (-0.4, -1.0), marks=pytest.mark.slow),  # lies along a side wall
        ("butter", (90, 0, 0), (-1.0, -1.0)),  # on its edge in a corner of the front, and higher than the side walls
        pytest.param("salt", (0, 0, 0), (-1.0, -1.0), marks=pytest.mark.slow),  # stands in a corner: it is laid down
    ],
)
def test_what_touches_the_walls_of_a_drawer_is_taken_out(
    item: str, turn: tuple[int, int, int], share: tuple[float, float]
) -> None:
    world = kitchen(items=(item,), placed={item: MIDDLE}, opened={MIDDLE: True})
    pose = world.pose(item)
    turned = Rotation.from_euler("xyz", turn, degrees=True)
    floor, shape, rotation = world.drawers.floors()[MIDDLE], world.shapes[item], turned.as_matrix()
    extent = np.array([shape.reach(rotation.T @ axis) for axis in np.eye(3)])
    centre = np.array(floor.centre) + [*(np.array(share) * (0.5 * np.array(floor.size) - extent[:2] - 1e-3)), extent[2]]
    pose[:3], pose[3:] = centre - rotation @ shape.centre, np.roll(turned.as_quat(), 1)
    world.put(item, pose)
    world.settle(0.3)
    result = do(world, pick, item, MIDDLE)
    assert (result.status, result.holding) == (SkillStatus.DONE, True), result.reason
    assert true(world, f"holding({item})", f"in({item},{MIDDLE})", f"open({MIDDLE})") == [True, False, True]


def test_a_closed_drawer_gives_and_takes_nothing() -> None:
    world = kitchen(items=("lemon", "can"), placed={"lemon": LEFT, "can": "tray"})
    assert do(world, pick, "lemon", LEFT).status is SkillStatus.CLOSED
    assert do(world, pick, "can", "tray").done
    result = do(world, place, "can", LEFT)
    assert (result.status, result.holding) == (SkillStatus.CLOSED, True)


@pytest.mark.parametrize(("skill", "opened"), [(open_, False), (close, True)])
def test_a_drawer_that_is_stuck_is_told_and_let_go_of(skill: Skill, opened: bool) -> None:
    world = kitchen(items=(), opened={LEFT: opened})
    before = world.openings()[LEFT]
    world.disturb("jam", RNG(0), about=LEFT, seconds="15")
    result = do(world, skill, LEFT)
    assert (result.status, result.holding) == (SkillStatus.JAMMED, False), result.reason
    assert world.openings()[LEFT] == pytest.approx(before, abs=0.01)
    world.settle(15.0)
    assert do(world, skill, LEFT).done
    assert true(world, f"open({LEFT})") == [not opened]


def test_a_drawer_that_gets_stuck_on_the_way_is_told_how_far_it_went() -> None:
    world = kitchen(items=())

    def jam(phase: Phase) -> None:
        if phase.name == "pull":
            world.schedule(0.5 * phase.seconds, lambda: world.drawers.jam(MIDDLE, world.time + 5.0))

    result = do(world, open_, MIDDLE, on=jam)
    assert (result.status, result.holding) == (SkillStatus.STOPPED_SHORT, False), result.reason
    assert 0.02 < world.openings()[MIDDLE] < 0.17
    world.settle(5.0)
    assert do(world, open_, MIDDLE).done  # from where it is
    assert world.openings()[MIDDLE] == pytest.approx(world.drawers.specs[MIDDLE].stroke, abs=0.012)


def test_fingers_that_lose_the_handle_are_told() -> None:
    world = kitchen(items=())

    def loosen(phase: Phase) -> None:
        if phase.name == "pull":
            world.schedule(0.4 * phase.seconds, lambda: world.force_open(0.6))

    result = do(world, open_, RIGHT, on=loosen)
    assert (result.status, result.holding) == (SkillStatus.SLIPPED, False), result.reason
    assert world.openings()[RIGHT] < 0.17


def test_a_handle_that_is_missed_is_told_and_the_next_try_gets_it() -> None:
    world = kitchen(items=())
    world.mislead(np.array([0.0, 0.075, 0.0]))
    result = do(world, open_, MIDDLE)
    assert result.status in (SkillStatus.GRASP_MISSED, SkillStatus.UNREACHABLE), result.reason
    assert true(world, f"open({MIDDLE})") == [False]
    assert do(world, open_, MIDDLE).done


def test_what_stands_before_a_drawer_is_put_aside_before_it_is_opened() -> None:
    world = kitchen(items=("can",), placed={"can": "worktop"})
    pose = world.pose("can")
    pose[:2] = [0.48, 0.0]
    world.put("can", pose)
    world.settle(0.3)
    result = do(world, open_, MIDDLE)
    assert result.status is SkillStatus.DONE, result.reason
    assert true(world, f"open({MIDDLE})", "on(can,worktop)") == [True, True]
    assert np.linalg.norm(world.pose("can")[:2] - pose[:2]) > 0.05


def test_the_arm_plans_around_a_drawer_where_it_is_now() -> None:
    from executive.skills.arm import Attempt

    world = kitchen(items=())
    attempt = Attempt(Step("any", ()), SkillContext(world.handle, RNG(0), lambda news: None, lambda: False))
    hand = np.eye(4)
    hand[:3, :3] = np.diag([1.0, -1.0, -1.0])
    hand[:3, 3] = [0.45, 0.0, 0.85]
    q = next(q for seed in attempt.arm.kinematics.seeds(hand, world.joints())
             if (q := attempt.arm.kinematics.solve(hand, seed)) is not None)  # fmt: skip
    attempt.update_collisions()
    assert attempt.arm.collision.free(q)
    world.drawers.slide(MIDDLE, 0.15)
    attempt.update_collisions()
    assert not attempt.arm.collision.free(q)
    assert any(MIDDLE in pair for pair in attempt.arm.collision.touching(q))
    attempt.update_collisions(ignored=[MIDDLE])
    assert attempt.arm.collision.free(q)
