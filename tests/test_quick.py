"""Which tests `make quick` runs follows from what their files import; the rule keeps up with the tree."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.conftest import SLOW, is_quick

TESTS = Path(__file__).parent


@pytest.mark.parametrize("name", [name for name in SLOW if name.startswith(("executive.", "benchmarks"))])
def test_what_is_slow_is_there(name: str) -> None:
    parent, _, last = name.rpartition(".")
    public = getattr(import_module(parent), "__all__", ()) if parent else ()
    assert last in public or find_spec(name) is not None


def test_decisions_are_quick_and_what_simulates_is_not(tmp_path: Path) -> None:
    assert is_quick(TESTS / "executive" / "core" / "test_policy.py")
    assert not is_quick(TESTS / "executive" / "sim" / "test_world.py")
    for number, line in enumerate(("import mujoco.viewer", "from executive import run", "def f():\n    import torch")):
        file = tmp_path / f"test_{number}.py"
        file.write_text(f"{line}\n")
        assert not is_quick(file)
