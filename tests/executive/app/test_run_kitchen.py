"""Whole runs in which things are looked for in drawers, and what goes wrong with these is noticed and mended."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive import RunConfig, run
from executive.app.worlds import make_setting
from executive.domain.loader import load_domain


def test_what_init_leaves_between_some_places_is_in_one_of_these_and_the_robot_is_not_told() -> None:
    found = set()
    for seed in range(4):
        domain = load_domain("kitchen", "two-items")
        stage = make_setting(domain, RunConfig("kitchen", "two-items", seed, "oracle")).open(0)
        true = {str(atom) for atom in stage.truth.of(domain.task.atoms).true}
        stage.world.close()
        assert not stage.placed
        places = []
        for atoms in domain.parsed.oneof:
            (place,) = (str(atom) for atom in atoms if str(atom) in true)
            places.append(place)
        found.add(tuple(places))
    assert len(found) > 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "seed", "fault"),
    [
        (None, 2, "jam@1"),
        (None, 2, "miss@1"),
        (None, 2, "roll:drawer=left-drawer@1"),
        (None, 2, "drop:grasp@2"),
        ("two-items", 3, "shove:item=can,table=right-drawer@1"),  # from a closed drawer into another
    ],
)
def test_the_search_goes_on_whatever_goes_wrong(tmp_path: Path, problem: str | None, seed: int, fault: str) -> None:
    summary = run(RunConfig("kitchen", problem, seed, "oracle", (fault,), viewer=False, runs=tmp_path))
    assert summary["faults"]
    assert (summary["goal_seen"], summary["goal_true"]) == (True, True)


@pytest.mark.slow
def test_things_are_found_by_depth_alone(tmp_path: Path) -> None:
    summary = run(RunConfig("kitchen", None, 2, "oracle", poses="depth", viewer=False, runs=tmp_path))
    assert (summary["goal_seen"], summary["goal_true"]) == (True, True)
