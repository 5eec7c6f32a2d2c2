"""Asks an engine of unified-planning: a program of its own, so that an engine can be ended and its import waits for
nobody (`executive.planning.unified_planning` starts it).

    python -P engine_process.py ENGINE SECONDS

reads domain.pddl and problem.pddl in the current directory and writes answer.json, with as much of this as it finds
out: `installed` (the planners that there are), `known` (whether unified-planning knows the engine at all), `lacking`
(the problem's features that it does not take), `status`, `plan` (each action with its arguments) and `said`. With no
SECONDS, the problem is held against the engine and not solved.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def main(name: str, seconds: float | None) -> dict[str, Any]:
    """Ask the engine, or find out why not to."""
    from unified_planning.engines.factory import DEFAULT_ENGINES
    from unified_planning.environment import get_environment
    from unified_planning.io import PDDLReader
    from unified_planning.plans import PlanKind

    environment = get_environment()
    environment.credits_stream = None
    factory = environment.factory
    engines = [each for each in factory.engines if "[" not in each]  # others ask one of these
    planners = sorted(each for each in engines if factory.engine(each).is_oneshot_planner())
    answer: dict[str, Any] = {"installed": planners, "known": name in DEFAULT_ENGINES.keys() - engines}
    if name not in planners:
        return answer
    problem = PDDLReader(environment).parse_problem("domain.pddl", "problem.pddl")
    engine = factory.engine(name)
    if not engine.supports(problem.kind):
        return {**answer, "lacking": sorted(problem.kind.features - engine.supported_kind().features)}
    if seconds is None:
        return answer
    with factory.OneshotPlanner(name=name) as planner:
        result = planner.solve(problem, timeout=seconds)
    said = [message.message.strip() for message in result.log_messages or ()]
    answer |= {"status": result.status.name, "said": "\n".join(said)}
    if result.plan is not None:
        plan = result.plan.convert_to(PlanKind.SEQUENTIAL_PLAN, problem)
        answer["plan"] = [[step.action.name, *map(str, step.actual_parameters)] for step in plan.actions]
    return answer


if __name__ == "__main__":
    found = main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else None)
    Path("answer.json").write_text(json.dumps(found), encoding="utf-8")
