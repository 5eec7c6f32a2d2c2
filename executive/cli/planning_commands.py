"""The commands about PDDL tasks: plan."""

from __future__ import annotations

import json
import sys
import time as clock
from typing import Annotated

import typer

from executive.cli.app import NOT_REACHED, REACHED
from executive.cli.options import DomainName, ProblemFile, ProblemName, chosen_problem
from executive.errors import ExecutiveError, InputError

PlannerName = Annotated[
    str, typer.Option(help="fast-downward, or the name of any planner that unified-planning has here.")
]


def plan(
    domain: DomainName,
    problem_file: ProblemFile = None,
    problem: ProblemName = None,
    planner: PlannerName = "fast-downward",
    optimal: Annotated[bool, typer.Option("--optimal", help="Only a cheapest plan will do.")] = False,
    time: Annotated[float, typer.Option(help="The wall seconds that planning may take.", metavar="SECONDS")] = 30.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the plan as JSON.")] = False,
) -> int:
    """Print a plan from a problem's initial state to its goal, as a plan validator reads it."""
    from executive.app.planners import open_planner, plan_problem
    from executive.domain.loader import load_domain
    from executive.types import Plan

    if not 0.0 < time < 1e6:
        raise InputError(f"seconds above zero, not {time:g}", key="--time")
    began = clock.perf_counter()
    try:
        loaded = load_domain(domain, chosen_problem(problem_file, problem))
        planned = plan_problem(loaded, open_planner(loaded, planner, timeout=time, optimal=optimal))
    except ExecutiveError as error:
        if as_json and error.exit_code == InputError.exit_code:
            print(_as_json("refused", None, None, clock.perf_counter() - began, str(error)))
        raise
    answer = planned.answer
    if isinstance(answer, Plan):
        calls = [f"({' '.join((step.action, *step.args))})" for step in answer.steps]
        if as_json:
            print(_as_json("solved", calls, answer.cost, planned.seconds))
        else:
            for atom in sorted(planned.assumed):
                print(f"; taken to be so at first, as :init leaves it open: {atom}")
            print(*calls, f"; cost = {answer.cost:g}", sep="\n")
        return REACHED
    status = answer.reason.value.replace(" ", "-")
    if as_json:
        print(_as_json(status, None, None, planned.seconds, answer.detail))
    else:
        print(f"no plan: {status}: {answer.detail}", file=sys.stderr)
    return NOT_REACHED


def _as_json(status: str, calls: list[str] | None, cost: float | None, seconds: float, reason: str = "") -> str:
    told = {"status": status, "plan": calls, "cost": cost, "seconds": round(seconds, 3)}
    return json.dumps({**told, "reason": reason} if reason else told, indent=2)
