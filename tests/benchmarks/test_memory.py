"""What the benchmark of memory makes of what it measured."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import memory
from executive import machine


def test_growth_is_that_of_the_runs_after_the_first_ones() -> None:
    assert memory.growth([100.0, 300.0, 400.0, 400.0, 400.0, 400.0], 2) == pytest.approx(0.0, abs=1e-9)
    assert memory.growth([0.0, 0.0, 10.0, 12.0, 14.0], 2) == pytest.approx(2.0)


def test_it_is_drawn(tmp_path: Path) -> None:
    memory.plot([100.0, 200.0, 210.0, 205.0], 1, 0.1, tmp_path / "memory.png")
    assert (tmp_path / "memory.png").read_bytes().startswith(b"\x89PNG")


def test_memory_that_was_freed_goes_back() -> None:
    """Blocks below the size that the C library maps by itself stay with it until it is told."""
    before = memory.resident()
    blocks = [bytearray(100_000) for _ in range(3000)]
    last = bytearray(100_000)  # at the end of the heap: what lies before it is not given back without being asked
    assert memory.resident() > before + 200
    del blocks
    machine.give_back_memory()
    assert memory.resident() < before + 100
    assert len(last) == 100_000
