"""What the benchmark of memory makes of what it measured."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import memory


def test_growth_is_that_of_the_runs_after_the_first_ones() -> None:
    assert memory.growth([100.0, 300.0, 400.0, 400.0, 400.0, 400.0], 2) == pytest.approx(0.0, abs=1e-9)
    assert memory.growth([0.0, 0.0, 10.0, 12.0, 14.0], 2) == pytest.approx(2.0)


def test_it_is_drawn(tmp_path: Path) -> None:
    memory.plot([100.0, 200.0, 210.0, 205.0], 1, 0.1, tmp_path / "memory.png")
    assert (tmp_path / "memory.png").read_bytes().startswith(b"\x89PNG")


FREED = """
from benchmarks import memory
from executive.util import requirements
before = memory.resident()
blocks = [bytearray(100_000) for _ in range(3000)]
last = bytearray(100_000)  # at the end of the heap: what lies before it is not given back without being asked
full = memory.resident()
del blocks
requirements.give_back_memory()
print(full - before, memory.resident() - before)
"""
"""Blocks below the size that the C library maps by itself, which stay with it until it is told."""


@pytest.mark.skipif(sys.platform != "linux", reason="what a process has in use is read from /proc")
def test_memory_that_was_freed_goes_back() -> None:
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True, timeout=60)
    full, after = map(float, done.stdout.split())
    assert full > 200.0
    assert after < 100.0
