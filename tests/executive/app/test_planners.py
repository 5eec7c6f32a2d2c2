"""Which planner a name means, and what a plan from a problem's initial state is planned from."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.app.config import RunConfig
from executive.app.planners import open_planner, plan_problem
from executive.app.run import Run
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.planning import FastDownwardPlanner, UnifiedPlanner
from executive.types import Plan


def test_a_name_means_a_planner() -> None:
    domain = load_domain("grocery", "one-item")
    assert isinstance(open_planner(domain), FastDownwardPlanner)
    other = open_planner(domain, "fast-downward-opt")
    assert isinstance(other, UnifiedPlanner)
    answer = plan_problem(domain, other).answer
    assert isinstance(answer, Plan)
    assert (answer.planner, answer.cost) == ("fast-downward-opt", 2.0)


def test_what_init_leaves_open_is_taken_to_be_somewhere_and_said() -> None:
    domain = load_domain("grocery")
    planned = plan_problem(domain, open_planner(domain))
    assert isinstance(planned.answer, Plan)
    assert {atom.args[0] for atom in planned.assumed} == {atom.args[0] for atom in domain.task.goal.atoms}


def test_a_run_asks_the_planner_of_its_configuration(tmp_path: Path) -> None:
    config = RunConfig("grocery", "one-item", world="symbolic", planner="none-such", runs=tmp_path, viewer=False)
    with pytest.raises(InputError, match="none-such"):
        Run(config)
    assert not list(tmp_path.iterdir())
