"""Pick and place on the real stack: what they do, and what they say of it when it goes wrong."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from executive.errors import InputError
from executive.protocols import Simulator, Skill, SkillContext
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.skills import grasps, surfaces, transforms
from executive.skills.pick import pick
from executive.skills.place import place
from executive.types import Atom, Facts, Motion, News, Phase, SkillResult, SkillStatus, Step
from tests.contracts import SkillContract
from tests.executive.sim.stage import ITEMS, MEANING, OBJECTS, SCENE, TABLES, grocery


class Robot:
    """A world and the skills on it, with what they announced."""

    def __init__(self, world: MujocoWorld, seed: int = 0) -> None:
        self.world, self.rng = world, np.random.default_rng(seed)
        self.said: list[News] = []
        self.cancelled, self._cancel_in = False, ""
        self.truth = Truth(world, MEANING)

    def pick(self, item: str, table: str) -> SkillResult:
        return pick(Step("pick", (item, table)), self._context())

    def place(self, item: str, table: str) -> SkillResult:
        return place(Step("place", (item, table)), self._context())

    def table_of(self, item: str) -> str:
        return next(t for t in TABLES if self.so(f"on-table({item},{t})"))

    def so(self, atom: str) -> bool:
        return bool(self.truth.of([Atom.parse(atom)]).true)

    def cancel_in(self, phase: str) -> None:
        self.cancelled, self._cancel_in = False, phase

    def go_on(self) -> None:
        """No longer cancelled, and standing still."""
        self.world.settle(0.3)
        assert np.abs(self.world.data.qvel[:6]).max() < 0.02
        self.cancelled, self._cancel_in = False, ""

    def phases(self) -> list[str]:
        return [event.name for event in self.said if isinstance(event, Phase)]

    def _context(self) -> SkillContext:
        return SkillContext(self.world.handle, self.rng, self._hear, lambda: self.cancelled)

    def _hear(self, event: News) -> None:
        self.said.append(event)
        self.cancelled = self.cancelled or (isinstance(event, Phase) and event.name == self._cancel_in)


@cache
def at_first(item: str) -> str:
    """The table on which an item stands in the scene of seed 20."""
    return Robot(grocery(seed=20)).table_of(item)


class _OnTheRobot(SkillContract):
    """The contract of skills, for a loaf of bread in the scene of seed 20."""

    def holds(self, world: Simulator, facts: Facts) -> bool:
        assert isinstance(world, MujocoWorld)
        return Truth(world, MEANING).of(tuple(facts)).entails(facts)


class TestPick(_OnTheRobot):
    def make(self) -> tuple[Skill, Simulator]:
        return pick, grocery(seed=20)

    def possible(self) -> Step:
        source = at_first("bread-loaf")
        return Step.strips("pick", ("bread-loaf", source), Facts(), Facts.parse("robot-gripping(bread-loaf)"))

    def misplaced(self) -> Step:
        elsewhere = other(at_first("bread-loaf"))
        return Step.strips("pick", ("bread-loaf", elsewhere), Facts(), Facts.parse("robot-gripping(bread-loaf)"))


class TestPlace(_OnTheRobot):
    def make(self) -> tuple[Skill, Simulator]:
        world = grocery(seed=20)
        assert Robot(world).pick("bread-loaf", at_first("bread-loaf")).done
        return place, world

    def possible(self) -> Step:
        target = other(at_first("bread-loaf"))
        return Step.strips("place", ("bread-loaf", target), Facts(), Facts.parse(f"on-table(bread-loaf,{target})"))

    def misplaced(self) -> Step:
        target = other(at_first("lemon"))
        return Step.strips("place", ("lemon", target), Facts(), Facts.parse(f"on-table(lemon,{target})"))


def other(table: str) -> str:
    return TABLES[(TABLES.index(table) + 1) % 3]


def test_after_a_grasp_that_missed_another_one_is_tried() -> None:
    """The world is put back in between, so that nothing else tells the second attempt from the first."""
    robot = Robot(grocery(seed=20))
    source, before = robot.table_of("soda-can"), robot.world.snapshot()
    grips: list[np.ndarray] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("executive.skills.arm._EMPTY_WIDTH", 1.0)  # the fingers feel nothing, whatever is between them
        for _ in range(3):
            robot.world.restore(before)
            robot.said.clear()
            assert robot.pick("soda-can", source).status is SkillStatus.GRASP_MISSED
            approach = [event for event in robot.said if isinstance(event, Motion)][1]
            grips.append(approach.configurations[-1])
    assert min(np.abs(one - other).max() for one, other in combinations(grips, 2)) > 0.02
    robot.world.restore(before)
    assert robot.pick("soda-can", source).done


@pytest.mark.parametrize("item", ITEMS)
def test_picks_and_places(item: str) -> None:
    robot = Robot(grocery(seed=20))
    source = robot.table_of(item)
    result = robot.pick(item, source)
    assert result.status is SkillStatus.DONE, result.reason
    assert robot.so(f"robot-gripping({item})")
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() < 0.02
    result = robot.place(item, other(source))
    assert result.status is SkillStatus.DONE, result.reason
    assert robot.so(f"on-table({item},{other(source)})")
    assert robot.so("robot-gripper-empty()")
    assert robot.phases().count("transfer") == 2


def test_same_seed_same_poses() -> None:
    ends = []
    for _ in range(2):
        robot = Robot(grocery(seed=6), seed=9)
        source = robot.table_of("milk-carton")
        robot.pick("milk-carton", source)
        robot.place("milk-carton", other(source))
        ends.append(robot.world.data.qpos.copy())
    assert np.array_equal(*ends)


def test_a_missed_grasp_is_felt() -> None:
    robot = Robot(grocery(seed=20))
    robot.world.disturb("miss", np.random.default_rng(1))
    result = robot.pick("bread-loaf", robot.table_of("bread-loaf"))
    assert result.status is SkillStatus.GRASP_MISSED
    assert not robot.so("robot-gripping(bread-loaf)")


def test_a_drop_is_felt_and_ends_the_skill_early() -> None:
    robot = Robot(grocery(seed=20))
    source = robot.table_of("soda-can")
    assert robot.pick("soda-can", source).done

    def drop() -> None:
        robot.world.disturb("drop", robot.rng)

    def drop_in_transfer(event: News) -> None:
        robot.said.append(event)
        if isinstance(event, Phase) and event.name == "transfer":
            robot.world.schedule(0.4 * event.seconds, drop)

    context = SkillContext(robot.world.handle, robot.rng, drop_in_transfer, lambda: False)
    result = place(Step.strips("place", ("soda-can", other(source))), context)
    assert result.status is SkillStatus.DROPPED
    assert result.planned_seconds > result.seconds + 0.3
    assert not robot.so("robot-gripping(soda-can)")
    assert "lower" not in robot.phases()[robot.phases().index("transfer", 6) :]


def test_cancelled_stops_and_can_be_called_again() -> None:
    robot = Robot(grocery(seed=20))
    source = robot.table_of("cereal-box")
    robot.world.schedule(1.2, lambda: setattr(robot, "cancelled", True))
    result = robot.pick("cereal-box", source)
    assert result.status is SkillStatus.CANCELLED
    robot.world.settle(0.3)
    assert np.abs(robot.world.data.qvel[:6]).max() < 0.02
    robot.cancelled = False
    assert robot.pick("cereal-box", source).done


def test_cancelled_in_any_phase_stops_and_can_go_on() -> None:
    robot = Robot(grocery(seed=20))
    source = robot.table_of("bread-loaf")
    target = other(source)
    before = robot.world.snapshot()
    assert robot.pick("bread-loaf", source).done
    between = robot.world.snapshot()
    for phase in ("plan", "approach", "grip", "lift", "transfer"):
        robot.world.restore(before)
        robot.cancel_in(phase)
        assert robot.pick("bread-loaf", source).status is SkillStatus.CANCELLED, phase
        robot.go_on()
        assert robot.so("robot-gripper-empty()") is (phase in ("plan", "approach")), phase
        if robot.so("robot-gripper-empty()"):
            assert robot.pick("bread-loaf", source).done, phase
        assert robot.place("bread-loaf", target).done, phase
    for phase in ("plan", "transfer", "lower", "release", "retreat", "home"):
        robot.world.restore(between)
        robot.cancel_in(phase)
        assert robot.place("bread-loaf", target).status is SkillStatus.CANCELLED, phase
        robot.go_on()
        if not robot.so("robot-gripper-empty()"):
            assert robot.place("bread-loaf", target).done, phase
        assert robot.so(f"on-table(bread-loaf,{target})"), phase


def test_an_arm_that_is_held_up_says_so_and_pushes_no_further() -> None:
    robot = Robot(grocery(seed=20))
    source = robot.table_of("cereal-box")
    jammed = robot.world.model.joint("shoulder_pan_joint").dofadr[0]
    robot.world.schedule(1.2, lambda: robot.world.model.dof_damping.__setitem__(jammed, 1e6))
    result = robot.pick("cereal-box", source)
    assert result.status is SkillStatus.TIMED_OUT
    assert "in the way" in result.reason
    assert "grip" not in robot.phases()


def test_what_is_too_wide_is_not_tried(tmp_path: Path) -> None:
    text = SCENE.read_text(encoding="utf-8").replace("scale = [0.74, 1.25, 1.05]", "scale = [1.6, 3, 1]")
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    robot = Robot(MujocoWorld(file, {"cereal-box": "item", **dict.fromkeys(TABLES, "table")}))
    result = robot.pick("cereal-box", robot.table_of("cereal-box"))
    assert result.status is SkillStatus.UNREACHABLE
    assert "too wide" in result.reason


@pytest.mark.parametrize(("size", "status"), [(0.06, SkillStatus.DOES_NOT_FIT), (0.078, SkillStatus.DONE)])
def test_what_is_larger_than_a_table_does_not_fit_and_what_is_hardly_smaller_does(
    size: float, status: SkillStatus, tmp_path: Path
) -> None:
    tray = f'[[table]]\nname = "tray"\ncentre = [0.34, 0.0, 0.83]\nsize = [{size}, {size}, 0.03]\nyaw = 0.4\n'
    file = tmp_path / "scene.toml"
    file.write_text(f"{SCENE.read_text(encoding='utf-8')}\n{tray}", encoding="utf-8")
    objects = {"cereal-box": "item", "tray": "table", **dict.fromkeys(TABLES, "table")}
    robot = Robot(MujocoWorld(file, objects, held="cereal-box"))  # 7.4 x 3.8 cm as it is held
    result = robot.place("cereal-box", "tray")
    assert result.status is status, result.reason
    assert robot.so("on-table(cereal-box,tray)") is result.done


def test_a_robot_that_is_turned_finds_its_way(tmp_path: Path) -> None:
    turn = 0.8
    cos, sin = np.cos(turn), np.sin(turn)
    text = SCENE.read_text(encoding="utf-8").replace(
        "position = [0.0, 0.0, 0.92]", f"position = [0, 0, 0.92]\nyaw = {turn}"
    )
    for y in (0.41, 0.0, -0.41):
        place = f"[{cos * 0.46 - sin * y}, {sin * 0.46 + cos * y}, 0.80]\nyaw = {turn}"
        text = text.replace(f"[0.46, {y}, 0.80]", place)
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    robot = Robot(MujocoWorld(file, OBJECTS, seed=4))
    source = robot.table_of("milk-carton")
    assert robot.pick("milk-carton", source).done
    assert robot.place("milk-carton", other(source)).done
    assert robot.so(f"on-table(milk-carton,{other(source)})")


def test_without_home_pose_an_action_ends_where_it_is_done() -> None:
    robot = Robot(grocery(seed=20, home_pose=False))
    source = robot.table_of("milk-carton")
    assert robot.pick("milk-carton", source).done
    assert robot.so("robot-gripping(milk-carton)")
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() > 0.1
    assert robot.place("milk-carton", other(source)).done
    assert robot.so(f"on-table(milk-carton,{other(source)})")


def test_a_full_hand_does_not_pick() -> None:
    robot = Robot(grocery(seed=20))
    assert robot.pick("lemon", robot.table_of("lemon")).done
    result = robot.pick("soda-can", robot.table_of("soda-can"))
    assert not result.done
    assert robot.so("robot-gripping(lemon)")
    # What is in the hand is not what is to be put down. The hand takes it home and stays there.
    result = robot.place("soda-can", other(robot.table_of("soda-can")))
    assert result.status is SkillStatus.NOT_THERE
    assert result.reason == "the gripper does not hold soda-can"
    assert robot.so("robot-gripping(lemon)")
    assert np.abs(robot.world.joints() - robot.world.handle.limits.home).max() < 0.02


@pytest.mark.parametrize("args", [("lemon",), ("lemon", "lemon"), ("wood-table", "lemon"), ("a", "b", "c")])
@pytest.mark.parametrize("skill", [pick, place])
def test_an_action_with_other_parameters_is_the_domains_mistake(skill: Skill, args: tuple[str, ...]) -> None:
    robot = Robot(grocery(seed=20, items=("lemon",)))
    with pytest.raises(
        InputError, match=r"actions\.move: the skill takes an item and a table, a region, .* or another item, not "
    ):
        skill(Step("move", args), robot._context())


def test_grasps_close_across_what_fits_and_reach_down() -> None:
    world = grocery(seed=20)
    rng = np.random.default_rng(0)
    for item, shape in world.shapes.items():
        quaternion = rng.normal(size=4)
        pose = np.concatenate([[0.4, 0.0, 0.9], quaternion / np.linalg.norm(quaternion)])
        for rotation in (transforms.matrix(world.obstacles()[item]), transforms.matrix(pose)):
            for grasp in grasps.candidates(rotation, shape, 0.8):
                assert np.allclose(grasp[:3, :3].T @ grasp[:3, :3], np.eye(3), atol=1e-9)
                assert np.linalg.det(grasp[:3, :3]) == pytest.approx(1.0)
                assert grasp[2, 2] < -0.4  # from above
                assert 2 * shape.reach(rotation[:3, :3].T @ grasp[:3, 0]) < 0.08
                assert grasp[2, 3] >= 0.8


def test_resting_is_the_nearest_way_to_stand() -> None:
    world = grocery(seed=20)
    rng = np.random.default_rng(1)
    for shape in world.shapes.values():
        for _ in range(20):
            quaternion = rng.normal(size=4)
            item = transforms.matrix(np.concatenate([[0, 0, 1], quaternion / np.linalg.norm(quaternion)]))
            rested = surfaces.resting(item, shape)
            assert np.linalg.det(rested) == pytest.approx(1.0)
            flat = np.abs(rested[2])
            if shape.axis is None:
                assert np.max(flat) == pytest.approx(1.0)
            else:
                assert min(abs(flat[shape.axis]), abs(flat[shape.axis] - 1.0)) < 1e-6
