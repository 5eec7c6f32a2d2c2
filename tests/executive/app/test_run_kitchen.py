"""Whole runs in which things are looked for in drawers, and what goes wrong with these is noticed and mended."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive import RunConfig, run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "seed", "fault"),
    [
        (None, 2, "jam@1"),
        (None, 2, "miss@1"),
        (None, 2, "roll:drawer=left-drawer@1"),
        (None, 2, "drop:grasp@2"),
        ("two-items", 1, "shove:item=can,table=right-drawer@1"),  # from a closed drawer into another
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
