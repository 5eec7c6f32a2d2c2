"""What tests in several folders share, and which tests are quick."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parent.parent
SLOW = (
    "subprocess", "multiprocessing", "mujoco", "rerun", "torch", "transformers", "ray", "matplotlib", "pyarrow",
    "executive.run", "executive.resume", "executive.FastDownwardPlanner", "executive.app", "executive.cli",
    "executive.lab", "executive.replay", "executive.sim", "executive.skills", "executive.trace.viewer",
    "executive.planning.FastDownwardPlanner", "executive.planning.fast_downward", "executive.planning.mutex_groups",
    "executive.s3e.backends", "benchmarks", "skills",
)  # fmt: skip
"""A test file that imports one of these, by itself or by what it shares with others, simulates, draws, asks a model or
a planner, or starts processes. All others are quick: `make quick`."""


QUICK = frozenset({"executive.app.assembly", "executive.app.assembly.make_executive"})
"""What is quick all the same: it puts parts together that were made elsewhere."""

# Laws are not timed: the machine that checks them may be busy. Quick ones are checked with fewer examples.
settings.register_profile("untimed", deadline=None)
settings.register_profile("quick", deadline=None, max_examples=30)


def pytest_configure(config: pytest.Config) -> None:
    settings.load_profile("quick" if config.option.markexpr == "quick" else "untimed")


@cache
def is_quick(file: Path) -> bool:
    """Whether the tests of a file need nothing that is slow, by what it imports."""
    names = _imports(file)
    if any(name == slow or name.startswith(f"{slow}.") for name in names - QUICK for slow in SLOW):
        return False
    shared = {ROOT / f"{name.replace('.', '/')}.py" for name in names if name.startswith(("tests.", "examples."))}
    beside = file.parent / "conftest.py"
    return all(is_quick(each) for each in {*shared, beside} if each.exists() and each not in (file, Path(__file__)))


def _imports(file: Path) -> set[str]:
    names = set[str]()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Bytes are named by their argument: packed ones hold the time, and every worker must collect the same names."""
    return argname if isinstance(val, bytes) else None


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With `-m quick`, do not even import the other files: that alone takes longer than the quick tests."""
    if config.option.markexpr != "quick" or not collection_path.match("test_*.py"):
        return None
    return None if is_quick(collection_path) else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if is_quick(item.path) and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)


@pytest.fixture
def one_thread() -> Iterator[None]:
    """As in the processes that play a campaign; and tiny models are quicker on one thread than on several that wait
    for each other."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
