"""What the README tells people to type works, and what it points to is there."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.core
import typer.main

from executive import cli
from executive.errors import MissingError
from executive.faults import parse_fault

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def shell_lines() -> Iterator[str]:
    """The commands in the README's shell blocks, without their comments."""
    for block in re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL):
        for line in block.splitlines():
            yield line.split("#")[0].strip()


@pytest.mark.parametrize("line", [line for line in shell_lines() if line.startswith("executive ")])
def test_commands_parse(line: str) -> None:
    """Parsed, with every option and argument, but not carried out."""
    group = typer.main.get_command(cli.app)
    assert isinstance(group, typer.core.TyperGroup)
    arguments = shlex.split(line)[1:]
    with group.make_context("executive", list(arguments), obj=cli.Settings()) as context:
        name, command, rest = group.resolve_command(context, arguments)
        assert command is not None
        command.make_context(name, rest, parent=context)


@pytest.mark.parametrize("document", ["README.md", "runs/README.md"])
def test_links_lead_somewhere(document: str) -> None:
    folder = (ROOT / document).parent
    targets = re.findall(r"\]\(([^)#:]+)\)", (ROOT / document).read_text(encoding="utf-8"))
    assert [target for target in targets if not (folder / target).exists()] == []


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    named = set(re.findall(r"`make ([a-z-]+)`", README))
    named |= {line.split()[1] for line in shell_lines() if line.startswith("make ")}
    assert {"run", "test", "setup"} <= named
    assert named <= targets


@pytest.mark.parametrize("spec", re.findall(r"^\| `([^`]+)` \| ", README, flags=re.MULTILINE))
def test_faults_are_faults(spec: str) -> None:
    parse_fault(spec)


def test_python_finds_what_it_imports() -> None:
    for block in re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL):
        compile(block, "README.md", "exec")
        for line in block.splitlines():
            if line.startswith(("import ", "from ")):
                exec(line, {})


def test_exit_codes_are_those_of_the_command_line() -> None:
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", README, flags=re.MULTILINE)}
    assert listed == {cli.REACHED, cli.NOT_REACHED, cli.BAD_INPUT, MissingError.exit_code, cli.INTERRUPTED}
    assert f"{cli.BUG} is a bug" in README
