"""The command that makes problems."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from executive.cli.app import REACHED
from executive.cli.options import DomainName


def problems(
    domain: DomainName,
    objects: Annotated[str, typer.Option(help="How many objects: a number, or a range to draw it from.")] = "2-10",
    count: Annotated[int, typer.Option(min=1, help="How many problems.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Fixes all of them.")] = 0,
    subset: Annotated[str | None, typer.Option(help="Only objects of one of the subsets in problems.toml.")] = None,
    combinations: Annotated[
        str, typer.Option(help="all, seen (none that is held out of training), or held-out (at least one).")
    ] = "all",
    out: Annotated[Path, typer.Option(help="The folder for their PDDL.")] = Path("problems"),
    as_json: Annotated[bool, typer.Option("--json", help="Print what was made as JSON.")] = False,
) -> int:
    """Make random problems of a domain that has a problems.toml, such as blocksworld."""
    from executive.lab.config import read_combinations, read_range
    from executive.lab.problems import ProblemMaker, write

    maker = ProblemMaker(domain, *read_range(objects), seed, subset, read_combinations(combinations))
    made = list(maker.problems(count))
    files = write(made, out)
    if as_json:
        told = [
            {"name": each.name, "file": str(file), "objects": dict(each.objects)}
            for each, file in zip(made, files, strict=True)
        ]
        print(json.dumps(told, indent=2))
    else:
        print(f"{len(files)} problems in {out}; run one with: executive run {domain} --problem {files[0]}")
    return REACHED
