"""The table of speed says what was measured, and its baselines are what they claim to be."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.speed import queries, trajectory
from benchmarks.speed.collision import FullModel
from benchmarks.speed.table import Row, machine, plot, printed, read_former, side_by_side
from executive.sim.robot_api import ArmLimits
from executive.skills.arm import arm_of
from tests.executive.sim.stage import grocery


def test_a_row_is_printed_with_its_ratio_and_whether_it_is_reached(tmp_path: Path) -> None:
    rows = [
        Row("check", 2.0, 90.0, "us", "40 times", True, "MuJoCo", "one by one"),
        Row("growth", 1.5, None, "", "1", False, "itself", series=((1.0, 2.0), (2.0, 3.0))),
        Row("lost", 0, None, "", "0", None, "itself"),
    ]
    assert [row.ratio for row in rows] == [45.0, None, None]
    head, *lines = printed(rows, machine()).splitlines()
    assert head.split() == ["stage", "ours", "baseline", "ratio", "target", "reached", "against"]
    assert lines[0].split() == ["check", "2", "us", "90", "us", "45", "40", "times", "yes", "MuJoCo"]
    assert " no " in lines[1]
    assert "check: one by one" in lines
    plot(rows, tmp_path / "growth.png")
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")
    json.dumps(machine())


def test_what_a_row_said_before_stands_beside_it(tmp_path: Path) -> None:
    rows = [Row("check", 3.0, 90.0, "us", "40 times", True, "MuJoCo"), Row("new", 1.0, None, "s", "", None, "itself")]
    kept = {"rows": [{"stage": "check", "ours": 2.0, "ratio": 45.0}, {"stage": "gone", "ours": 0, "ratio": None}]}
    (tmp_path / "former.json").write_text(json.dumps(kept))
    head, check, new, *_ = printed(rows, machine(), read_former(tmp_path / "former.json")).splitlines()
    columns = [head.index(name) for name in ("ours", "former", "times", "former ratio", "baseline", "ratio  target")]
    cells = [check[start:end].strip() for start, end in itertools.pairwise(columns)]
    assert cells == ["3 us", "2 us", "1.50", "45", "90 us"]
    assert new.split() == ["new", "1", "s", "itself"]


def test_what_runs_by_turns_is_compared_by_neighbours() -> None:
    calls: list[str] = []
    side_by_side(lambda: calls.append("a"), lambda: calls.append("b"), 3, times=2)
    assert "".join(calls) == "aab" * 3


def test_the_recorded_motions_need_more_than_a_straight_edge() -> None:
    found, asked = queries.read()
    assert len(found) > 100
    assert asked > len(found)
    world = queries.stage()
    arm, limits = arm_of(world.handle), world.handle.limits
    for query in found[::6]:
        query.set_up(arm)
        assert not arm.collision.edge_free(query.start, query.goal)
        assert (query.start >= limits.lower - 0.01).all()
        assert (query.goal <= limits.upper + 0.01).all()


def test_the_full_model_sees_what_the_arm_is_in_and_nothing_else() -> None:
    world = grocery(seed=3)
    full = FullModel(world)
    full.update(world.obstacles(), world.gripper_joints(), None)
    home = world.handle.limits.home
    assert full.free(home), "items that stand on tables touch them, which is none of the arm's business"
    folded = home.copy()
    folded[2] = 2.9
    assert full.deepest(folded) > 0.01
    assert full.edge_free(home, home)
    assert not full.edge_free(home, folded)


@pytest.mark.parametrize("jerk", [40.0, 100.0])
def test_the_reference_is_the_shortest_time_where_that_is_known(jerk: float) -> None:
    """One joint, from rest to rest, never at its speed limit: half of the time it speeds up, half it slows down."""
    one = np.ones(1)
    limits = ArmLimits(-9 * one, 9 * one, 50 * one, 4 * one, jerk * one, 0 * one)
    length, acceleration = 1.0, 4.0
    points = np.linspace([0.0], [length], 21)
    found, without = trajectory.fastest(points, limits)
    assert without == pytest.approx(2 * np.sqrt(length / acceleration), rel=0.01)
    ramp = acceleration / jerk
    shortest = ramp + np.sqrt(ramp**2 + 4 * length / acceleration)
    assert found == pytest.approx(shortest, rel=0.03)
