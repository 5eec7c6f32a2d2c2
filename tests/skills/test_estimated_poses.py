"""Skills on poses that are estimated by depth: the simulator tells them nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from executive.app.config import DEPTH, RunConfig
from executive.app.depth_witness import ABSENT, IN_VIEW, DepthWitness
from executive.app.localizer import estimate_poses, item_models, open_localizer
from executive.app.run import Run
from executive.faults import FaultInjector
from executive.perception import Capture, EstimatedScenes, Localizer
from executive.relations.kinds import read_relation_kinds
from executive.sim.known_models import KnownScene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.trace.record.log import read_events
from executive.types import Atom, FaultInjected, Observation, OutcomeKind, PosesEstimated, SkillStatus
from tests.executive.sim.stage import MEANING, TABLES, grocery
from tests.skills.test_skills import Robot


def seeing(seed: int, *items: str, **options: int) -> Robot:
    """A robot that has nothing but its cameras to find items by."""
    world = grocery(seed, items, depth=True, **options)
    world.localizer = open_localizer(world)
    return Robot(world)


def silenced(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Has the simulator refuse to say where anything is, until what is returned is called."""

    def refuse(*_: object) -> NoReturn:
        raise AssertionError("the simulator is asked where something is")

    for name in ("pose", "poses", "gripped", "touched_by"):
        monkeypatch.setattr(MujocoWorld, name, refuse)
    return monkeypatch.undo


def test_an_item_is_taken_and_put_down_by_depth_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = seeing(20, "bread-loaf", "lemon")
    source = robot.table_of("bread-loaf")
    target = next(table for table in TABLES if table != source)
    speak = silenced(monkeypatch)
    picked, placed = robot.pick("bread-loaf", source), robot.place("bread-loaf", target)
    speak()
    assert (picked.status, placed.status) == (SkillStatus.DONE, SkillStatus.DONE)
    assert robot.so(f"on-table(bread-loaf,{target})")
    told = [news for news in robot.said if isinstance(news, PosesEstimated)]
    assert len(told) >= 3
    assert any(news.poses["bread-loaf"].source == "held" for news in told)
    assert told[-1].poses["bread-loaf"].source == "seen"
    assert np.linalg.norm(told[-1].poses["bread-loaf"].pose[:3] - robot.world.pose("bread-loaf")[:3]) < 0.01


def test_what_is_seen_nowhere_is_not_there() -> None:
    robot = seeing(20, "bread-loaf", "lemon")
    source = robot.table_of("lemon")
    robot.world.put("lemon", np.array([0.0, 0.0, 30.0, 1.0, 0.0, 0.0, 0.0]))
    assert robot.pick("lemon", source).status is SkillStatus.NOT_THERE


def test_who_misses_looks_again() -> None:
    robot = seeing(20, "lemon")
    robot.world.disturb("miss", np.random.default_rng(0))
    assert robot.pick("lemon", robot.table_of("lemon")).status is SkillStatus.DONE
    assert robot.phases().count("grip") == 2
    assert robot.so("robot-gripping(lemon)")


def test_what_is_unknown_is_in_the_way() -> None:
    robot = seeing(20, "lemon", blockings=1)
    table = next(table for table in TABLES if table != robot.table_of("lemon"))
    before = robot.world.obstacles()
    robot.world.disturb("block", np.random.default_rng(0), table=table)
    robot.world.settle(0.5)
    now = robot.world.obstacles()
    assert set(before) == {"lemon"}
    boxes = [now[name] for name in now if name in robot.world.handle.unknown]
    middle = np.array(next(each.centre for each in robot.world.spec.tables if each.name == table))
    assert boxes
    for box in boxes:
        assert np.abs(box[:2] - middle[:2]).max() < 0.3
    for name in robot.world.boxes:
        there = robot.world.pose(name)[:3]
        if abs(there[2] - middle[2]) < 0.3:
            assert min(np.abs(box[:3] - there).max() for box in boxes) < 0.08, f"{name} stands free"


