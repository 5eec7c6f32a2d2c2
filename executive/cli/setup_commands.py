"""The commands about the installation: shipped domains, a new domain, kinds of faults, and the machine."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from executive.cli.app import REACHED
from executive.errors import InputError, MissingError


def domains(
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON.")] = False,
) -> None:
    """List the domains that come with Executive, and their problems."""
    from executive.domain.loader import list_domains, load_domain

    listed: list[dict[str, Any]] = []
    for name in list_domains():
        domain = load_domain(name)
        default = {"name": domain.task.problem, "command": f"executive run {name}"}
        others = [
            {"name": problem.stem, "command": f"executive run {name} --problem {problem.stem}"}
            for problem in sorted((domain.folder / "problems").glob("*.pddl"))
        ]
        listed.append({"name": name, "description": domain.description or domain.title, "problems": [default, *others]})
    if as_json:
        print(json.dumps(listed, indent=2))
        return
    for entry in listed:
        print(f"{entry['name']}: {entry['description']}")
        for index, problem in enumerate(entry["problems"]):
            print(f"    {problem['command']}" + (f"    # {problem['name']}" if index == 0 else ""))


def new(
    name: Annotated[str, typer.Argument(help="The name of the domain and its folder, such as my-domain.")],
    parent: Annotated[Path, typer.Option("--in", help="Where that folder is made.")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="Print what was made as JSON.")] = False,
) -> None:
    """Make a domain of your own: a folder that runs at once, with every key in it explained."""
    from executive.domain.scaffold import create

    made = create(name, parent)
    if as_json:
        files = [str(file) for file in made.files]
        print(json.dumps({"folder": str(made.folder), "files": files, "commands": made.commands}, indent=2))
        return
    print(f"made {made.folder}, {len(made.files)} files that explain themselves; now try")
    for command in made.commands:
        print(f"    {command}")


def faults(
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON.")] = False,
) -> None:
    """List the faults that can be injected, and their grammar (for: executive run --fault, --faults)."""
    from executive.faults import KINDS

    if as_json:
        listed = [
            {
                "kind": name,
                "example": kind.example,
                "description": kind.description,
                "moment": kind.moment,
                "ways": dict(kind.ways),
                "default": kind.way or None,
                "arguments": dict(kind.keys),
                "lasting": kind.lasting,
            }
            for name, kind in KINDS.items()
        ]
        print(json.dumps(listed, indent=2))
        return
    print("KIND[:ARGUMENT,...]@N (in the N-th action), @N-M or @N-, or KIND:p=0.3 (with this chance in each action)")
    for name, kind in KINDS.items():
        print(f"\n{kind.example:<38} {kind.description}")
        print(f"    {'':<34} {kind.moment}")
        for way, meaning in kind.ways.items():
            written = f"{name}:NAME={way}" if name == "camera" else f"{name}:{way}"
            print(f"    {written:<34} {meaning}{' (if nothing is said)' if way == kind.way else ''}")
        for key, meaning in kind.keys.items():
            print(f"    {f'{key}=':<34} {meaning}")


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print it as a block for a bug report.")] = False,
) -> int:
    """Check what this machine has and lacks, each with the command that mends it."""
    from executive.app import doctor as examination
    from executive.app import doctor_report as report

    if as_json and markdown:
        raise InputError("excludes --json", key="--markdown")
    if as_json or markdown:
        findings = list(examination.examine())
        print(json.dumps(report.as_json(findings), indent=2) if as_json else report.as_markdown(findings))
    else:
        findings = report.tell(examination.examine(), sys.stdout)
    return REACHED if examination.ready(findings) else MissingError.exit_code
