"""Measurements that are kept are not made again."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.kept import Kept, Row


def never() -> Row:
    raise AssertionError("measured again")


def test_what_was_measured_is_kept_and_not_measured_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    with Kept(path) as kept:
        assert kept.of("seed 1", lambda: {"away": 0.25}) == {"away": 0.25}
        with pytest.raises(KeyboardInterrupt):
            kept.of("seed 2", _stopped)
    path.write_bytes(path.read_bytes() + b'{"of": "seed 2", "ro')  # killed while it wrote
    with Kept(path) as kept:
        assert kept.of("seed 1", never) == {"away": 0.25}
        kept.of("seed 2", lambda: {"away": 0.5})
        assert list(kept.rows) == ["seed 1", "seed 2"]
    with Kept(path) as kept:
        assert kept.of("seed 2", never) == {"away": 0.5}
        assert list(kept.rows) == ["seed 2"]


def test_without_a_file_everything_is_measured() -> None:
    for value in (1, 2):
        with Kept() as kept:
            assert kept.of("seed 1", lambda value=value: {"value": value})["value"] == value  # type: ignore[misc]


def _stopped() -> Row:
    raise KeyboardInterrupt