@pytest.mark.parametrize("estimator", ["oracle", pytest.param("vlm", marks=pytest.mark.slow)])
def test_a_whole_run_by_depth_alone(estimator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a model that looks, truth is told for the score alone; the oracle is asked for atoms and nothing else."""
    config = RunConfig(
        "grocery", "one-item", estimator=estimator, poses=DEPTH, runs=tmp_path, viewer=False,
        faults=("camera:black=no-depth@1-", "camera:wood=moved@0-"),
    )  # fmt: skip
    with Run(config) as prepared:
        speak = silenced(monkeypatch)
        if estimator == "vlm":
            monkeypatch.setattr(type(prepared.truth), "of", MujocoWorld.pose)
        prepared.executive.run()
        speak()
        goal = prepared.domain.task.goal
        assert goal.truth(prepared.truth.of(prepared.domain.task.atoms)) is True
        folder = prepared.folder
    payloads = [event.payload for event in read_events(folder)]
    assert payloads[-1].outcome is OutcomeKind.GOAL_REACHED  # type: ignore[union-attr]
    told = [payload for payload in payloads if isinstance(payload, PosesEstimated)]
    assert told
    assert all("wood" in news.left_out for news in told)
    assert {fault.detail for fault in payloads if isinstance(fault, FaultInjected)} == {
        "black: no-depth",
        "wood: moved",
    }
    first, *_, last = [payload for payload in payloads if isinstance(payload, Observation)]
    assert "black" in first.depth
    assert "black" not in last.depth


def test_depth_tells_of_atoms_as_the_truth_has_them() -> None:
    """A second witness: relations on the estimated scene; of what is hidden and only remembered it tells nothing."""
    world = grocery(21, ("bread-loaf", "lemon", "soda-can"), depth=True)
    scenes, _ = estimate_poses(world, FaultInjector([], world, 0))
    witness = DepthWitness(world, scenes, read_relation_kinds(MEANING, {}))
    atoms = [
        *(Atom("on-table", (item, table)) for item in world.items for table in TABLES),
        Atom("robot-gripper-empty"),
    ]
    truth = Truth(world, MEANING)
    told = witness.testify(world.sense(), atoms).probability
    assert {atom: round(value) for atom, value in told.items()} == dict(truth.of(atoms))
    world.put("lemon", np.array([0.0, 0.0, 30.0, 1.0, 0.0, 0.0, 0.0]))
    world.settle(0.1)
    told = witness.testify(world.sense(), atoms).probability
    assert {told[atom] for atom in atoms if "lemon" in atom.args} <= {ABSENT, IN_VIEW}
    world.localizer = None
    assert witness.testify(world.sense(), atoms).probability == {}


def behind_the_box(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """A robot with one depth camera left, which the cereal box hides the lemon from."""
    robot = seeing(20, "cereal-box", "lemon", "soda-can")
    robot.world.put("cereal-box", np.array([0.54, 0.0, 0.91, 0.5**0.5, 0.0, 0.0, 0.5**0.5]))
    robot.world.put("lemon", np.array([0.42, 0.0, 0.83, 1.0, 0.0, 0.0, 0.0]))
    robot.world.put("soda-can", np.array([0.45, -0.40, 0.86, 1.0, 0.0, 0.0, 0.0]))
    robot.world.settle(1.0)
    localizer = robot.world.localizer
    assert isinstance(localizer, Localizer)
    sense = localizer.capture

    def one_eyed() -> Capture:
        sensed = sense()
        return replace(sensed, depth={name: depth for name, depth in sensed.depth.items() if name == "front"})

    monkeypatch.setattr(localizer, "capture", one_eyed)
    return robot


def test_what_is_seen_nowhere_is_rather_where_something_may_hide_it(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = behind_the_box(monkeypatch)
    world = robot.world
    assert isinstance(world.localizer, Localizer)
    models = item_models(world.spec)
    witness = DepthWitness(world, EstimatedScenes(models, KnownScene(world.spec)), read_relation_kinds(MEANING, {}))
    atoms = {table: Atom("on-table", ("lemon", table)) for table in TABLES}
    assert set(witness.told([*atoms.values()]).values()) == {ABSENT}  # with one eye, much is out of sight
    monkeypatch.undo()
    world.put("lemon", np.array([0.0, 0.0, 30.0, 1.0, 0.0, 0.0, 0.0]))
    world.settle(0.1)
    told = witness.told([*atoms.values()])
    assert told[atoms["black-table"]] == ABSENT  # behind the box
    assert told[atoms["wood-table"]] == IN_VIEW


def test_what_hides_an_item_but_for_two_slivers_is_moved_first() -> None:
    robot = seeing(46, "cereal-box", "soda-can")
    robot.world.put("cereal-box", np.array([0.51, 0.007, 0.879, 1.0, 0.0, 0.0, 0.0]))
    robot.world.put("soda-can", np.array([0.443, 0.009, 0.846, 0.12, 0.0, 0.0, 0.993]))
    robot.world.settle(0.2)
    localizer = robot.world.localizer
    assert isinstance(localizer, Localizer)
    assert localizer.now().missing == ("soda-can",)
    assert localizer.now().lumps
    result = robot.pick("soda-can", "black-table")
    assert result.status is SkillStatus.DONE
    assert robot.so("robot-gripping(soda-can)")


def test_what_hides_an_item_is_moved_first(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = behind_the_box(monkeypatch)
    assert robot.world.locate("lemon") is None
    assert robot.world.hiders("lemon", np.array([[0.42, 0.0, 0.80]])) == ("cereal-box",)
    before = robot.world.pose("cereal-box")
    result = robot.pick("lemon", "black-table")
    assert result.status is SkillStatus.DONE
    assert robot.so("robot-gripping(lemon)")
    assert np.linalg.norm(robot.world.pose("cereal-box")[:2] - before[:2]) > 0.03
    assert robot.so("on-table(cereal-box,black-table)")
