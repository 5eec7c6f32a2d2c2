"""The command that says what a domain has, or why it is refused."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from executive.cli.options import DomainName, ProblemFile, ProblemName, chosen_problem
from executive.errors import DomainError, InputError

if TYPE_CHECKING:
    from executive.app.check import Report


def check(
    domain: DomainName,
    problem_file: ProblemFile = None,
    problem: ProblemName = None,
    time: Annotated[
        float, typer.Option(help="The wall seconds that counting actions may take.", metavar="SECONDS")
    ] = 30.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Read a domain and a problem, and print what they have: atoms, actions, mutex groups; or why they are refused."""
    from executive.app import check as checking

    if not 0.0 < time < 1e6:
        raise InputError(f"seconds above zero, not {time:g}", key="--time")
    try:
        report = checking.check(domain, chosen_problem(problem_file, problem), time)
    except DomainError as error:
        if as_json:
            nothing = dict.fromkeys(("fluents", "statics", "actions", "groups", "seconds"))
            refused = {"accepted": False, "refused_because": error.message, "line": checking.line_of(error)}
            print(json.dumps({**refused, **nothing, "file": str(error.file)}, indent=2))
        raise
    print(json.dumps(_document(report), indent=2) if as_json else _told(report))


def _document(report: Report) -> dict[str, Any]:
    said = asdict(report)
    said["seconds"] = round(report.seconds, 3)
    return {"accepted": True, "refused_because": None, "line": None, **said}


def _told(report: Report) -> str:
    kinds = ", ".join(f"{count} {kind}" for kind, count in report.objects.items())
    actions = "not counted in time" if report.actions is None else f"{report.actions:,}"
    rows = {
        "accepted": f"{report.domain}: {report.problem}",
        "uses": ", ".join(report.features) or "conjunctions of literals",
        "objects": f"{sum(report.objects.values()):,}{f' ({kinds})' if kinds else ''}",
        "fluent atoms": f"{report.fluents:,}",
        "static atoms": f"{report.statics:,}, of which {report.true_statics:,} are true",
        "actions": actions,
        "mutex groups": f"{report.groups:,}",
        **({"unsolvable": report.unreachable} if report.unreachable else {}),
    }
    return "\n".join(f"{name:<14}{value}" for name, value in rows.items())
