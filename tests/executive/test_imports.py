"""What importing costs: each check in a fresh interpreter, because this one has loaded everything already."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = {
    "daqp",
    "jinja2",
    "matplotlib",
    "mink",
    "mujoco",
    "numba",
    "ompl",
    "pandas",
    "PIL",
    "pydantic",
    "rerun",
    "rich",
}
HEAVY |= {"robosuite", "scipy", "sklearn", "toppra", "torch", "transformers", "typer", "unified_planning"}
"""What serves one purpose each, and is loaded where that purpose is."""


def loaded_by(statement: str) -> set[str]:
    """The top-level modules that a fresh interpreter has after `statement`."""
    script = f"{statement}\nimport json, sys\nprint(json.dumps(sorted({{name.split('.')[0] for name in sys.modules}})))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0, run.stderr
    return set(json.loads(run.stdout.splitlines()[-1]))


def test_the_package_and_its_values_are_light() -> None:
    modules = loaded_by("import executive, executive.types, executive.protocols, executive.errors")
    assert modules.isdisjoint(HEAVY)


@pytest.mark.parametrize("module", ["core.compare", "core.policy", "belief", "core.loop", "faults"])
def test_the_loop_and_its_parts_are_light(module: str) -> None:
    """They work with any planner, world, estimator and sink, so they load none."""
    assert loaded_by(f"import executive.{module}").isdisjoint(HEAVY)


def test_reading_a_domain_loads_neither_a_planner_nor_a_simulator() -> None:
    modules = loaded_by("import executive.domain")
    assert modules.isdisjoint(HEAVY - {"pydantic"})


def test_the_machine_is_checked_without_importing_what_is_checked() -> None:
    assert loaded_by("from executive.util import requirements; requirements.check()").isdisjoint(HEAVY)


@pytest.mark.parametrize("arguments", ["--help", "--version", "run --help", "run --no-such-option"])
def test_the_command_line_answers_before_anything_heavy_is_loaded(arguments: str) -> None:
    modules = loaded_by(f"from executive.cli import exit_code; exit_code({arguments.split()!r})")
    assert modules.isdisjoint(HEAVY - {"typer", "pydantic", "rich"})


def test_importing_the_trace_loads_no_viewer() -> None:
    assert loaded_by("import executive.trace").isdisjoint(HEAVY)
