"""The behaviour trees of a run's plans, and of a domain's problem."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from executive.app.planners import open_planner, plan_problem
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.export.behaviour_trees import Node, monitored_tree
from executive.trace.record.recording import Recording
from executive.types import Facts, NoPlan, Plan

_PATIENCE = {"max_retries": 2, "precondition_wait": 2, "max_looks_again": 3}
"""The settings of a run that its trees have, and what they were in a record that does not tell."""

Named = tuple[Node, Mapping[str, tuple[str, ...]]]
"""A tree, and the names of its actions' parameters where they are known."""


def tree_of_run(run: Path | str, number: int = 1) -> Named:
    """A plan of a run, the first or a later one, as a behaviour tree with that run's patience.

    Raises:
        InputError: the run has no such plan.
    """
    recording = Recording(Path(run))
    plans = [event.payload for event in recording.events if isinstance(event.payload, Plan)]
    if not 1 <= number <= len(plans):
        raise InputError(f"has plans 1 to {len(plans)}, and no plan {number}", file=recording.folder)
    started = recording.started
    retries, waits, looks_again = (int(started.settings.get(key, usual)) for key, usual in _PATIENCE.items())
    tree = monitored_tree(
        plans[number - 1].steps, started.task.goal, retries=retries, waits=waits, looks_again=looks_again
    )
    return tree, {}


def tree_of_problem(domain: str, problem: str | None = None) -> Named | NoPlan:
    """A plan from a problem's initial state to its goal as a behaviour tree; the reason, where there is none.

    Raises:
        DomainError: the domain has a mistake, or there is none.
    """
    loaded = load_domain(domain, problem)
    planned = plan_problem(loaded, open_planner(loaded))
    if isinstance(planned.answer, NoPlan):
        return planned.answer
    task = loaded.task
    state = Facts.closed(task.declared | planned.assumed, task.atoms)
    names = {
        name: tuple(variable.removeprefix("?") for variable, _ in action.parameters)
        for name, action in loaded.parsed.actions.items()
    }
    return monitored_tree(planned.answer.steps, task.goal, state), names
