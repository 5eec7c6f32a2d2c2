"""Whole runs with three cans that nothing tells apart: what is filmed is followed; of the rest, nothing is claimed."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive import RunConfig, run

SWAP = "swap:item=can-a,with=can-c,seconds=2@2"


def config(folder: Path, *faults: str, film: float = 5.0) -> RunConfig:
    return RunConfig("cans", "one-can", 2, "oracle", faults, poses="depth", film=film, viewer=False, runs=folder)


@pytest.mark.slow
def test_an_exchange_in_view_is_put_right(tmp_path: Path) -> None:
    summary = run(config(tmp_path, SWAP))
    assert summary["goal_seen"]
    assert summary["goal_true"]
    assert summary["replans"] >= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "film"), [((SWAP, "camera:no-depth@2"), 5.0), ((SWAP.replace(",seconds=2", ""),), 0.0)]
)
def test_after_an_exchange_that_nobody_saw_nothing_is_claimed(
    tmp_path: Path, faults: tuple[str, ...], film: float
) -> None:
    summary = run(config(tmp_path, *faults, film=film))
    assert not summary["goal_seen"]
    assert not summary["goal_true"]
