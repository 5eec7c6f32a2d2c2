"""How what the doctor finds is told: in a terminal, as JSON, and as Markdown for a bug report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from executive import __version__
from executive.app.doctor import Finding, State, ready


def tell(findings: Iterable[Finding], stream: TextIO) -> list[Finding]:
    """Print each finding as it comes and the verdict at the end, and return the findings."""
    from rich.text import Text

    from executive.trace.terminal.console import console_for

    console, told = console_for(stream), []
    for finding in findings:
        mark, style = _MARKS[finding.state]
        console.print(
            Text(f"{mark} ", style) + Text(f"{finding.part:<9}", "bold") + Text(finding.found), soft_wrap=True
        )
        if finding.command is not None:
            console.print(Text(f"{'':<11}{finding.command}", style), soft_wrap=True)
        told.append(finding)
    limited = sum(finding.state is State.LIMITED for finding in told)
    verdict = Text("a run can start", "green") if ready(told) else Text("no run can start", "bold red")
    if limited:
        verdict.append(f"; {limited} {'part is' if limited == 1 else 'parts are'} limited", "yellow")
    console.print(verdict)
    return told


_MARKS = {
    State.OK: ("\N{CHECK MARK}", "green"),
    State.LIMITED: ("!", "yellow"),
    State.MISSING: ("\N{BALLOT X}", "bold red"),
}


def as_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """Return the findings as a JSON object."""
    return {"executive": __version__, "ready": ready(findings), "findings": [asdict(each) for each in findings]}


def as_markdown(findings: Sequence[Finding]) -> str:
    """Return the findings as a Markdown block for a bug report, without the home folder's name, which is personal."""
    lines = [f"**executive {__version__}**", "", "| part | state | found |", "|---|---|---|"]
    lines += [f"| {each.part} | {each.state} | {_cell(each.found)} |" for each in findings]
    return "\n".join(lines)


def _cell(text: str) -> str:
    home = str(Path.home())
    return (text.replace(home, "~") if len(home) > 1 else text).replace("|", "\\|")
